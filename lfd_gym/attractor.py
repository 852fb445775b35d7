"""The linear attractor (2.1) that every movement primitive is made of, and the saturation that bounds its speed."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def gain(x: float, y: float, z: float, alpha: float, beta: float, speed_limit: float) -> float:
    """Factor k of the goal error (x, y, z) = g - x in the acceleration k (g - x) - alpha v of a linear attractor.

    Where nothing saturates k = alpha beta and the attractor is equation (2.1). Beyond, the desired velocity beta (g - x) is
    shortened to the speed limit (Khatib 1987), which keeps the path straight.

    Args:
        x, y, z: goal error in m, or a rotation vector in rad.
        alpha, beta: gains [1/s]; beta = alpha / 4 is critically damped.
        speed_limit: largest desired speed, m/s or rad/s.
    """
    speed = beta * math.sqrt(x * x + y * y + z * z)
    return alpha * beta * (speed_limit / speed if speed > speed_limit else 1.0)


def goal(position: Array, velocity: Array, wanted: Array, alpha: float, beta: float) -> Array:
    """The goal g for which an unsaturated attractor accelerates by ``wanted``: g = x + (a + alpha v) / (alpha beta)."""
    return position + (wanted + alpha * velocity) / (alpha * beta)


def response(time: Array, start: float, goal_: float, alpha: float) -> Array:
    """Closed form x(t) of (2.1) from rest for critical damping, beta = alpha / 4."""
    rate = 0.5 * alpha
    return goal_ + (start - goal_) * (1.0 + rate * time) * np.exp(-rate * time)
