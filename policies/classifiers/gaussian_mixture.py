"""Mixtures of Gaussians for weighted samples (Bishop 2006, 9.2)."""

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import logsumexp
from sklearn.exceptions import ConvergenceWarning

Array = NDArray[np.float64]


class Mixture(NamedTuple):
    """A mixture of M Gaussians."""

    weights: Array
    """(M,)."""
    means: Array
    """(M, n)."""
    covariances: Array
    """(M, n, n)."""
    history: tuple[float, ...]
    """Weighted log likelihood of the clouds after every step."""

    @property
    def n_parameters(self) -> int:
        """Free parameters, for model selection."""
        n = self.means.shape[1]
        return len(self.weights) * (1 + n + n * (n + 1) // 2) - 1


def expectation_maximisation(
    X: Array, weights: Array, cloud: Array, mixture: Mixture, tol: float, max_iter: int
) -> Mixture:
    """EM for weighted samples X (N, n), each a cloud of variances `cloud` (n,): the likelihood never falls.

    A Gaussian's log density of a cloud is its mean over the cloud, log N(x; mu, Sigma) - 1/2 tr(Sigma^-1 R) with R =
    diag(cloud); its maximum over Sigma is the weighted covariance plus R. Ends when a step gains less than tol per
    sample.
    """
    history: list[float] = []
    for _ in range(max_iter):
        log_joint = _log_joint(X, cloud, mixture)
        log_likelihood = logsumexp(log_joint, axis=1)
        history.append(float(weights @ log_likelihood))
        if len(history) > 1 and history[-1] - history[-2] <= tol * weights.sum():
            break
        mixture = _maximise(X, weights[:, None] * np.exp(log_joint - log_likelihood[:, None]), cloud)
    else:
        message = f"a mixture of {len(mixture.weights)} Gaussians did not converge in {max_iter} steps"
        warnings.warn(message, ConvergenceWarning, stacklevel=2)
        history.append(float(weights @ logsumexp(_log_joint(X, cloud, mixture), axis=1)))
    return mixture._replace(history=tuple(history))


def _log_joint(X: Array, cloud: Array, mixture: Mixture) -> Array:
    """(N, M) log of every Gaussian's share of the density of a cloud."""
    penalty = np.trace(np.linalg.inv(mixture.covariances) * cloud, axis1=1, axis2=2)
    return log_densities(X, mixture.means, mixture.covariances) + np.log(mixture.weights) - 0.5 * penalty


def _maximise(X: Array, shares: Array, cloud: Array) -> Mixture:
    """M-step for shares (N, M) of the samples' weights."""
    total = shares.sum(axis=0)
    means = shares.T @ X / total[:, None]
    centred = X[None] - means[:, None]
    covariances = np.einsum("im,mij,mik->mjk", shares, centred, centred) / total[:, None, None] + np.diag(cloud)
    return Mixture(total / total.sum(), means, covariances, ())


def single_gaussian(X: Array, weights: Array, cloud: Array) -> Mixture:
    """The most likely Gaussian, in closed form."""
    mixture = _maximise(X, weights[:, None], cloud)
    return mixture._replace(history=(float(weights @ _log_joint(X, cloud, mixture)[:, 0]),))


def split(mixture: Mixture) -> Mixture:
    """One Gaussian more: that with the largest weight times extent is cut across its main axis, in two equal halves."""
    values, axes = np.linalg.eigh(mixture.covariances)
    m = int(np.argmax(mixture.weights * values[:, -1]))
    offset = np.sqrt(2.0 / np.pi * values[m, -1]) * axes[m, :, -1]  # centroid of half a Gaussian
    weights, means, covariances = (np.concatenate([array, array[m : m + 1]]) for array in mixture[:3])
    weights[[m, -1]] *= 0.5
    means[[m, -1]] += np.stack([-offset, offset])
    covariances[[m, -1]] -= np.outer(offset, offset)
    return Mixture(weights, means, covariances, ())


def log_densities(X: Array, means: Array, covariances: Array) -> Array:
    """log N(x; mu_m, Sigma_m) (N, M)."""
    result = np.empty((len(X), len(means)))
    for m, (mean, factor) in enumerate(zip(means, np.linalg.cholesky(covariances), strict=True)):
        z = solve_triangular(factor, (X - mean).T, lower=True)
        constant = 0.5 * len(mean) * np.log(2.0 * np.pi) + np.log(np.diag(factor)).sum()
        result[:, m] = -0.5 * (z**2).sum(axis=0) - constant
    return result
