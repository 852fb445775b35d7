"""Import vector machine: kernel logistic regression on few kernels (Zhu and Hastie 2001; thesis 2.4)."""

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import log_softmax
from sklearn.exceptions import ConvergenceWarning
from sklearn.metrics.pairwise import rbf_kernel

from policies.classifiers.kernel_classifier import Gamma, KernelClassifier

Array = NDArray[np.float64]

JITTER = 1e-10
"""Added to the kernel's values at the imported points among themselves: nearly equal points stay solvable."""
MAX_NEWTON_STEPS, NEWTON_TOLERANCE = 100, 1e-10
"""Newton's method ends where a step promises less than this fraction of the objective."""


class ImportVectorMachine(KernelClassifier):
    """Imports kernels one by one, always the one that lowers the objective of kernel logistic regression most.

    The objective is H = C sum_i w_i (-log p(y_i|x_i)) + 1/2 sum_c a_c' K a_c (Zhu and Hastie 2001, (7), with lambda =
    1/C; multinomial as in their 2005 article) with an intercept that is not penalised. Each round ranks all points by
    one Newton step over the present coefficients and the candidate's, imports the best, and converges (A1-A4). It stops
    when H falls by less than the fraction `tol`; with all points imported it is kernel logistic regression. Where a large C
    leaves the Hessian indefinite by rounding, it stops there with a `ConvergenceWarning`.

    Parameters:
        C: inverse strength of the regularisation.
        gamma: of the kernel; "scale" is 1 / (n times the variance of the samples).
        tol: relative decrease of H that ends the imports, epsilon of (A4).
        max_imports: at most so many kernels; None for no limit.

    Attributes:
        objective_: (k + 1,) H before and after every import; it never rises.
    """

    def __init__(
        self, C: float = 1.0, gamma: Gamma = "scale", tol: float = 1e-3, max_imports: int | None = None
    ) -> None:
        self.C, self.gamma, self.tol, self.max_imports = C, gamma, tol, max_imports

    def _fit(self, points: Array, class_weights: Array) -> None:
        gram = rbf_kernel(points, gamma=self.gamma_)
        weights = self.C * class_weights
        imported: list[int] = []
        state = _converge(_problem(gram, imported, weights), np.zeros((1, _columns(weights))))
        history = [state.objective]
        while len(imported) < (len(points) if self.max_imports is None else self.max_imports):
            try:
                best = int(np.argmax(_gain(gram, imported, weights, state)))
                start = np.vstack([state.coefficients, np.zeros(state.coefficients.shape[1])])
                state = _converge(_problem(gram, [*imported, best], weights), start)
            except np.linalg.LinAlgError:
                warnings.warn(
                    f"no kernel is imported beyond {len(imported)}: with C = {self.C} rounding hides what another one gains",
                    ConvergenceWarning,
                    stacklevel=2,
                )
                break
            imported.append(best)
            history.append(state.objective)
            if history[-2] - history[-1] <= self.tol * abs(history[-1]):
                break
        self.objective_ = np.array(history)
        self.support_vectors_ = points[imported]
        self.intercept_, self.dual_coef_ = state.coefficients[0], state.coefficients[1:].T


class _State(NamedTuple):
    """A minimum of the objective over the imported kernels, and its second-order model; c scores are free."""

    coefficients: Array
    """(1 + q, c): intercepts, then the kernels'."""
    objective: float
    residual: Array
    """(M, c) derivative of the loss by the scores."""
    curvature: Array
    """(M, c, c) second derivative."""
    factor: tuple[Array, bool]
    """Cholesky factor of the Hessian."""


