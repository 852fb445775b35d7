"""When a commanded force takes over from position, and when it lets go: a state machine on its own.

FREE        no force is commanded; the tool is position controlled in all directions.
APPROACH    a force is commanded along d; the reference advances along d at the guarded speed.
CONTACT     the filtered force along d stayed above ``CONTACT_FRACTION`` of the command for ``CONTACT_TIME``, and not because
            the tool itself was accelerated; the direction d is force controlled until the command vanishes or turns by more
            than ``TURN_LIMIT`` in one step.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FREE, APPROACH, CONTACT = 0, 1, 2
GUARDED_SPEED = 0.03
"""Speed of the approach [m/s]: a contact at this speed stays below the sensor's range."""
CONTACT_FRACTION = 0.25
"""Share of the commanded force that must be felt."""
CONTACT_TIME = 0.02
"""How long it must be felt [s]."""
INERTIAL_SHARE = 0.5
"""Share of what is felt that the tool's own acceleration may explain, if it is to be a contact."""
TURN_LIMIT = math.radians(30.0)
_COS_TURN_LIMIT = math.cos(TURN_LIMIT)


@njit(cache=True)
def advance(
    mode: int,
    timer: float,
    direction: NDArray[np.float64],
    force: NDArray[np.float64],
    pressed: float,
    inertial: float,
    dt: float,
) -> tuple[int, float]:
    """One tick of the state machine; ``direction`` (3,) is overwritten by that of the force.

    Args:
        mode, timer: state; the timer [s] counts how long the contact has been felt.
        direction: unit direction of the force at the last tick, world frame.
        force: commanded force of the tool on the world, world frame [N]; zero means none.
        pressed: filtered force of the tool on the world along the commanded direction [N].
        inertial: what of it would accelerate the tool in empty air as it is accelerated now [N].
        dt: length of the tick [s].

    Returns:
        The new mode and timer.
    """
    magnitude = math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    if magnitude <= 0.0:
        return FREE, 0.0
    x, y, z = force[0] / magnitude, force[1] / magnitude, force[2] / magnitude
    turned = x * direction[0] + y * direction[1] + z * direction[2] < _COS_TURN_LIMIT
    direction[0], direction[1], direction[2] = x, y, z
    if mode == FREE or turned:
        return APPROACH, 0.0
    if mode == CONTACT:
        return CONTACT, timer
    felt = pressed > CONTACT_FRACTION * magnitude and inertial <= INERTIAL_SHARE * pressed
    timer = timer + dt if felt else 0.0
    return (CONTACT if timer >= CONTACT_TIME - 1e-9 else APPROACH), timer
