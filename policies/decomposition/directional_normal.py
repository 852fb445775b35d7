"""The Directional Normal Distribution: where movements converge to (thesis 3.3).

A point x that moves with velocity v is on its way to a goal near mu: for some t >= 0, x + t v ~ N(mu, S). With a flat prior
on t, z = mu_t / sigma_t and r = (x - mu)^T S^-1 (x - mu) - z^2 of (3.6), (3.7),

    log p = -(d/2) log 2 pi - 1/2 log |S| - r/2 + 1/2 log 2 pi + log sigma_t + log Phi(z)

which is (3.9) corrected: the logarithm belongs outside of the integral, and (3.8) uses the posterior of t as its prior. The
M-step (3.12), (3.13) is exact for this likelihood, so it never falls. A point with v = 0 is an anchor, at the goal: t = 0.

All functions take a `Geometry`'s points about the current mean, so that positions and orientations share them; leading
dimensions (...) are distributions that are fitted at once.
"""

import warnings
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import erfcx
from sklearn.base import BaseEstimator
from sklearn.exceptions import ConvergenceWarning

from lfd_gym.errors import InvalidArgumentError
from policies.decomposition.geometry import GEOMETRIES, Geometry

Array = NDArray[np.float64]

ASYMPTOTIC = 30.0
"""Below minus this z the moments of t come from their asymptotic series: their closed forms cancel. Above it none is cut."""


class Expected(NamedTuple):
    """What the E-step gives: leading dimensions (..., N)."""

    log_density: Array
    """log p of every point."""
    first: Array
    """E[t]."""
    variance: Array
    """Var[t]."""


class Truncated(NamedTuple):
    """t / sigma_t ~ N(z, 1) on t >= 0."""

    log_mass: Array
    """log Phi(z)."""
    first: Array
    """E[t / sigma_t] = z + h, with the hazard h = phi(z) / Phi(z)."""
    second: Array
    """E[(t / sigma_t)^2] = 1 + z (z + h)."""


def truncated_normal(z: ArrayLike) -> Truncated:
    """Accurate for every z, from one `erfcx`: Phi(z) = erfcx(-z / sqrt 2) exp(-z^2 / 2) / 2.

    Far below 0 from the asymptotic series, E = 1/|z| - 2/|z|^3 + 10/|z|^5 - ...; far above nothing is cut off.
    """
    shape, z = np.shape(z), np.atleast_1d(np.asarray(z, dtype=np.float64))
    near = np.clip(z, -ASYMPTOTIC, ASYMPTOTIC)
    scaled = erfcx(near * -np.sqrt(0.5))
    square = near * near
    log_mass = np.log(0.5 * scaled) - 0.5 * square
    first = z + np.sqrt(2.0 / np.pi) / scaled
    second = 1.0 + z * first
    far = z < -ASYMPTOTIC
    if far.any():
        u = -1.0 / z[far]
        rest = u**2 * (2.0 - u**2 * (10.0 - u**2 * (74.0 - 706.0 * u**2)))
        first[far], second[far] = u * (1.0 - rest), rest
        tail = np.log1p(-(u**2) * (1.0 - u**2 * (3.0 - u**2 * (15.0 - 105.0 * u**2))))
        log_mass[far] = np.log(u) - 0.5 / u**2 - 0.5 * np.log(2.0 * np.pi) + tail
    return Truncated(*(part.reshape(shape) for part in (log_mass, first, second)))