class _Problem(NamedTuple):
    design: Array
    """(M, 1 + q): one, and the imported kernels at the points."""
    penalty: Array
    """(1 + q, 1 + q)."""
    weights: Array
    """(M, C) of the classes at the points, times C."""

    def log_probabilities(self, coefficients: Array) -> Array:
        scores = self.design @ coefficients
        if scores.shape[1] == 1:  # of two classes the first one's score is zero
            scores = np.hstack([np.zeros_like(scores), scores])
        result: Array = log_softmax(scores, axis=1)
        return result

    def objective(self, coefficients: Array) -> float:
        loss = -(self.weights * self.log_probabilities(coefficients)).sum()
        return float(loss + 0.5 * (coefficients * (self.penalty @ coefficients)).sum())

    def expand(self, coefficients: Array) -> tuple[_State, Array]:
        """The second-order model at some coefficients, and the gradient (1 + q, c)."""
        n, c = coefficients.shape
        p = np.exp(self.log_probabilities(coefficients))
        total = self.weights.sum(axis=1)
        residual = (total[:, None] * p - self.weights)[:, -c:]
        p = p[:, -c:]
        curvature = total[:, None, None] * (p[:, :, None] * np.eye(c) - p[:, :, None] * p[:, None, :])
        hessian = _cross(self.design, self.design, curvature)
        for a in range(c):
            hessian[:, a, :, a] += self.penalty
        if c > 1:  # a constant added to all intercepts changes nothing: any curvature makes the step along it zero
            hessian[0, :, 0, :] += total.mean()
        factor = cho_factor(hessian.reshape(n * c, n * c))
        gradient = self.design.T @ residual + self.penalty @ coefficients
        return _State(coefficients, self.objective(coefficients), residual, curvature, factor), gradient


def _columns(weights: Array) -> int:
    """Free scores per point: one of two classes, all of more."""
    return 1 if weights.shape[1] == 2 else weights.shape[1]


def _problem(gram: Array, imported: list[int], weights: Array) -> _Problem:
    penalty = np.zeros((len(imported) + 1, len(imported) + 1))
    penalty[1:, 1:] = gram[np.ix_(imported, imported)] + JITTER * np.eye(len(imported))
    return _Problem(np.column_stack([np.ones(len(gram)), gram[:, imported]]), penalty, weights)


def _converge(problem: _Problem, coefficients: Array) -> _State:
    """Newton's method with halved steps."""
    for _ in range(MAX_NEWTON_STEPS):
        state, gradient = problem.expand(coefficients)
        step = -cho_solve(state.factor, gradient.ravel()).reshape(gradient.shape)
        promise = -0.5 * float((gradient * step).sum())
        if promise <= NEWTON_TOLERANCE * abs(state.objective):
            return state
        while problem.objective(coefficients + step) > state.objective - 0.1 * promise:
            step = 0.5 * step
            promise = 0.5 * promise
        coefficients = coefficients + step
    warnings.warn(
        f"Newton's method made {MAX_NEWTON_STEPS} steps without convergence", ConvergenceWarning, stacklevel=2
    )
    return state


def _gain(gram: Array, imported: list[int], weights: Array, state: _State) -> Array:
    """Decrease (M,) of the second-order model of H if a point is imported; minus infinity where it is already.

    With H_SS the Hessian of the present coefficients, whose gradient is zero, one Newton step over them and the
    candidate's a_l gains 1/2 g_l' (H_ll - H_lS H_SS^-1 H_Sl)^-1 g_l.
    """
    problem, c = _problem(gram, imported, weights), state.residual.shape[1]
    gradient = gram @ state.residual + gram[:, imported] @ state.coefficients[1:]
    cross = _cross(problem.design, gram, state.curvature)
    for a in range(c):
        cross[1:, a, :, a] += gram[imported]
    cross = cross.reshape(-1, len(gram), c)
    own = (gram**2 @ state.curvature.reshape(-1, c * c)).reshape(-1, c, c) + (1.0 + JITTER) * np.eye(c)
    solved = cho_solve(state.factor, cross.reshape(len(cross), -1)).reshape(cross.shape)
    left, others = own - np.einsum("dla,dlb->lab", cross, solved), np.delete(np.arange(len(gram)), imported)
    step = np.linalg.solve(left[others], gradient[others, :, None])[:, :, 0]
    gain = np.full(len(gram), -np.inf)
    gain[others] = 0.5 * (gradient[others] * step).sum(axis=1)
    return gain


def _cross(left: Array, right: Array, curvature: Array) -> Array:
    """(i, c, j, c): sum over the points of left_i curvature right_j."""
    c = curvature.shape[1]
    result = np.empty((left.shape[1], c, right.shape[1], c))
    for a in range(c):
        for b in range(c):
            result[:, a, :, b] = left.T @ (curvature[:, a, b, None] * right)
    return result
