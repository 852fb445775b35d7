"""The Mixture of Attractors movement primitive (thesis chapter 4)."""

from collections.abc import Sequence
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from lfd_gym.errors import InvalidArgumentError
from policies.arguments import check_count, check_flag, check_number
from policies.moa.alignment import align
from policies.moa.attractors import BoxAttractors, split
from policies.moa.checks import checked, checked_bounds
from policies.moa.frames import Frames
from policies.moa.generic_solver import solve_generic
from policies.moa.interior_point import Solution, solve
from policies.moa.one_step import OneStepFit, fit_one_step
from policies.moa.response import Response
from policies.moa.setting import Setting, common_length
from policies.moa.softmax import solve_softmax
from policies.moa.support_points import interpolation
from policies.moa.tie_break import SLACK, break_tie, nearness
from policies.moa.tracking import TrackingProblem

Array = NDArray[np.float64]

POSSIBLE: dict[str, tuple[float, float]] = {
    "overlap": (1e-6, 0.999),
    "margin": (0.0, 100.0),
    "tolerance": (1e-12, 1.0),
    "slack": (0.0, 100.0),
    "accuracy": (0.0, 100.0),
    "switching": (0.0, 1e6),
}
"""Arguments and the least and largest value of each."""


class MixtureOfAttractors(BaseEstimator):
    """Movements of any shape relative to several frames, learned by one convex problem (Algorithm 4).

    x'' = alpha (beta (G a(t) - x) - x') (4.9): attractors G stand at the corners of a box in every frame, and their activations
    a(t), shared by all demonstrations, make the simulated trajectories nearest to the demonstrated ones (4.29).

    Demonstrations have to show the same sequence of movements: they are brought to one time first. A frame that the hand
    carries explains the movement for a trivial reason, and a skill would wait for it: give such a frame as it stood before.

    Args:
        n_support: support points N_S (4.19), or None for free activations at every step (4.16).
        alpha, beta: gains of the attractors [1/s]; beta = alpha / 4 where None.
        dt: time step of the trajectories [s].
        overlap: value of a support point's RBF at the centre of its neighbour (4.3.3).
        margin: by which the bounding boxes are widened on each side, relative to their extent.
        bounds: boxes (low, high), each (F, d) in the frames' coordinates, instead of bounding boxes. With the world as only
            frame and joint limits as box it is joint-space MoA (4.5.2): two attractors per joint, and the limits are kept
            where beta <= alpha / 4 and the movement starts at rest.
        goal_frame: index of the frame to whose goal the movement converges for t -> infinity: the last support point then
            attracts to the mean end point in this frame (4.5.2).
        objective: "simulation" (4.12), or "one-step", the likelihood (4.36), with covariances in `one_step_`.
        solver: "structured", "softmax", or a solver of `qpsolvers` such as "proxqp".
        tolerance: relative gap to the minimum.
        second_stage: whether to pick one of many nearly equal solutions, see `tie_break`.
        slack, accuracy: what the second stage may spend: this fraction of the least error, and a root mean square deviation of
            this fraction of the movement's spread (root mean square distance from its mean).
        switching: cost of changing frames in the second stage, in units of the mean preference.
        aligned: whether the trajectories are aligned in time already.
        warm_start: start from the previous fit.

    Attributes:
        attractors_: boxes in the coordinates of the frames.
        z_: (N_S, F (1 + d)) activations at the support points, in the short form of `policies.moa.attractors`.
        frame_activations_: (N, F) summed activation of every frame at every time step.
        sparsity_: J_sparsity (4.32), 1 for one frame at a time.
        minimum_: `Solution` of the first stage: cost, certified gap, number of iterations.
        solution_: `Solution` of the last stage; the same where there was no second one.
        objective_: J at z_, (4.29) or the squared Mahalanobis distances of (4.36).
        gap_: certified bound on `objective_` minus its minimum; what the second stage spent counts in.
        residuals_: per demonstration, simulated minus aligned demonstrated positions (N, d).
        n_steps_: time steps N of the movement.
        warps_: per demonstration the fractional time steps (N,) that match those of the movement.
        one_step_: covariances and likelihood of the objective "one-step", else None.
    """

    attractors_: BoxAttractors
    z_: Array
    frame_activations_: Array
    sparsity_: float
    minimum_: Solution
    solution_: Solution
    objective_: float
    gap_: float
    residuals_: list[Array]
    n_steps_: int
    warps_: list[Array]
    one_step_: OneStepFit | None

    def __init__(
        self,
        n_support: int | None = 75,
        alpha: float = 40.0,
        beta: float | None = None,
        dt: float = 0.02,
        overlap: float = 0.1,
        margin: float = 0.1,
        bounds: tuple[ArrayLike, ArrayLike] | None = None,
        goal_frame: int | None = None,
        objective: Literal["simulation", "one-step"] = "simulation",
        solver: str = "structured",
        tolerance: float = 1e-6,
        second_stage: bool = True,
        slack: float = SLACK,
        accuracy: float = 3e-3,
        switching: float = 0.1,
        aligned: bool = False,
        warm_start: bool = False,
    ) -> None:
        self.n_support = n_support
        self.alpha = alpha
        self.beta = beta
        self.dt = dt
        self.overlap = overlap
        self.margin = margin
        self.bounds = bounds
        self.goal_frame = goal_frame
        self.objective = objective
        self.solver = solver
        self.tolerance = tolerance
        self.second_stage = second_stage
        self.slack = slack
        self.accuracy = accuracy
        self.switching = switching
        self.aligned = aligned
        self.warm_start = warm_start

    def fit(
        self,
        trajectories: Sequence[ArrayLike],
        frames: Sequence[Frames] | None = None,
        warps: Sequence[Array] | None = None,
    ) -> Self:
        """Learn from M trajectories (N_m, d) and the frames of each, at rest or moving; the world alone where None.

        warps are given where another entity was aligned before, see `alignment.align`.

        Raises:
            DemonstrationError: demonstrations that cannot be learned from.
            InvalidArgumentError, UnknownNameError: an argument that is not possible.
        """
        setting = self.setting(trajectories, frames, warps)
        fixed = None if self.goal_frame is None else setting.resting_at_goal(self.goal_frame)
        self.one_step_ = None
        if self.objective == "simulation":
            problem = setting.problem()
            accuracy = self.accuracy * setting.spread
            self.minimum_ = self._minimise(problem, setting, fixed)
        else:
            self.one_step_ = fit_one_step(setting, lambda weighted: self._minimise(weighted, setting, fixed))
            problem, accuracy = self.one_step_.problem, 0.0
            self.minimum_ = self.one_step_.solution
        self.solution_ = self.minimum_
        if self.second_stage and problem.n_frames > 1:
            allowed = (1.0 + self.slack) * self.minimum_.error + accuracy**2 * problem.n_points
            self.solution_ = self._break_tie(problem, nearness(setting.local, setting.weights), allowed, fixed)

        self.z_, self.objective_ = self.solution_.z, self.solution_.error
        self.gap_ = self.objective_ - self.minimum_.error + self.minimum_.gap
        self.attractors_, self.n_steps_, self.warps_ = setting.attractors, len(setting.points[0]), setting.warps
        self.frame_activations_ = self.activations()[0]
        self.sparsity_ = sparsity(self.frame_activations_)
        pairs = zip(setting.points, setting.frames, strict=True)
        self.residuals_ = [self.predict(frame, x[0], x[1]) - x for x, frame in pairs]
        return self

    def setting(
        self,
        trajectories: Sequence[ArrayLike],
        frames: Sequence[Frames] | None = None,
        warps: Sequence[Array] | None = None,
    ) -> Setting:
        """Aligned demonstrations, attractors and support points: what `fit` solves is its `problem`. Raises like `fit`."""
        self._check_arguments()
        points, frames = checked(trajectories, frames)
        if warps is None:
            warps = [np.arange(len(x), dtype=np.float64) for x in points] if self.aligned else align(points, frames)
        weights = interpolation(common_length(warps, len(points)), self.n_support, self.overlap)
        attractors = self.margin if self.bounds is None else checked_bounds(self.bounds, frames[0])
        return Setting.of_demonstrations(points, frames, warps, attractors, weights, self._response())

    def predict(self, frames: Frames, first: ArrayLike, second: ArrayLike | None = None, n: int | None = None) -> Array:
        """The trajectory (n, d) in a scene with these frames, from its first two positions; at rest where there is one.

        n is the number of time steps, those of the demonstrations where None; moving frames need as many.
        """
        goals = self.goals(frames, n)
        first = np.asarray(first, dtype=np.float64)
        second = first if second is None else np.asarray(second, dtype=np.float64)
        return self._response().simulate(goals, first, second)

    def goals(self, frames: Frames, n: int | None = None) -> Array:
        """The goal G_i a_i (n, d) of every time step in a scene with these frames."""
        alpha, places = self.activations(n)
        if len(frames) != alpha.shape[1] or frames.n_steps not in (None, len(alpha)):
            raise InvalidArgumentError(
                f"{len(frames)} frames over {frames.n_steps or 'any number of'} steps were given; "
                f"{alpha.shape[1]} frames over {len(alpha)} steps are needed"
            )
        there = frames.origins * alpha[..., None] + (frames.axes @ places[..., None])[..., 0]
        return np.asarray(there.sum(axis=1))

    def activations(self, n: int | None = None) -> tuple[Array, Array]:
        """Frame activations alpha (n, F) and places q (n, F, d) of the first n time steps, all where None.

        The goal in a scene is sum_f alpha_f p_f + R_f q_f, with origin p_f and axes R_f of frame f. Beyond the demonstrated
        movement the last support point takes over.
        """
        check_is_fitted(self, "z_")
        weights = interpolation(self.n_steps_, self.n_support, self.overlap, n)
        alpha, rho = split(weights.interpolated(self.z_), self.attractors_.n_frames)
        low, high = self.attractors_.low, self.attractors_.high
        return alpha, 0.5 * (alpha[..., None] * (low + high) + rho * (high - low))

    def _check_arguments(self) -> None:
        if self.n_support is not None:
            check_count("n_support", self.n_support, 2)
        for name, (least, most) in POSSIBLE.items():
            check_number(name, getattr(self, name), least, most)
        for name in ("second_stage", "aligned", "warm_start"):
            check_flag(name, getattr(self, name))
        if self.objective not in ("simulation", "one-step"):
            raise InvalidArgumentError(f"no objective {self.objective!r}; possible: simulation, one-step")

    def _response(self) -> Response:
        return Response.of_attractor(self.alpha, self.beta, self.dt)

    def _minimise(self, problem: TrackingProblem, setting: Setting, fixed: Array | None) -> Solution:
        free = problem if fixed is None else problem.with_last(fixed)
        if self.solver == "structured":
            guess = self.z_[: free.n_support] if self.warm_start and hasattr(self, "z_") else None
            usable = guess is not None and guess.shape == (free.n_support, free.n_parameters)
            return _completed(solve(free, self.tolerance, start=guess if usable else None), fixed)
        if self.solver == "softmax":
            return _completed(solve_softmax(free, setting.attractors, self.tolerance), fixed)
        return _completed(solve_generic(free, setting.attractors, self.solver, self.tolerance), fixed)

    def _break_tie(self, problem: TrackingProblem, preference: Array, allowed: float, fixed: Array | None) -> Solution:
        if fixed is None:
            return break_tie(problem, self.minimum_, preference, self.switching, allowed, self.tolerance)
        first = self.minimum_._replace(z=self.minimum_.z[:-1])
        free, near = problem.with_last(fixed), preference[:-1]
        return _completed(break_tie(free, first, near, self.switching, allowed, self.tolerance), fixed)


def sparsity(frame_activations: Array) -> float:
    """J_sparsity (4.32) of frame activations (N, F): 1 where one frame is active at a time, 1 / F where all are alike."""
    return float((frame_activations**2).sum(axis=1).mean())


def _completed(solution: Solution, last: Array | None) -> Solution:
    """The solution with the activations of a fixed last support point."""
    return solution if last is None else solution._replace(z=np.vstack([solution.z, last]))
