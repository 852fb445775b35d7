"""Unit quaternions (w, x, y, z), compiled for single float64 arrays; the rotation they stand for acts on column vectors."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def multiply(a: Array, b: Array) -> Array:
    """Hamilton product: first rotate by ``b``, then by ``a``."""
    return np.array(
        [
            a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
            a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
        ]
    )


@njit(cache=True)
def conjugate(q: Array) -> Array:
    """The inverse rotation of a unit quaternion."""
    return np.array([q[0], -q[1], -q[2], -q[3]])


@njit(cache=True)
def canonical(q: Array) -> Array:
    """The same rotation with w >= 0: q and -q are one orientation."""
    return q.copy() if q[0] >= 0.0 else -q


@njit(cache=True)
def rotate(q: Array, v: Array) -> Array:
    """The vector ``v`` turned by ``q``."""
    tx = 2.0 * (q[2] * v[2] - q[3] * v[1])
    ty = 2.0 * (q[3] * v[0] - q[1] * v[2])
    tz = 2.0 * (q[1] * v[1] - q[2] * v[0])
    return np.array(
        [
            v[0] + q[0] * tx + q[2] * tz - q[3] * ty,
            v[1] + q[0] * ty + q[3] * tx - q[1] * tz,
            v[2] + q[0] * tz + q[1] * ty - q[2] * tx,
        ]
    )


@njit(cache=True)
def from_rotation_vector(r: Array) -> Array:
    """exp(r) for a rotation vector r [rad]; exact to rounding for small r as well."""
    angle = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    scale = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    return np.array([math.cos(0.5 * angle), scale * r[0], scale * r[1], scale * r[2]])


@njit(cache=True)
def to_rotation_vector(q: Array) -> Array:
    """log(q) [rad], the shortest rotation: its norm is at most pi."""
    sign = 1.0 if q[0] >= 0.0 else -1.0
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 2.0 * sign if sine < 1e-8 else sign * 2.0 * math.atan2(sine, sign * q[0]) / sine
    return np.array([scale * q[1], scale * q[2], scale * q[3]])


@njit(cache=True)
def to_matrix(q: Array) -> Array:
    """Rotation matrix (3, 3) of a unit quaternion."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


@njit(cache=True)
def from_matrix(m: Array) -> Array:
    """Unit quaternion with w >= 0 of a rotation matrix (3, 3), by the largest of its four squares."""
    q = np.empty(4)
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    if trace > max(m[0, 0], m[1, 1], m[2, 2]):
        q[0] = 1.0 + trace
        q[1], q[2], q[3] = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    elif m[0, 0] >= m[1, 1] and m[0, 0] >= m[2, 2]:
        q[1] = 1.0 + m[0, 0] - m[1, 1] - m[2, 2]
        q[0], q[2], q[3] = m[2, 1] - m[1, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]
    elif m[1, 1] >= m[2, 2]:
        q[2] = 1.0 - m[0, 0] + m[1, 1] - m[2, 2]
        q[0], q[1], q[3] = m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], m[1, 2] + m[2, 1]
    else:
        q[3] = 1.0 - m[0, 0] - m[1, 1] + m[2, 2]
        q[0], q[1], q[2] = m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    q /= math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return canonical(q)


@njit(cache=True)
def yaw(q: Array) -> float:
    """Angle about the vertical axis [rad] of the rotation's x axis seen from above."""
    return math.atan2(2.0 * (q[1] * q[2] + q[0] * q[3]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))
