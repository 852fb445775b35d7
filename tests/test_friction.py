"""Friction that is asked for, and what varies and is hidden, acts."""

from typing import Any

import mujoco
import numpy as np
import pytest
from registered import IDS

from lfd_gym.registry import ENVIRONMENTS, load, look_up, make
from lfd_gym.rollout import TeacherPolicy, rollout
from scripted_teachers import TEACHERS

SEED = 100000
TASKS = {env_id: load(ENVIRONMENTS[env_id].entry_point) for env_id in IDS}
TOUCHED_BY_HAND = [i for i, task in TASKS.items() if task.tool == "hand" and {"grip", "press"} & {*task.controls}]


def shown(env: Any, env_id: str) -> Any:
    """Steps of the noise-free teacher."""
    return rollout(env, TeacherPolicy(look_up(TEACHERS, "teacher for", env_id)(noise=0.0)), SEED)


def grips(env: Any) -> list[mujoco.MjContact]:
    """Contacts between a fingertip and what is no part of the hand."""
    found, model = [], env.model
    for contact in env.data.contact:
        pair = [model.geom(int(geom)) for geom in contact.geom]
        in_hand = [model.body(int(geom.bodyid[0])).name.startswith("hand/") for geom in pair]
        if in_hand.count(True) == 1 and pair[in_hand.index(True)].name.endswith("_tip"):
            found.append(contact)
    return found


@pytest.mark.parametrize("env_id", TOUCHED_BY_HAND)
def test_the_asked_fingertip_friction_is_that_of_every_grip(env_id: str) -> None:
    env = make(env_id, fingertip_friction=0.7)
    for _ in shown(env, env_id):
        found = grips(env.unwrapped)
        if found:
            break
    assert found
    np.testing.assert_array_equal([contact.friction[0] for contact in found], 0.7)


@pytest.mark.parametrize("env_id", IDS)
def test_every_mass_and_friction_that_varies_acts(env_id: str) -> None:
    """A tenth more of it, and the same actions move the world otherwise."""
    env = make(env_id)
    world, path, actions = env.unwrapped, [], []
    for step in shown(env, env_id):
        actions.append(step.action)
        path.append(world.data.qpos.copy())
    m = world.model
    hidden = m.body_mass, m.geom_friction, m.pair_friction, m.dof_frictionloss
    varied = [i for i, view in enumerate(world._randomised) if any(np.may_share_memory(view, h) for h in hidden)]
    assert varied
    for i in varied:
        env.reset(seed=SEED)
        world._randomised[i] *= 1.1
        assert any(differs(env, action, before) for action, before in zip(actions, path, strict=True)), i


def differs(env: Any, action: np.ndarray, before: np.ndarray) -> bool:
    """Whether a step leads to another place than before."""
    env.step(action)
    return not np.array_equal(env.unwrapped.data.qpos, before)
