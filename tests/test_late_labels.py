"""Labels that come after the next movement has begun teach what labels in time teach."""

import dataclasses

import numpy as np
import pytest
from kinematic_world import CLOSE, TWIST, solve, teach

from lfd_gym.demonstration import Demonstration
from policies.late_labels import LATE, on_time
from policies.sequence_graph import segments
from policies.sequence_graph_learner import SequenceGraphLearner
from policies.task_data import measure, primitive_table


def late(demonstration: Demonstration, *steps: int) -> Demonstration:
    """Every change of the labels comes so many steps later, in turn."""
    labels = demonstration.labels.copy()
    for i, part in enumerate(segments(demonstration.labels)[:-1]):
        labels[part.stop : part.stop + steps[i % len(steps)]] = part.label
    return dataclasses.replace(demonstration, labels=labels)


def corrected(demonstration: Demonstration) -> np.ndarray:
    table = primitive_table(demonstration.primitives, list(demonstration.observations))
    return on_time(demonstration, measure(demonstration.observations, table.frames), table).labels


@pytest.mark.parametrize("steps", [(2,), (5,), (10,), (0, 7, 3)])
def test_a_skill_of_late_labels_solves_the_task(steps: tuple[int, ...]) -> None:
    skill = SequenceGraphLearner().fit([late(teach(seed), *steps) for seed in range(3)]).skill_
    assert all(solve(skill, seed)[0] for seed in range(100, 104))


def test_a_grip_that_is_let_go_with_the_last_sample_was_held() -> None:
    shown = [teach(seed) for seed in range(3)]
    loosened = []
    for demonstration in shown:
        torque = demonstration.observations["hand_torque"].copy()
        torque[[part.stop for part in segments(demonstration.labels)]] = 0.0
        seen = {**demonstration.observations, "hand_torque": torque}
        loosened.append(dataclasses.replace(demonstration, observations=seen))
    held, let_go = (SequenceGraphLearner().fit(own).skill_.primitives.grip for own in (shown, loosened))
    assert (held[TWIST] > 0.0).any()
    assert np.array_equal(let_go, held)


def test_labels_in_time_stay() -> None:
    for seed in range(5):
        assert np.array_equal(corrected(teach(seed)), teach(seed).labels)


def test_a_movement_that_was_interrupted_ends_where_it_was() -> None:
    """The hand never rests before the label changes: what was to be seen is that it is still closing."""
    demonstration = teach(0)
    part = next(part for part in segments(demonstration.labels) if part.label == CLOSE)
    closing = np.abs(np.diff(demonstration.observations["hand_position"][part.start : part.stop, 1])) > 1e-3
    stop = part.start + int(np.flatnonzero(closing)[-1]) - 5
    labels = demonstration.labels.copy()
    labels[stop : part.stop] = demonstration.labels[part.stop]
    assert stop - part.start > LATE / demonstration.dt
    broken = dataclasses.replace(demonstration, labels=labels)
    assert np.array_equal(corrected(broken), labels)
