"""What is learned from demonstrations as they come: broken off, pressing now and then, turning by more than half a turn."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest

from lfd_gym import quaternion
from lfd_gym.demonstration import Demonstration, EntityControl
from lfd_gym.errors import DemonstrationError
from lfd_gym.evaluation import evaluate
from lfd_gym.recording import record
from policies.movement_primitives import MovementPrimitives, learn_primitives
from policies.sequence_graph import segments
from policies.sequence_graph_learner import SequenceGraphLearner
from policies.task_data import CONTROLLED, HAND, ORIENTATION, POSITION, measure, primitive_table
from policies.task_space import CYLINDRICAL
from scripted_teachers.box_flipping import BoxFlippingTeacher
from scripted_teachers.move_object import MoveObjectTeacher
from scripted_teachers.whiteboard import WhiteboardTeacher


@pytest.fixture(scope="module")
def shown() -> list[Demonstration]:
    return record("move-object", MoveObjectTeacher(noise=1.0), n=3, seed=0).demonstrations


@pytest.fixture(scope="module")
def flips() -> list[Demonstration]:
    return record("box-flipping", BoxFlippingTeacher(noise=1.0), n=3, seed=0).demonstrations


def learn(demonstrations: Sequence[Demonstration]) -> MovementPrimitives:
    rows = demonstrations[0].primitives
    table = primitive_table(rows, list(demonstrations[0].observations))
    measured = [measure(demonstration.observations, table.frames) for demonstration in demonstrations]
    return learn_primitives([row.name for row in rows], table, demonstrations, measured, "arclength")


def row(primitives: MovementPrimitives, name: str) -> int:
    return next(i for i, full in enumerate(primitives.names) if name in full)


def cut(demonstration: Demonstration, n: int, success: bool = True) -> Demonstration:
    """Its first n steps."""
    return dataclasses.replace(
        demonstration,
        observations={name: values[: n + 1] for name, values in demonstration.observations.items()},
        actions=demonstration.actions[:n],
        rewards=demonstration.rewards[:n],
        states=demonstration.states[: n + 1],
        labels=demonstration.labels[:n],
        success=success,
    )


def part(demonstration: Demonstration, name: str) -> slice:
    """The steps of a primitive's first segment."""
    k = next(i for i, row in enumerate(demonstration.primitives) if name in row.name)
    return next(slice(s.start, s.stop) for s in segments(demonstration.labels) if s.label == k)


@pytest.mark.parametrize("steps", [1, 4, 8, 12])
@pytest.mark.parametrize("name", ["carry", "withdraw"])
def test_a_recording_that_breaks_off_after_a_transition_moves_no_goal(shown, name: str, steps: int) -> None:
    whole = learn(shown)
    k = row(whole, name)
    begin = next(s.start for s in segments(shown[2].labels) if s.label == k)
    broken = learn([*shown[:2], cut(shown[2], begin + steps)])
    np.testing.assert_allclose(broken.goal[k, POSITION], learn(shown[:2]).goal[k, POSITION], atol=0.01)


def test_a_failed_recording_moves_no_goal_and_no_force_wherever_it_breaks_off(flips) -> None:
    """Also in a press or a slow start, which looks like a movement that came to rest."""
    whole = learn(flips[:2])
    most = np.full(whole.goal.shape, 0.1)
    most[:, POSITION] = np.where((whole.table.space == CYLINDRICAL)[:, None], [0.015, 0.1, 0.015], 0.015)
    for n in range(part(flips[2], "push").start + 4, len(flips[2]), 4):
        broken, k = learn([*flips[:2], cut(flips[2], n, success=False)]), flips[2].labels[n - 1]
        off = np.abs(broken.goal - whole.goal) * (whole.table.modes == CONTROLLED)
        assert (off[k] <= most[k]).all()
        np.testing.assert_allclose(broken.force[k], whole.force[k], atol=1.0)


