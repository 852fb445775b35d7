"""Demonstrations brought to one time (4.30), and frames."""

import numpy as np
import pytest
from moa_scenes import random_frames, turn

from lfd_gym.errors import DemonstrationError, InvalidArgumentError
from policies.moa.alignment import align, frame_distances, warp, warped
from policies.moa.frames import Frames, resample
from policies.moa.time_warping import warping_path


def path(n):
    """A curve that never meets itself, (n, 2)."""
    t = np.linspace(0.0, 1.0, n)
    return np.stack([t + 0.3 * np.sin(7 * t), np.cos(5 * t)], axis=1)


def test_distance_is_that_of_the_frame_in_which_points_are_nearest():
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(20, 3, 2)), rng.normal(size=(30, 3, 2))
    expected = np.array([[min(np.linalg.norm(x[k] - y[k]) for k in range(3)) for y in b] for x in a])
    np.testing.assert_allclose(frame_distances(a, b), expected, atol=1e-12)


def test_paths_too_long_for_the_memory_are_refused():
    with pytest.raises(DemonstrationError, match="lower control_hz"):
        warp(np.broadcast_to(0.0, (20_000, 1, 3)), np.broadcast_to(0.0, (20_000, 1, 3)))


def cheapest(cost):
    """The least weighted cost over all paths, one by one."""
    n, m = cost.shape

    def rest(i, j):
        if (i, j) == (n - 1, m - 1):
            return 0.0
        steps = [(a, b) for a, b in ((0, 1), (1, 0), (1, 1)) if i + a < n and j + b < m]
        return min((a + b) * cost[i + a, j + b] + rest(i + a, j + b) for a, b in steps)

    return cost[0, 0] + rest(0, 0)


@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (6, 1), (2, 3), (5, 5), (6, 4)])
def test_the_warping_path_is_the_cheapest_of_all(shape):
    rng = np.random.default_rng(6)
    for _ in range(5):
        cost = rng.uniform(size=shape)
        path = warping_path(cost)
        steps = np.diff(path, axis=0)
        assert (path[0] == 0).all()
        assert tuple(path[-1] + 1) == shape
        assert {tuple(step) for step in steps} <= {(0, 1), (1, 0), (1, 1)}
        paid = cost[0, 0] + (steps.sum(axis=1) * cost[tuple(path[1:].T)]).sum()
        assert paid == pytest.approx(cheapest(cost))


@pytest.mark.parametrize("shape", [(1, 6), (6, 1), (5, 4)])
def test_the_warping_path_ends_at_the_first_pair_even_where_sums_of_costs_overflow(shape):
    path = warping_path(np.full(shape, 1e308))
    assert (path[0] == 0).all()
    assert {tuple(step) for step in np.diff(path, axis=0)} <= {(0, 1), (1, 0), (1, 1)}


@pytest.mark.parametrize(
    ("cost", "message"),
    [
        (np.where(np.eye(3), np.nan, 1.0), r"3 costs of time warping are not finite, the first is nan at \(0, 0\)"),
        (np.full((2, 2), np.inf), "4 costs of time warping are not finite"),
        (np.empty((0, 3)), r"shape \(0, 3\); needed"),
        (np.ones(3), r"shape \(3,\); needed"),
    ],
)
def test_costs_that_cannot_be_warped_by(cost, message):
    with pytest.raises(InvalidArgumentError, match=message):
        warping_path(cost)


def test_a_planted_change_of_time_is_found():
    x = path(300)
    planted = 299.0 * np.linspace(0.0, 1.0, 400) ** 1.4
    found = warp(resample(x, planted)[:, None], x[:, None])
    assert np.abs(found - planted).max() < 2.5
    assert (np.diff(found) >= 0.0).all()
    assert found[0] == 0.0
    assert found[-1] == 299.0


def test_each_part_is_aligned_in_the_frame_in_which_it_is_alike():
    rng, x = np.random.default_rng(1), path(200)
    half = np.arange(200)[:, None] < 100
    demonstrations, frames = [], []
    for _ in range(2):
        frame = random_frames(rng, 2, 2)
        there = frame.origins[:, None] + x @ frame.axes.swapaxes(1, 2)
        demonstrations.append(np.where(half, there[0], there[1]))
        frames.append(frame)
    slow = np.repeat(np.arange(200), 2)
    demonstrations[1] = demonstrations[1][slow]
    found = align(demonstrations, frames, reference=0)[1]
    assert np.abs(found - 2.0 * np.arange(200)).max() < 4.0


def test_the_reference_is_the_demonstration_of_median_length():
    lengths = [90, 60, 80, 70]
    warps = align([path(n) for n in lengths], [Frames.world(2)] * 4)
    assert {len(index) for index in warps} == {70}
    np.testing.assert_array_equal(warps[3], np.arange(70))


def test_turning_the_scene_does_not_change_the_alignment():
    rng = np.random.default_rng(2)
    points, frames = (
        [path(80), path(100) + 0.02 * rng.normal(size=(100, 2))],
        [random_frames(rng, 2, 2) for _ in range(2)],
    )
    rotation, shift = turn(rng, 2), rng.normal(size=2)
    moved = align([x @ rotation.T + shift for x in points], [f.moved(rotation, shift) for f in frames])
    for before, after in zip(align(points, frames), moved, strict=True):
        np.testing.assert_allclose(before, after, atol=1e-9)


def test_moving_frames_are_warped_with_the_trajectory():
    rng = np.random.default_rng(3)
    frames, points, index = random_frames(rng, 2, 2, 50), path(50), np.linspace(0.0, 49.0, 70)
    x, at = warped(points, frames, index)
    np.testing.assert_allclose(at.local(x), resample(frames.local(points), index), atol=1e-3)


def test_local_points_are_those_seen_from_every_frame():
    rng = np.random.default_rng(4)
    frames, x = random_frames(rng, 3, 3, 20), rng.normal(size=(20, 3))
    local = frames.local(x)
    for i in range(20):
        for f in range(3):
            np.testing.assert_allclose(frames.axes[i, f] @ local[i, f] + frames.origins[i, f], x[i], atol=1e-12)


def test_poses_are_position_and_quaternion():
    frames = Frames.of_poses(np.array([[1.0, 2.0, 3.0, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]]))
    np.testing.assert_allclose(frames.local(np.array([[1.0, 4.0, 3.0]]))[0, 0], [2.0, 0.0, 0.0], atol=1e-12)


def test_frames_join_at_rest_and_moving():
    rng = np.random.default_rng(5)
    still, moving = random_frames(rng, 2, 2), random_frames(rng, 1, 2, 30)
    joined = Frames.joined([still, moving])
    assert len(joined) == 3
    assert joined.n_steps == 30
    np.testing.assert_array_equal(joined.origins[:, 2], moving.origins[:, 0])
    assert not Frames.joined([still, still]).moving
    assert not Frames(np.tile(still.origins, (9, 1, 1)), np.tile(still.axes, (9, 1, 1, 1))).moving


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: Frames(np.zeros((2, 3)), np.zeros((2, 2, 2))),
        lambda: Frames(np.zeros((0, 2)), np.zeros((0, 2, 2))),
        lambda: Frames(np.full((1, 2), np.nan), np.eye(2)[None]),
        lambda: Frames(np.zeros((1, 2)), 0.5 * np.eye(2)[None]),
        lambda: Frames.of_poses(np.zeros((1, 6))),
    ],
)
def test_malformed_frames_are_refused(wrong):
    with pytest.raises(InvalidArgumentError, match="frames have origins|not finite|not orthogonal|poses are"):
        wrong()
