"""Scores of decompositions: frames that are tied or carried, and where axes of force point."""

import dataclasses
import itertools

import numpy as np
import pytest
from kinematic_world import PRIMITIVES, teach

from lfd_gym import quaternion
from lfd_gym.demonstration import Demonstration, EntityControl
from lfd_gym.experiments.decomposition_scores import Score, _as_good, _rows, planted, score
from policies.decomposition.result import Decomposition, EntityDecomposition, EntityPrimitive
from policies.decomposition.segmentation import Segment
from policies.decomposition.task_spaces import EntitySegments, TaskSpace


@pytest.fixture(scope="module")
def shown() -> list[Demonstration]:
    return [teach(seed) for seed in (1, 2, 3)]


def controls(entity: str) -> list[EntityControl]:
    """In the order in which `planted` counts them."""
    rows = [getattr(primitive, entity) for primitive in PRIMITIVES]
    return list(dict.fromkeys(row for row in rows if set(row.axes) != {"hold"}))


def _control_index(demonstration: Demonstration, entity: str) -> np.ndarray:
    """`planted` as an index into `controls`."""
    own = planted(demonstration, entity)
    rows = controls(entity)
    table = [rows.index(getattr(row, entity)) if getattr(row, entity) in rows else -1 for row in PRIMITIVES]
    return np.where(own < 0, -1, np.array(table)[own])


def answer(shown: list[Demonstration], entity: str) -> EntityDecomposition:
    """The teacher's own table as a decomposition; what is held continues the control before."""
    parts, assignment = [], []
    for m, demonstration in enumerate(shown):
        own = _control_index(demonstration, entity)
        last = np.maximum.accumulate(np.where(own >= 0, np.arange(len(own)), 0))
        own = np.maximum(own[last], 0)
        edges = [0, *(np.flatnonzero(np.diff(own)) + 1), len(own)]
        for start, stop in itertools.pairwise(edges):
            parts.append(Segment(m, int(start), int(stop), int(stop)))
            assignment.append(int(own[start]))
    primitives = tuple(
        EntityPrimitive(
            TaskSpace(row.frame, row.space),
            np.ones(1),
            np.zeros(3),
            np.eye(3),
            row.axes,
            np.array([8.0 * (axis == "force") for axis in row.axes[:3]]),
        )
        for row in controls(entity)
    )
    data = EntitySegments(entity, tuple(parts), (), (), float(shown[0].dt))
    return EntityDecomposition(data, primitives, np.array(assignment), np.zeros(len(parts), dtype=np.int64))


def judged(shown: list[Demonstration], found: EntityDecomposition) -> Score:
    """Of the position alone."""
    return score(shown, Decomposition({"position": found}, "answer"))


def equal(shown: list[Demonstration], entity: str = "position") -> dict[str, set[str]]:
    """Name of every row that controls an entity -> frames that are as good as its own."""
    rows = _rows(shown, entity)
    return {PRIMITIVES[row].name: _as_good(shown, entity, row, control) for row, control in rows.items()}


def with_primitive(found: EntityDecomposition, k: int, **changes: object) -> EntityDecomposition:
    primitives = list(found.primitives)
    primitives[k] = primitives[k]._replace(**changes)
    return found._replace(primitives=tuple(primitives))


def test_a_wrong_frame_costs_its_time(shown: list[Demonstration]) -> None:
    found = answer(shown, "position")
    k = next(i for i, row in enumerate(controls("position")) if row.frame == "bin")
    wrong = judged(shown, with_primitive(found, k, space=TaskSpace("lid", "cartesian"))).entities["position"]
    own = np.concatenate([_control_index(demonstration, "position") for demonstration in shown])
    assert wrong.frame == pytest.approx(1.0 - np.mean(own[own >= 0] == k))
    assert wrong.rand == 1.0


def test_a_cylindrical_space_is_another_space_in_the_same_frame(shown: list[Demonstration]) -> None:
    found = answer(shown, "position")
    k = next(i for i, row in enumerate(controls("position")) if row.frame == "bin")
    other = judged(shown, with_primitive(found, k, space=TaskSpace("bin", "cylindrical"))).entities["position"]
    assert other.frame == 1.0
    assert other.space < 1.0


def test_axes_make_controls_of_one_primitive(shown: list[Demonstration]) -> None:
    """The lid is reached, and pulled: one primitive of the table's position with other axes."""
    own = judged(shown, answer(shown, "position")).entities["position"]
    assert own.planted_goals < own.planted
    assert own.rand_goals < own.rand


def test_frames_that_are_tied_are_equal_and_others_are_not(shown: list[Demonstration]) -> None:
    assert equal(shown)["carry"] == {"bin"}
    assert equal(shown)["reach"] == {"lid"}
    tied = []
    for demonstration in shown:
        lid = demonstration.observations["frame_lid"]
        off = np.array([quaternion.rotate(row[3:], np.array([0.1, 0.2, 0.0])) for row in lid])
        seen = {**demonstration.observations, "frame_knob": np.hstack([lid[:, :3] + off, lid[:, 3:]])}
        tied.append(dataclasses.replace(demonstration, observations=seen))
    assert equal(tied)["carry"] == {"bin"}
    assert equal(tied)["reach"] == {"lid", "knob"}


def test_what_the_hand_carries_is_not_what_a_movement_is_about(shown: list[Demonstration]) -> None:
    """It is where the tool is at the end of every movement, but not where it will be at the beginning."""
    carried = []
    for demonstration in shown:
        tool = demonstration.observations["tool_position"]
        frame = np.hstack([tool, np.tile([1.0, 0.0, 0.0, 0.0], (len(tool), 1))])
        carried.append(
            dataclasses.replace(demonstration, observations={**demonstration.observations, "frame_held": frame})
        )
    assert all("held" not in equal(carried)[name] for name in ("reach", "carry"))


def test_force_along_another_axis_or_elsewhere_or_nowhere_is_wrong(shown: list[Demonstration]) -> None:
    found = answer(shown, "position")
    pulls = next(i for i, row in enumerate(controls("position")) if "force" in row.axes)
    other = next(i for i, row in enumerate(controls("position")) if row.frame == "bin")
    for k, axes in (
        (pulls, ("force", "position", "position")),
        (pulls, ("position",) * 3),
        (pulls, ("position", "force", "force")),
        (other, ("position", "position", "force")),
    ):
        wrong = judged(shown, with_primitive(found, k, axes=axes))
        assert not wrong.forces
        assert wrong.forces_time < 1.0


def test_axes_of_force_are_compared_by_where_they_point(shown: list[Demonstration]) -> None:
    """The third axis of a cylindrical space is that of its frame; its first is not."""
    found = answer(shown, "position")
    k = next(i for i, row in enumerate(controls("position")) if "force" in row.axes)
    for frame, space in (("world", "cartesian"), ("lid", "cylindrical")):
        assert judged(shown, with_primitive(found, k, space=TaskSpace(frame, space))).forces_time == 1.0
    turned = []
    for demonstration in shown:
        bin_ = demonstration.observations["frame_bin"].copy()
        bin_[:, 3:] = quaternion.from_rotation_vector(np.array([0.5 * np.pi, 0.0, 0.0]))
        turned.append(
            dataclasses.replace(demonstration, observations={**demonstration.observations, "frame_bin": bin_})
        )
    assert not judged(turned, with_primitive(found, k, space=TaskSpace("bin", "cartesian"))).forces
