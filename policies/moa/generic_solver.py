"""The quadratic program as the thesis writes it (4.26), for the solvers that `qpsolvers` offers.

Lambda, H and f are built in full: a reference for small problems.
"""

from typing import Any, NamedTuple

import numpy as np
import qpsolvers
from numpy.typing import NDArray
from scipy.sparse import csc_matrix

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
        for row in range(goals.shape[1]):  # one coordinate of one demonstration at a time
            columns = goals[:, row, :, None] * weights[:, None, :]
            Lambda = group.response.forced(columns.reshape(len(weights), -1))
            H += 2.0 * Lambda.T @ Lambda
            f -= 2.0 * Lambda[2:].T @ group.targets[2:, row]
    return QuadraticProgram(H, f, problem.scale, np.tile(np.eye(n_support), k))


def solve_program(program: QuadraticProgram, solver: str = "proxqp", tolerance: float = 1e-9) -> Array:
    """s (K N_S,) as a solver of `qpsolvers` leaves it: slightly negative in places.

    tolerance is proxqp's absolute one, relative to the cost of predicting nothing; other solvers use their own.

    Raises:
        UnknownNameError: a solver that is not installed.
        LfdGymError: the solver gave up.
    """
    if solver not in qpsolvers.available_solvers:
        raise UnknownNameError("solver", str(solver), ["structured", "softmax", *qpsolvers.available_solvers])
    form = np.asarray if solver in qpsolvers.dense_solvers else csc_matrix
    n_support, n = program.A.shape
    given = qpsolvers.Problem(form(program.H), program.f, A=form(program.A), b=np.ones(n_support), lb=np.zeros(n))
    options: dict[str, Any] = {"eps_abs": tolerance * program.constant} if solver == "proxqp" else {}
    found = qpsolvers.solve_problem(given, solver, **options)
    if found.x is None:
        raise LfdGymError(f"the solver '{solver}' found no solution; 'structured' does")
    return np.asarray(found.x)


def solve_generic(
    problem: TrackingProblem, attractors: BoxAttractors, solver: str = "proxqp", tolerance: float = 1e-6
) -> Solution:
    """The solution of `solve_program`, made feasible and certified like any other; the cost has to be the error alone."""
    s = solve_program(quadratic_program(problem, attractors), solver)
    activations = np.maximum(s.reshape(-1, problem.n_support).T, 0.0)
    activations /= activations.sum(axis=1, keepdims=True)
    z = projected(activations @ attractors.corner_matrix().T, problem.n_frames)
    cost, gradient = problem.cost_and_gradient(z)
    gap = problem.gap(z, cost, gradient)
    return Solution(z, cost, problem.error(z), gap.absolute, gap.relative, 0, gap.relative <= tolerance)
