"""Demonstrations brought to a common time (thesis 4.3.2)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lfd_gym.errors import DemonstrationError
from policies.moa.frames import Frames, resample
from policies.moa.time_warping import warping_path

Array = NDArray[np.float64]

MOST_PAIRS = 100_000_000
"""Of steps, at 32 bytes each."""


def frame_distances(local: Array, other: Array) -> Array:
    """Cost (N, M) of (4.30): the distance of two points in the frame in which they are nearest; inputs (N, F, d), (M, F, d)."""
    nearest = np.full((len(local), len(other)), np.inf)
    for f in range(local.shape[1]):
        a, b = local[:, f], other[:, f]
        squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
        np.minimum(nearest, squared, out=nearest)
    return np.sqrt(np.maximum(nearest, 0.0))


def warp(reference: Array, other: Array) -> Array:
    """Fractional time steps (N,) of `other` (M, F, d) that match the steps of `reference` (N, F, d).

    Monotone; first and last steps match. A step of the reference with several partners gets their mean. Raises
    DemonstrationError for more steps than fit into memory pair by pair.
    """
    if len(reference) * len(other) > MOST_PAIRS:
        raise DemonstrationError(
            f"demonstrations of {len(reference)} and {len(other)} steps are too long to be aligned; use a lower control_hz"
        )
    here, there = warping_path(frame_distances(reference, other)).T
    index = np.bincount(here, weights=there) / np.bincount(here)
    index[0], index[-1] = 0.0, len(other) - 1.0
    return np.asarray(index)


def align(
    trajectories: Sequence[Array],
    frames: Sequence[Frames],
    reference: int | None = None,
) -> list[Array]:
    """The warp (N,) of every trajectory (N_m, d) to the time of a reference.

    The reference is one of the trajectories; where None, that of `median_length`. Trajectories of other entities
    that were recorded at the same time are aligned by the same warps.
    """
    local = [frame.local(points) for points, frame in zip(trajectories, frames, strict=True)]
    if reference is None:
        reference = median_length(trajectories)
    own = np.arange(len(local[reference]), dtype=np.float64)
    return [own if m == reference else warp(local[reference], other) for m, other in enumerate(local)]


def median_length(trajectories: Sequence[Array]) -> int:
    """Index of the first trajectory of median length, the shorter one of two."""
    return int(np.argsort([len(points) for points in trajectories], kind="stable")[(len(trajectories) - 1) // 2])


def warped(points: Array, frames: Frames, index: Array) -> tuple[Array, Frames]:
    """Trajectory and frames at the fractional time steps of a warp."""
    return resample(points, index), frames.resampled(index)
