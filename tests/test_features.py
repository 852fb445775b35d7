"""Task-space coordinates against scipy, and the goal distance (thesis 2.16, 2.17)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lfd_gym.demonstration import EntityControl, Primitive
from lfd_gym.errors import DemonstrationError
from policies.goal_distance import goal_distance, goal_distance_width
from policies.task_data import (
    mean_quaternion,
    measure,
    primitive_table,
    task_coordinates,
    trajectory,
    world_goal,
)
from policies.task_space import CARTESIAN, CYLINDRICAL


def quaternions(n: int, seed: int = 0) -> np.ndarray:
    return Rotation.random(n, rng=np.random.default_rng(seed)).as_quat(scalar_first=True)


def poses(n: int, seed: int) -> np.ndarray:
    return np.hstack([np.random.default_rng(seed).normal(size=(n, 3)), quaternions(n, seed)])


def row(frame: str = "box", space: str = "cartesian", axes: tuple[str, ...] = ("position",) * 3) -> Primitive:
    return Primitive(
        "reach",
        EntityControl(0, frame, space, axes),
        EntityControl(0, "world", "rotation", ("hold",) * 3),
        EntityControl(0, "world", "joints", ("position",) * 4),
    )


def test_coordinates_agree_with_scipy_and_are_inverted():
    at, turned, tool = poses(50, 1), poses(50, 2), poses(50, 3)
    mean, hand = quaternions(1, 4)[0], np.arange(4.0)
    for p, o, t in zip(at, turned, tool, strict=True):
        x = task_coordinates(t[:3], t[3:], hand, p, o, CARTESIAN, mean)
        r_p, r_o, r_t, r_mean = (Rotation.from_quat(q, scalar_first=True) for q in (p[3:], o[3:], t[3:], mean))
        assert x[:3] == pytest.approx(r_p.inv().apply(t[:3] - p[:3]))
        assert x[3:6] == pytest.approx((r_o.inv() * r_t * r_mean.inv()).as_rotvec())
        for space in (CARTESIAN, CYLINDRICAL):
            x = task_coordinates(t[:3], t[3:], hand, p, o, space, mean)
            position, orientation = world_goal(x, p, o, space, mean)
            assert position == pytest.approx(t[:3])
            assert abs(orientation @ t[3:]) == pytest.approx(1)


@pytest.mark.parametrize("space", [CARTESIAN, CYLINDRICAL])
def test_turning_the_scene_leaves_the_coordinates(space):
    turn = Rotation.from_euler("xyz", [0.3, -0.2, 1.5])
    frame, tool = poses(20, 5), poses(20, 6)

    def turned(pose: np.ndarray) -> np.ndarray:
        q = (turn * Rotation.from_quat(pose[3:], scalar_first=True)).as_quat(scalar_first=True)
        return np.r_[turn.apply(pose[:3]) + 0.4, q]

    mean, hand = quaternions(1)[0], np.zeros(4)
    for f, t in zip(frame, tool, strict=True):
        g, s = turned(f), turned(t)
        before, after = (
            task_coordinates(t[:3], t[3:], hand, f, f, space, mean),
            task_coordinates(s[:3], s[3:], hand, g, g, space, mean),
        )
        assert after == pytest.approx(before)


def test_a_quaternion_and_its_negative_are_one_orientation():
    tool, mean = poses(20, 7), quaternions(1)[0]
    frame = poses(1, 8)[0]
    for t in tool:
        there, back = (
            task_coordinates(t[:3], sign * t[3:], np.zeros(4), frame, frame, CARTESIAN, mean) for sign in (1, -1)
        )
        assert there == pytest.approx(back)


def test_mean_orientation_ignores_signs():
    near = Rotation.from_rotvec(np.random.default_rng(0).normal(0, 0.05, (30, 3))) * Rotation.from_rotvec([0, 0, 2.0])
    q = near.as_quat(scalar_first=True) * np.random.default_rng(1).choice([-1, 1], (30, 1))
    error = Rotation.from_quat(mean_quaternion(q), scalar_first=True) * near.mean().inv()
    assert error.magnitude() < 1e-3


def test_batch_equals_single_observations():
    n = 12
    observations = {
        "tool_position": poses(n, 1)[:, :3],
        "tool_quaternion": quaternions(n, 2),
        "hand_position": np.random.default_rng(3).normal(size=(n, 4)),
        "frame_box": poses(n, 4),
    }
    table = primitive_table([row()], list(observations))
    assert table.frames == ("world", "box")
    measured, mean = measure(observations, table.frames), quaternions(1)[0]
    for t, x in enumerate(trajectory(measured, table, 0, mean)):
        one = [
            measured.position[t],
            measured.quaternion[t],
            measured.hand[t],
            measured.frames[t, 1],
            measured.frames[t, 0],
        ]
        assert x == pytest.approx(task_coordinates(*one, CARTESIAN, mean))


def test_goal_distance_is_the_printed_one():
    rng = np.random.default_rng(0)
    for _ in range(20):
        delta, gain = rng.normal(size=10), rng.uniform(0.1, 2, size=10)
        expected = 1 - np.exp(-0.5 * delta @ np.diag(gain**2) @ delta)
        assert goal_distance(delta, gain, 0.0) == pytest.approx(expected)
        above, below = goal_distance(delta, gain, 1.0), goal_distance(delta, gain, -1.0)
        assert (1 - above) * (1 - below) == pytest.approx(1 - expected)


def test_width_saturates_beyond_the_decision():
    rng = np.random.default_rng(0)
    way, there = [np.linspace(0.3, 0.006, 80) for _ in range(3)], [np.abs(rng.normal(0, 0.002, 40)) for _ in range(3)]
    width = goal_distance_width({"on the way": way, 1: there}, smallest=0.002)
    f = 1 - np.exp(-0.5 * (np.array([0.001, 0.05]) / width) ** 2)
    assert f[0] < 0.15
    assert f[1] > 0.95


def test_impossible_tables_are_refused_in_one_line():
    names = ["tool_position", "frame_box"]
    for bad, message in [
        (row(frame="bix"), "has the frame 'bix'; tracked are: world, box"),
        (row(space="spherical"), "has the space 'spherical'; possible: cartesian, cylindrical"),
        (row(axes=("position",) * 2), "needs 3 of: position, force, hold"),
    ]:
        with pytest.raises(DemonstrationError, match=message):
            primitive_table([bad], names)
