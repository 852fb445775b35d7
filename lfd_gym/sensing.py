"""What the robot measures, compiled: the weight-compensated wrench, and the flat observation."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import controller, quaternion

Array = NDArray[np.float64]


@njit(cache=True)
def external_wrench(
    rotation: Array, reading: Array, sensor: Array, tool_com: Array, mass: float, gravity: Array, wrench: Array
) -> None:
    """Writes what the world exerts on the tool (6,), world axes, about the sensor's origin, weight compensated.

    A MuJoCo force sensor reads what the arm exerts on the tool in the sensor's axes: F = -R f - m g and, with c the tool's
    centre of mass relative to the sensor, T = -R t - c x m g.
    """
    for i in range(3):
        force = torque = 0.0
        for j in range(3):
            force += rotation[3 * i + j] * reading[j]
            torque += rotation[3 * i + j] * reading[3 + j]
        wrench[i] = -force - mass * gravity[i]
        wrench[3 + i] = -torque
    cx, cy, cz = tool_com[0] - sensor[0], tool_com[1] - sensor[1], tool_com[2] - sensor[2]
    wrench[3] -= mass * (cy * gravity[2] - cz * gravity[1])
    wrench[4] -= mass * (cz * gravity[0] - cx * gravity[2])
    wrench[5] -= mass * (cx * gravity[1] - cy * gravity[0])


ARM_SIZE = 46
"""Numbers that are measured without hand and frames."""


def size(n_hand: int) -> int:
    """Numbers that `observe` writes before the frames; `n_hand` is 4 with a hand, 0 without."""
    return ARM_SIZE + 2 * n_hand


@njit(cache=True)
def observe(  # type: ignore[no-untyped-def]
    settings,
    command,
    memory,
    qpos,
    qvel,
    tool,
    tool_rotation,
    sensor,
    sensor_rotation,
    reading,
    tool_com,
    hand_joints,
    actuator_force,
    acceleration,
    body_position,
    body_quaternion,
    frames,
    reference,
    flat,
):
    """Writes the observation in the order of `lfd_gym.envs.measured.bounds`; starts a new mean of the wrench.

    Quaternions of tool and reference lie in the half space of `reference` (4,), those of frames have w >= 0. Right after a
    reset the wrench is that of the moment. Returns whether positions, velocities and accelerations are finite.
    """
    s, m, n = settings[0], memory[0], controller.N_JOINTS
    flat[0:7], flat[7:14] = qpos[:n], qvel[:n]
    flat[14:17], flat[17:21] = tool, _towards(np.array(quaternion.from_matrix_(tool_rotation)), reference)
    flat[21:27], flat[27:30] = m.tool_velocity, m.position
    flat[30:34], flat[34:40] = _towards(m.quaternion, reference), m.velocity
    if m.ticks > 0:
        flat[40:46] = m.wrench_sum / m.ticks
        m.wrench_sum[:] = 0.0
        m.ticks = 0.0
    else:
        external_wrench(sensor_rotation, reading, sensor, tool_com, s.tool_mass, s.gravity, flat[40:46])
        flat[40:46] += command[0].sensor_error
    at = ARM_SIZE
    for i in range(s.n_hand):
        flat[at + i] = qpos[hand_joints[i]]
        flat[at + s.n_hand + i] = actuator_force[n + i]
    at += 2 * s.n_hand
    upward = np.array([1.0, 0.0, 0.0, 0.0])
    for body in frames:
        flat[at : at + 3], flat[at + 3 : at + 7] = body_position[body], _towards(body_quaternion[body], upward)
        at += 7
    return bool(np.isfinite(qpos).all() and np.isfinite(qvel).all() and np.isfinite(acceleration).all())


@njit(cache=True)
def _towards(q: Array, reference: Array) -> Array:
    """The sign of q that lies in the half space of a reference."""
    dot = q[0] * reference[0] + q[1] * reference[1] + q[2] * reference[2] + q[3] * reference[3]
    return q.copy() if dot >= 0.0 else -q
