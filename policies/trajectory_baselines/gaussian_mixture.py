"""Gaussian mixture regression over time, in one frame (GMR) and in all of them (TP-GMM, Calinon et al. 2012)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from lfd_gym.action import ActionLayout
from lfd_gym.errors import DemonstrationError
from policies.arguments import check_count, check_number
from policies.moa.checks import checked
from policies.moa.frames import AT_REST, Frames, resample
from policies.trajectory_baselines.task_mixture import fit_task_mixture
from policies.trajectory_learner import TrajectoryLearner

Array = NDArray[np.float64]


class MixturePath(NamedTuple):
    """A task-parametrised mixture of K components, each a Gaussian over time and point in every one of F frames.

    Time is the same in all frames, and so are its mean and variance.
    """

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
        mixed by the responsibilities of the time. Calinon's product of joint Gaussians, conditioned afterwards, has the same
        conditional means and other responsibilities: where frames disagree, components move in time, and parts of the path are
        left out.
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
    """From aligned points in every frame (M, N, F, d): a `TaskMixture` of time and point in each of the chosen frames.

    EM begins with equal parts of the time, one for each component. Points are scaled by their spread, time runs from 0 to 1.
    With one frame it is a Gaussian mixture over time and point with full covariances.

    Raises:
        DemonstrationError: points that are all the same, or fewer steps than components.
    """
    chosen = local[:, :, frames]
    m, n, f, d = chosen.shape
    if np.ptp(chosen, axis=(0, 1)).max() <= AT_REST:
        raise DemonstrationError("all points of all demonstrations are the same; a Gaussian mixture needs a movement")
    if n < n_components:
        raise DemonstrationError(
            f"{n} aligned steps are too few for {n_components} Gaussians; set n_components to at most {n}"
        )
    time = np.linspace(0.0, 1.0, n)
    scale = float(np.sqrt(chosen.var(axis=(0, 1)).mean()))
    times = np.broadcast_to(np.tile(time, m)[:, None], (f, m * n, 1))
    rows = np.concatenate([times, np.moveaxis(chosen.reshape(m * n, f, d), 1, 0) / scale], axis=2)
    part = np.minimum(np.arange(n) * n_components // max(n - 1, 1), n_components - 1)
    mixture = fit_task_mixture(rows, np.eye(n_components)[np.tile(part, m)], regularisation, max_iter).mixture
    return MixturePath(
        mixture.prior,
        time,
        mixture.mean[0, :, 0],
        mixture.covariance[0, :, 0, 0],
        scale * mixture.mean[:, :, 1:],
        scale * mixture.covariance[:, :, 0, 1:],
        scale**2 * mixture.covariance[:, :, 1:, 1:],
    )


class TPGMMLearner(TrajectoryLearner):
    """Task-parametrised mixture over time (Calinon et al. 2012, thesis 4.4.2).

    Parameters:
        n_components: Gaussians; the thesis's 75.
        regularisation: added to the covariances' diagonals, time from 0 to 1 and points in units of their spread.
        max_iter: steps of EM at most; a warning says where they were too few.
        events: scale of contact and hand in the alignment [m].

    Where it breaks: few demonstrations do not tell what a frame has to do with a movement. Where they happen to lie close to a
    plane of it, the path is drawn to this plane.
    """

    is_baseline = True
    seen_frames = slice(None)

    def __init__(
        self, n_components: int = 75, regularisation: float = 1e-6, max_iter: int = 30, events: float = 0.05
    ) -> None:
        self.n_components, self.regularisation = n_components, regularisation
        self.max_iter, self.events = max_iter, events

    def check_arguments(self, dt: float) -> None:
        """One Gaussian and one step of EM at least; the regularisation keeps covariances invertible."""
        super().check_arguments(dt)
        check_count("n_components", self.n_components, 1)
        check_number("regularisation", self.regularisation, 1e-10, 1.0)
        check_count("max_iter", self.max_iter, 1)

    def generator(
        self, points: Sequence[Array], frames: Sequence[Frames], warps: Sequence[Array], layout: ActionLayout, dt: float
    ) -> MixturePath:
        """EM on the aligned points; every demonstration has to move."""
        checked(points, frames)
        rows = zip(points, frames, warps, strict=True)
        local = np.array([frame.local(resample(x, index)) for x, frame, index in rows])
        return fit_mixture(local, self.n_components, self.regularisation, self.seen_frames, self.max_iter)


class GMRLearner(TPGMMLearner):
    """Gaussian mixture regression over time in the world frame alone; parameters as of `TPGMMLearner`."""

    seen_frames = slice(0, 1)
