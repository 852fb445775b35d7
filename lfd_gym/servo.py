"""What the controller does in one physics step, compiled: wrench, contact, reference, PID, torque, finger drives.

The attractor is a reference inside the controller: it moves at the controller's rate towards the commanded goal and the PID of
thesis 2.1.3 tracks it. Where a force is commanded the state machine of ``contact.py`` decides who owns its direction d:

    APPROACH  the reference advances along d at the guarded speed, all six directions stay position controlled;
    CONTACT   S = I - d d^T: the force along d is regulated, the reference follows the tool along d.

Everything lives in three records (``SETTINGS``, ``COMMAND``, ``MEMORY``), so that a step allocates next to nothing and the
controller's state is saved and restored as bytes.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import attractor, contact, controller, quaternion
from lfd_gym.action import decode_array

Array = NDArray[np.float64]

SETTINGS = np.dtype(
    [
        ("dt", "f8"),
        ("alpha", "f8"),
        ("beta", "f8"),
        ("speed_limit", "f8"),
        ("turn_limit", "f8"),
        ("workspace_low", "f8", 3),
        ("workspace_high", "f8", 3),
        ("stiffness", "f8"),
        ("damping", "f8"),
        ("integral", "f8"),
        ("integral_limit", "f8", 2),
        ("lead_limit", "f8", 2),
        ("force_integral", "f8"),
        ("force_damping", "f8"),
        ("filter", "f8"),
        ("rest", "f8", 7),
        ("joint_low", "f8", 7),
        ("joint_high", "f8", 7),
        ("joint_speed", "f8"),
        ("joint_brake", "f8"),
        ("torque_limit", "f8", 7),
        ("joint_damping", "f8", 7),
        ("joint_friction", "f8", 7),
        ("friction_speed", "f8"),
        ("tool_mass", "f8"),
        ("gravity", "f8", 3),
        ("n_hand", "i8"),
        ("hand_speed", "f8", 4),
        ("hand_stiffness", "f8", 4),
        ("hand_stall", "f8", 4),
    ],
    align=True,
)
"""Constants of one environment, in SI units; the first of a pair is linear, the second angular."""

COMMAND = np.dtype([("position", "f8", 3), ("quaternion", "f8", 4), ("force", "f8", 3), ("hand", "f8", 4)], align=True)
"""The goal of one control step: pose in the world, force of the tool on the world [N], hand joint angles [rad]."""

MEMORY = np.dtype(
    [
        ("position", "f8", 3),
        ("quaternion", "f8", 4),
        ("velocity", "f8", 6),
        ("tool_velocity", "f8", 6),
        ("integral", "f8", 6),
        ("mode", "f8"),
        ("timer", "f8"),
        ("direction", "f8", 3),
        ("force_integral", "f8"),
        ("pressed", "f8", 3),
        ("wrench_sum", "f8", 6),
        ("ticks", "f8"),
        ("hand", "f8", 4),
        ("guided", "f8"),
        ("guide_position", "f8", 3),
        ("guide_quaternion", "f8", 4),
        ("guide_velocity", "f8", 6),
        ("guide_force", "f8", 3),
        ("guide_torque", "f8", 3),
        ("guide_holds", "f8"),
    ],
    align=True,
)
"""The controller's state: the reference's pose and twist, the measured twist of the tool, integrals, contact mode, filtered
force of the tool on the world, the sum of the wrenches since the last observation, the references of the hand's drives, and
whether an outside hand guides the arm, with its pose, twist and force."""


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


@njit(cache=True)
def move_reference(settings, command, memory, tool: Array, tool_quaternion, error: Array, feed: Array) -> None:  # type: ignore[no-untyped-def]
    """Advances the reference by one tick; writes its error (6,) to the tool and its acceleration (6,).

    Heun's rule: the reference follows the closed form of (2.1) to second order.
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
    for part in range(2):
        _limit_lead(error, velocity, m.tool_velocity, 3 * part, s.lead_limit[part])
    for i in range(3):
        m.position[i] = tool[i] + error[i]
    q = quaternion.multiply_(quaternion.from_rotation_vector_(error[3], error[4], error[5]), tool_quaternion)
    q = quaternion.normalised_(q)
    m.quaternion[0], m.quaternion[1], m.quaternion[2], m.quaternion[3] = q


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


