"""From clusters of segments to movement primitives: frame, goal, confidence, force or position per axis (thesis 3.2.3)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from policies.decomposition.result import COMPLETE, EntityPrimitive
from policies.decomposition.task_spaces import EntitySegments, View, nearest_rotation

Array = NDArray[np.float64]

FORCE_THRESHOLD = 5.0
"""[N]: a weaker force is not what a primitive is about (thesis 3.5)."""
SMALLER_FORCE = 0.8
"""Share of the strongest axis below which a force comes along with it."""
NOT_MOVING = 0.1
"""Along an axis whose mean speed is below this share of the entity's usual one it does not move: a thread rises, a corner
slides."""
SLOWEST = 1e-3
"""[m/s]: below this it never moves (thesis 3.5)."""


def extract(
    data: EntitySegments,
    assignment: NDArray[np.int64],
    kinds: NDArray[np.int64],
    posteriors: Sequence[Array],
    held: Sequence[Sequence[bool]] | None = None,
) -> tuple[EntityPrimitive, ...]:
    """The primitives that segments are assigned to.

    Args:
        data: the segments of an entity.
        assignment, kinds: (L,) as in `EntityDecomposition`.
        posteriors: per primitive (F,) the probability of every task space.
        held: per primitive the axes that it leaves as they are; None: none.
    """
    usual = np.median([_speed(data, i) for i, part in enumerate(data.segments) if part.moves] or [0.0])
    primitives = []
    for k, posterior in enumerate(posteriors):
        f = int(np.argmax(posterior))
        members = np.flatnonzero((assignment == k) & (kinds == COMPLETE))
        members = members if len(members) else np.flatnonzero(assignment == k)
        views = [data.views[i][f] for i in members]
        goal, covariance = _goal(views, data.entity)
        size = 3 if data.entity == "orientation" else len(goal)
        axes = ["hold" if held is not None and held[k][i] else "position" for i in range(size)]
        force = np.zeros(3)
        if data.entity == "position":
            force = _force(data, members, f, float(usual))
            axes = ["force" if force[i] else axis for i, axis in enumerate(axes)]
        primitives.append(EntityPrimitive(data.spaces[f], np.asarray(posterior), goal, covariance, tuple(axes), force))
    return tuple(primitives)


def _goal(views: Sequence[View], entity: str) -> tuple[Array, Array]:
    ends = np.array([view.end for view in views])
    if entity != "orientation":
        return ends.mean(axis=0), _covariance(ends - ends.mean(axis=0))
    mean = nearest_rotation(ends.mean(axis=0).reshape(3, 3))
    turned = Rotation.from_matrix(ends.reshape(-1, 3, 3)) * Rotation.from_matrix(mean).inv()
    return mean.ravel(), _covariance(turned.as_rotvec())


def _covariance(deviations: Array) -> Array:
    return np.asarray(deviations.T @ deviations / max(len(deviations) - 1, 1))


def _force(data: EntitySegments, members: NDArray[np.int64], f: int, usual: float) -> Array:
    """(3,) median force of axes along which the members press and do not move [N], else 0."""
    forces = np.array([data.views[i][f].force_level for i in members])
    durations = [(data.segments[i].stop - data.segments[i].start) * data.dt for i in members]
    ways = np.array([np.abs(data.views[i][f].way) for i in members])
    speeds = np.median(ways / np.maximum(durations, data.dt)[:, None], axis=0)
    level = np.median(forces, axis=0)
    strongest = np.abs(level).max()
    presses = (np.abs(level) > FORCE_THRESHOLD) & (np.abs(level) > SMALLER_FORCE * strongest)
    return np.where(presses & (speeds < max(SLOWEST, NOT_MOVING * usual)), level, 0.0)


def _speed(data: EntitySegments, i: int) -> float:
    """Mean speed of a segment's motion in the world."""
    part, view = data.segments[i], data.views[i][0]
    return view.length / ((part.rest - part.start) * data.dt)
