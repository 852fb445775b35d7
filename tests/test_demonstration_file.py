"""Demonstrations survive the disk unchanged, and every broken file is refused in one line."""

import dataclasses
import json
import pickle
from pathlib import Path

import h5py
import numpy as np
import pytest

from lfd_gym.demonstration import (
    Demonstration,
    EntityControl,
    Primitive,
    load_demonstrations,
    save_demonstrations,
    taught_seeds,
)
from lfd_gym.errors import DemonstrationError


def make_demonstration(seed: int = 0, n_steps: int = 12) -> Demonstration:
    rng = np.random.default_rng(seed)
    position = EntityControl(0, "box", "cylindrical", ("position", "force", "hold"))
    orientation = EntityControl(1, "world", "rotation", ("position",) * 3)
    hand = EntityControl(2, "world", "joints", ("hold",) * 4)
    return Demonstration(
        observations={
            "tool_position": rng.normal(size=(n_steps + 1, 3)),
            "frame_box": rng.normal(size=(n_steps + 1, 7)),
        },
        actions=rng.uniform(-1, 1, size=(n_steps, 13)),
        rewards=rng.uniform(size=n_steps),
        labels=rng.integers(-1, 2, size=n_steps),
        primitives=(Primitive("reach", position, orientation, hand), Primitive("press", position, orientation, None)),
        dt=0.02,
        success=True,
        env_id="lfd_gym/MoveObject-v0",
        env_kwargs={"fingertip_friction": 0.8},
        seed={"teach": 0, "index": seed, "reset": 2**32 + 7},
        setup={"object": {"position": [0.5, 0.0, 0.1], "yaw": 0.3}},
        teacher={"name": "move_object", "noise": 1.0, "mode": "commanded"},
        action_layout={"force_limit": 20.0, "hand_low": [0.0] * 4},
        states=rng.normal(size=(n_steps + 1, 30)),
        versions={"numpy": "2"},
    )


def test_a_file_gives_back_every_field_bit_for_bit(tmp_path: Path) -> None:
    written = [make_demonstration(0), make_demonstration(1, n_steps=5)]
    save_demonstrations(tmp_path / "demos.h5", written)
    read = load_demonstrations(tmp_path / "demos.h5")
    assert len(read) == 2
    for before, after in zip(written, read, strict=True):
        for field in dataclasses.fields(Demonstration):
            a, b = getattr(before, field.name), getattr(after, field.name)
            if isinstance(a, np.ndarray):
                assert a.dtype == b.dtype
                np.testing.assert_array_equal(a, b)
            elif field.name == "observations":
                assert sorted(a) == sorted(b)
                for name in a:
                    np.testing.assert_array_equal(a[name], b[name])
            else:
                assert a == b, field.name


def test_equal_demonstrations_give_equal_bytes(tmp_path: Path) -> None:
    for name in ("a.h5", "b.h5"):
        save_demonstrations(tmp_path / name, [make_demonstration(3)])
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_the_file_has_the_layout_that_robomimic_reads(tmp_path: Path) -> None:
    demonstration = make_demonstration()
    save_demonstrations(tmp_path / "demos.h5", [demonstration])
    with h5py.File(tmp_path / "demos.h5") as file:
        demo = file["data/demo_0"]
        assert demo.attrs["num_samples"] == len(demonstration)
        for name in ("actions", "rewards", "dones", "states", "obs/tool_position", "next_obs/tool_position"):
            assert len(demo[name]) == len(demonstration), name
        np.testing.assert_array_equal(demo["obs/tool_position"][1:], demo["next_obs/tool_position"][:-1])
        assert demo["dones"][-1] == 1


def test_seeds_that_are_not_known_are_passed_over() -> None:
    known = make_demonstration()
    assert taught_seeds([dataclasses.replace(known, seed={}), known]) == (2**32 + 7,)


def test_a_layout_that_is_none_of_this_suite_is_named_when_it_is_needed() -> None:
    with pytest.raises(DemonstrationError, match="action layout is {}; needed are workspace_low, "):
        _ = dataclasses.replace(make_demonstration(), action_layout={}).layout


def test_arrays_are_read_only_copies() -> None:
    rows = np.zeros((4, 2))
    base = make_demonstration(n_steps=3)
    demonstration = dataclasses.replace(base, observations={"x": rows})
    rows[0] = 1.0
    assert demonstration.observations["x"][0, 0] == 0.0
    for array in (demonstration.actions, demonstration.labels, demonstration.states, demonstration.observations["x"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_a_pickled_demonstration_is_the_same() -> None:
    demonstration = make_demonstration()
    again = pickle.loads(pickle.dumps(demonstration))
    np.testing.assert_array_equal(again.states, demonstration.states)
    assert again.primitives == demonstration.primitives


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"actions": np.zeros((0, 13))}, "T >= 1"),
        ({"labels": np.full(12, 2)}, "primitive table allows -1 to 1"),
        ({"rewards": np.zeros(11)}, "rewards"),
        ({"states": np.zeros((12, 4))}, "states"),
        ({"observations": {"x": np.zeros((12, 3))}}, "observation 'x'"),
        ({"dt": 0.0}, "positive"),
        ({"env_id": ["x"]}, "id is .* must be a text"),
        ({"seed": 3}, "seed is 3; it must be whole numbers by name"),
        ({"seed": {"reset": "x"}}, "seed is .* whole numbers"),
        ({"action_layout": None}, "action layout is None"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict, message: str) -> None:
    with pytest.raises(DemonstrationError, match=message):
        dataclasses.replace(make_demonstration(), **change)


def break_missing(path: Path) -> None:
    path.unlink()


def break_truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-2000])


def break_text(path: Path) -> None:
    path.write_text("not an HDF5 file")


def break_foreign(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["data/demo_0/actions"] = np.zeros((3, 7))


def break_schema(path: Path) -> None:
    with h5py.File(path, "a") as file:
        file["data"].attrs["schema"] = "lfd_gym.demonstrations/99"


def break_array(path: Path) -> None:
    with h5py.File(path, "a") as file:
        del file["data/demo_0/labels"]


def break_record(path: Path) -> None:
    with h5py.File(path, "a") as file:
        file["data/demo_0"].attrs["record"] = '{"dt": 0.02, "primitives": []}'


def break_origin(path: Path) -> None:
    with h5py.File(path, "a") as file:
        attributes = file["data/demo_0"].attrs
        attributes["record"] = json.dumps({**json.loads(attributes["record"]), "env_id": ["x"]})


def break_empty(path: Path) -> None:
    with h5py.File(path, "a") as file:
        del file["data/demo_0"]


@pytest.mark.parametrize(
    "broken",
    [
        break_missing,
        break_truncated,
        break_text,
        break_foreign,
        break_schema,
        break_array,
        break_record,
        break_origin,
        break_empty,
    ],
)
def test_a_broken_file_is_refused_in_one_line_that_names_it(tmp_path: Path, broken) -> None:
    path = tmp_path / "demos.h5"
    save_demonstrations(path, [make_demonstration()])
    broken(path)
    with pytest.raises(DemonstrationError) as caught:
        load_demonstrations(path)
    assert "demos.h5" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "demos.h5"
    save_demonstrations(path, [make_demonstration()])
    before = path.read_bytes()
    bad = dataclasses.replace(make_demonstration(), setup={"object": object()})
    with pytest.raises(DemonstrationError, match="cannot store a object"):
        save_demonstrations(path, [bad])
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["demos.h5"]


def test_saving_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DemonstrationError, match="at least one"):
        save_demonstrations(tmp_path / "demos.h5", [])
