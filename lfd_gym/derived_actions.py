"""Actions for a motion that nobody commanded: the attractor (2.1) inverted on the smoothed recording."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter
from scipy.spatial.transform import Rotation

from lfd_gym import attractor
from lfd_gym.action import DEAD_ZONE, ActionLayout

Array = NDArray[np.float64]

WINDOW = 0.3
"""Length of the smoothing window [s]."""


def derive_actions(observations: Mapping[str, Array], commanded: Array, layout: ActionLayout, dt: float) -> Array:
    """Goals that would have moved the reference as the tool was moved.

    g = x + (a + alpha v) / (alpha beta) with position, velocity and acceleration from a Savitzky-Golay filter; the same for
    the rotation vector about the mean orientation. The force is what the tool exerted on the world, smoothed, where it
    exceeds the dead zone. The fingers keep what they were told.

    Args:
        observations: arrays with T + 1 rows.
        commanded: actions (T, A) whose hand part counts.
        layout: of the actions.
        dt: time step [s].

    Returns:
        Actions, shape (T, A), float32.
    """
    n = len(commanded)
    rotations = Rotation.from_quat(observations["tool_quaternion"], scalar_first=True)
    mean = rotations.mean()
    goals = _goal(observations["tool_position"], layout, dt)
    turns = _goal((rotations * mean.inv()).as_rotvec(), layout, dt)
    orientations = (Rotation.from_rotvec(turns) * mean).as_quat(scalar_first=True)
    force = -_smooth(observations["wrench"][:, :3], dt)
    force[np.linalg.norm(force, axis=1) < DEAD_ZONE * layout.force_limit] = 0.0
    hands = [layout.decode(action).hand for action in commanded]
    return np.stack([layout.encode(goals[i], orientations[i], force[i], hands[i]) for i in range(n)])


def _goal(x: Array, layout: ActionLayout, dt: float) -> Array:
    return attractor.goal(_smooth(x, dt), _smooth(x, dt, 1), _smooth(x, dt, 2), layout.alpha, layout.beta)


def _smooth(x: Array, dt: float, derivative: int = 0) -> Array:
    window = min(max(2 * round(0.5 * WINDOW / dt) + 1, 5), len(x) - 1 + len(x) % 2)
    return savgol_filter(x, window, min(3, window - 1), deriv=derivative, delta=dt, axis=0)
