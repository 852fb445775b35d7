"""How well a segment fits a primitive that did not simply end at its goal.

With eps the prior probabilities of the kinds, mu and v a primitive's predictive mean and variance in its most probable space, s
and e start and end of a segment, u the direction in which it arrives and m = u (mu - e) what remains:

    stopped early   log eps_S + log N_across(v + (kappa m)^2) - log tau - m / tau + v / (2 tau^2)
                    + log Phi((m - v / tau) / sqrt v): the Directional Normal Distribution at the end of the segment, with an
                    exponential prior on what remains
    pause inside    log eps_P - log L + log[Phi(t / sqrt v) - Phi((t - L) / sqrt v)] + log N_across(v + (kappa L)^2) with
                    L = |mu - s| and t the progress from s to mu
    accident        log eps_A + log N(e; mu, v) of the pose, whatever the force: log 1/V of the forces; only of a primitive
                    that does not press
    loose           log eps_L + log N(e; mu, v + w^2): a movement less careful than the others to the same goal

The forces of all but the third are N(e; mu, v). Of an orientation, mu - e is the rotation vector from the end to the goal.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr

from policies.decomposition.evidence import Predictive
from policies.decomposition.observed import FORCE, FORCE_LOG_VOLUME, UNIT, Observed, rotation_vectors
from policies.decomposition.result import ACCIDENT, LOOSE, PAUSE, STOPPED
from policies.decomposition.task_spaces import nearest_rotation

Array = NDArray[np.float64]

DRIFT = 0.08
"""kappa: how far a movement strays sideways, per way."""
CARELESS = 1.5
"""w: how far a careless movement ends from its goal, in units."""
LEFT = 2.0
"""A movement that pauses leads farther than this, in units."""


def incomplete_scores(observed: Observed, predictive: Predictive, rows: NDArray[np.int64]) -> Array:
    """(rows, K, 5) log-density of segments under every primitive by kind, eps included; `COMPLETE` is left out."""
    at = rows[:, None], predictive.space
    part, d = observed.groups[0].part, observed.groups[0].dimensions[predictive.space]
    v, goal = predictive.variance[:, 0], predictive.mean[:, part]
    to_goal, way, gone = _ways(observed, observed.starts[at], observed.ends[at][..., part], goal)
    force, at_goal = np.zeros(to_goal.shape[:2]), _normal(to_goal, v, d)
    result = np.full((*to_goal.shape[:2], 5), -np.inf)
    if len(observed.groups) > 1:
        free = predictive.mean[:, FORCE.start] < 0.5
        force = _normal(observed.ends[at][..., FORCE] - predictive.mean[:, FORCE], predictive.variance[:, 1], 4)
        result[..., ACCIDENT] = np.where(free, at_goal - FORCE_LOG_VOLUME, -np.inf)
    remains = np.einsum("lkd,lkd->lk", observed.directions[at], to_goal)
    tau = observed.remains[rows, None]
    across = np.maximum((to_goal**2).sum(axis=-1) - remains**2, 0.0)
    result[..., STOPPED] = force + (
        _normal_square(across, v + (DRIFT * remains) ** 2, d - 1)
        - np.log(tau)
        - remains / tau
        + 0.5 * v / tau**2
        + log_ndtr((remains - v / tau) / np.sqrt(v))
    )
    result[..., PAUSE] = force + _passed(way, gone, v, d)
    result[..., LOOSE] = force + _normal(to_goal, v + CARELESS**2, d)
    return np.asarray(result + observed.constants[at][..., None] + observed.log_shares[rows, None])


def _ways(observed: Observed, starts: Array, ends: Array, goals: Array) -> tuple[Array, Array, Array]:
    """From ends to goals, from starts to goals, from starts to ends (rows, K, 3 or d); of an orientation rotation vectors."""
    if not observed.rotation:
        return goals - ends, goals - starts, ends - starts
    scale = 1.0 / UNIT["orientation"]
    goals = np.array([nearest_rotation(row.reshape(3, 3)).ravel() for row in goals])
    starts, ends = _matrices(starts), _matrices(ends)
    return (
        scale * rotation_vectors(ends, goals),
        scale * rotation_vectors(starts, goals),
        scale * rotation_vectors(starts, ends),
    )


def _matrices(rows: Array) -> Array:
    """Rotation matrices (..., 9) of scaled ones."""
    return np.asarray(rows * (np.sqrt(3.0) / np.linalg.norm(rows, axis=-1, keepdims=True)))


def _passed(way: Array, gone: Array, v: Array, d: Array) -> Array:
    """Log-density of an end that went some of the way to a goal; -inf where nothing is left."""
    length, sigma = np.linalg.norm(way, axis=-1), np.sqrt(v)
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.einsum("lkd,lkd->lk", way, gone) / length
        share = ndtr(along / sigma) - ndtr((along - length) / sigma)
        across = np.maximum((gone**2).sum(axis=-1) - along**2, 0.0)
        density = np.log(share) - np.log(length) + _normal_square(across, v + (DRIFT * length) ** 2, d - 1)
    return np.where(length > np.maximum(4.0 * sigma, LEFT), density, -np.inf)


def _normal(x: Array, v: Array, d: ArrayLike) -> Array:
    return _normal_square((x**2).sum(axis=-1), v, d)


def _normal_square(square: Array, v: Array, d: ArrayLike) -> Array:
    return np.asarray(-0.5 * np.asarray(d) * np.log(2.0 * np.pi * v) - 0.5 * square / v)
