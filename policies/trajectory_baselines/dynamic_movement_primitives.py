"""Dynamic Movement Primitives (4.1)-(4.4), one for the whole path or one per segment (VAR-DMP, Ureche et al. 2015)."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_filter

from lfd_gym.action import ActionLayout
from policies.arguments import check_flag, check_number
from policies.moa.frames import Frames, resample
from policies.moa.support_points import interpolation
from policies.trajectory_learner import LARGEST, TrajectoryLearner

Array = NDArray[np.float64]

ALPHA, BETA = 25.0, 6.25
"""Gains of the transformation system [1/s]. They are the same in segments of any length: one that begins elsewhere than it was
demonstrated to, in another scene, is back on its path after half a second."""
PHASE_DECAY = 4.0
"""Decay of the phase z' = -PHASE_DECAY z over a segment."""
SMOOTHING = 0.14
"""Time over which accelerations are taken [s]."""
SHORTEST = 0.4
"""Of a segment [s]."""
LONGEST_STEP = 0.5 / ALPHA
"""Of the integration [s], beyond which it would not be stable."""


class SegmentedDMP(NamedTuple):
    """DMPs one after the other, each in a frame of its own: x'' = alpha (beta (g - x) - x') + z (g - x_0) W.

    Without goal scaling the factor (g - x_0) is left out.
    """

    start: NDArray[np.int64]
    """(S + 1,) time steps at which segments begin, and N."""
    frame: NDArray[np.int64]
    """(S,) frame of each segment."""
    goal: Array
    """(S, d) in the frame's coordinates."""
    forcing: Array
    """(N, d) the forcing term divided by z, in units of (g - x_0) where it is scaled."""
    scaled: NDArray[np.bool_]
    """() whether the forcing term is scaled by g - x_0."""
    dt: Array
    """() time step [s]."""

    def path(self, frames: Frames, first: Array) -> Array:
        """(N, d) from rest; each segment begins where, and as fast as, the last one ended."""
        position, velocity = np.array(first, dtype=np.float64), np.zeros(len(first))
        n_steps = math.ceil(float(self.dt) / LONGEST_STEP - 1e-9)
        h = float(self.dt) / n_steps
        rows = np.empty((self.start[-1], len(first)))
        for (begin, end), f, place in zip(pairwise(self.start), self.frame, self.goal, strict=True):
            axes, n = frames.axes[f], int(end - begin)
            x, goal = axes.T @ (position - frames.origins[f]), place
            v = axes.T @ velocity
            scale = goal - x if self.scaled else 1.0
            forces = phase(n)[:, None] * scale * self.forcing[begin:end]
            for i in range(n):
                rows[begin + i] = frames.origins[f] + axes @ x
                for _ in range(n_steps):
                    v = v + (ALPHA * (BETA * (goal - x) - v) + forces[i]) * h
                    x = x + v * h
            position, velocity = frames.origins[f] + axes @ x, axes @ v
        return rows


def phase(n: int) -> Array:
    """z (n,) of (4.2) over n steps."""
    return np.exp(-PHASE_DECAY * np.arange(n) / n)


def fit_segments(
    local: Array, start: NDArray[np.int64], frame: NDArray[np.int64], step: int, goal_scaling: bool, dt: float
) -> SegmentedDMP:
    """Forcing terms from aligned points in every frame (M, N, F, d), by least squares over all demonstrations.

    One radial basis function every `step` time steps, normalised over time; with goal scaling the weights of (4.3), corrected,
    are fitted, else those of a forcing term that does not depend on the goal.
    """
    goals, forcing = [], []
    for (begin, end), f in zip(pairwise(start), frame, strict=True):
        paths = local[:, begin:end, f]
        n = paths.shape[1]
        window = min(2 * max(round(0.5 * SMOOTHING / dt), 1) + 1, n - 1 + n % 2)
        velocity, acceleration = (
            savgol_filter(paths, window, min(3, window - 1), deriv=k, delta=dt, axis=1) for k in (1, 2)
        )
        following = local[:, min(end, local.shape[1] - 1), f]
        goal = following.mean(axis=0)
        wanted = acceleration - ALPHA * (BETA * (goal - paths) - velocity)
        scale = np.broadcast_to((goal - paths[:, 0])[:, None] if goal_scaling else 1.0, wanted.shape)
        z = phase(n)
        basis = interpolation(n, min(max(round(n / step), 2), n), 0.1).matrix
        columns = []
        for k in range(wanted.shape[2]):
            regressors = (scale[:, :, k, None] * (z[:, None] * basis)).reshape(-1, basis.shape[1])
            columns.append(basis @ np.linalg.lstsq(regressors, wanted[:, :, k].ravel(), rcond=1e-10)[0])
        goals.append(goal)
        forcing.append(np.stack(columns, axis=1))
    return SegmentedDMP(start, frame, np.array(goals), np.concatenate(forcing), np.array(goal_scaling), np.array(dt))


