"""MoA without constraints (thesis 4.5.2): activations are the softmax of free numbers, and gradients find them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import softmax

from policies.moa.attractors import BoxAttractors, projected
from policies.moa.interior_point import Solution
from policies.moa.tracking import TrackingProblem

Array = NDArray[np.float64]


def cost_and_gradient(theta: Array, problem: TrackingProblem, corners: Array) -> tuple[float, Array]:
    """Cost and gradient in theta (N_S, K), where a_s = softmax(theta_s) activates the attractors of `corner_matrix`."""
    activations = softmax(theta, axis=1)
    cost, gradient = problem.cost_and_gradient(activations @ corners.T)
    along = gradient @ corners
    return cost, activations * (along - (activations * along).sum(axis=1, keepdims=True))


def solve_softmax(
    problem: TrackingProblem,
    attractors: BoxAttractors,
    tolerance: float = 1e-6,
    max_iterations: int = 5000,
) -> Solution:
    """A local minimum by L-BFGS from equal activations, in memory proportional to the number of activations.

    No constraint is left, but the minimum is often at infinite theta, and gradients vanish wherever a softmax saturates: some
    tenths of the least error may be missing, and the certified gap of the convex problem bounds them.
    """
    corners = attractors.corner_matrix()
    shape = (problem.n_support, corners.shape[1])
    scale = max(problem.scale, np.finfo(float).tiny)

    def flat(theta: Array) -> tuple[float, Array]:
        cost, gradient = cost_and_gradient(theta.reshape(shape), problem, corners)
        return cost / scale, gradient.reshape(-1) / scale

    options: dict[str, Any] = {"maxiter": max_iterations, "maxfun": 2 * max_iterations, "ftol": 0.0, "gtol": 1e-10}
    found = minimize(flat, np.zeros(shape).reshape(-1), jac=True, method="L-BFGS-B", options=options)
    z = projected(softmax(found.x.reshape(shape), axis=1) @ corners.T, problem.n_frames)
    cost, gradient = problem.cost_and_gradient(z)
    gap = problem.gap(z, cost, gradient)
    return Solution(z, cost, problem.error(z), gap.absolute, gap.relative, int(found.nit), gap.relative <= tolerance)
