"""Scores of decompositions: what was taught itself scores full marks, and every kind of mistake costs what it should."""

import dataclasses
import itertools

import numpy as np
import pytest
from kinematic_world import PRIMITIVES, teach

from lfd_gym import quaternion
from lfd_gym.demonstration import Demonstration
from lfd_gym.experiments.decomposition_scores import (
    UNKNOWN,
    controls,
    entity_scores,
    equal_frames,
    force_score,
    taught,
)
from policies.decomposition.result import Decomposition, EntityDecomposition, EntityPrimitive
from policies.decomposition.segmentation import ENTITIES, Segment
from policies.decomposition.task_spaces import EntitySegments, TaskSpace


@pytest.fixture(scope="module")
def shown() -> list[Demonstration]:
    return [teach(seed) for seed in (1, 2, 3)]


def answer(shown: list[Demonstration], entity: str) -> EntityDecomposition:
    """The teacher's own table as a decomposition; what is held before the first movement counts as the first primitive."""
    rows = controls(shown[0], entity)
    parts, assignment = [], []
    for m, demonstration in enumerate(shown):
        own = np.maximum(taught(demonstration, entity), 0)
        edges = [0, *(np.flatnonzero(np.diff(own)) + 1), len(own)]
        for start, stop in itertools.pairwise(edges):
            parts.append(Segment(m, int(start), int(stop), int(stop)))
            assignment.append(int(own[start]))
    primitives = tuple(
        EntityPrimitive(
            TaskSpace(row.frame, row.space), np.ones(1), np.zeros(3), np.eye(3), row.axes,
            np.array([8.0 * (axis == "force") for axis in row.axes[:3]]),
        )
        for row in rows
    )  # fmt: skip
    data = EntitySegments(entity, tuple(parts), (), (), float(shown[0].dt))
    return EntityDecomposition(data, primitives, np.array(assignment), np.zeros(len(parts), dtype=np.int64))


def score(shown: list[Demonstration], found: EntityDecomposition) -> tuple:
    return entity_scores(shown, Decomposition({found.data.entity: found}, "answer"))[found.data.entity]


def with_primitive(found: EntityDecomposition, k: int, **changes: object) -> EntityDecomposition:
    primitives = list(found.primitives)
    primitives[k] = primitives[k]._replace(**changes)
    return found._replace(primitives=tuple(primitives))


@pytest.mark.parametrize("entity", ENTITIES)
def test_the_answer_has_full_marks(shown: list[Demonstration], entity: str) -> None:
    found = score(shown, answer(shown, entity))
    assert found.frame == 1.0
    assert found.rand_controls == 1.0
    assert found.found == found.taught_controls


def test_force_where_it_was_taught_has_full_marks(shown: list[Demonstration]) -> None:
    assert force_score(shown, answer(shown, "position")) == (1.0, 0.0)


def test_what_is_held_continues_the_movement_before(shown: list[Demonstration]) -> None:
    names = [PRIMITIVES[label].name for label in shown[0].labels]
    own = taught(shown[0], "position")
    assert own[names.index("close")] == own[names.index("close") - 1]
    rows = controls(shown[0], "hand")
    assert [row.primitive for row in rows] == [0, 1]
    held = dataclasses.replace(shown[0], labels=np.full(len(shown[0]), 1))
    assert np.all(taught(held, "position") == UNKNOWN)


def test_a_wrong_frame_costs_its_time(shown: list[Demonstration]) -> None:
    found = answer(shown, "position")
    k = next(i for i, row in enumerate(controls(shown[0], "position")) if row.frame == "bin")
    wrong = score(shown, with_primitive(found, k, space=TaskSpace("lid", "cartesian")))
    own = np.concatenate([taught(demonstration, "position") for demonstration in shown])
    assert wrong.frame == pytest.approx(1.0 - np.mean(own[own != UNKNOWN] == k))
    assert wrong.rand_controls == 1.0


def test_one_primitive_for_everything_is_worth_nothing(shown: list[Demonstration]) -> None:
    found = answer(shown, "orientation")
    merged = score(shown, found._replace(assignment=np.zeros_like(found.assignment)))
    assert merged.rand == 0.0
    assert merged.found == 1


def test_frames_that_are_tied_are_equal_and_others_are_not(shown: list[Demonstration]) -> None:
    assert all(
        row.frame in right
        for row, right in zip(controls(shown[0], "position"), equal_frames(shown, "position"), strict=True)
    )
    assert all("bin" not in right for right in equal_frames(shown, "position")[:1])
    tied = []
    for demonstration in shown:
        lid = demonstration.observations["frame_lid"]
        off = np.array([quaternion.rotate(row[3:], np.array([0.1, 0.2, 0.0])) for row in lid])
        seen = {**demonstration.observations, "frame_knob": np.hstack([lid[:, :3] + off, lid[:, 3:]])}
        tied.append(dataclasses.replace(demonstration, observations=seen))
    for row, right in zip(controls(tied[0], "position"), equal_frames(tied, "position"), strict=True):
        assert ("knob" in right) == (row.frame == "lid")


def test_a_frame_that_is_carried_is_not_what_a_movement_is_about(shown: list[Demonstration]) -> None:
    """It is where the tool is at the end of every movement, but not where it will be at the beginning."""
    carried = []
    for demonstration in shown:
        tool = demonstration.observations["tool_position"]
        frame = np.hstack([tool, np.tile([1.0, 0.0, 0.0, 0.0], (len(tool), 1))])
        seen = {**demonstration.observations, "frame_held": frame}
        carried.append(dataclasses.replace(demonstration, observations=seen))
    moving = [i for i, row in enumerate(controls(shown[0], "position")) if row.frame == "bin"]
    assert all("held" not in equal_frames(carried, "position")[i] for i in moving)


def test_force_along_another_axis_or_elsewhere_is_wrong(shown: list[Demonstration]) -> None:
    found = answer(shown, "position")
    rows = controls(shown[0], "position")
    pulls = next(i for i, row in enumerate(rows) if "force" in row.axes)
    other = next(i for i, row in enumerate(rows) if row.frame == "bin")
    sideways = with_primitive(found, pulls, axes=("force", "position", "position"))
    assert force_score(shown, sideways) == (0.0, 0.0)
    everywhere = with_primitive(found, other, axes=("position", "position", "force"))
    assert force_score(shown, everywhere).pressed == 1.0
    assert force_score(shown, everywhere).elsewhere > 0.1
    assert force_score(shown, with_primitive(found, pulls, axes=("position",) * 3)) == (0.0, 0.0)
