"""What an active primitive asks of the robot: goals in the world, a force, and where the attractor has to pull."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import quaternion
from lfd_gym.action import ActionLayout
from lfd_gym.contact import CONTACT_FRACTION
from policies.features import CONTROLLED, FORCE, HOLD, task_coordinates, world_goal
from policies.movement_primitives import MovementPrimitives
from policies.task_space import CYLINDRICAL, curved_goal, directions

Array = NDArray[np.float64]


class Goals(NamedTuple):
    """Goals of the three entities in the world; what the next primitive holds."""

    position: Array
    """(3,) [m]."""
    quaternion: Array
    """(4,)."""
    hand: Array
    """(4,) [rad]."""


def command(
    primitives: MovementPrimitives,
    label: int,
    seen: Array,
    frames: Array,
    held: Goals,
    observation: Mapping[str, NDArray[Any]],
    layout: ActionLayout,
) -> tuple[Goals, Array, Array]:
    """Goals of a primitive, its force (3,) [N], and the position (3,) [m] at which the robot's attractor has to pull.

    A held coordinate keeps its last goal in the world. Along a force axis the goal is the measured position, so that a
    primitive that holds this axis next holds it where the pressing ended. In a Cartesian space the attractor pulls at the
    goal. In a cylindrical one it pulls along the arc, at most as fast as demonstrated, and a primitive that presses stays
    where it is along the other coordinates until it feels contact as `lfd_gym.contact` defines it.

    seen (11,) is position, quaternion and hand as measured, frames (F, 7) the poses of the table's frames.
    """
    table, force = primitives.table, primitives.force[label]
    at, turned, space = frames[table.position_frame[label]], frames[table.orientation_frame[label]], table.space[label]
    wrench = np.asarray(observation["wrench"], dtype=np.float64) if force.any() else np.zeros(6)
    x, position, orientation, hand, force = _command(
        seen, *held, at, turned, space, table.modes[label],
        primitives.mean[label], primitives.goal[label], primitives.grip[label], force, wrench,
    )  # fmt: skip
    goals = Goals(position, orientation, hand)
    if space != CYLINDRICAL:
        return goals, force, position
    reference = np.asarray(observation["reference_position"], dtype=np.float64)
    velocity = np.asarray(observation["reference_velocity"], dtype=np.float64)[:3]
    limit = min(primitives.speed[label], layout.speed_limit)
    return goals, force, curved_goal(x[:3], reference, velocity, at, layout.alpha, layout.beta, limit)


@njit(cache=True)
def _command(
    seen: Array,
    position: Array,
    orientation: Array,
    hand: Array,
    at: Array,
    turned: Array,
    space: int,
    modes: NDArray[np.int64],
    mean: Array,
    goal: Array,
    grip: Array,
    force: Array,
    wrench: Array,
) -> tuple[Array, Array, Array, Array, Array]:
    held = task_coordinates(position, orientation, hand, at, turned, space, mean)
    now = task_coordinates(seen[:3], seen[3:7], seen[7:], at, turned, space, mean)
    force = quaternion.rotate(at[3:], directions(now[:3], space) @ force)
    x = np.where(modes == CONTROLLED, goal, np.where(modes == FORCE, now, held))
    x[6:] += grip
    if space == CYLINDRICAL and -np.dot(force, wrench[:3]) < CONTACT_FRACTION * np.dot(force, force):
        x[:3] = now[:3]
    new_position, new_orientation = world_goal(x, at, turned, space, mean)
    if (modes[:3] == HOLD).all():
        new_position = position.copy()
    if (modes[3:6] == HOLD).all():
        new_orientation = orientation.copy()
    return x, new_position, new_orientation, x[6:].copy(), force
