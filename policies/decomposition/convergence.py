"""Segments as points that say where they converge to: what the Directional Normal Distribution is given (thesis 3.2, 3.3).

A position is seen together with its force, x = (position, force / 40), as in thesis 3.5. Velocities have unit length in every
space, so that densities can be compared; a cylindrical space has its Jacobian.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.decomposition.geometry import Euclidean, Geometry, Rotations
from policies.decomposition.task_spaces import EntitySegments, end_samples

Array = NDArray[np.float64]

FORCE_SCALE = 1.0 / 40.0
"""[m/N] (thesis 3.5; 1/20 to 1/80 gave the same there)."""
SLOW = 0.15
"""Share of a segment's peak speed below which a point's direction is noise."""
POWER = 4.0
"""Weights (i / N)^4 toward the end of a segment, as (2.6) has them: a bow counts less."""
POINTS = 6
"""Points that stand for a segment: each for an equal share of the weight."""


class Converging(NamedTuple):
    """L segments with Q points each, in F task spaces."""

    spaces: tuple[Geometry, ...]
    """Per space the L Q points."""
    log_jacobian: Array
    """(F, L Q)."""
    ends: Array
    """(F, L, D) where the segments end, as means to begin with."""
    n_points: int
    """Q."""


def converging(data: EntitySegments, ends_only: bool = False) -> Converging:
    """The points of an entity's segments; of the ends only, one anchor per segment."""
    n_points = 1 if ends_only else POINTS
    chosen = [_chosen(data, i, n_points) for i in range(len(data.segments))]
    geometries: list[Geometry] = []
    log_jacobians, ends = [], []
    for f, space in enumerate(data.spaces):
        x, v, jacobian, own_ends = [], [], [], []
        for i, (at, peak) in enumerate(chosen):
            view = data.views[i][f]
            last = view.end
            if data.entity == "position":
                full = np.hstack([view.samples, FORCE_SCALE * view.force])
                rates = np.gradient(full, data.dt, axis=0)
                last = np.concatenate([view.end, FORCE_SCALE * view.force_level])
            else:
                full, rates = view.samples, view.velocities
            speed = np.linalg.norm(view.velocities[at], axis=1)
            moves = (speed > SLOW * peak) & (peak > 0.0) & (not ends_only)
            length = np.linalg.norm(rates[at], axis=1, keepdims=True)
            x.append(last[None] if ends_only else full[at])
            v.append(np.where(moves[:, None], rates[at] / np.maximum(length, 1e-12), 0.0))
            radii = x[-1][:, 0] if space.space == "cylindrical" else np.full(n_points, space.radius)
            jacobian.append(np.log(space.radius / np.maximum(radii, 1e-3)))
            own_ends.append(last)
        kind = Rotations if data.entity == "orientation" else Euclidean
        geometries.append(kind(np.concatenate(x), np.concatenate(v)))
        log_jacobians.append(np.concatenate(jacobian))
        ends.append(np.array(own_ends))
    return Converging(tuple(geometries), np.array(log_jacobians), np.array(ends), n_points)


def _chosen(data: EntitySegments, i: int, n_points: int) -> tuple[NDArray[np.int64], float]:
    """Which samples stand for a segment, and its peak speed in the world.

    The slow start is dropped, the rest after the motion counts for its first few samples: how long it lasts says nothing.
    """
    part, view, n_end = data.segments[i], data.views[i][0], end_samples(data.dt)
    speed, moving = np.linalg.norm(view.velocities, axis=1), part.rest - part.start
    if not part.moves:
        return np.round(np.linspace(max(len(speed) - n_end, 0), len(speed) - 1, n_points)).astype(np.int64), 0.0
    peak = float(speed[: moving + 1].max())
    fast = np.flatnonzero(speed[: moving + 1] > SLOW * peak)
    last = min(moving + n_end, len(speed) - 1)
    candidates = np.r_[fast, np.arange(fast[-1] + 1, last + 1)]
    weights = ((candidates - candidates[0] + 1.0) / (candidates[-1] - candidates[0] + 1.0)) ** POWER
    shares = np.cumsum(weights) / weights.sum()
    return candidates[np.searchsorted(shares, (np.arange(n_points) + 0.5) / n_points)], peak