@njit(cache=True)
def overspeed(position: float, velocity: float, low: float, high: float, speed: float, rate: float) -> float:
    """How much faster a joint is than it may be [rad/s]: than ``speed``, or than ``rate`` [1/s] times its way to the limit."""
    fastest, slowest = min(speed, rate * (high - position)), max(-speed, rate * (low - position))
    return velocity - min(max(velocity, slowest), fastest)


@njit(cache=True)
def outside_hand(memory, impedance, tool: Array, tool_quaternion, link: Array, applied: Array) -> None:  # type: ignore[no-untyped-def]
    """Writes the wrench (6,) that an outside hand exerts on the link above the wrist sensor (thesis 3.1.2).

    A hand that holds the tool is a spring and a damper between the tool and where the hand is; along a force that it exerts
    beside it only brakes. A hand that does not hold it only exerts its force and torque.

    Args:
        impedance: see `guidance.Impedance`.
        tool, tool_quaternion: pose of the tool point.
        link: centre of mass of the link, about which MuJoCo applies a wrench.
        applied: row of `data.xfrc_applied`.
    """
    m = memory[0]
    turn = quaternion.difference_(m.guide_quaternion, tool_quaternion)
    holds = m.guide_holds
    strength = math.sqrt(m.guide_force[0] ** 2 + m.guide_force[1] ** 2 + m.guide_force[2] ** 2)
    along = speed = 0.0
    for i in range(3):
        applied[i] = holds * impedance.stiffness * (m.guide_position[i] - tool[i])
        applied[i] += holds * impedance.damping * (m.guide_velocity[i] - m.tool_velocity[i])
        applied[3 + i] = m.guide_torque[i] + holds * impedance.turn_stiffness * turn[i]
        applied[3 + i] += holds * impedance.turn_damping * (m.guide_velocity[3 + i] - m.tool_velocity[3 + i])
        if strength > 0.0:
            along += applied[i] * m.guide_force[i] / strength
            speed += m.tool_velocity[i] * m.guide_force[i] / strength
    for i in range(3):
        if strength > 0.0:
            applied[i] += m.guide_force[i] - (along + holds * impedance.brake * speed) * m.guide_force[i] / strength
        applied[i] = min(max(applied[i], -impedance.strongest), impedance.strongest)
    x, y, z = tool[0] - link[0], tool[1] - link[1], tool[2] - link[2]
    applied[3] += y * applied[2] - z * applied[1]
    applied[4] += z * applied[0] - x * applied[2]
    applied[5] += x * applied[1] - y * applied[0]


@njit(cache=True)
def _follow(memory, tool: Array, tool_quaternion) -> None:  # type: ignore[no-untyped-def]
    """Somebody else moves the arm: the reference goes along and nothing is stored."""
    m = memory[0]
    m.mode, m.timer, m.force_integral = contact.FREE, 0.0, 0.0
    m.quaternion[0], m.quaternion[1], m.quaternion[2], m.quaternion[3] = tool_quaternion
    for i in range(3):
        m.position[i] = tool[i]
    for i in range(6):
        m.velocity[i], m.integral[i] = m.tool_velocity[i], 0.0


@njit(cache=True)
def drive_hand(settings, command, memory, qpos: Array, hand_joints: Array, ctrl: Array) -> None:  # type: ignore[no-untyped-def]
    """Moves the references of spread and fingers towards their goals.

    A worm drive: rate limited, it stops advancing when its spring would press harder than the stall torque, and it holds
    what it has reached. Fingers open without a stall; the spread stalls both ways.
    """
    s, c, m = settings[0], command[0], memory[0]
    for i in range(s.n_hand):
        step = min(max(c.hand[i] - m.hand[i], -s.hand_speed[i] * s.dt), s.hand_speed[i] * s.dt)
        load = s.hand_stiffness[i] * (m.hand[i] + step - qpos[hand_joints[i]])
        if (step > 0.0 and load > s.hand_stall[i]) or (i == 0 and step < 0.0 and load < -s.hand_stall[i]):
            step = 0.0
        m.hand[i] += step
        ctrl[controller.N_JOINTS + i] = m.hand[i]


