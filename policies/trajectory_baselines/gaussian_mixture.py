"""Gaussian mixture regression over time, in one frame (GMR) and in all of them (TP-GMM, Calinon et al. 2012)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax
from sklearn.mixture import GaussianMixture

from lfd_gym.action import ActionLayout
from lfd_gym.errors import DemonstrationError
from policies.moa.frames import Frames, resample
from policies.moa_learner import TrajectoryLearner

Array = NDArray[np.float64]


class MixturePath(NamedTuple):
    """A task-parametrised mixture of K Gaussians over time and the points in F frames."""

    prior: Array
    """(K,)."""
    time: Array
    """(N,) at which the path is asked for, in units of the mixture."""
    time_mean: Array
    """(K,)."""
    time_variance: Array
    """(K,)."""
    mean: Array
    """(F, K, d) of the points."""
    slope: Array
    """(F, K, d): covariance of points and time."""
    covariance: Array
    """(F, K, d, d) of the points."""

    def path(self, frames: Frames, first: Array) -> Array:
        """E[x | t] (N, d): the first frames, as many as were learned, are asked.

        In every frame each component is conditioned on the time; the products over the frames, in world coordinates, are
        mixed by the responsibilities of the time.
        """
        n_frames = len(self.mean)
        origins, axes = frames.origins[:n_frames], frames.axes[:n_frames]
        off = self.time[:, None] - self.time_mean
        log_density = -0.5 * (off**2 / self.time_variance + np.log(self.time_variance))
        weight = np.exp(log_softmax(np.log(self.prior) + log_density, axis=1))
        slope = self.slope / self.time_variance[:, None]
        rest = self.covariance - slope[..., :, None] * self.slope[..., None, :]
        precision = axes[:, None] @ np.linalg.inv(rest) @ axes[:, None].swapaxes(-1, -2)
        centre = np.einsum("fij,fkj->fki", axes, self.mean) + origins[:, None]
        turned = np.einsum("fij,fkj->fki", axes, slope)
        total = np.linalg.inv(precision.sum(axis=0))
        at_mean = np.einsum("kij,fkjl,fkl->ki", total, precision, centre)
        per_time = np.einsum("kij,fkjl,fkl->ki", total, precision, turned)
        return np.asarray(weight @ at_mean + (weight * off) @ per_time)


def fit_mixture(
    local: Array, n_components: int, regularisation: float, frames: slice, max_iter: int = 30
) -> MixturePath:
    """From aligned points in every frame (M, N, F, d): one joint mixture over time and all frames, initialised by equal parts
    of the time. Points are scaled by their spread, time runs from 0 to 1."""
    chosen = local[:, :, frames]
    m, n, f, d = chosen.shape
    if n < n_components:
        raise DemonstrationError(f"{n} aligned steps are too few for {n_components} Gaussians; set n_components")
    time = np.linspace(0.0, 1.0, n)
    scale = float(chosen.std(axis=(0, 1)).mean())
    rows = np.concatenate([np.tile(time, m)[:, None], chosen.reshape(m * n, f * d) / scale], axis=1)
    part = np.minimum((time * n_components).astype(int), n_components - 1)
    resp = np.eye(n_components)[np.tile(part, m)]
    count = resp.sum(axis=0)
    means = (resp.T @ rows) / count[:, None]
    spread = [
        np.cov(rows[resp[:, k] > 0].T, bias=True) + regularisation * np.eye(rows.shape[1]) for k in range(len(count))
    ]
    mixture = GaussianMixture(
        n_components, reg_covar=regularisation, random_state=0, max_iter=max_iter,
        weights_init=count / count.sum(), means_init=means, precisions_init=np.linalg.inv(spread),
    ).fit(rows)  # fmt: skip
    covariance = mixture.covariances_
    blocks = [slice(1 + i * d, 1 + (i + 1) * d) for i in range(f)]
    return MixturePath(
        mixture.weights_,
        time,
        mixture.means_[:, 0],
        covariance[:, 0, 0],
        scale * np.array([mixture.means_[:, b] for b in blocks]),
        scale * np.array([covariance[:, 0, b] for b in blocks]),
        scale**2 * np.array([covariance[:, b, b] for b in blocks]),
    )


class TPGMMLearner(TrajectoryLearner):
    """Task-parametrised mixture over time (4.4.2).

    Parameters:
        n_components: Gaussians; the thesis takes 75. Of ten settings tried on development setups the default wrote best: with
            more Gaussians the fewer points of each make the products over the frames unreliable.
        regularisation: added to the covariances' diagonals, time from 0 to 1 and points in units of their spread.
        max_iter: steps of EM; a warning says where they were too few.
        events: scale of contact and hand in the alignment [m].
    """

    seen_frames = slice(None)

    def __init__(
        self, n_components: int = 40, regularisation: float = 1e-5, max_iter: int = 30, events: float = 0.05
    ) -> None:
        self.n_components, self.regularisation = n_components, regularisation
        self.max_iter, self.events = max_iter, events

    def generator(
        self, points: Sequence[Array], frames: Sequence[Frames], warps: Sequence[Array], layout: ActionLayout, dt: float
    ) -> MixturePath:
        """EM on the aligned points."""
        rows = zip(points, frames, warps, strict=True)
        local = np.array([frame.local(resample(x, index)) for x, frame, index in rows])
        return fit_mixture(local, self.n_components, self.regularisation, self.seen_frames, self.max_iter)


class GMRLearner(TPGMMLearner):
    """Gaussian mixture regression over time in the world frame alone; parameters as of `TPGMMLearner`."""

    seen_frames = slice(0, 1)
