"""Motion of the tracked objects in the hand: what is held does not move relative to the tool (thesis 2.5.3, Table 2.2).

Whether a grasp still holds does not show in where the tool is relative to an object, which differs from grasp to grasp, but in
whether that has changed since the movement began. For every tracked frame f the observation `motion_f` is

    m_f(t) = min(|p_f(t) - p_f(t_0)|, GONE) [m],

with p_f the tool point in the coordinates of f and t_0 the time at which the current primitive was activated.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import quaternion
from policies.sequence_graph import segments
from policies.task_data import Measurement

Array = NDArray[np.float64]

MOTION = "motion_"
"""Beginning of the observations' names."""
GONE = 0.05
"""An object that moved in the hand by more [m], half of what the hand spans, is not held at all."""


@njit(cache=True)
def tool_in_frames(position: Array, frames: Array) -> Array:
    """The tool point (3,) in the coordinates of poses (F, 7): (F, 3) [m]."""
    result = np.empty((len(frames), 3))
    for f in range(len(frames)):
        result[f] = quaternion.rotate(quaternion.conjugate(frames[f, 3:]), position - frames[f, :3])
    return result


@njit(cache=True)
def motions(place: Array, began: Array) -> Array:
    """m_f (F,) [m] of the tool in the frames (F, 3), now and when the primitive began."""
    result = np.empty(len(place))
    for f in range(len(place)):
        off = place[f] - began[f]
        result[f] = min(np.sqrt(np.dot(off, off)), GONE)
    return result


def motion_observations(measured: Measurement, labels: NDArray[np.int64], names: Sequence[str]) -> dict[str, Array]:
    """`motion_<name>` (T + 1, 1) of the named frames, the first of which is the world, along a labelled demonstration.

    The observation at which a primitive begins still belongs to the one before.
    """
    places = np.stack([tool_in_frames(p, f) for p, f in zip(measured.position, measured.frames, strict=True)])
    result = np.zeros(places.shape[:2])
    for part in segments(labels):
        for t in range(part.start + 1, part.stop + 1):
            result[t] = motions(places[t], places[part.start])
    return {MOTION + name: result[:, f : f + 1] for f, name in enumerate(names) if f > 0}
