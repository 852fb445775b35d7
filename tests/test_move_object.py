"""What the dense reward of MoveObject pays for."""

import numpy as np

from lfd_gym.registry import make
from lfd_gym.rollout import TeacherPolicy, rollout
from scripted_teachers.move_object import MoveObjectTeacher


def test_nearness_to_the_target_pays_in_the_grip_only() -> None:
    """Without the object in its hand a robot earns no more for carrying its open hand to the target."""
    env = make("move-object", reward_type="dense")
    world, gripped, paid, lifted = env.unwrapped, [], [], []
    for step in rollout(env, TeacherPolicy(MoveObjectTeacher(noise=0.0)), 100000):
        gripped.append(world._gripped())
        paid.append(step.reward)
        lifted.append(world.subtask_flags()[0])
    first, last = np.flatnonzero(gripped)[[0, -1]]
    assert max(paid[:first]) < 0.1 < 0.18 < min(paid[first:last])
    assert not any(lifted[:first] + lifted[last + 1 :])
    assert np.mean(gripped[first : last + 1]) > 0.9
    assert paid[first] < 0.4 < 0.5 < paid[last]
