"""The quadratic program as the thesis writes it (4.26), for the solvers that `qpsolvers` offers.

Lambda, H and f are built in full: a reference for small problems.
"""

from typing import Any, NamedTuple

import numpy as np
import qpsolvers
from numpy.typing import NDArray

from lfd_gym.errors import LfdGymError, UnknownNameError
from policies.moa.attractors import BoxAttractors, projected
from policies.moa.interior_point import Solution
from policies.moa.tracking import TrackingProblem

Array = NDArray[np.float64]


class QuadraticProgram(NamedTuple):
    """min 1/2 s'Hs + f's + constant with A s = 1, s >= 0, where s (K N_S,) holds S (K, N_S) row by row."""

    H: Array
    f: Array
    constant: float
    A: Array
    """kron(1'_K, I_{N_S}): the activations of every support point sum to one."""


def quadratic_program(problem: TrackingProblem, attractors: BoxAttractors) -> QuadraticProgram:
    """(4.25) and (4.26) with H = 2 sum Lambda'Lambda, f = -2 sum Lambda'y (corrected: the factor 2 in both)."""
    corners = attractors.corner_matrix()
    n_support, k = problem.n_support, corners.shape[1]
    H, f = np.zeros((k * n_support, k * n_support)), np.zeros(k * n_support)
    for group in problem.groups:
        weights, goals = group.weights.matrix, group.matrices @ corners
        n, rows = group.targets.shape
        columns = np.einsum("is,idk->idks", weights, np.broadcast_to(goals, (n, rows, k)))
        Lambda = group.response.forced(columns.reshape(n, -1)).reshape(n * rows, k * n_support)
        targets = group.targets.copy()
        targets[:2] = 0.0
        H += 2.0 * Lambda.T @ Lambda
        f -= 2.0 * Lambda.T @ targets.reshape(-1)
    return QuadraticProgram(H, f, problem.scale, np.tile(np.eye(n_support), k))


def solve_generic(
    problem: TrackingProblem, attractors: BoxAttractors, solver: str = "proxqp", tolerance: float = 1e-9
) -> Solution:
    """The solution that a solver of `qpsolvers` finds, made feasible, and certified like any other.

    Solvers leave activations slightly negative; they are clipped and normalised. The cost has to be the tracking error
    alone.

    Raises:
        UnknownNameError: a solver that is not installed.
        LfdGymError: the solver gave up.
    """
    if solver not in qpsolvers.available_solvers:
        raise UnknownNameError("solver", solver, ["structured", "softmax", *qpsolvers.available_solvers])
    H, f, _, A = quadratic_program(problem, attractors)
    program = qpsolvers.Problem(H, f, A=A, b=np.ones(len(A)), lb=np.zeros(len(f)))
    options: dict[str, Any] = {"eps_abs": tolerance * problem.scale} if solver == "proxqp" else {}
    found = qpsolvers.solve_problem(program, solver, **options)
    if found.x is None:
        raise LfdGymError(f"the solver '{solver}' found no solution; 'structured' does")
    activations = np.maximum(found.x.reshape(-1, problem.n_support).T, 0.0)
    activations /= activations.sum(axis=1, keepdims=True)
    z = projected(activations @ attractors.corner_matrix().T, problem.n_frames)
    cost, gradient = problem.cost_and_gradient(z)
    gap = problem.gap(z, cost, gradient)
    return Solution(z, cost, problem.error(z), gap.absolute, gap.relative, 0, bool(found.found))
