"""The attractor as a reference inside the controller: it moves at the controller's rate towards the commanded goal."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import attractor, contact, quaternion

Array = NDArray[np.float64]

SHOULDER, WRIST, POINTING = 1, 5, 6
"""Joints whose anchors are the centres of shoulder and wrist, and the one about whose axis the hand turns."""


@njit(cache=True)
def move_reference(  # type: ignore[no-untyped-def]
    settings,
    command,
    memory,
    tool: Array,
    tool_quaternion,
    qpos: Array,
    anchor: Array,
    axis: Array,
    error: Array,
    feed: Array,
) -> None:
    """Advances the reference by one tick; writes its error (6,) to the tool and its acceleration (6,).

    Heun's rule: the reference follows the closed form of (2.1) to second order. It stays within the arm's reach, of which
    the joints' angles, anchors and axes (as in `servo.tick`) tell.
    """
    s, c, m = settings[0], command[0], memory[0]
    d, velocity = m.direction, m.velocity
    px, py, pz = m.position[0], m.position[1], m.position[2]
    start = (m.quaternion[0], m.quaternion[1], m.quaternion[2], m.quaternion[3])
    v0 = (velocity[0], velocity[1], velocity[2], velocity[3], velocity[4], velocity[5])
    q = start
    for stage in range(2):
        x, y, z = c.position[0] - px, c.position[1] - py, c.position[2] - pz
        k = attractor.gain(x, y, z, s.alpha, s.beta, s.speed_limit)
        ax, ay, az = k * x - s.alpha * velocity[0], k * y - s.alpha * velocity[1], k * z - s.alpha * velocity[2]
        if m.mode == contact.APPROACH:
            along = d[0] * ax + d[1] * ay + d[2] * az
            speed = d[0] * velocity[0] + d[1] * velocity[1] + d[2] * velocity[2]
            along = s.alpha * (contact.GUARDED_SPEED - speed) - along
            ax, ay, az = ax + along * d[0], ay + along * d[1], az + along * d[2]
        x, y, z = quaternion.difference_(c.quaternion, q)
        k = attractor.gain(x, y, z, s.alpha, s.beta, s.turn_limit)
        bx, by, bz = k * x - s.alpha * velocity[3], k * y - s.alpha * velocity[4], k * z - s.alpha * velocity[5]
        if stage == 0:
            feed[0], feed[1], feed[2], feed[3], feed[4], feed[5] = ax, ay, az, bx, by, bz
        else:
            feed[0], feed[1], feed[2] = 0.5 * (feed[0] + ax), 0.5 * (feed[1] + ay), 0.5 * (feed[2] + az)
            feed[3], feed[4], feed[5] = 0.5 * (feed[3] + bx), 0.5 * (feed[4] + by), 0.5 * (feed[5] + bz)
        for i in range(6):
            velocity[i] = v0[i] + s.dt * feed[i]
        h = 0.5 * s.dt
        px = m.position[0] + h * (v0[0] + velocity[0])
        py = m.position[1] + h * (v0[1] + velocity[1])
        pz = m.position[2] + h * (v0[2] + velocity[2])
        turn = quaternion.from_rotation_vector_(
            h * (v0[3] + velocity[3]), h * (v0[4] + velocity[4]), h * (v0[5] + velocity[5])
        )
        q = quaternion.multiply_(turn, start)
    m.position[0], m.position[1], m.position[2] = px, py, pz
    if m.mode == contact.CONTACT:
        gap = speed = 0.0
        for i in range(3):
            gap += d[i] * (tool[i] - m.position[i])
            speed += d[i] * (m.tool_velocity[i] - velocity[i])
        for i in range(3):
            m.position[i] += gap * d[i]
            velocity[i] += speed * d[i]
    elif m.mode == contact.APPROACH:
        for i in range(3):
            m.position[i] = min(max(m.position[i], s.workspace_low[i]), s.workspace_high[i])
    error[3], error[4], error[5] = quaternion.difference_(q, tool_quaternion)
    for i in range(3):
        error[i] = m.position[i] - tool[i]
    bend = s.bend[0] if qpos[WRIST] >= 0.0 else s.bend[1]
    _limit_reach(error, velocity, anchor[SHOULDER], anchor[WRIST], axis[POINTING], s.upper_arm, s.forearm, bend)
    for part in range(2):
        _limit_lead(error, velocity, m.tool_velocity, 3 * part, s.lead_limit[part])
    for i in range(3):
        m.position[i] = tool[i] + error[i]
    q = quaternion.multiply_(quaternion.from_rotation_vector_(error[3], error[4], error[5]), tool_quaternion)
    q = quaternion.normalised_(q)
    m.quaternion[0], m.quaternion[1], m.quaternion[2], m.quaternion[3] = q


@njit(cache=True)
def _limit_reach(
    error: Array,
    velocity: Array,
    shoulder: Array,
    wrist: Array,
    pointing: Array,
    upper_arm: float,
    forearm: float,
    bend: float,
) -> None:
    """A reference beyond the arm's reach is held at its border, along which it may still move.

    The elbow w - b f is within the upper arm's length of the shoulder, with the wrist w and the forearm's length b. The
    forearm's direction f is best that of a straight arm; where the wrist would have to bend farther than it can, that at the
    wrist's limit which is next to it: cos(limit) t + sin(limit) u, with t where the hand is pointing and u at a right angle.
    Points are in the world frame [m]; `bend` is cos(limit).
    """
    x, y, z = wrist[0] + error[0] - shoulder[0], wrist[1] + error[1] - shoulder[1], wrist[2] + error[2] - shoulder[2]
    ahead = x * pointing[0] + y * pointing[1] + z * pointing[2]
    length = math.sqrt(x * x + y * y + z * z)
    fx, fy, fz = x, y, z
    if ahead < bend * length:
        aside = math.sqrt(max(length * length - ahead * ahead, 1e-18))
        along = bend / math.sqrt(1.0 - bend * bend) * aside - ahead
        fx, fy, fz = x + along * pointing[0], y + along * pointing[1], z + along * pointing[2]
    share = forearm / math.sqrt(fx * fx + fy * fy + fz * fz)
    x, y, z = x - share * fx, y - share * fy, z - share * fz
    length = math.sqrt(x * x + y * y + z * z)
    if length <= upper_arm:
        return
    outward = (x / length, y / length, z / length)
    speed = outward[0] * velocity[0] + outward[1] * velocity[1] + outward[2] * velocity[2]
    for i in range(3):
        error[i] -= (length - upper_arm) * outward[i]
        if speed > 0.0:
            velocity[i] -= speed * outward[i]


@njit(cache=True)
def _limit_lead(error: Array, velocity: Array, tool_velocity: Array, first: int, limit: float) -> None:
    """A blocked tool holds its reference back: the error is shortened and the reference no longer runs ahead."""
    x, y, z = error[first], error[first + 1], error[first + 2]
    length = math.sqrt(x * x + y * y + z * z)
    if length <= limit:
        return
    ahead = 0.0
    for i in range(first, first + 3):
        ahead += error[i] / length * (velocity[i] - tool_velocity[i])
    for i in range(first, first + 3):
        if ahead > 0.0:
            velocity[i] -= ahead * error[i] / length
        error[i] *= limit / length
