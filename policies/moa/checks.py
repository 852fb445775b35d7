"""What demonstrations have to be like before anything is learned from them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lfd_gym.errors import DemonstrationError, InvalidArgumentError
from policies.moa.attractors import BoxAttractors
from policies.moa.frames import Frames

Array = NDArray[np.float64]

FEWEST = 3
"""Points of a movement: two fix its start (4.13), and one is left to explain."""


def checked(trajectories: Sequence[ArrayLike], frames: Sequence[Frames] | None) -> tuple[list[Array], list[Frames]]:
    """Trajectories as arrays (N_m, d), and their frames; the world alone where None.

    Raises:
        DemonstrationError: no demonstration, fewer than 3 points, values that are not finite, dimensions or frames that differ
            between demonstrations, frames that move for another number of steps, or a movement without length.
    """
    points = [np.asarray(trajectory, dtype=np.float64) for trajectory in trajectories]
    if not points:
        raise DemonstrationError("no demonstration was given; at least 1 is needed")
    for m, x in enumerate(points):
        if x.ndim != 2 or len(x) < FEWEST or not x.shape[1]:
            raise DemonstrationError(
                f"demonstration {m} has the shape {x.shape}; needed: at least {FEWEST} points (N, d)"
            )
        if not np.isfinite(x).all():
            raise DemonstrationError(
                f"demonstration {m} is not finite at step {np.flatnonzero(~np.isfinite(x).all(1))[0]}"
            )
        if x.shape[1] != points[0].shape[1]:
            raise DemonstrationError(
                f"demonstration {m} has {x.shape[1]} dimensions, demonstration 0 {points[0].shape[1]}"
            )
        if np.ptp(x, axis=0).max() == 0.0:
            raise DemonstrationError(f"demonstration {m} has length 0: it never moves")
    if frames is None:
        return points, [Frames.world(points[0].shape[1])] * len(points)
    frames = list(frames)
    if len(frames) != len(points):
        raise DemonstrationError(f"{len(points)} demonstrations came with the frames of {len(frames)}")
    for m, (x, frame) in enumerate(zip(points, frames, strict=True)):
        if len(frame) != len(frames[0]):
            raise DemonstrationError(f"demonstration {m} has {len(frame)} frames, demonstration 0 {len(frames[0])}")
        if frame.n_dimensions != x.shape[1]:
            raise DemonstrationError(f"demonstration {m} has {x.shape[1]} dimensions, its frames {frame.n_dimensions}")
        if frame.n_steps not in (None, len(x)):
            raise DemonstrationError(f"demonstration {m} has {len(x)} points, its frames {frame.n_steps} time steps")
    return points, frames


def checked_bounds(bounds: tuple[ArrayLike, ArrayLike], frames: Frames) -> BoxAttractors:
    """Attractors at the corners of given boxes; raises InvalidArgumentError for other shapes, low > high or no numbers."""
    low, high = (np.asarray(bound, dtype=np.float64) for bound in bounds)
    shape = (len(frames), frames.n_dimensions)
    if low.shape != shape or high.shape != shape or not (low <= high).all():
        raise InvalidArgumentError(f"bounds are two arrays {shape} with low <= high, not {low.shape} and {high.shape}")
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise InvalidArgumentError("bounds must be finite")
    return BoxAttractors(low, high)