@njit(cache=True)
def tick(  # type: ignore[no-untyped-def]
    settings,
    command,
    memory,
    qpos,
    qvel,
    inertia,
    bias,
    anchor,
    axis,
    tool,
    tool_rotation,
    sensor,
    sensor_rotation,
    reading,
    tool_com,
    hand_joints,
    ctrl,
    guided_link,
    guided_wrench,
    impedance,
    work,
    gains,
):
    """One physics step of the controller: reads the simulation's arrays, writes ``ctrl`` and ``memory``.

    Args:
        settings, command, memory: arrays of one record each.
        qpos, qvel: generalised coordinates, the arm's seven joints first.
        inertia: lower triangle of the sparse inertia matrix, row by row, the arm first.
        bias: gravity and Coriolis torques.
        anchor, axis: of all joints, world frame.
        tool, tool_rotation: tool point (3,) and rotation (9,), world frame.
        sensor, sensor_rotation: origin and rotation of the wrist sensor.
        reading: force and torque of the wrist sensor, sensor axes.
        tool_com: centre of mass of all that hangs on the sensor.
        hand_joints: addresses of spread and finger angles in ``qpos``.
        guided_link, guided_wrench: centre of mass of the link that an outside hand guides, and the wrench that acts on it.
        impedance: of the outside hand.
        work: scratch (27, 14); gains: of the null space.
    """
    s, c, m = settings[0], command[0], memory[0]
    n = controller.N_JOINTS
    jacobian, drift, error, feed = work[0:6, :7], work[6, :6], work[7, :6], work[8, :6]
    wrench, e_d, e_f, torque, xi = work[9, :6], work[10, :6], work[11, :6], work[12, :7], work[13, :7]
    full, selection, scratch = work[14:21, :7], work[14:20, 8:14], work[21:27]
    controller.arm_jacobian(anchor, axis, qvel, tool, jacobian, drift)
    for i in range(6):
        m.tool_velocity[i] = 0.0
        for j in range(n):
            m.tool_velocity[i] += jacobian[i, j] * qvel[j]

    external_wrench(sensor_rotation, reading, sensor, tool_com, s.tool_mass, s.gravity, wrench)
    m.ticks += 1
    for i in range(6):
        m.wrench_sum[i] += wrench[i]
    blend = 1.0 - math.exp(-s.dt * s.filter)
    along = 0.0
    magnitude = math.sqrt(c.force[0] * c.force[0] + c.force[1] * c.force[1] + c.force[2] * c.force[2])
    for i in range(3):
        m.pressed[i] += blend * (-wrench[i] - m.pressed[i])
        along += m.pressed[i] * c.force[i] / magnitude if magnitude > 0.0 else 0.0
    before = int(m.mode)
    mode, timer = contact.advance(before, m.timer, m.direction, c.force, along, s.dt)
    d = m.direction
    if mode == contact.CONTACT:
        for i in range(3):
            # a tool that is pulled out of the workspace stops at its border
            if (d[i] > 0.0 and tool[i] > s.workspace_high[i]) or (d[i] < 0.0 and tool[i] < s.workspace_low[i]):
                mode, timer = contact.APPROACH, 0.0
    m.mode, m.timer = mode, timer
    in_contact = mode == contact.CONTACT
    if (in_contact and before != contact.CONTACT) or not in_contact:
        m.force_integral = 0.0

    move_reference(settings, command, memory, tool, quaternion.from_matrix_(tool_rotation), error, feed)
    speed_along = 0.0
    for i in range(3):
        speed_along += d[i] * m.tool_velocity[i]
    if in_contact:
        m.force_integral += s.force_integral * s.dt * (magnitude - along)
        m.force_integral = min(max(m.force_integral, -magnitude), magnitude)
    for i in range(6):
        limit = s.integral_limit[0] if i < 3 else s.integral_limit[1]
        m.integral[i] = min(max(m.integral[i] + s.integral * s.dt * error[i], -limit), limit)
        e_d[i] = e_f[i] = 0.0
        for j in range(6):
            selection[i, j] = 1.0 if i == j else 0.0
    if in_contact:
        stored = d[0] * m.integral[0] + d[1] * m.integral[1] + d[2] * m.integral[2]
        for i in range(3):
            m.integral[i] -= stored * d[i]
            e_d[i] = -s.force_damping * speed_along * d[i]
            e_f[i] = (magnitude + m.force_integral) * d[i]
            for j in range(3):
                selection[i, j] -= d[i] * d[j]
    for i in range(6):
        feed[i] += s.stiffness * error[i] + s.damping * (m.velocity[i] - m.tool_velocity[i]) + m.integral[i]

    if m.guided:
        outside_hand(memory, impedance, tool, quaternion.from_matrix_(tool_rotation), guided_link, guided_wrench)
        _follow(memory, tool, quaternion.from_matrix_(tool_rotation))
        for i in range(6):
            feed[i] = e_d[i] = e_f[i] = 0.0

    k = 0
    for i in range(n):
        for j in range(i + 1):
            full[i, j] = inertia[k]
            k += 1
    controller.null_space_acceleration(qpos, qvel, s.rest, s.joint_low, s.joint_high, gains, xi)
    controller.hybrid_torque(full, jacobian, drift, bias, selection, feed, e_d, e_f, xi, torque, scratch)
    for i in range(n):
        load = torque[i] + s.joint_damping[i] * qvel[i] + s.joint_friction[i] * math.tanh(qvel[i] / s.friction_speed)
        load = min(max(load, -s.torque_limit[i]), s.torque_limit[i])
        excess = overspeed(qpos[i], qvel[i], s.joint_low[i], s.joint_high[i], s.joint_speed, s.joint_brake)
        # what is too fast is taken back over four ticks, by the inertia that the joint feels
        load -= 0.25 / s.dt * excess * inertia[i * (i + 3) // 2]
        ctrl[i] = min(max(load, -s.torque_limit[i]), s.torque_limit[i])
    drive_hand(settings, command, memory, qpos, hand_joints, ctrl)


@njit(cache=True)
def command(command, low, high, rotation_limit, force_limit, hand_low, hand_high, reference, action) -> bool:  # type: ignore[no-untyped-def]
    """Writes the goal of an action (see `lfd_gym.action`); False, and nothing written, where it is not finite."""
    goal = decode_array(action, low, high, rotation_limit, force_limit, hand_low, hand_high, reference)
    if math.isnan(goal[0]):
        return False
    c = command[0]
    c.position[:], c.quaternion[:], c.force[:] = goal[0:3], goal[3:7], goal[7:10]
    c.hand[: hand_low.size] = goal[10:]
    return True


def measurements(n_hand: int) -> tuple[tuple[str, int], ...]:
    """Names and sizes of what `observe` writes before the frames; `n_hand` is 4 with a hand, 0 without."""
    arm = (("joint_position", 7), ("joint_velocity", 7))
    tool = (("tool_position", 3), ("tool_quaternion", 4), ("tool_velocity", 6))
    reference = (("reference_position", 3), ("reference_quaternion", 4), ("reference_velocity", 6), ("wrench", 6))
    return (*arm, *tool, *reference, *((("hand_position", 4), ("hand_torque", 4)) if n_hand else ()))


@njit(cache=True)
def observe(  # type: ignore[no-untyped-def]
    settings,
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
    """Writes the observation, `measurements` and then a pose (7,) per frame; starts a new mean of the wrench.

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
    at = 46
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
