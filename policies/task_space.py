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

from lfd_gym import attractor, quaternion

Array = NDArray[np.float64]

CARTESIAN, CYLINDRICAL = 0, 1
POSITION_SPACES = ("cartesian", "cylindrical")
"""Names of the spaces in a primitive table, by number."""
AXES = (("x", "y", "z"), ("radius", "angle", "axis"))
"""What the coordinates of each space are called."""
SMALLEST_RADIUS = 1e-3
"""[m]: nearer to the axis an angular speed is counted as if it were here."""


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
def curved_goal(
    goal: Array, position: Array, velocity: Array, frame: Array, alpha: float, beta: float, speed_limit: float
) -> Array:
    """Where a Cartesian attractor has to pull so that the reference moves as one in cylindrical coordinates would.

    The attractor (2.1), saturated as the robot's own is, wants r'' = k (r_g - r) - alpha r',
    r phi'' = k r (phi_g - phi) - alpha r phi', z'' = k (z_g - z) - alpha z'. In axes of the frame, which is at rest, this
    is an acceleration (r'' - r phi'^2, r phi'' + 2 r' phi', z'') along the `directions`, which the effective goal
    x + (x'' + alpha x') / (alpha beta) brings about.

    Args:
        goal: cylindrical coordinates of the goal (3,).
        position, velocity: of the reference, world frame (3,) [m], [m/s].
        frame: pose (7,) of the primitive's frame.
        alpha, beta: gains [1/s]; speed_limit [m/s].
    """
    to_frame = quaternion.conjugate(frame[3:])
    y = coordinates(quaternion.rotate(to_frame, position - frame[:3]), CYLINDRICAL)
    error = difference(goal, y, y[0], CYLINDRICAL)
    e = directions(y, CYLINDRICAL)
    moving = e.T @ quaternion.rotate(to_frame, velocity)
    turning = moving[1] / max(y[0], SMALLEST_RADIUS)
    wanted = attractor.gain(error[0], error[1], error[2], alpha, beta, speed_limit) * error
    wanted[0] -= y[0] * turning**2
    wanted[1] += 2.0 * moving[0] * turning
    return position + quaternion.rotate(frame[3:], e @ wanted) / (alpha * beta)
