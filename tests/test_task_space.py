"""Cartesian and cylindrical coordinates of a position, and movements in them."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from kinematic_world import teach
from scipy.spatial.transform import Rotation

from lfd_gym.demonstration import Demonstration, EntityControl, Primitive
from lfd_gym.errors import DemonstrationError
from policies.movement_primitives import MovementPrimitives, learn_primitives
from policies.task_data import deviation, measure, primitive_table
from policies.task_space import (
    CARTESIAN,
    CYLINDRICAL,
    coordinates,
    difference,
    directions,
    moved,
    point,
)

FRAME = np.r_[0.5, -0.3, 0.1, Rotation.from_euler("xyz", [1.5, 0.2, -0.7]).as_quat(scalar_first=True)]


def points(n: int = 50) -> np.ndarray:
    return np.random.default_rng(0).normal(size=(n, 3))


@pytest.mark.parametrize("space", [CARTESIAN, CYLINDRICAL])
def test_coordinates_are_inverted_and_grow_along_their_directions(space):
    step = 1e-6
    for p in points():
        y = coordinates(p, space)
        assert point(y, space) == pytest.approx(p)
        e = directions(y, space)
        assert e.T @ e == pytest.approx(np.eye(3), abs=1e-12)
        metric = np.array([1.0, y[0] if space == CYLINDRICAL else 1.0, 1.0])
        for i in range(3):
            moved = coordinates(p + step * e[:, i], space)
            assert metric * (moved - y) / step == pytest.approx(np.eye(3)[i], abs=1e-5)


def test_an_angle_counts_by_the_shorter_way_around():
    there, here = np.array([0.2, math.pi - 0.1, 0.0]), np.array([0.2, -math.pi + 0.1, 0.0])
    assert difference(there, here, 0.2, CYLINDRICAL) == pytest.approx([0.0, -0.2 * 0.2, 0.0])
    assert difference(there, here, 0.2, CARTESIAN) == pytest.approx(there - here)
    x, goal = np.r_[there, np.zeros(7)], np.r_[here, np.zeros(7)]
    assert deviation(x, goal, CYLINDRICAL)[:3] == pytest.approx([0.0, -0.2 * 0.2, 0.0])


def path(start: np.ndarray, goal: np.ndarray, way: float, space: int) -> np.ndarray:
    steps = [start]
    while not np.array_equal(steps[-1], goal):
        steps.append(moved(steps[-1], goal, way, space))
        assert len(steps) < 1000
    return np.array(steps)


@pytest.mark.parametrize(
    ("space", "start", "goal"),
    [(CARTESIAN, [0.3, 0.1, -0.1], [0.1, -0.2, 0.1]), (CYLINDRICAL, [0.3, 2.8, -0.1], [0.15, -2.6, 0.1])],
)
def test_a_movement_keeps_its_speed_and_goes_the_short_way(space, start, goal):
    steps = path(np.array(start), np.array(goal), 0.004, space)
    travelled = np.linalg.norm(np.diff([point(y, space) for y in steps], axis=0), axis=1)
    assert travelled.max() < 0.004 * 1.001
    assert travelled[:-1].min() > 0.004 * 0.98
    assert travelled.sum() < 0.45


def test_an_arc_keeps_its_radius():
    steps = path(np.array([0.2, 0.1, 0.05]), np.array([0.2, 2.0, 0.05]), 0.00502, CYLINDRICAL)
    assert steps[:, [0, 2]] == pytest.approx(np.tile([0.2, 0.05], (len(steps), 1)))
    assert len(steps) == 1 + math.ceil(0.2 * 1.9 / 0.00502)


def test_the_axis_itself_is_no_trap():
    away = path(np.zeros(3), np.array([0.1, 1.0, 0.0]), 0.005, CYLINDRICAL)
    assert np.isfinite(away).all()


def test_goals_and_a_radial_press_are_learned_across_the_branch_cut():
    """Half of the arcs end below pi and half above it; the press points to the axis wherever the tool is."""
    arc = arc_row("arc", "force")
    taught = [drawn_arc(0.2, math.pi + end, (arc,)) for end in (-0.02, 0.02, -0.02, 0.02)]
    learned = learn(taught)
    assert abs(learned.goal[0, 1]) == pytest.approx(math.pi, abs=0.03)
    assert learned.goal[0, [0, 2]] == pytest.approx([0.2, 0.05], abs=1e-6)
    assert learned.force[0] == pytest.approx([-7.0, 0.0, 0.0])
    speed = 0.2 * (math.pi - 1.0) / 79 / taught[0].dt
    assert learned.speed[0] == pytest.approx(speed, rel=0.03)


@pytest.mark.parametrize(("radius", "angle", "fits"), [(0.007, 2.5, True), (0.2, 0.4, True), (0.2, 0.9, False)])
def test_rows_that_share_a_goal_end_near_each_other_along_the_arc(radius, angle, fits):
    rows = arc_row("first", "position"), arc_row("second", "position")
    taught = [drawn_arc(radius, 1.0 + end, rows, label) for label, end in ((0, 0.1), (1, 0.1 + angle))]
    if fits:
        learned = learn(taught)
        assert learned.goal[0, :3] == pytest.approx(learned.goal[1, :3])
    else:
        with pytest.raises(DemonstrationError, match="'first' and 'second' share a primitive"):
            learn(taught)


def test_whether_rows_may_share_a_goal_does_not_depend_on_their_order():
    for ends in itertools.permutations((0.0, 0.45, 0.9)):
        rows = tuple(arc_row(name, "position") for name in "abc")
        with pytest.raises(DemonstrationError, match="share a primitive .* 0.90 m or rad apart"):
            learn([drawn_arc(0.2, 1.1 + end, rows, label) for label, end in enumerate(ends)])


def arc_row(name: str, radius: str) -> Primitive:
    """What is done along the radius."""
    axes = (radius, "position", "position")
    return teach(0).primitives[0]._replace(name=name, position=EntityControl(0, "lid", "cylindrical", axes))


def drawn_arc(radius: float, end: float, rows: tuple[Primitive, ...], label: int = 0) -> Demonstration:
    """An arc from 1 rad to an end, of one row of the table, with 7 N towards the axis."""
    y = np.stack([np.full(80, radius), np.linspace(1.0, end, 80), np.full(80, 0.05)], axis=1)
    turn = Rotation.from_quat(FRAME[3:], scalar_first=True)
    radial = turn.apply([directions(row, CYLINDRICAL)[:, 0] for row in y])
    observations = {
        "tool_position": FRAME[:3] + turn.apply([point(row, CYLINDRICAL) for row in y]),
        "tool_quaternion": np.tile([1.0, 0.0, 0.0, 0.0], (80, 1)),
        "wrench": np.hstack([7.0 * radial, np.zeros((80, 3))]),
        "frame_lid": np.tile(FRAME, (80, 1)),
    }
    template = teach(0)
    return dataclasses.replace(
        template,
        observations=observations,
        actions=template.actions[:79],
        rewards=np.zeros(79),
        states=np.zeros((80, 1)),
        labels=np.full(79, label),
        primitives=rows,
    )


def learn(taught: list[Demonstration]) -> MovementPrimitives:
    rows = taught[0].primitives
    table = primitive_table(rows, list(taught[0].observations))
    measured = [measure(demonstration.observations, table.frames) for demonstration in taught]
    return learn_primitives([row.name for row in rows], table, taught, measured, "arclength")
