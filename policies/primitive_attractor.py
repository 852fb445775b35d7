"""What an active primitive asks of the robot: goals in the world, a force, and where the attractor has to pull."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import quaternion
from lfd_gym.contact import CONTACT_FRACTION
from policies.movement_primitives import MovementPrimitives
from policies.task_data import CONTROLLED, FORCE, HOLD, task_coordinates, world_goal
from policies.task_space import CYLINDRICAL, coordinates, directions, moved, point

Array = NDArray[np.float64]


class Goals(NamedTuple):
    """Goals of the three entities in the world; what the next primitive holds."""

    position: Array
    """(3,) [m]."""
    quaternion: Array
    """(4,)."""
    hand: Array
    """(4,) [rad]."""
    pull: Array
    """(3,) where the attractor of the position pulls now, on its way to the goal [m]."""
    pace: Array
    """() how fast it moves there [m/s]."""


def command(
    primitives: MovementPrimitives,
    label: int,
    seen: Array,
    frames: Array,
    before: Goals,
    observation: Mapping[str, NDArray[Any]],
    dt: float,
) -> tuple[Goals, Array]:
    """Goals of a primitive and its force (3,) [N], world frame.

    A held coordinate keeps its last goal in the world. Along a force axis the goal is the measured position, so that a
    primitive that holds this axis next holds it where the pressing ended.

    The attractor's pull moves to the goal with the demonstrated acceleration and speed, straight in the primitive's own
    space. So a movement begins as gently as a human's (a goal that jumps asks for alpha times the speed limit at once, and
    shakes off what the hand holds), and runs along the arc in a cylindrical space; the tool follows at a distance of
    speed / beta, and inside an arc of angular speed w by a share of (2 w / alpha)^2 of the radius. In a cylindrical space a
    primitive that presses stays where it is along the other coordinates until it feels contact as `lfd_gym.contact` defines
    it.

    seen (11,) is position, quaternion and hand as measured, frames (F, 7) the poses of the table's frames, dt the time step
    [s].
    """
    table, force = primitives.table, primitives.force[label]
    at, turned = frames[table.position_frame[label]], frames[table.orientation_frame[label]]
    wrench = np.asarray(observation["wrench"], dtype=np.float64) if force.any() else np.zeros(6)
    pace = min(before.pace + primitives.acceleration[label] * dt, primitives.speed[label])
    position, orientation, hand, pull, force = _command(
        seen, *before[:4], at, turned, table.space[label], table.modes[label],
        primitives.mean[label], primitives.goal[label], primitives.grip[label], force, wrench, pace * dt,
    )  # fmt: skip
    return Goals(position, orientation, hand, pull, np.asarray(pace)), force


@njit(cache=True)
def _command(
    seen: Array,
    position: Array,
    orientation: Array,
    hand: Array,
    pull: Array,
    at: Array,
    turned: Array,
    space: int,
    modes: NDArray[np.int64],
    mean: Array,
    goal: Array,
    grip: Array,
    force: Array,
    wrench: Array,
    way: float,
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
    to_frame = quaternion.conjugate(at[3:])
    start = coordinates(quaternion.rotate(to_frame, pull - at[:3]), space)
    end = coordinates(quaternion.rotate(to_frame, new_position - at[:3]), space)
    for i in range(3):
        if modes[i] == FORCE:
            start[i] = end[i]
    new_pull = at[:3] + quaternion.rotate(at[3:], point(moved(start, end, way, space), space))
    return new_position, new_orientation, x[6:].copy(), new_pull, force