def segment_by_variance(local: Array, window: int, shortest: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Starts (S + 1,) and frames (S,) of segments of aligned points in every frame (M, N, F, d), by Ureche et al. (2015).

    The frame of a step is the one in which the variance over the demonstrations, in a window around it and relative to that of
    the whole demonstration in this frame, is least. Segments of fewer than `shortest` steps join the one before.
    """
    variance = local.var(axis=0).sum(axis=2)
    relative = uniform_filter1d(variance, window, axis=0) / local.var(axis=(0, 1)).sum(axis=1)
    frame = relative.argmin(axis=1)
    start = [0]
    for i in np.flatnonzero(np.diff(frame)) + 1:
        if i - start[-1] >= shortest and len(frame) - i >= shortest:
            start.append(int(i))
    middle = [int(np.bincount(frame[a:b]).argmax()) for a, b in pairwise([*start, len(frame)])]
    return np.array([*start, len(frame)]), np.array(middle)


class DMPLearner(TrajectoryLearner):
    """One DMP in the world, to the mean end point.

    Parameters:
        goal_scaling: whether the forcing term is scaled by g - x_0 as in (4.3).
        spacing: time between basis functions [s].
        events: scale of contact and hand in the alignment [m].
    """

    is_baseline = True

    def __init__(self, goal_scaling: bool = False, spacing: float = 0.15, events: float = 0.05) -> None:
        self.goal_scaling, self.spacing, self.events = goal_scaling, spacing, events

    def check_arguments(self, dt: float) -> None:
        """At most one basis function per time step."""
        super().check_arguments(dt)
        check_flag("goal_scaling", self.goal_scaling)
        check_number("spacing", self.spacing, dt, LARGEST)

    def generator(
        self, points: Sequence[Array], frames: Sequence[Frames], warps: Sequence[Array], layout: ActionLayout, dt: float
    ) -> SegmentedDMP:
        """One segment."""
        rows = zip(points, frames, warps, strict=True)
        local = np.array([frame.local(resample(x, index)) for x, frame, index in rows])
        start, frame = self.segments(local, dt)
        return fit_segments(local, start, frame, max(round(self.spacing / dt), 1), self.goal_scaling, dt)

    def segments(self, local: Array, dt: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where DMPs begin, and the frame of each: here the whole path in the world."""
        return np.array([0, local.shape[1]]), np.array([0])


class VarDMPLearner(DMPLearner):
    """Segments whose frames are chosen by the variance over the demonstrations, and a DMP for each.

    Parameters:
        window: over which variances are averaged [s].
        goal_scaling, spacing, events: as of `DMPLearner`.
    """

    def __init__(
        self, window: float = 1.0, goal_scaling: bool = False, spacing: float = 0.15, events: float = 0.05
    ) -> None:
        super().__init__(goal_scaling, spacing, events)
        self.window = window

    def check_arguments(self, dt: float) -> None:
        """A window of a time step at least."""
        super().check_arguments(dt)
        check_number("window", self.window, dt, LARGEST)

    def segments(self, local: Array, dt: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """By the variance."""
        return segment_by_variance(local, max(round(self.window / dt), 1), max(round(SHORTEST / dt), 2))
