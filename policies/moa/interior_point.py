"""A primal-dual interior-point solver for tracking problems (Mehrotra 1992), built on their band structure.

Every iterate is strictly feasible, so the gap of `TrackingProblem.gap` certifies each of them; gradients are exact, and only
the Newton matrix is cut to a band. One band Cholesky factorisation per iteration, O(N_S (F (1 + d))^3 width^2).
"""

import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg.lapack import dpbtrf, dpbtrs
from sklearn.exceptions import ConvergenceWarning

from policies.moa import normal_matrix
from policies.moa.attractors import join, split
from policies.moa.tracking import TrackingProblem

Array = NDArray[np.float64]

SHORTEN = 0.999
"""Fraction of the way to the boundary that a step goes at most."""
REGULARISATION = 1e-13
"""Added to the diagonal of the Newton matrix, relative to its largest Hessian entry: the Hessian is singular."""
STEADIER = (0.0, 1e-11, 1e-9, 1e-7)
"""Further shares of the diagonal, in turn until rounding leaves the matrix positive definite."""
FIRST_DUAL = 0.03
"""Duals at the start, relative to the gradient: between 0.03 and 1 each factor of 3 costs half an iteration."""
PULL = 0.1
"""How far a warm start is pulled to the middle of the feasible set, and its duals relative to those of a cold one."""


class Solution(NamedTuple):
    """What a solver found."""

    z: Array
    """(N_S, F (1 + d)) activations in the short form of `attractors`, feasible."""
    cost: float
    """The whole cost at z."""
    error: float
    """Its part J, the sum of squared tracking errors."""
    gap: float
    """Certified bound on cost minus minimum."""
    relative_gap: float
    """The same over the cost."""
    n_iterations: int
    converged: bool
    """Whether the relative gap is within the tolerance."""


def solve(
    problem: TrackingProblem,
    tolerance: float = 1e-6,
    max_iterations: int = 60,
    start: Array | None = None,
) -> Solution:
    """Activations whose cost is within a relative `tolerance` of the minimum.

    start (N_S, F (1 + d)) is a feasible guess, such as the solution of a similar problem. Warns with ConvergenceWarning where
    the tolerance is not met; the gap is certified in any case.
    """
    method = _Method(problem)
    state = method.begin(start)
    for iteration in range(max_iterations):
        z = join(state.alpha, state.rho)
        cost, gradient = problem.cost_and_gradient(z)
        gap = problem.gap(z, cost, gradient)
        if gap.relative <= tolerance:
            return Solution(z, cost, problem.error(z), gap.absolute, gap.relative, iteration, True)
        try:
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                state = method.advance(state, gradient)
        except np.linalg.LinAlgError:
            break
        if not np.isfinite(join(state.alpha, state.rho)).all():
            break
    warnings.warn(f"relative gap {gap.relative:.1e} after {iteration + 1} iterations", ConvergenceWarning, stacklevel=2)
    return Solution(z, cost, problem.error(z), gap.absolute, gap.relative, iteration + 1, False)


@dataclass
class _State:
    """An iterate; slack and dual (2, N_S, F, d) belong to alpha + rho >= 0 and alpha - rho >= 0."""

    alpha: Array
    rho: Array
    slack: Array
    dual: Array


