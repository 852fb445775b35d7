"""The mean orientation of aligned demonstrations, at every time step in the frame in which they differ least."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

WINDOW = 0.5
"""Spreads are averaged over this time [s]."""
SWITCH = 0.1
"""Cost of changing frames: a spread of about 18 degrees for one second [s]."""

DECIMALS = 9
"""Of a spread: what differs less is rounding."""


class OrientationSchedule(NamedTuple):
    """Per time step the orientation of the tool."""

    quaternion: Array
    """(N, 4) relative to a frame."""
    frame: NDArray[np.int64]
    """(N,) the frame."""


def learn_orientations(quaternions: Sequence[Array], axes: Sequence[Array], dt: float) -> OrientationSchedule:
    """The schedule of aligned demonstrations, with orientations (N, 4) in the world and axes (F, 3, 3) of the frames at rest.

    The spread in a frame is the mean squared distance |R - R_mean|^2 / 2 of the rotation matrices; frames change where that
    pays, by the sequence of least spread over time plus `SWITCH` for every change. Equally good frames: the first one, so
    that a single demonstration's orientations are those in the world.
    """
    turns = [Rotation.from_quat(q, scalar_first=True).as_matrix() for q in quaternions]
    relative = np.mean([a.swapaxes(1, 2) @ turn[:, None] for a, turn in zip(axes, turns, strict=True)], axis=0)
    u, s, vt = np.linalg.svd(relative)
    sign = np.ones_like(s)
    sign[..., 2] = np.linalg.det(u @ vt)
    mean = (u * sign[..., None, :]) @ vt
    spread = uniform_filter1d(3.0 - (s * sign).sum(axis=2), max(round(WINDOW / dt), 1), axis=0)
    frame = cheapest_sequence(np.round(spread, DECIMALS) * dt, SWITCH)
    chosen = mean[np.arange(len(frame)), frame]
    return OrientationSchedule(Rotation.from_matrix(chosen).as_quat(canonical=True, scalar_first=True), frame)


def cheapest_sequence(costs: Array, switch: float) -> NDArray[np.int64]:
    """The sequence (N,) of columns of costs (N, F) with the least sum, each change costing `switch` more (Viterbi)."""
    total, came = costs[0].copy(), np.zeros(costs.shape, dtype=np.int64)
    for i in range(1, len(costs)):
        best = int(np.argmin(total))
        stays = total <= total[best] + switch
        came[i] = np.where(stays, np.arange(len(total)), best)
        total = np.minimum(total, total[best] + switch) + costs[i]
    sequence = np.empty(len(costs), dtype=np.int64)
    sequence[-1] = int(np.argmin(total))
    for i in range(len(costs) - 1, 0, -1):
        sequence[i - 1] = came[i, sequence[i]]
    return sequence
