"""Unit quaternions (w, x, y, z), compiled; the rotation they stand for acts on column vectors.

The functions take float64 arrays or tuples. Those that end in an underscore return tuples and allocate nothing; they are what
the controller calls at every physics step.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


@njit(cache=True)
def multiply_(a: Array, b: Array) -> Quaternion:
    """Hamilton product: first rotate by ``b``, then by ``a``."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@njit(cache=True)
def difference_(a: Array, b: Array) -> Vector:
    """Rotation vector log(a b*) [rad]: the shortest turn in world axes that takes ``b`` to ``a``."""
    return to_rotation_vector_(multiply_(a, (b[0], -b[1], -b[2], -b[3])))


@njit(cache=True)
def from_rotation_vector_(x: float, y: float, z: float) -> Quaternion:
    """exp(r) for a rotation vector r [rad]; exact to rounding for small r as well."""
    angle = math.sqrt(x * x + y * y + z * z)
    scale = 0.5 - angle * angle / 48.0 if angle < 1e-4 else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), scale * x, scale * y, scale * z


@njit(cache=True)
def to_rotation_vector_(q: Array) -> Vector:
    """log(q) [rad], the shortest rotation: its norm is at most pi."""
    sign = 1.0 if q[0] >= 0.0 else -1.0
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 2.0 * sign if sine < 1e-8 else sign * 2.0 * math.atan2(sine, sign * q[0]) / sine
    return scale * q[1], scale * q[2], scale * q[3]


@njit(cache=True)
def from_matrix_(m: Array) -> Quaternion:
    """Unit quaternion of a rotation matrix (9,), row by row, by the largest of its four squares."""
    trace = m[0] + m[4] + m[8]
    if trace > max(m[0], m[4], m[8]):
        w, x, y, z = 1.0 + trace, m[7] - m[5], m[2] - m[6], m[3] - m[1]
    elif m[0] >= m[4] and m[0] >= m[8]:
        w, x, y, z = m[7] - m[5], 1.0 + m[0] - m[4] - m[8], m[1] + m[3], m[2] + m[6]
    elif m[4] >= m[8]:
        w, x, y, z = m[2] - m[6], m[1] + m[3], 1.0 - m[0] + m[4] - m[8], m[5] + m[7]
    else:
        w, x, y, z = m[3] - m[1], m[2] + m[6], m[5] + m[7], 1.0 - m[0] - m[4] + m[8]
    return normalised_((w, x, y, z))


@njit(cache=True)
def normalised_(q: Array) -> Quaternion:
    """The unit quaternion in the direction of q."""
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return q[0] * scale, q[1] * scale, q[2] * scale, q[3] * scale


@njit(cache=True)
def multiply(a: Array, b: Array) -> Array:
    """Hamilton product: first rotate by ``b``, then by ``a``."""
    return np.array(multiply_(a, b))


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
    """exp(r) for a rotation vector r [rad]."""
    return np.array(from_rotation_vector_(r[0], r[1], r[2]))


@njit(cache=True)
def to_rotation_vector(q: Array) -> Array:
    """log(q) [rad], the shortest rotation: its norm is at most pi."""
    return np.array(to_rotation_vector_(q))


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
    """Unit quaternion with w >= 0 of a rotation matrix (3, 3)."""
    return canonical(np.array(from_matrix_(m.copy().reshape(9))))


@njit(cache=True)
def yaw(q: Array) -> float:
    """Angle about the vertical axis [rad] of the rotation's x axis seen from above."""
    return math.atan2(2.0 * (q[1] * q[2] + q[0] * q[3]), 1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))
