"""Frames of carried objects stay where the objects last stood.

While an object is carried its frame explains the demonstrated movement perfectly and for a trivial reason: a skill that
follows it would never move, the object waiting for the hand and the hand for the object. What a lift or a transport is
relative to is the place that the object was taken from. The rule is causal, so that a skill at run time sees what the learner
saw.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.moa.frames import Frames

Array = NDArray[np.float64]

WINDOW = 0.3
"""Time over which motion is compared [s]: above the jitter of tracking, below any transport."""
MOVED = 0.005
"""A frame that moves less within the window is not carried, in units of the trajectory (5 mm)."""


class Parking(NamedTuple):
    """What is remembered from step to step."""

    points: Array
    """(w, d) recent places of the hand, the oldest first."""
    origins: Array
    """(w, F, d) recent origins of the frames."""
    axes: Array
    """(w, F, d, d)"""
    held_origins: Array
    """(F, d) where each frame counts as standing."""
    held_axes: Array
    """(F, d, d)"""
    waits: NDArray[np.int64]
    """(F,) steps until a frame counts as released; 0 where it is free."""

    @classmethod
    def start(cls, point: Array, frames: Frames, dt: float) -> "Parking":
        """The memory at the first step; frames of one instant."""
        w = max(round(WINDOW / dt), 1) + 1
        return cls(
            np.tile(point, (w, 1)),
            np.tile(frames.origins, (w, 1, 1)),
            np.tile(frames.axes, (w, 1, 1, 1)),
            frames.origins,
            frames.axes,
            np.zeros(len(frames), dtype=np.int64),
        )

    def step(self, point: Array, frames: Frames) -> "Parking":
        """The memory one step later.

        A frame is carried while it moves within the window and the hand's place in it changes by less than half of that way.
        It is then held where it was when the window began, and released once it has not been carried for one window.
        """
        points = np.concatenate([self.points[1:], point[None]])
        origins = np.concatenate([self.origins[1:], frames.origins[None]])
        axes = np.concatenate([self.axes[1:], frames.axes[None]])
        way = np.linalg.norm(origins[-1] - origins[0], axis=1)
        slip = np.linalg.norm(_seen(points[-1], origins[-1], axes[-1]) - _seen(points[0], origins[0], axes[0]), axis=1)
        carried = (way > MOVED) & (slip < 0.5 * way)
        waits = np.where(carried, len(points), np.maximum(self.waits - 1, 0))
        taken, free = carried & (self.waits == 0), waits == 0
        held_origins = np.where(taken[:, None], origins[0], np.where(free[:, None], origins[-1], self.held_origins))
        held_axes = np.where(taken[:, None, None], axes[0], np.where(free[:, None, None], axes[-1], self.held_axes))
        return Parking(points, origins, axes, held_origins, held_axes, waits)


def parked(points: Array, frames: Frames, dt: float) -> Frames:
    """The frames as a skill would see them step by step while the hand moves along points (N, d)."""
    if not frames.moving:
        return frames
    memory = Parking.start(points[0], Frames(frames.origins[0], frames.axes[0]), dt)
    origins, axes = [memory.held_origins], [memory.held_axes]
    for point, *pose in zip(points[1:], frames.origins[1:], frames.axes[1:], strict=True):
        memory = memory.step(point, Frames(*pose))
        origins.append(memory.held_origins)
        axes.append(memory.held_axes)
    return Frames(np.array(origins), np.array(axes))


def _seen(point: Array, origins: Array, axes: Array) -> Array:
    """A point (d,) in the coordinates of every frame (F, d)."""
    return ((point - origins)[:, None] @ axes)[:, 0]
