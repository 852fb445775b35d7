"""The linear attractor (2.1) that every movement primitive is made of, and the saturation that bounds its speed."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def acceleration(error: Array, velocity: Array, alpha: float, beta: float, speed_limit: float) -> Array:
    """Acceleration of a linear attractor, alpha (v_d - v) with v_d = beta (g - x) shortened to the speed limit.

    Where nothing saturates this is alpha (beta (g - x) - v), equation (2.1); the saturation of the goal error is
    Khatib's (1987) and keeps the path straight.

    Args:
        error: g - x in m (or a rotation vector in rad), shape (d,).
        velocity: shape (d,).
        alpha, beta: gains [1/s]; beta = alpha / 4 is critically damped.
        speed_limit: largest desired speed, m/s or rad/s.
    """
    squared = 0.0
    for i in range(error.size):
        squared += error[i] * error[i]
    speed = beta * math.sqrt(squared)
    gain = alpha * beta * (speed_limit / speed if speed > speed_limit else 1.0)
    out = np.empty(error.size)
    for i in range(error.size):
        out[i] = gain * error[i] - alpha * velocity[i]
    return out


def goal(position: Array, velocity: Array, wanted: Array, alpha: float, beta: float) -> Array:
    """The goal g for which an unsaturated attractor accelerates by ``wanted``: g = x + (a + alpha v) / (alpha beta)."""
    return position + (wanted + alpha * velocity) / (alpha * beta)


def response(time: Array, start: float, goal_: float, alpha: float) -> Array:
    """Closed form x(t) of (2.1) from rest for critical damping, beta = alpha / 4."""
    rate = 0.5 * alpha
    return goal_ + (start - goal_) * (1.0 + rate * time) * np.exp(-rate * time)
