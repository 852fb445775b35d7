"""Aligned demonstrations, attractors and support points: all that a tracking problem is made of (Algorithm 4, lines 1-10)."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lfd_gym.errors import DemonstrationError, InvalidArgumentError
from policies.arguments import is_whole
from policies.moa.alignment import warped
from policies.moa.attractors import BoxAttractors, join
from policies.moa.frames import Frames
from policies.moa.response import Response
from policies.moa.support_points import Interpolation
from policies.moa.tracking import Group, TrackingProblem

Array = NDArray[np.float64]


class Setting(NamedTuple):
    """What is given once demonstrations share their time."""

    points: list[Array]
    """Per demonstration (N, d)."""
    frames: list[Frames]
    attractors: BoxAttractors
    weights: Interpolation
    response: Response
    warps: list[Array]
    """Per demonstration the fractional steps (N,) of the recording that match those of the movement."""

    @property
    def local(self) -> list[Array]:
        """Per demonstration its points in every frame (N, F, d)."""
        return [frame.local(x) for x, frame in zip(self.points, self.frames, strict=True)]

    @property
    def spread(self) -> float:
        """Root mean square distance of the points of a demonstration from their mean."""
        return float(np.sqrt(np.mean([x.var(axis=0).sum() for x in self.points])))

    def centred(self) -> tuple[list[Array], list[Array]]:
        """Per demonstration what `centred` gives."""
        pairs = [centred(x, frame, self.attractors) for x, frame in zip(self.points, self.frames, strict=True)]
        return [x for x, _ in pairs], [matrix for _, matrix in pairs]

    def problem(self) -> TrackingProblem:
        """The sum of squared errors (4.29) of the simulated trajectories."""
        points, matrices = self.centred()
        steps = max(len(matrix) for matrix in matrices)
        stacked = np.concatenate([np.broadcast_to(m, (steps, *m.shape[1:])) for m in matrices], axis=1)
        targets = [x - self.response.free(x[0], x[1], len(x)) for x in points]
        group = Group(self.weights, stacked, np.concatenate(targets, axis=1), self.response)
        return TrackingProblem((group,), self.attractors.n_frames)

    def resting_at_goal(self, frame: int) -> Array:
        """z (P,) of the single goal that lies at the mean end point, seen from a frame.

        Raises InvalidArgumentError for a frame that does not exist.
        """
        n = self.attractors.n_frames
        if not (is_whole(frame) and -n <= frame < n):
            raise InvalidArgumentError(f"no frame {frame}; possible: 0 to {n - 1}")
        alpha, rho = np.zeros(n), np.zeros(self.attractors.low.shape)
        low, high = self.attractors.low[frame], self.attractors.high[frame]
        end = np.mean([x[-1, frame] for x in self.local], axis=0)
        alpha[frame] = 1.0
        rho[frame] = np.clip((2.0 * end - low - high) / np.maximum(high - low, np.finfo(float).tiny), -1.0, 1.0)
        return join(alpha, rho)

    @classmethod
    def of_demonstrations(
        cls,
        points: Sequence[Array],
        frames: Sequence[Frames],
        warps: Sequence[Array],
        attractors: BoxAttractors | float,
        weights: Interpolation,
        response: Response,
    ) -> Self:
        """Demonstrations brought to one time by their warps; attractors are given, or the margin of bounding boxes."""
        pairs = [warped(x, frame, index) for x, frame, index in zip(points, frames, warps, strict=True)]
        if not isinstance(attractors, BoxAttractors):
            attractors = BoxAttractors.around(np.concatenate([frame.local(x) for x, frame in pairs]), float(attractors))
        return cls([x for x, _ in pairs], [frame for _, frame in pairs], attractors, weights, response, list(warps))


def centred(points: Array, frames: Frames, attractors: BoxAttractors) -> tuple[Array, Array]:
    """A trajectory (N, d) and the map from interpolated z to goals, (1, d, P) or (N, d, P), both about its mean.

    Activations sum to one, so the origin does not matter, but to rounding it does.
    """
    middle = points.mean(axis=0)
    matrix = attractors.goal_matrix(frames.moved(np.eye(len(middle)), -middle))
    return points - middle, matrix if matrix.ndim == 3 else matrix[None]


def common_length(warps: Sequence[Array], n: int) -> int:
    """Time steps N of n aligned demonstrations; raises DemonstrationError where they differ or are not as many."""
    if len(warps) != n:
        raise DemonstrationError(f"{n} demonstrations came with {len(warps)} warps")
    lengths = sorted({len(index) for index in warps})
    if len(lengths) > 1:
        raise DemonstrationError(f"aligned demonstrations have one length, not {', '.join(map(str, lengths))}")
    return lengths[0]
