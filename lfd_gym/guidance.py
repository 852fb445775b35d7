"""An outside hand that guides the arm, as in kinesthetic teaching."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import contact, quaternion

Array = NDArray[np.float64]


MOST_DAMPING = 0.6
"""Part of an arm's speed that a hand may take in one physics step; from 2 on the simulation would be unstable."""


class Impedance(NamedTuple):
    """A human hand on the link above the wrist sensor, as a spring and a damper."""

    stiffness: float = 900.0
    """[N/m]"""
    damping: float = 60.0
    """[N s/m]"""
    turn_stiffness: tuple[float, float, float] = (20.0, 20.0, 20.0)
    """About the axes of the tool [N m/rad]."""
    turn_damping: tuple[float, float, float] = (1.5, 1.5, 1.5)
    """About the axes of the tool [N m s/rad]."""
    brake: float = 110.0
    """Damping where the arm gives way to a force that the hand exerts [N s/m]: free, 10 N move the arm at 9 cm/s."""
    strongest: float = 60.0
    """Largest force along an axis [N]."""

    def holding(self, mobility: Array, dt: float) -> "Impedance":
        """The hand that holds an arm of a mobility (6,) along and about the tool's axes [1/kg, 1/(kg m^2)]: a light one softly.

        dt is the physics step [s]; stiffness and damping are reduced alike until `MOST_DAMPING` holds.
        """
        move = min(1.0, MOST_DAMPING / (dt * self.damping * mobility[:3].max()))
        turn = np.minimum(1.0, MOST_DAMPING / (dt * np.array(self.turn_damping) * mobility[3:]))
        return self._replace(
            stiffness=move * self.stiffness,
            damping=move * self.damping,
            turn_stiffness=tuple((turn * self.turn_stiffness).tolist()),
            turn_damping=tuple((turn * self.turn_damping).tolist()),
        )


@njit(cache=True)
def outside_hand(memory, impedance, tool: Array, tool_rotation: Array, link: Array, applied: Array) -> None:  # type: ignore[no-untyped-def]
    """Writes the wrench (6,) that an outside hand exerts on the link above the wrist sensor (thesis 3.1.2).

    A hand that holds the arm is a spring and a damper between the link and where it has to be for the tool to be where the hand
    wants it; along a force that it exerts beside it only brakes. A hand that does not hold only exerts its force and torque,
    as if on the tool.

    Args:
        impedance: see `Impedance`.
        tool, tool_rotation: tool point (3,) and rotation (9,), world frame.
        link: centre of mass of the link, about which MuJoCo applies a wrench.
        applied: row of `data.xfrc_applied`.
    """
    m = memory[0]
    turn = quaternion.difference_(m.guide_quaternion, quaternion.from_matrix_(tool_rotation))
    strength = math.sqrt(m.guide_force[0] ** 2 + m.guide_force[1] ** 2 + m.guide_force[2] ** 2)
    along = speed = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        way_j, way_k = link[j] - tool[j], link[k] - tool[k]
        error = m.guide_position[i] - tool[i] + turn[j] * way_k - turn[k] * way_j
        lag_j, lag_k = (
            m.guide_velocity[3 + j] - m.tool_velocity[3 + j],
            m.guide_velocity[3 + k] - m.tool_velocity[3 + k],
        )
        lag = m.guide_velocity[i] - m.tool_velocity[i] + lag_j * way_k - lag_k * way_j
        applied[i] = m.guide_holds * (impedance.stiffness * error + impedance.damping * lag)
        if strength > 0.0:
            along += applied[i] * m.guide_force[i] / strength
            speed += m.tool_velocity[i] * m.guide_force[i] / strength
    for i in range(3):
        if strength > 0.0:
            applied[i] -= (along + m.guide_holds * impedance.brake * max(speed, 0.0)) * m.guide_force[i] / strength
        j, k = (i + 1) % 3, (i + 2) % 3
        applied[3 + i] = m.guide_torque[i]
        applied[3 + i] += (tool[j] - link[j]) * m.guide_force[k] - (tool[k] - link[k]) * m.guide_force[j]
    for axis in range(3):
        torque = 0.0
        for i in range(3):
            lag = m.guide_velocity[3 + i] - m.tool_velocity[3 + i]
            torque += tool_rotation[3 * i + axis] * (
                impedance.turn_stiffness[axis] * turn[i] + impedance.turn_damping[axis] * lag
            )
        for i in range(3):
            applied[3 + i] += m.guide_holds * torque * tool_rotation[3 * i + axis]
    for i in range(3):
        applied[i] = min(max(applied[i] + m.guide_force[i], -impedance.strongest), impedance.strongest)


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
