"""The arm where a test wants it."""

from typing import Any

import mujoco
import numpy as np

from lfd_gym import wam


def posture(model: mujoco.MjModel, tool: str, place: np.ndarray) -> np.ndarray:
    """Joint angles (7,) with the tool point at a place [m], pointing down."""
    arm = wam.inverse_kinematics(model, tool, place, wam.TOOL_DOWN)
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
