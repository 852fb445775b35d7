"""A Gaussian mixture in several frames at once (TP-GMM, Calinon et al. 2012), by expectation maximisation."""

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from sklearn.exceptions import ConvergenceWarning

Array = NDArray[np.float64]

TOLERANCE = 1e-3
"""EM ends where the mean log-likelihood of a point changes by less."""


class TaskMixture(NamedTuple):
    """K components, each with a Gaussian of the D coordinates in every one of F frames.

    p(x_1, ..., x_F) = sum_k pi_k prod_f N(x_f | mu_fk, Sigma_fk): given the component, what is seen in one frame says nothing
    about another. So a component has no covariance between frames, and time, where it is a coordinate, counts F times.
    """

    prior: Array
    """pi (K,)."""
    mean: Array
    """mu (F, K, D)."""
    covariance: Array
    """Sigma (F, K, D, D)."""

    @classmethod
    def of_responsibilities(cls, rows: Array, responsibility: Array, regularisation: float) -> "TaskMixture":
        """M-step: points (F, R, D) with responsibilities (R, K); the regularisation is added to the diagonals."""
        count = responsibility.sum(axis=0) + 10.0 * np.finfo(float).eps
        mean = responsibility.T @ rows / count[:, None]
        off = rows[:, None] - mean[:, :, None]
        weighted = off * responsibility.T[:, :, None]
        covariance = weighted.swapaxes(2, 3) @ off / count[:, None, None]
        return cls(count / count.sum(), mean, covariance + regularisation * np.eye(rows.shape[2]))

    def expectation(self, rows: Array) -> tuple[Array, float]:
        """E-step: responsibilities (R, K) of points (F, R, D), and their mean log-likelihood."""
        root = np.linalg.inv(np.linalg.cholesky(self.covariance))
        log_density = np.log(self.prior) - 0.5 * self.mean.shape[0] * rows.shape[2] * np.log(2.0 * np.pi)
        for x, mean, whiten in zip(rows, self.mean, root, strict=True):
            white = (x - mean[:, None]) @ whiten.swapaxes(1, 2)
            log_determinant = np.log(np.diagonal(whiten, axis1=1, axis2=2)).sum(axis=1)
            log_density = log_density + log_determinant - 0.5 * (white**2).sum(axis=2).T
        total = logsumexp(log_density, axis=1, keepdims=True)
        return np.exp(log_density - total), float(total.mean())


class MixtureFit(NamedTuple):
    """A mixture, and how EM came to it."""

    mixture: TaskMixture
    log_likelihood: list[float]
    """Mean over the points before every step; but for the regularisation it never falls."""
    converged: bool


def fit_task_mixture(rows: Array, first: Array, regularisation: float, max_iter: int) -> MixtureFit:
    """EM from first responsibilities (R, K) of points (F, R, D). Warns with ConvergenceWarning where it has not converged."""
    mixture, history = TaskMixture.of_responsibilities(rows, first, regularisation), [-np.inf]
    for _ in range(max_iter):
        responsibility, log_likelihood = mixture.expectation(rows)
        history.append(log_likelihood)
        mixture = TaskMixture.of_responsibilities(rows, responsibility, regularisation)
        if abs(history[-1] - history[-2]) < TOLERANCE:
            return MixtureFit(mixture, history[1:], True)
    warnings.warn(f"the mixture has not converged after {max_iter} steps of EM", ConvergenceWarning, stacklevel=2)
    return MixtureFit(mixture, history[1:], False)
