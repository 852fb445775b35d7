"""Hybrid position/force task-space inverse dynamics, thesis (2.2), compiled.

With J# = M^-1 J^T Lambda and Lambda = (J M^-1 J^T)^-1 the dynamically consistent inverse, equation (2.2) becomes

    T = J^T [Lambda (S e_x + (I - S) e_d - Jdot qdot + J xi) + (I - S) e_f] - M xi + g + h,

which needs one Cholesky factorisation of M (7 x 7) and one of J M^-1 J^T (6 x 6). Twists and wrenches are (linear, angular)
at the tool point in world axes.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

N_JOINTS = 7
REGULARISATION = 1e-6
"""Added to the diagonal of J M^-1 J^T [1/kg], so that singular poses stay finite."""


class NullSpace(NamedTuple):
    """Gains of xi, the joint acceleration that is projected into the null space of the task."""

    damping: float = 9.0
    """Joint speed damping [1/s]."""
    stiffness: float = 20.0
    """Pull towards the rest posture [1/s^2]."""
    limit_stiffness: float = 200.0
    """Push away from a joint limit [1/s^2], from ``limit_start`` of the half range on."""
    limit_start: float = 0.75


@njit(cache=True)
def arm_jacobian(anchor: Array, axis: Array, velocity: Array, tool: Array, jacobian: Array, drift: Array) -> None:
    """Writes the Jacobian (6, 7) of the tool point and the drift Jdot qdot (6,) of a chain of hinges.

    Args:
        anchor, axis: joint anchors and axes in world coordinates, at least 7 rows of 3.
        velocity: joint velocities [rad/s].
        tool: tool point, world [m].
    """
    for i in range(N_JOINTS):
        ax, ay, az = axis[i, 0], axis[i, 1], axis[i, 2]
        rx, ry, rz = tool[0] - anchor[i, 0], tool[1] - anchor[i, 1], tool[2] - anchor[i, 2]
        jacobian[0, i] = ay * rz - az * ry
        jacobian[1, i] = az * rx - ax * rz
        jacobian[2, i] = ax * ry - ay * rx
        jacobian[3, i], jacobian[4, i], jacobian[5, i] = ax, ay, az
    vx = vy = vz = 0.0
    for i in range(N_JOINTS):
        vx += jacobian[0, i] * velocity[i]
        vy += jacobian[1, i] * velocity[i]
        vz += jacobian[2, i] * velocity[i]
    for i in range(6):
        drift[i] = 0.0
    wx = wy = wz = 0.0
    for i in range(N_JOINTS):
        ax, ay, az = axis[i, 0], axis[i, 1], axis[i, 2]
        # the anchor moves with the links below joint i, the axis turns with them
        px = py = pz = 0.0
        for j in range(i):
            bx, by, bz = axis[j, 0], axis[j, 1], axis[j, 2]
            sx, sy, sz = anchor[i, 0] - anchor[j, 0], anchor[i, 1] - anchor[j, 1], anchor[i, 2] - anchor[j, 2]
            px += velocity[j] * (by * sz - bz * sy)
            py += velocity[j] * (bz * sx - bx * sz)
            pz += velocity[j] * (bx * sy - by * sx)
        dax, day, daz = wy * az - wz * ay, wz * ax - wx * az, wx * ay - wy * ax
        rx, ry, rz = tool[0] - anchor[i, 0], tool[1] - anchor[i, 1], tool[2] - anchor[i, 2]
        ux, uy, uz = vx - px, vy - py, vz - pz
        speed = velocity[i]
        drift[0] += speed * (day * rz - daz * ry + ay * uz - az * uy)
        drift[1] += speed * (daz * rx - dax * rz + az * ux - ax * uz)
        drift[2] += speed * (dax * ry - day * rx + ax * uy - ay * ux)
        drift[3] += speed * dax
        drift[4] += speed * day
        drift[5] += speed * daz
        wx, wy, wz = wx + ax * speed, wy + ay * speed, wz + az * speed


@njit(cache=True)
def _cholesky(a: Array, n: int) -> None:
    """Overwrites the lower triangle of a symmetric positive definite matrix by its Cholesky factor."""
    for j in range(n):
        for k in range(j):
            for i in range(j, n):
                a[i, j] -= a[i, k] * a[j, k]
        scale = 1.0 / math.sqrt(a[j, j])
        for i in range(j, n):
            a[i, j] *= scale


@njit(cache=True)
def null_space_acceleration(
    position: Array, velocity: Array, rest: Array, low: Array, high: Array, gains: NullSpace, xi: Array
) -> None:
    """Writes xi (7,): damping, posture, and a ramp beyond ``limit_start`` of the half range of every joint."""
    for i in range(N_JOINTS):
        centre, half = 0.5 * (low[i] + high[i]), 0.5 * (high[i] - low[i])
        beyond = abs(position[i] - centre) - gains.limit_start * half
        push = gains.limit_stiffness * beyond if beyond > 0.0 else 0.0
        if position[i] < centre:
            push = -push
        xi[i] = gains.damping * velocity[i] + gains.stiffness * (position[i] - rest[i]) + push


@njit(cache=True)
def hybrid_torque(
    inertia: Array,
    jacobian: Array,
    drift: Array,
    bias: Array,
    selection: Array,
    e_x: Array,
    e_d: Array,
    e_f: Array,
    xi: Array,
    torque: Array,
    work: Array,
) -> None:
    """Writes the joint torque (7,) of equation (2.2).

    Args:
        inertia: M (7, 7), overwritten by its Cholesky factor.
        jacobian: J (6, 7); drift: Jdot qdot (6,); bias: g + h (7,).
        selection: S (6, 6), a projector; I - S is force controlled.
        e_x, e_d: task accelerations of the position controller and of the damping (6,).
        e_f: wrench of the tool on the world (6,).
        xi: joint acceleration for the null space (7,).
        work: scratch (6, 14).
    """
    for i in range(N_JOINTS):
        torque[i] = bias[i]
        for j in range(N_JOINTS):
            torque[i] -= (inertia[i, j] if j <= i else inertia[j, i]) * xi[j]
    _cholesky(inertia, N_JOINTS)
    # rows of y = (L^-1 J^T)^T, so that J M^-1 J^T = y y^T
    y, a = work[:, :7], work[:, 8:14]
    for k in range(6):
        for i in range(N_JOINTS):
            value = jacobian[k, i]
            for j in range(i):
                value -= inertia[i, j] * y[k, j]
            y[k, i] = value / inertia[i, i]
    for i in range(6):
        for j in range(i + 1):
            value = REGULARISATION if i == j else 0.0
            for k in range(N_JOINTS):
                value += y[i, k] * y[j, k]
            a[i, j] = value
    _cholesky(a, 6)
    wrench = work[:, 7]
    for i in range(6):
        value = -drift[i] + e_d[i]
        for j in range(6):
            value += selection[i, j] * (e_x[j] - e_d[j])
        for j in range(N_JOINTS):
            value += jacobian[i, j] * xi[j]
        for j in range(i):
            value -= a[i, j] * wrench[j]
        wrench[i] = value / a[i, i]
    for i in range(5, -1, -1):
        value = wrench[i]
        for j in range(i + 1, 6):
            value -= a[j, i] * wrench[j]
        wrench[i] = value / a[i, i]
    for i in range(6):
        value = e_f[i]
        for j in range(6):
            value -= selection[i, j] * e_f[j]
        wrench[i] += value
        for j in range(N_JOINTS):
            torque[j] += jacobian[i, j] * wrench[i]


class HybridController:
    """Equation (2.2) for any selection matrix, as a function of the current dynamics.

    For use on its own; the environments call the kernels above from `lfd_gym.servo.tick`.

    Args:
        rest: posture that the null space prefers, shape (7,) [rad].
        low, high: joint limits, shape (7,) [rad].
        gains: null-space gains.
    """

    def __init__(self, rest: Array, low: Array, high: Array, gains: NullSpace | None = None) -> None:
        self.rest, self.low, self.high = (np.array(a, dtype=np.float64) for a in (rest, low, high))
        self.gains = NullSpace() if gains is None else gains

    def torque(
        self,
        position: Array,
        velocity: Array,
        inertia: Array,
        jacobian: Array,
        drift: Array,
        bias: Array,
        e_x: Array,
        selection: Array | None = None,
        e_f: Array | None = None,
        e_d: Array | None = None,
    ) -> Array:
        """Joint torque (7,) [N m]; without a selection matrix all six directions are position controlled."""
        zero, torque, xi = np.zeros(6), np.empty(N_JOINTS), np.empty(N_JOINTS)
        null_space_acceleration(position, velocity, self.rest, self.low, self.high, self.gains, xi)
        hybrid_torque(
            np.array(inertia, dtype=np.float64),
            jacobian,
            drift,
            bias,
            np.eye(6) if selection is None else np.asarray(selection, dtype=np.float64),
            e_x,
            zero if e_d is None else e_d,
            zero if e_f is None else e_f,
            xi,
            torque,
            np.empty((6, 14)),
        )
        return torque