class _Method:
    """Newton's method on the central path; the activation of the last frame follows from the others."""

    def __init__(self, problem: TrackingProblem) -> None:
        self.problem = problem
        free = problem.n_frames - 1
        self.basis = np.delete(np.eye(problem.n_parameters), free, axis=1)
        self.basis[free, :free] = -1.0
        self.hessian = normal_matrix.band(problem, self.basis)
        self.largest = max(float(self.hessian[:, 0].max()), np.finfo(float).tiny)
        self.work = np.empty_like(self.hessian)

    def begin(self, start: Array | None) -> _State:
        """Primal in the middle or near the guess; duals on the central path, small against a typical gradient."""
        z = self.problem.uniform()
        _, gradient = self.problem.cost_and_gradient(z)
        size = FIRST_DUAL * float(np.abs(gradient).mean()) / self.problem.n_frames
        if start is not None:
            z = (1.0 - PULL) * start + PULL * z
            size *= PULL
        alpha, rho = split(z, self.problem.n_frames)
        slack = _both(alpha, rho)
        return _State(alpha, rho, slack, max(size, np.finfo(float).tiny) / slack)

    def advance(self, state: _State, gradient: Array) -> _State:
        """One predictor-corrector step; the corrector counts the part of the predictor that is possible, or it may cycle."""
        mean = (state.slack * state.dual).mean()
        factor = self._factorise(state)
        residual = gradient - self._transposed(state.dual)

        def direction(complementarity: Array) -> tuple[Array, Array, Array]:
            right = (self._transposed(complementarity / state.slack) - residual) @ self.basis
            step = dpbtrs(factor, right.reshape(-1), lower=1)[0].reshape(right.shape) @ self.basis.T
            d_slack = _both(*split(step, self.problem.n_frames))
            return step, d_slack, (complementarity - state.dual * d_slack) / state.slack

        def longest(d_slack: Array, d_dual: Array) -> float:
            worst = max((-d_slack / state.slack).max(), (-d_dual / state.dual).max())
            return float(min(1.0, SHORTEN / max(worst, SHORTEN)))

        affine = -state.slack * state.dual
        _, d_slack, d_dual = direction(affine)
        length = longest(d_slack, d_dual)
        reached = ((state.slack + length * d_slack) * (state.dual + length * d_dual)).mean()
        target = mean * (reached / mean) ** 3
        step, d_slack, d_dual = direction(affine + target - length**2 * d_slack * d_dual)
        length = longest(d_slack, d_dual)
        d_alpha, d_rho = split(step, self.problem.n_frames)
        alpha, rho = state.alpha + length * d_alpha, state.rho + length * d_rho
        return _State(alpha, rho, _both(alpha, rho), state.dual + length * d_dual)

    def _transposed(self, dual: Array) -> Array:
        return join((dual[0] + dual[1]).sum(axis=2), dual[0] - dual[1])

    def _factorise(self, state: _State) -> Array:
        weights = state.dual / state.slack
        for more in STEADIER:
            np.copyto(self.work, self.hessian)
            _add_barrier(self.work, weights)
            self.work[:, 0] += more * self.work[:, 0] + max(REGULARISATION, more) * self.largest
            factor, info = dpbtrf(self.work.T, lower=1, overwrite_ab=1)
            if not info:
                return np.asarray(factor)
        raise np.linalg.LinAlgError


def _both(alpha: Array, rho: Array) -> Array:
    """alpha + rho and alpha - rho, shape (2, N_S, F, d)."""
    out = np.empty((2, *rho.shape))
    np.add(alpha[:, :, None], rho, out=out[0])
    np.subtract(alpha[:, :, None], rho, out=out[1])
    return out


@njit(cache=True)
def _add_barrier(hessian: Array, weights: Array) -> None:
    """Add C' diag(weights) C in the unknowns (alpha without the last frame, rho), weights (2, N_S, F, d)."""
    n_support, n_frames, n_dimensions = weights.shape[1:]
    free = n_frames - 1
    q = free + n_frames * n_dimensions
    for s in range(n_support):
        for f in range(n_frames):
            total = 0.0
            for d in range(n_dimensions):
                up, down = weights[0, s, f, d], weights[1, s, f, d]
                row = free + f * n_dimensions + d
                total += up + down
                hessian[s * q + row, 0] += up + down
                if f < free:
                    hessian[s * q + f, row - f] += up - down
                else:
                    for k in range(free):
                        hessian[s * q + k, row - k] -= up - down
            if f < free:
                hessian[s * q + f, 0] += total
            else:
                for k in range(free):
                    for j in range(k + 1):
                        hessian[s * q + j, k - j] += total
