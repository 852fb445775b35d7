"""The learner of the Mixture of Attractors."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lfd_gym.action import ActionLayout
from policies.arguments import check_number
from policies.moa.frames import Frames
from policies.moa.mixture_of_attractors import MixtureOfAttractors
from policies.moa.tie_break import nearly_equal
from policies.path_generators import AttractorPath
from policies.trajectory_learner import LARGEST, TrajectoryLearner

Array = NDArray[np.float64]


class MoALearner(TrajectoryLearner):
    """Path by a Mixture of Attractors (thesis chapter 4), whose attractors have the controller's own gains.

    Parameters:
        spacing: time between support points [s].
        margin: of the bounding boxes, see `MixtureOfAttractors`.
        solver: see `MixtureOfAttractors`.
        second_stage: whether one of many nearly equal solutions is picked, see `policies.moa.tie_break`; equal is what
            differs by less than noise takes away from the error.
        events: scale of contact and hand in the alignment [m].

    Attributes:
        model_: the fitted `MixtureOfAttractors`.
    """

    model_: MixtureOfAttractors

    def __init__(
        self,
        spacing: float = 0.15,
        margin: float = 0.1,
        solver: str = "structured",
        second_stage: bool = True,
        events: float = 0.05,
    ) -> None:
        self.spacing, self.margin, self.solver = spacing, margin, solver
        self.second_stage, self.events = second_stage, events

    def check_arguments(self, dt: float) -> None:
        """At most one support point per time step; `MixtureOfAttractors` checks the rest."""
        super().check_arguments(dt)
        check_number("spacing", self.spacing, dt, LARGEST)

    def generator(
        self, points: Sequence[Array], frames: Sequence[Frames], warps: Sequence[Array], layout: ActionLayout, dt: float
    ) -> AttractorPath:
        """The convex problem of Algorithm 4."""
        n_support = max(round(len(warps[0]) * dt / self.spacing), 2)
        slack = nearly_equal(len(points), points[0].shape[1])
        self.model_ = MixtureOfAttractors(
            n_support, layout.alpha, layout.beta, dt,
            margin=self.margin, solver=self.solver, second_stage=self.second_stage, slack=slack,
        ).fit(points, frames, warps)  # fmt: skip
        return AttractorPath.of(self.model_)
