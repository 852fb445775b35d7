"""What is measured, and between which values: the observation space of all tasks."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lfd_gym import wam

Array = NDArray[np.float64]
Bounds = dict[str, tuple[Array, Array]]


def bounds(
    joint_range: Array, tool: str, frames: Iterable[str], features: Mapping[str, tuple[ArrayLike, ArrayLike]]
) -> Bounds:
    """Lowest and highest value of every observation, in the order in which the robot writes them.

    Args:
        joint_range: of the model's joints, the arm's first [rad], shape (>= 7, 2).
        tool: "hand", which is measured, or "pen".
        frames: names of the tracked bodies.
        features: bounds of the task's own observations.
    """
    low, high = joint_range[: wam.N_JOINTS].T
    unit = np.ones(4)
    position, wrench = np.full(3, 5.0), np.array([2000.0] * 3 + [500.0] * 3)
    twist = np.array([10.0] * 3 + [40.0] * 3)
    found: Bounds = {
        "joint_position": (low - 0.2, high + 0.2),
        "joint_velocity": (np.full(7, -20.0), np.full(7, 20.0)),
        "tool_position": (-position, position),
        "tool_quaternion": (-unit, unit),
        "tool_velocity": (-twist, twist),
        "reference_position": (-position, position),
        "reference_quaternion": (-unit, unit),
        "reference_velocity": (-twist, twist),
        "wrench": (-wrench, wrench),
    }
    if tool == "hand":
        found["hand_position"] = (np.array(wam.HAND_LOW) - 0.2, np.array(wam.HAND_HIGH) + 0.2)
        found["hand_torque"] = (-5.0 * unit, 5.0 * unit)
    for name in frames:
        found[f"frame_{name}"] = (np.concatenate([-position, -unit]), np.concatenate([position, unit]))
    for name, (least, most) in features.items():
        found[name] = (np.array(least, dtype=np.float64), np.array(most, dtype=np.float64))
    return found
