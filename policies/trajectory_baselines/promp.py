"""Probabilistic Movement Primitives (Paraschos et al. 2013), conditioned on the start."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.action import ActionLayout
from policies.arguments import check_number
from policies.moa.frames import Frames, resample
from policies.moa.mixture_of_attractors import POSSIBLE
from policies.moa.support_points import interpolation
from policies.trajectory_learner import LARGEST, TrajectoryLearner

Array = NDArray[np.float64]


class ConditionedPath(NamedTuple):
    """The mean path of a ProMP, given where it starts."""

    mean: Array
    """(N, d) without knowing the start."""
    gain: Array
    """(N, d, d): by how much each point follows the start."""

    def path(self, frames: Frames, first: Array) -> Array:
        """Posterior mean, in the world."""
        return np.asarray(self.mean + self.gain @ (first - self.mean[0]))


def fit_promp(paths: Array, n_basis: int, overlap: float, ridge: float, noise: float) -> ConditionedPath:
    """From aligned paths (M, N, d): weights w by ridge regression on normalised radial basis functions, w ~ N(mu, Sigma).

    Conditioning on x_0 with variance noise^2 gives w = mu + Sigma Phi_0' (Phi_0 Sigma Phi_0' + noise^2 I)^-1 (x_0 - Phi_0 mu).
    """
    m, n, d = paths.shape
    phi = interpolation(n, n_basis, overlap).matrix
    weights = np.linalg.solve(phi.T @ phi + ridge * np.eye(n_basis), phi.T @ paths)
    mean = weights.mean(axis=0)
    deviation = (weights - mean).reshape(m, -1)
    start = (phi[0] @ (weights - mean)).reshape(m, d)
    gain = deviation.T @ start @ np.linalg.inv(start.T @ start + m * noise**2 * np.eye(d))
    return ConditionedPath(phi @ mean, np.einsum("nk,kij->nij", phi, gain.reshape(n_basis, d, d)))


class ProMPLearner(TrajectoryLearner):
    """Distribution of the paths in the world.

    Parameters:
        spacing: time between basis functions [s].
        overlap: value of a basis function at the centre of its neighbour.
        ridge: of the regression of the weights.
        noise: standard deviation with which the start is met [m].
        events: scale of contact and hand in the alignment [m].
    """

    is_baseline = True

    def __init__(
        self,
        spacing: float = 0.15,
        overlap: float = 0.1,
        ridge: float = 1e-6,
        noise: float = 1e-3,
        events: float = 0.05,
    ) -> None:
        self.spacing, self.overlap, self.ridge, self.noise, self.events = spacing, overlap, ridge, noise, events

    def check_arguments(self, dt: float) -> None:
        """At most one basis function per time step; ridge and noise are positive, so that there is always a solution."""
        super().check_arguments(dt)
        check_number("spacing", self.spacing, dt, LARGEST)
        check_number("overlap", self.overlap, *POSSIBLE["overlap"])
        check_number("ridge", self.ridge, 1e-12, 1.0)
        check_number("noise", self.noise, 1e-6, LARGEST)

    def generator(
        self, points: Sequence[Array], frames: Sequence[Frames], warps: Sequence[Array], layout: ActionLayout, dt: float
    ) -> ConditionedPath:
        """Weights of all demonstrations, their mean and covariance."""
        paths = np.array([resample(x, index) for x, index in zip(points, warps, strict=True)])
        n_basis = max(round(paths.shape[1] * dt / self.spacing), 2)
        return fit_promp(paths, n_basis, self.overlap, self.ridge, self.noise)
