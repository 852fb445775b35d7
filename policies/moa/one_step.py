"""MoA as a likelihood of the next position (thesis 4.5.2): noise in (4.9), and a variance for every part of the movement.

Given the two positions before it, a position is normal with mean c1 x_{i-1} + c2 x_{i-2} + c3 G_i a_i and covariance Sigma_i
(4.34). Sigma is shared by the demonstrations and constant between support points; where they scatter, tracking counts less.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.moa.interior_point import Solution
from policies.moa.response import Response
from policies.moa.setting import Setting
from policies.moa.tracking import Group, TrackingProblem

Array = NDArray[np.float64]

FLOOR, ROUNDING = 1e-3, 1e-6
"""Least standard deviation in any direction, relative to that of all one-step errors, and to what the goals cause."""
MAX_ROUNDS = 30


class OneStepFit(NamedTuple):
    """Activations and covariances of largest likelihood."""

    solution: Solution
    problem: TrackingProblem
    """The last weighted problem; its error is the sum of squared Mahalanobis distances."""
    covariances: Array
    """(N_S, d, d) Sigma around every support point, squared units of the trajectory."""
    log_likelihood: list[float]
    """(4.36) after every round, with the terms -1/2 sum log |2 pi Sigma_i| that the thesis drops; it never falls."""
    converged: bool


def fit_one_step(setting: Setting, solve: Callable[[TrackingProblem], Solution], tolerance: float = 1e-4) -> OneStepFit:
    """Activations and covariances in turn, each exactly, until the likelihood rises by less than `tolerance` of itself.

    `solve` minimises a weighted problem.
    """
    weights, response = setting.weights, setting.response
    points, matrices = setting.centred()
    d = setting.attractors.n_dimensions
    wanted = [np.vstack([np.zeros((2, d)), response.wanted_goals(x)]) for x in points]
    owner = (weights.first + weights.values.argmax(axis=1))[2:]
    covariances = np.tile(np.eye(d) * (response.c3 * setting.spread) ** 2, (weights.n_support, 1, 1))
    history: list[float] = []
    while True:
        problem = _weighted(setting, wanted, matrices, covariances, owner)
        solution = solve(problem)
        mixed = weights.interpolated(solution.z)[..., None]
        errors = response.c3 * np.array(
            [((matrix @ mixed)[..., 0] - goals)[2:] for matrix, goals in zip(matrices, wanted, strict=True)]
        )
        if not history:
            floor = max(FLOOR**2 * float((errors**2).mean()), (ROUNDING * response.c3 * setting.spread) ** 2)
        covariances = _covariances(errors, owner, weights.n_support, floor)
        history.append(_log_likelihood(errors, covariances[owner]))
        converged = len(history) > 1 and history[-1] - history[-2] <= tolerance * abs(history[-2])
        if converged or len(history) == MAX_ROUNDS:
            return OneStepFit(solution, problem, covariances, history, converged)


def _weighted(
    setting: Setting, wanted: list[Array], matrices: list[Array], covariances: Array, owner: NDArray[np.int64]
) -> TrackingProblem:
    """Squared Mahalanobis distances of (4.36) as a tracking problem without dynamics."""
    roots = setting.response.c3 * np.linalg.inv(np.linalg.cholesky(covariances))
    root = np.concatenate([roots[owner[:1]], roots[owner[:1]], roots[owner]])
    stacked = np.concatenate([root @ matrix for matrix in matrices], axis=1)
    targets = np.concatenate([(root @ goals[..., None])[..., 0] for goals in wanted], axis=1)
    group = Group(setting.weights, stacked, targets, Response.none())
    return TrackingProblem((group,), setting.attractors.n_frames)


def _covariances(errors: Array, owner: NDArray[np.int64], n_support: int, floor: float) -> Array:
    """Maximum-likelihood covariances (N_S, d, d) of errors (M, N - 2, d), no eigenvalue below the floor."""
    d = errors.shape[2]
    sums, counts = np.zeros((n_support, d, d)), np.bincount(owner, minlength=n_support)
    np.add.at(sums, owner, np.einsum("mni,mnj->nij", errors, errors))
    values, vectors = np.linalg.eigh(sums / np.maximum(counts * len(errors), 1)[:, None, None])
    return np.asarray((vectors * np.maximum(values, floor)[:, None, :]) @ vectors.swapaxes(1, 2))


def _log_likelihood(errors: Array, covariances: Array) -> float:
    solved = np.linalg.solve(covariances, errors[..., None])[..., 0]
    log_determinant = np.linalg.slogdet(2.0 * np.pi * covariances)[1]
    return float(-0.5 * ((errors * solved).sum() + len(errors) * log_determinant.sum()))