def e_step(x: Array, v: Array, covariance: Array) -> Expected:
    """Points x (..., N, d) about the mean, velocities v (..., N, d), covariance S (..., d, d)."""
    d = x.shape[-1]
    factor = np.linalg.cholesky(covariance)
    whiten = np.swapaxes(np.linalg.inv(factor), -1, -2)
    away, along = x @ whiten, v @ whiten
    speed = np.sqrt(_dot(along, along))
    moves = speed > 0.0
    rate = np.where(moves, speed, 1.0)
    z = -_dot(away, along) / rate
    log_det = 2.0 * np.log(np.diagonal(factor, axis1=-2, axis2=-1)).sum(axis=-1)[..., None]
    residual = _dot(away, away) - z * z
    cut = truncated_normal(z)
    log_density = -0.5 * (d * np.log(2.0 * np.pi) + log_det + residual)
    log_density += np.where(moves, 0.5 * np.log(2.0 * np.pi) - np.log(rate) + cut.log_mass, 0.0)
    variance = np.maximum(cut.second - cut.first**2, 0.0) / rate**2
    return Expected(log_density, np.where(moves, cut.first / rate, 0.0), np.where(moves, variance, 0.0))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def m_step(x: Array, v: Array, expected: Expected, weights: Array, floor: float) -> tuple[Array, Array]:
    """The mean (..., d) that maximises, about the one before, and the covariance (..., d, d).

    Weights (..., N) >= 0. No eigenvalue of the covariance is below the floor, which is the constrained maximum: the
    likelihood does not fall by it.
    """
    total = weights.sum(axis=-1)[..., None]
    projected = x + expected.first[..., None] * v
    mean = (weights[..., None] * projected).sum(axis=-2) / total
    off = projected - mean[..., None, :]
    scatter = np.swapaxes(off * weights[..., None], -1, -2) @ off
    scatter = scatter + np.swapaxes(v * (weights * expected.variance)[..., None], -1, -2) @ v
    values, vectors = np.linalg.eigh(scatter / total[..., None])
    return mean, (vectors * np.maximum(values, floor)[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def meeting_point(x: Array, v: Array, weights: Array) -> tuple[Array, float]:
    """Where the lines x + t v meet best, by least squares, and the mean square distance from it per coordinate.

    Lines that are nearly parallel meet near their points' mean.
    """
    d = x.shape[-1]
    unit = v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300)
    across = np.eye(d) - unit[:, :, None] * unit[:, None, :]
    centre = weights @ x / weights.sum()
    ridge = 1e-3 * weights.sum()
    matrix = (weights[:, None, None] * across).sum(axis=0) + ridge * np.eye(d)
    off = (weights[:, None, None] * across @ (x - centre)[:, :, None]).sum(axis=0)[:, 0]
    point = centre + np.linalg.solve(matrix, off)
    left = (across @ (x - point)[:, :, None])[..., 0]
    return point, float(weights @ (left**2).sum(axis=1) / weights.sum() / d)


class DirectionalNormal(BaseEstimator):
    """Goal and covariance of one Directional Normal Distribution (Algorithm 3).

    Parameters:
        geometry: "euclidean"; "rotation" for orientations as rotation vectors about the current mean (the default for
            orientations), "matrix" for their nine numbers as in 3.3.2.
        floor: least variance of any direction, in squared units of x.
        max_iter, tol: EM ends after so many steps, or when the mean log-likelihood gains less.

    Attributes:
        goal_: (d,) mu, of orientations (9,) the rows of a rotation matrix.
        covariance_: (d, d) S; of orientations (3, 3) of the rotation vector about the goal, or (9, 9).
        history_: mean log-likelihood before every step, converged_: whether it stopped rising.

    A goal that is approached from one direction only is free beyond the points: give anchors.
    """

    goal_: Array
    covariance_: Array
    history_: list[float]
    converged_: bool

    def __init__(
        self, geometry: str = "euclidean", floor: float = 1e-8, max_iter: int = 500, tol: float = 1e-7
    ) -> None:
        self.geometry, self.floor, self.max_iter, self.tol = geometry, floor, max_iter, tol

    def fit(
        self,
        X: ArrayLike,
        velocities: ArrayLike,
        sample_weight: ArrayLike | None = None,
        start: tuple[ArrayLike, ArrayLike] | None = None,
    ) -> Self:
        """X (N, d), velocities (N, d), of orientations X (N, 9) and angular velocities (N, 3), axes as those of X.

        start: mean and covariance to begin with; None: where the lines of the points meet. Raises InvalidArgumentError for
        shapes that do not fit, numbers that are not finite and weights that are negative or all zero.
        """
        points = self._points(X, velocities)
        weights = np.ones(len(points.x)) if sample_weight is None else np.asarray(sample_weight, dtype=np.float64)
        if weights.shape != (len(points.x),) or not np.all(weights >= 0.0) or not 0.0 < weights.sum() < np.inf:
            raise InvalidArgumentError(f"sample_weight must be {len(points.x)} finite numbers >= 0, not all of them 0")
        if start is None:
            mean = points.centre(weights)
            x, v = points.about(mean)
            shift, variance = meeting_point(x, v, weights)
            mean = points.moved(mean, shift)
            covariance = max(variance, self.floor) * np.eye(x.shape[-1])
        else:
            mean, covariance = (np.asarray(part, dtype=np.float64) for part in start)
        self.history_, self.converged_ = [], False
        best = (-np.inf, mean, covariance)
        for _ in range(self.max_iter):
            x, v = points.about(mean)
            expected = e_step(x, v, covariance)
            self.history_.append(float(weights @ expected.log_density / weights.sum()))
            gain = self.history_[-1] - best[0]
            if gain > 0.0:
                best = (self.history_[-1], mean, covariance)
            if gain < self.tol:
                self.converged_ = True
                break
            shift, covariance = m_step(x, v, expected, weights, self.floor)
            mean = points.moved(mean, shift)
        if not self.converged_:
            warnings.warn(
                f"EM still gained more than {self.tol} after {self.max_iter} steps: raise max_iter, or give anchors",
                ConvergenceWarning,
                stacklevel=2,
            )
        _, self.goal_, self.covariance_ = best
        return self

    def score_samples(self, X: ArrayLike, velocities: ArrayLike) -> Array:
        """log p (N,) of every point."""
        x, v = self._points(X, velocities).about(self.goal_)
        return e_step(x, v, self.covariance_).log_density

    def score(self, X: ArrayLike, velocities: ArrayLike) -> float:
        """Mean log p."""
        return float(self.score_samples(X, velocities).mean())

    def _points(self, X: ArrayLike, velocities: ArrayLike) -> Geometry:
        if self.geometry not in GEOMETRIES:
            raise InvalidArgumentError(f"no geometry '{self.geometry}'; possible: {', '.join(GEOMETRIES)}")
        x, v = (np.asarray(part, dtype=np.float64) for part in (X, velocities))
        wanted = (len(x), 3 if self.geometry != "euclidean" else x.shape[-1])
        if x.ndim != 2 or v.shape != wanted or (self.geometry != "euclidean" and x.shape[1] != 9):
            raise InvalidArgumentError(
                f"points {x.shape} and velocities {v.shape} do not fit: (N, d) twice, of orientations (N, 9) and (N, 3)"
            )
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            raise InvalidArgumentError("points and velocities must be finite")
        return GEOMETRIES[self.geometry](x, v)
