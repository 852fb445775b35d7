"""What counts as an object on its target, and what the dense reward of MoveObject pays for."""

import math
from typing import Any

import numpy as np
import pytest
from placed_arm import succeeds_with_tool_at

from lfd_gym import quaternion
from lfd_gym.envs.move_object import MoveObjectEnv
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


@pytest.fixture(scope="module")
def world() -> MoveObjectEnv:
    """The target at (0.6, 0.1)."""
    world = MoveObjectEnv()
    world.reset(seed=0, options={"setup": {"target": {"position": [0.6, 0.1]}}})
    return world


def succeeds(
    world: Any, off: Any = (0, 0), up: float = 0, tilt: float = 0, speed: Any = 0, tool: Any = (0, 0, 0.2)
) -> bool:
    """With the object so far off the target, above the table, tilted and moving, the tool so far from the object."""
    body, place = world.data.joint("object_joint"), np.array([0.6 + off[0], 0.1 + off[1], 0.045 + up])
    body.qpos[:3], body.qpos[3:] = place, quaternion.from_rotation_vector(np.array([tilt, 0.0, 0.0]))
    body.qvel[:3] = speed
    return succeeds_with_tool_at(world, place + tool)


@pytest.mark.parametrize(
    ("inside", "outside"),
    [
        ({"off": (-0.0195, 0.0)}, {"off": (-0.0205, 0.0)}),
        ({"off": (0.0135, 0.0135)}, {"off": (0.0145, 0.0145)}),
        ({"up": 0.0045}, {"up": 0.0055}),
        ({"tilt": math.acos(0.982)}, {"tilt": math.acos(0.978)}),
        ({"speed": (0.0, -0.019, 0.0)}, {"speed": (0.0, -0.021, 0.0)}),
        ({"tool": (0.0, 0.0, 0.101)}, {"tool": (0.0, 0.0, 0.099)}),
        ({"tool": (0.0, -0.137, -0.003)}, {"tool": (0.0, -0.137, -0.006)}),
        ({"tool": (0.025, 0.137, -0.003)}, {"tool": (0.025, 0.137, -0.006)}),
    ],
    ids=["off", "off both ways", "height", "tilt", "speed", "tool", "third fingertip", "second fingertip"],
)
def test_success_needs_the_object_on_target_standing_at_rest_and_left(world: Any, inside: Any, outside: Any) -> None:
    assert succeeds(world, **inside)
    assert not succeeds(world, **outside)
