"""Demonstrations as a data set of LeRobot: what lies in its files is what was measured, and they say where it is."""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import toy

from lfd_gym import cli
from lfd_gym.demonstration import Demonstration, save_demonstrations
from lfd_gym.errors import DemonstrationError, InvalidArgumentError, MissingExtraError
from lfd_gym.export import lerobot
from lfd_gym.export.lerobot import to_lerobot
from lfd_gym.recording import record

pandas = pytest.importorskip("pandas", reason="needs the extra 'data'")
parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra 'data'")
ID = "point/noisy"
FIRST = Path("chunk-000", "file-000.parquet")


@pytest.fixture(scope="module")
def shown() -> list[Demonstration]:
    """Two demonstrations with an arm of several joints and an action with a hand."""
    rng = np.random.default_rng(0)

    def richer(demonstration: Demonstration) -> Demonstration:
        n = len(demonstration)
        observations = {**demonstration.observations, "joint_position": rng.normal(size=(n + 1, 3))}
        labels = np.where(np.arange(n) < 2, -1, 0)
        actions = rng.uniform(-1.0, 1.0, size=(n, 13))
        return replace(demonstration, observations=observations, labels=labels, actions=actions)

    return [richer(d) for d in record(toy.ENV_ID, toy.PointTeacher(), n=2, seed=0).demonstrations]


@pytest.fixture(scope="module")
def folder(shown: list[Demonstration], tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("sets")
    assert to_lerobot(shown, root, ID) == root / ID
    return root / ID


def test_rows_are_what_was_measured_before_each_action(shown, folder: Path) -> None:
    rows = parquet.read_table(folder / "data" / FIRST).to_pandas()
    for i, demonstration in enumerate(shown):
        own, n = rows[rows.episode_index == i], len(demonstration)
        assert own.frame_index.tolist() == list(range(n))
        state = np.hstack([demonstration.observations[name] for name in ("joint_position", "position")])[:n]
        np.testing.assert_array_equal(np.stack(own["observation.state"]), state.astype(np.float32))
        target = demonstration.observations["frame_target"][:n, 0]
        np.testing.assert_array_equal(own["observation.environment_state"], target.astype(np.float32))
        np.testing.assert_array_equal(np.stack(own["action"]), demonstration.actions)
        np.testing.assert_array_equal(own["next.reward"], demonstration.rewards.astype(np.float32))
        assert own["next.done"].tolist() == own["next.success"].tolist() == [False] * (n - 1) + [True]
        np.testing.assert_allclose(own.timestamp, np.arange(n) * demonstration.dt, rtol=1e-6)
    assert rows["index"].tolist() == list(range(sum(map(len, shown))))


def test_labels_are_subtasks_with_the_names_of_the_primitives(shown, folder: Path) -> None:
    subtasks = pandas.read_parquet(folder / "meta" / "subtasks.parquet")
    rows = parquet.read_table(folder / "data" / FIRST).to_pandas()
    names = [subtasks.iloc[i].name for i in rows.subtask_index]
    assert names == [("none", "reach")[label + 1] for demonstration in shown for label in demonstration.labels]
    tasks = pandas.read_parquet(folder / "meta" / "tasks.parquet")
    assert tasks.task_index.to_dict() == {"point": 0}


def test_the_index_says_where_episodes_are_and_how_values_spread(shown, folder: Path) -> None:
    episodes = parquet.read_table(folder / "meta" / "episodes" / FIRST).to_pylist()
    lengths = [len(demonstration) for demonstration in shown]
    assert [(e["dataset_from_index"], e["dataset_to_index"]) for e in episodes] == [
        (0, lengths[0]),
        (lengths[0], sum(lengths)),
    ]
    info = json.loads((folder / "meta" / "info.json").read_text())
    assert (info["total_episodes"], info["total_frames"], info["fps"]) == (2, sum(lengths), 10)
    assert (folder / info["data_path"].format(chunk_index=0, file_index=0)).exists()
    assert info["features"]["action"]["names"][8:] == ["force.2", "hand.0", "hand.1", "hand.2", "hand.3"]
    assert info["features"]["observation.state"] == {
        "dtype": "float32",
        "shape": [4],
        "names": ["joint_position.0", "joint_position.1", "joint_position.2", "position.0"],
    }
    columns = parquet.read_schema(folder / "data" / FIRST)
    assert set(columns.names) == set(info["features"])
    for name, feature in info["features"].items():
        kind = columns.field(name).type
        assert [kind.list_size] == feature["shape"] if hasattr(kind, "list_size") else feature["shape"] == [1]
    statistics = json.loads((folder / "meta" / "stats.json").read_text())["action"]
    actions = np.concatenate([demonstration.actions for demonstration in shown]).astype(float)
    np.testing.assert_allclose(statistics["mean"], actions.mean(axis=0), rtol=1e-12)
    np.testing.assert_allclose(statistics["q90"], np.quantile(actions, 0.9, axis=0), rtol=1e-12)
    np.testing.assert_allclose(episodes[1]["stats/action/std"], shown[1].actions.astype(float).std(axis=0), rtol=1e-12)


def test_a_demonstration_that_failed_ends_without_success(shown, tmp_path: Path) -> None:
    to_lerobot([replace(shown[0], success=False), shown[1]], tmp_path, ID)
    rows, n = parquet.read_table(tmp_path / ID / "data" / FIRST).to_pandas(), len(shown[0])
    assert rows["next.done"][:n].tolist() == [False] * (n - 1) + [True]
    assert not rows["next.success"][:n].any()
    assert rows["next.success"][n:].sum() == 1


def test_what_cannot_be_exported_is_refused_and_leaves_nothing(shown, tmp_path: Path, monkeypatch) -> None:
    for repo_id in ("point", "a/b/c", "../point", ""):
        with pytest.raises(InvalidArgumentError, match="no id of a data set"):
            to_lerobot(shown, tmp_path, repo_id)
    with pytest.raises(InvalidArgumentError, match=r"0\.03 s is no fraction"):
        to_lerobot([replace(d, dt=0.03) for d in shown], tmp_path, ID)
    renamed = replace(shown[1], primitives=(shown[1].primitives[0]._replace(name="push"),))
    with pytest.raises(DemonstrationError, match="tables of primitives"):
        to_lerobot([shown[0], renamed], tmp_path, ID)
    with pytest.raises(DemonstrationError, match="actions of demonstration 1 are not finite"):
        to_lerobot([shown[0], replace(shown[1], actions=np.nan * shown[1].actions)], tmp_path, ID)
    with pytest.raises(InvalidArgumentError, match="cannot write '/proc/sets/"):
        to_lerobot(shown, "/proc/sets", ID)

    def broken(*arguments: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(lerobot, "_info", broken)
    with pytest.raises(KeyboardInterrupt):
        to_lerobot(shown, tmp_path / "sets", ID)
    assert [path for path in (tmp_path / "sets").rglob("*") if path.name != "point"] == []
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(MissingExtraError, match=r"lfd-gym\[data\]"):
        to_lerobot(shown, tmp_path / "sets", ID)


def test_the_command_says_how_the_data_set_is_read(shown, tmp_path: Path, capsys) -> None:
    file = tmp_path / "noisy.h5"
    save_demonstrations(file, shown)
    export = ["export", str(file), "--to", "lerobot", "--out", str(tmp_path / "sets")]
    assert cli.main(export) == 0
    assert f"LeRobotDataset('point/noisy', root='{tmp_path}/sets/point/noisy')" in capsys.readouterr().out
    assert cli.main(export) == 2
    assert "already" in capsys.readouterr().err
