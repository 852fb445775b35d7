"""Demonstrations as a data set of another library: it reads what was measured, and can do it again."""

import os
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import toy

from lfd_gym import cli
from lfd_gym.demonstration import Demonstration, save_demonstrations
from lfd_gym.errors import DemonstrationError, InvalidArgumentError, MissingExtraError
from lfd_gym.export.minari import ROOT, to_minari
from lfd_gym.recording import record
from scripted_teachers.move_object import MoveObjectTeacher

minari = pytest.importorskip("minari", reason="needs the extra 'data'")
ID = "point/noisy-v3"


@pytest.fixture(scope="module")
def shown() -> list[Demonstration]:
    return record(toy.ENV_ID, toy.PointTeacher(), n=2, seed=0, env_kwargs={"speed": 2.0}).demonstrations


def test_minari_reads_what_was_measured_and_makes_the_environment(shown, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.delenv(ROOT, raising=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        assert to_minari(shown, tmp_path / "sets", ID) == tmp_path / "sets" / ID
    assert ROOT not in os.environ
    monkeypatch.setenv(ROOT, str(tmp_path / "sets"))
    read = minari.load_dataset(ID)
    assert read.total_episodes == 2
    for episode, demonstration in zip(read, shown, strict=True):
        assert set(episode.observations) == set(demonstration.observations)
        for name, rows in demonstration.observations.items():
            np.testing.assert_array_equal(episode.observations[name], rows)
        np.testing.assert_array_equal(episode.actions, demonstration.actions)
        np.testing.assert_array_equal(episode.rewards, demonstration.rewards)
        np.testing.assert_array_equal(episode.infos["label"][1:], demonstration.labels)
        np.testing.assert_array_equal(episode.infos["state"], demonstration.states)
        assert episode.terminations.tolist() == [False] * (len(demonstration) - 1) + [True]
        assert not episode.truncations.any()
    env = read.recover_environment()
    (facts,) = read.storage.get_episode_metadata([1])
    observation, _ = env.reset(seed=facts["seed"])
    for action in shown[1].actions:
        observation, *_ = env.step(action)
    for name, value in observation.items():
        np.testing.assert_array_equal(value, shown[1].observations[name][-1])


def test_an_episode_that_success_did_not_end_is_truncated(tmp_path: Path, monkeypatch) -> None:
    arguments = {"terminate_on_success": False}
    shown = record("move-object", MoveObjectTeacher(noise=0.0), n=1, seed=0, env_kwargs=arguments).demonstrations
    to_minari(shown, tmp_path, "object-v0")
    monkeypatch.setenv(ROOT, str(tmp_path))
    (episode,) = minari.load_dataset("object-v0")
    assert shown[0].success
    assert not episode.terminations.any()
    assert episode.truncations.tolist() == [False] * (len(shown[0]) - 1) + [True]


def test_seed_and_options_make_the_setup_that_was_shown_twice(tmp_path: Path, monkeypatch) -> None:
    shown = record("move-object", MoveObjectTeacher(noise=0.0), n=2, seed=77, repeat=2).demonstrations
    assert shown[0].setup == shown[1].setup
    to_minari(shown, tmp_path, ID)
    monkeypatch.setenv(ROOT, str(tmp_path))
    read = minari.load_dataset(ID)
    env = read.recover_environment()
    for facts, demonstration in zip(read.storage.get_episode_metadata([0, 1]), shown, strict=True):
        env.reset(seed=facts["seed"], options=facts["options"])
        np.testing.assert_array_equal(env.unwrapped.get_state(), demonstration.states[0])


def test_an_episode_whose_seed_is_not_known_has_none(shown, tmp_path: Path, monkeypatch) -> None:
    to_minari([replace(shown[0], seed={}, teacher={}), shown[1]], tmp_path, ID)
    monkeypatch.setenv(ROOT, str(tmp_path))
    facts = list(minari.load_dataset(ID).storage.get_episode_metadata([0, 1]))
    assert [one.get("seed") for one in facts] == [None, shown[1].seed["reset"]]


def test_what_cannot_be_exported_is_refused_and_leaves_nothing(shown, tmp_path: Path, monkeypatch) -> None:
    for dataset_id in ("point", "a/b/c-v0", "../point-v0", ""):
        with pytest.raises(InvalidArgumentError, match="no id of a data set"):
            to_minari(shown, tmp_path / "sets", dataset_id)
    other = record(toy.ENV_ID, toy.PointTeacher(), n=1, seed=1).demonstrations
    with pytest.raises(DemonstrationError, match="several arguments"):
        to_minari([*shown, *other], tmp_path / "sets", ID)
    position, actions = shown[1].observations["position"], shown[1].actions
    for change, message in [
        ({"observations": {"position": position}}, "observes other quantities"),
        (
            {"observations": {**shown[1].observations, "position": np.hstack([position] * 2)}},
            "observes other quantities",
        ),
        ({"observations": {**shown[1].observations, "position": np.nan * position}}, "'position' of demonstration 1"),
        ({"actions": np.hstack([actions] * 2)}, "actions of demonstration 1 have another size"),
        ({"actions": np.nan * actions}, "actions of demonstration 1 are not finite"),
    ]:
        with pytest.raises(DemonstrationError, match=message):
            to_minari([shown[0], replace(shown[1], **change)], tmp_path / "sets", ID)
    with pytest.raises(InvalidArgumentError, match="cannot write '/proc/sets/"):
        to_minari(shown, "/proc/sets", ID)

    def broken(*arguments, **further):
        raise KeyboardInterrupt

    monkeypatch.setattr(minari, "create_dataset_from_buffers", broken)
    with pytest.raises(KeyboardInterrupt):
        to_minari(shown, tmp_path / "sets", ID)
    assert [path for path in (tmp_path / "sets").rglob("*") if path.name != "point"] == []
    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(MissingExtraError, match=r"lfd-gym\[data\]"):
        to_minari(shown, tmp_path / "sets", ID)


def test_the_command_names_the_data_set_after_task_and_file(shown, tmp_path: Path, monkeypatch, capsys) -> None:
    file = tmp_path / "noisy.h5"
    save_demonstrations(file, shown)
    monkeypatch.chdir(tmp_path)
    assert cli.main(["export", str(file), "--out", "here"]) == 0
    assert (tmp_path / "here" / "point" / "noisy-v0" / "data").is_dir()
    assert "minari.load_dataset('point/noisy-v0')" in capsys.readouterr().out
    assert cli.main(["export", str(file), "--out", str(tmp_path / "sets")]) == 0
    assert "minari.load_dataset('point/noisy-v0')" in capsys.readouterr().out
    assert cli.main(["export", str(file), "--out", str(tmp_path / "sets")]) == 2
    assert "already" in capsys.readouterr().err
    assert cli.main(["export", str(file), "--to", "csv", "--out", str(tmp_path / "sets")]) == 2
    assert "possible: minari, lerobot" in capsys.readouterr().err
