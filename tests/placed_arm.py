"""The arm where a test wants it."""

import math
from typing import Any

import mujoco
import numpy as np

from lfd_gym import wam


def posture(model: mujoco.MjModel, tool: str, place: np.ndarray) -> np.ndarray:
    """Joint angles (7,) with the tool point at a place [m], pointing down."""
    arm = inverse_kinematics(model, tool, place, wam.TOOL_DOWN)
    if arm is None:
        raise ValueError(f"the tool does not reach {place}")
    return arm


def succeeds_with_tool_at(world: Any, place: np.ndarray) -> bool:
    """What an environment's predicate says of its objects as they are, once the hand is there."""
    world.data.qpos[: wam.N_JOINTS] = posture(world.model, "hand", place)
    mujoco.mj_forward(world.model, world.data)
    np.testing.assert_allclose(world.data.site("hand/tool").xpos, place, atol=1e-4)
    world.after_physics()
    return bool(world.succeeded())


def inverse_kinematics(
    model: mujoco.MjModel, tool: str, position: np.ndarray, quaternion: np.ndarray
) -> np.ndarray | None:
    """Joint angles (7,) that bring the tool point to a pose, near `wam.HOME`; None where it is out of reach.

    Damped least squares on a scratch simulation; the answer keeps 3 degrees from every joint limit.
    """
    data = mujoco.MjData(model)
    low, high = model.jnt_range[: wam.N_JOINTS].T
    margin = math.radians(3.0)
    site = model.site(f"{tool}/tool").id
    jacobian, error, current = np.zeros((6, model.nv)), np.empty(6), np.empty(4)
    data.qpos[: wam.N_JOINTS] = wam.HOME
    for _ in range(200):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        error[:3] = position - data.site_xpos[site]
        mujoco.mju_mat2Quat(current, data.site_xmat[site])
        mujoco.mju_negQuat(current, current)
        mujoco.mju_mulQuat(turn := np.empty(4), quaternion, current)
        mujoco.mju_quat2Vel(error[3:], turn, 1.0)
        if np.abs(error[:3]).max() < 1e-5 and np.abs(error[3:]).max() < 1e-4:
            return data.qpos[: wam.N_JOINTS].copy()
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
        j = jacobian[:, : wam.N_JOINTS]
        step = j.T @ np.linalg.solve(j @ j.T + 1e-4 * np.eye(6), error)
        data.qpos[: wam.N_JOINTS] = np.clip(
            data.qpos[: wam.N_JOINTS] + step * min(1.0, 0.3 / max(np.abs(step).max(), 1e-9)),
            low + margin,
            high - margin,
        )
    return None