def test_a_press_that_breaks_off_presses_no_less(flips) -> None:
    """Nor where no recording says that it failed: it had not moved."""
    broken = [cut(d, part(d, "flip").start + 3) for d in flips[1:]]
    np.testing.assert_array_equal(learn([flips[0], *broken]).force, learn(flips[:1]).force)


@pytest.mark.parametrize("turn", [3.5, 4.2])
def test_what_breaks_off_does_not_depend_on_where_the_angle_is_counted_from(flips, turn: float) -> None:
    flip = part(flips[2], "flip")
    broken = [*flips[:2], cut(flips[2], (flip.start + flip.stop) // 2)]
    whole, other = learn(broken), learn([_about_its_axis(d, turn) for d in broken])
    np.testing.assert_allclose(other.force, whole.force, atol=1e-6)
    np.testing.assert_allclose(other.speed, whole.speed, atol=1e-9)
    round_ = whole.table.space == CYLINDRICAL
    np.testing.assert_allclose(other.goal[round_][:, [0, 2]], whole.goal[round_][:, [0, 2]], atol=1e-6)


def _about_its_axis(demonstration: Demonstration, angle: float) -> Demonstration:
    """With the frame of the edge turned about its z axis [rad]."""
    frame, turn = demonstration.observations["frame_obstacle_edge"].copy(), np.array([0.0, 0.0, angle])
    frame[:, 3:] = [quaternion.multiply(q, quaternion.from_rotation_vector(turn)) for q in frame[:, 3:]]
    return dataclasses.replace(demonstration, observations={**demonstration.observations, "frame_obstacle_edge": frame})


def test_rows_that_share_an_orientation_share_it_whichever_axes_they_hold(shown) -> None:
    """Tilted about y at the end of the last movement."""
    k = row(learn(shown), "withdraw")
    control = shown[0].primitives[0].orientation
    for axes in (("position",) * 3, ("hold", "position", "position")):
        shared = EntityControl(99, control.frame, "rotation", axes)
        rows = tuple(
            primitive._replace(orientation=shared) if i in (0, k) else primitive
            for i, primitive in enumerate(shown[0].primitives)
        )
        taught = [dataclasses.replace(_tilted_at_the_end(d, k, 0.1), primitives=rows) for d in shown]
        learned = learn(taught)
        np.testing.assert_allclose(learned.mean[0], learned.mean[k])
        np.testing.assert_allclose(learned.goal[0, ORIENTATION], learned.goal[k, ORIENTATION])


@pytest.mark.parametrize("n", [2, 3])
def test_a_hand_that_was_not_observed_cannot_be_controlled(n: int) -> None:
    taught = record("whiteboard", WhiteboardTeacher(noise=0.0), n=1, seed=0).demonstrations * n
    hand = EntityControl(0, "world", "joints", ("position",) * 4)
    rows = tuple(primitive._replace(hand=hand) for primitive in taught[0].primitives)
    with pytest.raises(DemonstrationError, match="no observation 'hand_position'"):
        SequenceGraphLearner().fit([dataclasses.replace(d, primitives=rows) for d in taught])


def test_where_failed_recordings_break_off_is_no_end(shown) -> None:
    broken = [cut(d, part(d, "grasp").stop, success=False) for d in shown[1:]]
    with pytest.warns(UserWarning, match="not solved in demonstration 1, 2"):
        skill = SequenceGraphLearner().fit([shown[0], *broken]).skill_
    for i, node in enumerate(skill.nodes[:-1]):
        assert i not in node.targets[1:]
        assert np.isfinite(node.patience)
    assert evaluate("move-object", skill, episodes=1, seed=100000).success_rate == 1.0


def test_a_primitive_that_only_a_failed_recording_shows_can_be_stayed_in(shown) -> None:
    """In a fully connected graph, where it is left for all others."""
    names = [primitive.name for primitive in shown[0].primitives]
    k, other = names.index("withdraw"), names.index("release")
    whole = [dataclasses.replace(d, labels=np.where(d.labels == k, other, d.labels)) for d in shown[:2]]
    last = part(shown[2], "withdraw")
    broken = cut(shown[2], (last.start + last.stop) // 2, success=False)
    with pytest.warns(UserWarning, match="not solved in demonstration 2"):
        skill = SequenceGraphLearner(graph="fully-connected").fit([*whole, broken]).skill_
    assert k in skill.graph.labels
    assert all(node.targets[0] == i for i, node in enumerate(skill.nodes) if i > 0)


def test_a_movement_that_ends_a_recording_counts_where_it_did_not_need_to_move(shown) -> None:
    """The tool stays upright while it withdraws: the tilt at the end is as good a goal as any."""
    k = row(learn(shown), "withdraw")
    tilted = learn([_tilted_at_the_end(demonstration, k, 0.04) for demonstration in shown])
    off = quaternion.multiply(reached(tilted, k), quaternion.conjugate(reached(learn(shown), k)))
    assert np.linalg.norm(quaternion.to_rotation_vector(off)) > 0.01


def reached(primitives: MovementPrimitives, k: int) -> np.ndarray:
    """Orientation at the goal of primitive k."""
    return quaternion.multiply(quaternion.from_rotation_vector(primitives.goal[k, ORIENTATION]), primitives.mean[k])


def _tilted_at_the_end(demonstration: Demonstration, k: int, angle: float) -> Demonstration:
    observations, last = dict(demonstration.observations), segments(demonstration.labels)[-1]
    assert last.label == k
    turned = observations["tool_quaternion"].copy()
    turn = quaternion.from_rotation_vector(np.array([angle, 0.0, 0.0]))
    for t in range(last.start, len(turned)):
        turned[t] = quaternion.multiply(turn, turned[t])
    return dataclasses.replace(demonstration, observations=observations | {"tool_quaternion": turned})


def test_a_finger_that_pressed_once_presses_to_that_side(shown) -> None:
    k = row(learn(shown), "carry")
    torques = (0.7, -0.003, -0.003)
    pressing = [_with_torque(demonstration, k, torque) for demonstration, torque in zip(shown, torques, strict=True)]
    assert learn(pressing).grip[k, 1] > 0.0


def _with_torque(demonstration: Demonstration, k: int, torque: float) -> Demonstration:
    values = demonstration.observations["hand_torque"].copy()
    for segment in segments(demonstration.labels):
        if segment.label == k:
            values[segment.start : segment.stop + 1, HAND.start - 5] = torque
    return dataclasses.replace(demonstration, observations={**demonstration.observations, "hand_torque": values})


@pytest.mark.parametrize("angle", [2.0, 3.3, 4.5])
def test_a_turn_of_more_than_half_a_turn_has_its_goal_where_it_ends(shown, angle: float) -> None:
    turning = [_turned(demonstration, angle) for demonstration in shown]
    primitives = learn(turning)
    k = row(primitives, "withdraw")
    off = quaternion.multiply(reached(primitives, k), quaternion.conjugate(np.array([0.0, 0.0, 1.0, 0.0])))
    assert np.linalg.norm(quaternion.to_rotation_vector(off)) < 0.02


def _turned(demonstration: Demonstration, angle: float) -> Demonstration:
    """The last primitive turns by an angle about the vertical, smoothly, to the tool's reference, and rests there."""
    last = segments(demonstration.labels)[-1]
    turned, n = demonstration.observations["tool_quaternion"].copy(), len(demonstration) + 1 - last.start
    s = np.minimum(np.linspace(0.0, 1.5, n), 1.0)
    for t, left in zip(
        range(last.start, len(turned)), angle * (1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2)), strict=True
    ):
        turn = quaternion.from_rotation_vector(np.array([0.0, 0.0, left]))
        turned[t] = quaternion.multiply(turn, np.array([0.0, 0.0, 1.0, 0.0]))
    return dataclasses.replace(demonstration, observations={**demonstration.observations, "tool_quaternion": turned})
