"""MoA-S: attractors that are activated by where the hand is, not by time (thesis 4.4.1)."""

from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.cluster import KMeans
from sklearn.metrics import pairwise_distances
from sklearn.utils.validation import check_is_fitted

from lfd_gym.errors import InvalidArgumentError
from policies.arguments import check_count, check_number
from policies.moa.attractors import BoxAttractors
from policies.moa.checks import checked
from policies.moa.frames import Frames
from policies.moa.interior_point import Solution, solve
from policies.moa.mixture_of_attractors import POSSIBLE
from policies.moa.response import Response
from policies.moa.setting import centred
from policies.moa.support_points import Interpolation, bandwidth, normalised_rbf
from policies.moa.tracking import Group, TrackingProblem

Array = NDArray[np.float64]


class SpatialMixtureOfAttractors(BaseEstimator):
    """x'' = alpha (beta (G S w(x) - x) - x'): the weights w of the support points depend on the position.

    The support points are the centres of k-means clusters of the demonstrated positions. The activations are fitted along the
    demonstrated positions, which keeps the problem convex; it does not promise that the movement, which goes by its own
    positions, converges to where the demonstrations end. It may cycle or stop early (Figure 4.3).

    Args:
        n_support: support points.
        alpha, beta, dt, overlap, margin, tolerance: see `MixtureOfAttractors`.
        gate_frame: index of the frame in which positions activate support points.
        random_state: seed of k-means.

    Attributes:
        centres_: (N_S, d) support points in the gate frame.
        z_: (N_S, F (1 + d)) their activations.
        attractors_: boxes in the coordinates of the frames.
        solution_: `Solution` with error, certified gap and number of iterations.
    """

    centres_: Array
    z_: Array
    attractors_: BoxAttractors
    solution_: Solution

    def __init__(
        self,
        n_support: int = 20,
        alpha: float = 40.0,
        beta: float | None = None,
        dt: float = 0.02,
        overlap: float = 0.1,
        margin: float = 0.1,
        gate_frame: int = 0,
        tolerance: float = 1e-6,
        random_state: int = 0,
    ) -> None:
        self.n_support = n_support
        self.alpha = alpha
        self.beta = beta
        self.dt = dt
        self.overlap = overlap
        self.margin = margin
        self.gate_frame = gate_frame
        self.tolerance = tolerance
        self.random_state = random_state

    def fit(self, trajectories: Sequence[ArrayLike], frames: Sequence[Frames] | None = None) -> Self:
        """Learn from M trajectories (N_m, d), which need no alignment, and the frames of each; the world alone where None.

        Raises DemonstrationError and InvalidArgumentError like `MixtureOfAttractors.fit`.
        """
        check_count("n_support", self.n_support, 2)
        check_count("gate_frame", self.gate_frame, 0)
        for name in ("overlap", "margin", "tolerance"):
            check_number(name, getattr(self, name), *POSSIBLE[name])
        response = self._response()
        points, frames = checked(trajectories, frames)
        if not 0 <= self.gate_frame < len(frames[0]):
            raise InvalidArgumentError(f"no frame {self.gate_frame}; possible: 0 to {len(frames[0]) - 1}")
        local = [frame.local(x) for x, frame in zip(points, frames, strict=True)]
        gates = [x[:, self.gate_frame] for x in local]
        n_points = len(np.unique(np.concatenate(gates), axis=0))
        if not 2 <= self.n_support <= n_points:
            raise InvalidArgumentError(
                f"{self.n_support} support points; possible: 2 to the number of points, {n_points}"
            )
        clusters = KMeans(self.n_support, n_init=10, random_state=self.random_state).fit(np.concatenate(gates))
        self.centres_ = clusters.cluster_centers_
        self.attractors_ = BoxAttractors.around(np.concatenate(local), self.margin)
        groups = []
        for x, frame, gate in zip(points, frames, gates, strict=True):
            x, matrix = centred(x, frame, self.attractors_)
            before = np.vstack([gate[:1], gate[:-1]])
            groups.append(Group(self._weights(before), matrix, x - response.free(x[0], x[1], len(x)), response))
        self.solution_ = solve(TrackingProblem(tuple(groups), len(frames[0])), self.tolerance)
        self.z_ = self.solution_.z
        return self

    def predict(self, frames: Frames, first: ArrayLike, n: int, second: ArrayLike | None = None) -> Array:
        """The trajectory (n, d) in a scene with frames at rest, from its first two positions; at rest where there is one."""
        check_is_fitted(self, "z_")
        if frames.moving:
            raise InvalidArgumentError("the frames move; frames at rest are needed")
        matrix, response = self.attractors_.goal_matrix(frames), self._response()
        x = np.empty((n, frames.n_dimensions))
        x[0], x[1:2] = first, first if second is None else second
        for i in range(2, n):
            gate = frames.local(x[i - 1 : i])[:, self.gate_frame]
            goal = matrix @ self._weights(gate).interpolated(self.z_)[0]
            x[i] = response.c1 * x[i - 1] + response.c2 * x[i - 2] + response.c3 * goal
        return x

    def _weights(self, gates: Array) -> Interpolation:
        between = pairwise_distances(self.centres_)
        np.fill_diagonal(between, np.inf)
        gamma = bandwidth(float(between.min(axis=1).mean()), self.overlap)
        return normalised_rbf(pairwise_distances(gates, self.centres_, metric="sqeuclidean"), gamma)

    def _response(self) -> Response:
        return Response.of_attractor(self.alpha, self.beta, self.dt)
