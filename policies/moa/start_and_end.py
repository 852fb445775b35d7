"""Movements relative to their start and end points (thesis 4.4.1)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from policies.moa.frames import Frames

Array = NDArray[np.float64]


def start_and_end(points: Array) -> Frames:
    """Two frames with the world's axes, at the first and the last point of a trajectory (N, d)."""
    return Frames.at(points[[0, -1]])


def least_error(trajectories: Sequence[Array]) -> Array:
    """The least mean squared error (N,) per time step that time-varying weights of start and end can reach.

    Of aligned trajectories (N, d) every model x_i = w_i start + (1 - w_i) end + q_i with 0 <= w_i <= 1 is in this class, MoA
    with these two frames among them; w_i and q_i are optimal for each step on its own.
    """
    points = np.array(trajectories)
    way = points[:, :1] - points[:, -1:]
    way = way - way.mean(axis=0)
    rest = points - points[:, -1:]
    rest = rest - rest.mean(axis=0)
    along, length = (rest * way).sum(axis=(0, 2)), (way**2).sum(axis=(0, 2))
    weight = np.divide(along, length, out=np.zeros_like(along), where=length > 0.0).clip(0.0, 1.0)
    return np.asarray(((rest - weight[:, None] * way) ** 2).sum(axis=2).mean(axis=0))
