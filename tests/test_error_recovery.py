"""A slip leads back to the beginning because it was demonstrated, and only then (thesis 2.5.3)."""

import kinematic_world
import numpy as np
import pytest
import slipping_world
from slipping_world import ABOVE, BEGIN, BESIDE, CLOSE, LIFT, solve, teach

from policies.object_motion import GONE, MOTION, motion_observations, motions, tool_in_frames
from policies.sequence_graph_learner import SequenceGraphLearner
from policies.task_data import measure


def skill(slips: tuple[int, ...], graph: str):
    """Taught with two flat and two tall blocks; only flat ones slip."""
    shown = [teach(seed, tall, () if tall else slips) for seed, tall in ((0, False), (1, True), (2, False), (3, True))]
    return SequenceGraphLearner(graph=graph).fit(shown).skill_


@pytest.mark.parametrize("graph", ["global", "local"])
def test_a_demonstrated_slip_is_recovered_from_with_every_grasp(graph):
    taught = skill((0,), graph)
    assert solve(taught, 10, False, (0, 1)) == (True, [BEGIN, ABOVE, CLOSE, LIFT] * 3)
    assert solve(taught, 11, True, (0,)) == (True, [BEGIN, BESIDE, CLOSE, LIFT] * 2)
    assert solve(taught, 12, True) == (True, [BEGIN, BESIDE, CLOSE, LIFT])


@pytest.mark.parametrize("dt", [0.1, 0.002])
def test_a_slip_is_recognised_at_every_control_rate(dt, monkeypatch):
    for world in (kinematic_world, slipping_world):
        monkeypatch.setattr(world, "DT", dt)
    assert solve(skill((0,), "global"), 11, True, (0,)) == (True, [BEGIN, BESIDE, CLOSE, LIFT] * 2)


def test_what_was_not_demonstrated_is_not_done():
    assert solve(skill((), "global"), 10, False, (0,)) == (False, [BEGIN, ABOVE, CLOSE, LIFT])


def test_motion_begins_anew_with_every_movement_and_does_not_depend_on_where_the_scene_is():
    demonstration = teach(0, False, (0,))
    measured = measure(demonstration.observations, ["world", "block"])
    motion = motion_observations(measured, demonstration.labels, ["world", "block"])
    assert list(motion) == [MOTION + "block"]
    lifts = np.flatnonzero((demonstration.labels[:-1] == LIFT) & (demonstration.labels[1:] != LIFT))
    assert motion[MOTION + "block"][lifts[0] + 1] == pytest.approx(0.02, abs=0.012)
    assert motion[MOTION + "block"][-1] == pytest.approx(0.0, abs=1e-12)
    assert motion[MOTION + "block"].max() == GONE


def test_what_moves_with_the_hand_does_not_move_in_it():
    rng = np.random.default_rng(0)
    frames = np.hstack([rng.normal(size=(3, 3)), rng.normal(size=(3, 4))])
    frames[:, 3:] /= np.linalg.norm(frames[:, 3:], axis=1, keepdims=True)
    place = tool_in_frames(np.array([0.1, 0.2, 0.3]), frames)
    carried = frames.copy()
    carried[:, :3] += [0.5, -0.2, 0.1]
    moved = tool_in_frames(np.array([0.6, 0.0, 0.4]), carried)
    assert motions(moved, place) == pytest.approx(np.zeros(3), abs=1e-12)
    assert motions(moved + np.array([0.0, 0.03, 0.0]), place) == pytest.approx(np.full(3, 0.03))
