"""Replay: the demonstrated path as it was."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.action import ActionLayout
from policies.moa.frames import Frames, resample
from policies.trajectory_learner import TrajectoryLearner

Array = NDArray[np.float64]


class FixedPath(NamedTuple):
    """The same path in every scene."""

    points: Array
    """(N, d)."""

    def path(self, frames: Frames, first: Array) -> Array:
        """Whatever the scene."""
        return self.points


class ReplayLearner(TrajectoryLearner):
    """Plays the path of one demonstration, the one that the others are aligned to.

    Parameters:
        events: scale of contact and hand in the alignment [m].
    """

    is_baseline = True

    def __init__(self, events: float = 0.05) -> None:
        self.events = events

    def generator(
        self, points: Sequence[Array], frames: Sequence[Frames], warps: Sequence[Array], layout: ActionLayout, dt: float
    ) -> FixedPath:
        """The demonstration whose time is the common one."""
        own = next(m for m, index in enumerate(warps) if len(index) == len(points[m]) and (np.diff(index) == 1.0).all())
        return FixedPath(resample(points[own], warps[own]))
