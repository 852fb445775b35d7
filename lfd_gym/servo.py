"""What the controller does in one physics step, compiled: wrench, contact, reference, PID, torque, finger drives.

The PID of thesis 2.1.3 tracks the reference (`reference.py`). Where a force is commanded the state machine of `contact.py`
decides who owns its direction d:

    APPROACH  the reference advances along d at the guarded speed, all six directions stay position controlled;
    CONTACT   S = I - d d^T: the force along d is regulated, the reference follows the tool along d.

Everything lives in the three records of `records.py`, and a step allocates next to nothing.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import contact, controller, guidance, quaternion, reference, sensing
from lfd_gym.action import decode_array

Array = NDArray[np.float64]

BEYOND = 0.01
"""How far out of the workspace a force is regulated [m]; contact begins in half of it."""


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
    m, n = memory[0], controller.N_JOINTS
    jacobian, drift, error, feed = work[0:6, :7], work[6, :6], work[7, :6], work[8, :6]
    wrench, e_d, e_f, torque, xi = work[9, :6], work[10, :6], work[11, :6], work[12, :7], work[13, :7]
    change, full, selection, scratch = work[9, 8:14], work[14:21, :7], work[14:20, 8:14], work[21:27]
    s, turned = settings[0], quaternion.from_matrix_(tool_rotation)
    controller.arm_jacobian(anchor, axis, qvel, tool, jacobian, drift)
    sensing.external_wrench(sensor_rotation, reading, sensor, tool_com, s.tool_mass, s.gravity, wrench)
    along, inertial = feel(settings, command, memory, jacobian, qvel, tool, tool_com, wrench, change)
    touch(settings, command, memory, tool, along, inertial)
    reference.move_reference(settings, command, memory, tool, turned, qpos, anchor, axis, error, feed)
    regulate(settings, command, memory, along, error, feed, selection, e_d, e_f)
    if m.guided:
        guidance.outside_hand(memory, impedance, tool, tool_rotation, guided_link, guided_wrench)
        guidance.follow(memory, tool, turned)
        for i in range(6):
            feed[i] = e_d[i] = e_f[i] = 0.0
    k = 0
    for i in range(n):
        for j in range(i + 1):
            full[i, j] = inertia[k]
            k += 1
    controller.null_space_acceleration(qpos, qvel, s.rest, s.joint_low, s.joint_high, gains, xi)
    controller.hybrid_torque(full, jacobian, drift, bias, selection, feed, e_d, e_f, xi, torque, scratch)
    drive_arm(settings, qpos, qvel, inertia, torque, ctrl)
    drive_hand(settings, command, memory, qpos, hand_joints, ctrl)


@njit(cache=True)
def feel(  # type: ignore[no-untyped-def]
    settings,
    command,
    memory,
    jacobian: Array,
    qvel: Array,
    tool: Array,
    tool_com: Array,
    wrench: Array,
    change: Array,
) -> tuple[float, float]:
    """Measures the tool's twist, adds up the wrench, and filters the force of the tool on the world.

    Args:
        settings, command, memory: arrays of one record each.
        jacobian: of the tool point (6, 7).
        qvel: joint speeds, the arm's first.
        tool, tool_com: tool point, and centre of mass of all that hangs on the sensor, world frame.
        wrench: what the world exerts on the tool (6,); the sensor's error is added.
        change: scratch (6,).

    Returns:
        Along the commanded force [N]: the filtered force of the tool on the world, and what accelerates the tool now.
    """
    s, c, m = settings[0], command[0], memory[0]
    for i in range(6):
        before, m.tool_velocity[i] = m.tool_velocity[i], 0.0
        for j in range(controller.N_JOINTS):
            m.tool_velocity[i] += jacobian[i, j] * qvel[j]
        change[i] = m.tool_velocity[i] - before
        wrench[i] += c.sensor_error[i]
        m.wrench_sum[i] += wrench[i]
    m.ticks += 1
    blend = 1.0 - math.exp(-s.dt * s.filter)
    along = inertial = 0.0
    magnitude = _length(c.force)
    for i in range(3):
        m.pressed[i] += blend * (-wrench[i] - m.pressed[i])
        if magnitude > 0.0:
            j, k = (i + 1) % 3, (i + 2) % 3
            swung = change[3 + j] * (tool_com[k] - tool[k]) - change[3 + k] * (tool_com[j] - tool[j])
            along += m.pressed[i] * c.force[i] / magnitude
            inertial += s.tool_mass / s.dt * (change[i] + swung) * c.force[i] / magnitude
    return along, inertial


@njit(cache=True)
def touch(settings, command, memory, tool: Array, along: float, inertial: float) -> None:  # type: ignore[no-untyped-def]
    """Decides who owns the direction of a commanded force; what `feel` returned tells whether there is contact.

    There is none for a tool that is faster along the force than the speed limit, or that has left the workspace along it.
    """
    s, c, m = settings[0], command[0], memory[0]
    before, d = int(m.mode), m.direction
    mode, timer = contact.advance(before, m.timer, d, c.force, along, inertial, s.dt)
    if mode != contact.FREE:
        fast = d[0] * m.tool_velocity[0] + d[1] * m.tool_velocity[1] + d[2] * m.tool_velocity[2] > s.speed_limit
        margin, outside = BEYOND if before == contact.CONTACT else 0.5 * BEYOND, False
        for i in range(3):
            beyond = tool[i] - s.workspace_high[i] if d[i] > 0.0 else s.workspace_low[i] - tool[i]
            outside = outside or (d[i] != 0.0 and beyond > margin)
        if fast or outside:
            mode, timer = contact.APPROACH, 0.0
    m.mode, m.timer = mode, timer
    if mode != contact.CONTACT or before != contact.CONTACT:
        m.force_integral = 0.0


@njit(cache=True)
def regulate(  # type: ignore[no-untyped-def]
    settings, command, memory, along: float, error: Array, feed: Array, selection: Array, e_d: Array, e_f: Array
) -> None:
    """Writes what equation (2.2) is given: S, the accelerations e_x (added to `feed`) and e_d, and the wrench e_f.

    The PID of the pose acts on the reference's error (6,); in contact the force along d is regulated by a PI controller with
    damping, and the integral of the pose stores nothing along d.
    """
    s, c, m = settings[0], command[0], memory[0]
    d, in_contact, magnitude = m.direction, m.mode == contact.CONTACT, _length(c.force)
    for i in range(6):
        limit = s.integral_limit[0] if i < 3 else s.integral_limit[1]
        m.integral[i] = min(max(m.integral[i] + s.integral * s.dt * error[i], -limit), limit)
        e_d[i] = e_f[i] = 0.0
        for j in range(6):
            selection[i, j] = 1.0 if i == j else 0.0
    if in_contact:
        m.force_integral += s.force_integral * s.dt * (magnitude - along)
        m.force_integral = min(max(m.force_integral, -magnitude), magnitude)
        stored = d[0] * m.integral[0] + d[1] * m.integral[1] + d[2] * m.integral[2]
        speed = 0.0
        for i in range(3):
            speed += d[i] * m.tool_velocity[i]
        for i in range(3):
            m.integral[i] -= stored * d[i]
            e_d[i] = -s.force_damping * speed * d[i]
            e_f[i] = (magnitude + m.force_integral) * d[i]
            for j in range(3):
                selection[i, j] -= d[i] * d[j]
    for i in range(6):
        feed[i] += s.stiffness * error[i] + s.damping * (m.velocity[i] - m.tool_velocity[i]) + m.integral[i]


@njit(cache=True)
def drive_arm(settings, qpos: Array, qvel: Array, inertia: Array, torque: Array, ctrl: Array) -> None:  # type: ignore[no-untyped-def]
    """Writes the arm's torques (7,) within their limits: joint friction is compensated, and joints that are too fast braked.

    What is too fast is taken back over four ticks, by the inertia that the joint feels.
    """
    s = settings[0]
    for i in range(controller.N_JOINTS):
        load = torque[i] + s.joint_damping[i] * qvel[i] + s.joint_friction[i] * math.tanh(qvel[i] / s.friction_speed)
        load = min(max(load, -s.torque_limit[i]), s.torque_limit[i])
        excess = overspeed(qpos[i], qvel[i], s.joint_low[i], s.joint_high[i], s.joint_speed, s.joint_brake)
        load -= 0.25 / s.dt * excess * inertia[i * (i + 3) // 2]
        ctrl[i] = min(max(load, -s.torque_limit[i]), s.torque_limit[i])


@njit(cache=True)
def _length(x: Array) -> float:
    return math.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


@njit(cache=True)
def overspeed(position: float, velocity: float, low: float, high: float, speed: float, rate: float) -> float:
    """How much faster a joint is than it may be [rad/s]: than ``speed``, or than ``rate`` [1/s] times its way to the limit."""
    fastest, slowest = min(speed, rate * (high - position)), max(-speed, rate * (low - position))
    return velocity - min(max(velocity, slowest), fastest)


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
def set_goal(command, low, high, rotation_limit, force_limit, hand_low, hand_high, reference, action) -> bool:  # type: ignore[no-untyped-def]
    """Writes the goal of an action (see `lfd_gym.action`); False, and nothing written, where it is not finite."""
    goal = decode_array(action, low, high, rotation_limit, force_limit, hand_low, hand_high, reference)
    if math.isnan(goal[0]):
        return False
    c = command[0]
    c.position[:], c.quaternion[:], c.force[:] = goal[0:3], goal[3:7], goal[7:10]
    c.hand[: hand_low.size] = goal[10:]
    return True
