"""An outside hand that guides the arm, as in kinesthetic teaching."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import contact, quaternion

Array = NDArray[np.float64]


class Impedance(NamedTuple):
    """A human hand on the link above the wrist sensor, as a spring and a damper at the tool point."""

    stiffness: float = 900.0
    """[N/m]"""
    damping: float = 60.0
    """[N s/m]"""
    turn_stiffness: float = 20.0
    """[N m/rad]"""
    turn_damping: float = 1.5
    """[N m s/rad]"""
    brake: float = 110.0
    """Damping along a force that the hand exerts [N s/m]: free, 10 N move the arm at 9 cm/s."""
    strongest: float = 60.0
    """Largest force along an axis [N]."""


@njit(cache=True)
def outside_hand(memory, impedance, tool: Array, tool_quaternion, link: Array, applied: Array) -> None:  # type: ignore[no-untyped-def]
    """Writes the wrench (6,) that an outside hand exerts on the link above the wrist sensor (thesis 3.1.2).

    A hand that holds the tool is a spring and a damper between the tool and where the hand is; along a force that it exerts
    beside it only brakes. A hand that does not hold it only exerts its force and torque.

    Args:
        impedance: see `Impedance`.
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
def follow(memory, tool: Array, tool_quaternion) -> None:  # type: ignore[no-untyped-def]
    """Somebody else moves the arm: the reference goes along and nothing is stored."""
    m = memory[0]
    m.mode, m.timer, m.force_integral = contact.FREE, 0.0, 0.0
    m.quaternion[0], m.quaternion[1], m.quaternion[2], m.quaternion[3] = tool_quaternion
    for i in range(3):
        m.position[i] = tool[i]
    for i in range(6):
        m.velocity[i], m.integral[i] = m.tool_velocity[i], 0.0
