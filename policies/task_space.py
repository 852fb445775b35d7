"""Spaces in which a primitive controls a position: Cartesian or cylindrical, in a frame (thesis 2.1.2, 3.2, Figure 3.6).

Coordinates y (3,) of a point p (3,) [m] in the axes of the frame:

    Cartesian     y = p
    cylindrical   y = (radius [m], angle [rad], place along the axis [m]); the axis is the frame's z axis, and the angle
                  counts from its x axis towards its y axis, in (-pi, pi]

A difference of cylindrical coordinates is measured along the arc, (radius, radius x angle, axis) in metres, by the shorter
way around; so tolerances and speed limits mean the same in both spaces. At the axis itself the angle is undefined: a
primitive whose goal lies there has no angle to reach.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

CARTESIAN, CYLINDRICAL = 0, 1
POSITION_SPACES = ("cartesian", "cylindrical")
"""Names of the spaces in a primitive table, by number."""
AXES = (("x", "y", "z"), ("radius", "angle", "axis"))
"""What the coordinates of each space are called."""
SMALLEST_RADIUS = 1e-3
"""[m]: nearer to the axis a turn about it is counted as if it were here."""


@njit(cache=True)
def coordinates(point: Array, space: int) -> Array:
    """Coordinates y (3,) of a point (3,) [m] in axes of the frame."""
    if space == CYLINDRICAL:
        return np.array([math.hypot(point[0], point[1]), math.atan2(point[1], point[0]), point[2]])
    return point.copy()


@njit(cache=True)
def point(y: Array, space: int) -> Array:
    """Point (3,) [m] in axes of the frame that has coordinates y: inverse of `coordinates`."""
    if space == CYLINDRICAL:
        return np.array([y[0] * math.cos(y[1]), y[0] * math.sin(y[1]), y[2]])
    return y.copy()


@njit(cache=True)
def directions(y: Array, space: int) -> Array:
    """Unit vectors along which the coordinates grow at y, the columns of a rotation (3, 3) in axes of the frame."""
    axes = np.eye(3)
    if space == CYLINDRICAL:
        axes[0, 0], axes[1, 0] = math.cos(y[1]), math.sin(y[1])
        axes[0, 1], axes[1, 1] = -math.sin(y[1]), math.cos(y[1])
    return axes


@njit(cache=True)
def difference(y: Array, origin: Array, radius: float, space: int) -> Array:
    """y - origin (3,) [m]; an angle counts by the shorter way around, along the arc of a radius [m]."""
    result = y - origin
    if space == CYLINDRICAL:
        result[1] = radius * (np.mod(result[1] + math.pi, 2.0 * math.pi) - math.pi)
    return result


@njit(cache=True)
def moved(y: Array, goal: Array, way: float, space: int) -> Array:
    """Coordinates after a way [m] from y straight towards the goal in this space; the goal itself if it is nearer."""
    step = difference(goal, y, y[0], space)
    length = math.sqrt(np.dot(step, step))
    if length <= way:
        return goal.copy()
    step *= way / length
    if space == CYLINDRICAL:
        step[1] /= max(y[0], SMALLEST_RADIUS)
    return y + step
