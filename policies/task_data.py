"""Observations to task-space data: the primitive table, measurements, and coordinates in a frame (thesis 2.1.2).

A primitive controls up to three entities, each in a frame of its own: position, orientation, hand. Its task-space
coordinates x are (`N_COORDINATES`,):

    x[POSITION]      tool position in the frame, in the Cartesian or cylindrical coordinates of `task_space`
    x[ORIENTATION]   rotation vector r [rad] with R = exp(r) R_mean in axes of the frame; R_mean is the primitive's own
    x[HAND]          joint angles of spread and fingers [rad]

The same compiled kernel serves a whole demonstration and a single observation.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import quaternion
from lfd_gym.demonstration import EntityControl, Primitive
from lfd_gym.errors import DemonstrationError
from policies import task_space
from policies.task_space import POSITION_SPACES

Array = NDArray[np.float64]

POSITION, ORIENTATION, HAND = slice(0, 3), slice(3, 6), slice(6, 10)
N_COORDINATES = 10
ENTITIES = {"position": POSITION, "orientation": ORIENTATION, "hand": HAND}

HOLD, CONTROLLED, FORCE = 0, 1, 2
"""What a primitive does along one coordinate: nothing, reach a goal, or press."""
MODES = {"hold": HOLD, "position": CONTROLLED, "force": FORCE}
SPACES = {"position": POSITION_SPACES, "orientation": ("rotation",), "hand": ("joints",)}
WORLD = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""Pose of the world frame: position, quaternion."""


class Measurement(NamedTuple):
    """What was measured at N instants."""

    position: Array
    """Tool point, world frame (N, 3) [m]."""
    quaternion: Array
    """Tool orientation, world frame (N, 4)."""
    hand: Array
    """Joint angles of the hand (N, 4) [rad]; zeros where there is none."""
    frames: Array
    """Pose of every named frame (N, F, 7): position [m], quaternion."""


class PrimitiveTable(NamedTuple):
    """The primitive table as plain arrays, one row per primitive."""

    position_frame: NDArray[np.int64]
    """(K,) index into the frames."""
    orientation_frame: NDArray[np.int64]
    """(K,)."""
    space: NDArray[np.int64]
    """(K,) CARTESIAN or CYLINDRICAL, of the position."""
    modes: NDArray[np.int64]
    """(K, N_COORDINATES) of HOLD, CONTROLLED, FORCE."""
    shared: NDArray[np.int64]
    """(K, 3) per entity the first row with the same primitive of this entity, in the same frame and space."""
    frames: tuple[str, ...]
    """Names of the frames in use, "world" first."""

    def entity_frames(self) -> NDArray[np.int64]:
        """(K, 3) index into the frames per entity; the hand has none but its own."""
        return np.stack([self.position_frame, self.orientation_frame, np.zeros_like(self.position_frame)], axis=1)

    def alike(self, k: int, coordinates: slice, rows: Iterable[int]) -> list[int]:
        """Those of the rows that go to the same goal as row k along coordinates of one entity; k itself if it controls none."""
        entity = next(e for e, part in enumerate(ENTITIES.values()) if part.start <= coordinates.start < part.stop)
        controls = (self.modes[:, coordinates] == CONTROLLED).any(axis=1)
        if not controls[k]:
            return [k]
        return [j for j in rows if controls[j] and self.shared[j, entity] == self.shared[k, entity]]


def primitive_table(primitives: Sequence[Primitive], observation_names: Sequence[str]) -> PrimitiveTable:
    """Arrays of a primitive table; DemonstrationError for a frame, space or mode that cannot be learned with."""
    tracked = sorted(name.removeprefix("frame_") for name in observation_names if name.startswith("frame_"))
    known = ("world", *tracked)
    modes = np.zeros((len(primitives), N_COORDINATES), dtype=np.int64)
    for k, primitive in enumerate(primitives):
        for entity, part in ENTITIES.items():
            control: EntityControl | None = getattr(primitive, entity)
            if control is not None:
                _check_control(f"the {entity} of primitive '{primitive.name}'", entity, control, known)
                modes[k, part] = [MODES[axis] for axis in control.axes]
    used = {p.position.frame for p in primitives} | {p.orientation.frame for p in primitives}
    frames = ("world", *(name for name in tracked if name in used))
    position_frame = np.array([frames.index(p.position.frame) for p in primitives], dtype=np.int64)
    orientation_frame = np.array([frames.index(p.orientation.frame) for p in primitives], dtype=np.int64)
    space = np.array([POSITION_SPACES.index(p.position.space) for p in primitives], dtype=np.int64)
    kinds = [[_kind(entity, getattr(p, entity)) for entity in ENTITIES] for p in primitives]
    shared = [[[row[e] for row in kinds].index(kind) for e, kind in enumerate(own)] for own in kinds]
    return PrimitiveTable(position_frame, orientation_frame, space, modes, np.array(shared, dtype=np.int64), frames)


def _kind(entity: str, control: EntityControl | None) -> tuple[int, str, str] | None:
    """What primitives of an entity have in common that go to the same goal."""
    if control is None:
        return None
    return control.primitive, "world" if entity == "hand" else control.frame, control.space


def _check_control(what: str, entity: str, control: EntityControl, frames: Sequence[str]) -> None:
    if control.frame not in frames and entity != "hand":
        raise DemonstrationError(f"{what} has the frame '{control.frame}'; tracked are: {', '.join(frames)}")
    if control.space not in SPACES[entity]:
        raise DemonstrationError(f"{what} has the space '{control.space}'; possible: {', '.join(SPACES[entity])}")
    size = ENTITIES[entity].stop - ENTITIES[entity].start
    possible = ("position", "force", "hold") if entity == "position" else ("position", "hold")
    if len(control.axes) != size or not set(control.axes) <= set(possible):
        raise DemonstrationError(f"{what} has the axes {control.axes}; it needs {size} of: {', '.join(possible)}")


def measure(observations: Mapping[str, Array], frames: Sequence[str]) -> Measurement:
    """Measured quantities of a batch of observations (N, d) by name; frames[0] is the world."""
    position = np.asarray(observations["tool_position"], dtype=np.float64)
    n = len(position)
    hand = observations.get("hand_position")
    poses = np.empty((n, len(frames), 7))
    poses[:, 0] = WORLD
    for i, name in enumerate(frames[1:], start=1):
        poses[:, i] = observations["frame_" + name]
    return Measurement(
        position,
        np.asarray(observations["tool_quaternion"], dtype=np.float64),
        np.zeros((n, 4)) if hand is None or np.shape(hand)[1] == 0 else np.asarray(hand, dtype=np.float64),
        poses,
    )


@njit(cache=True)
def task_coordinates(
    position: Array,
    orientation: Array,
    hand: Array,
    position_frame: Array,
    orientation_frame: Array,
    space: int,
    mean: Array,
) -> Array:
    """Coordinates x (N_COORDINATES,) of one instant; frames are poses (7,), mean is the quaternion of R_mean."""
    x = np.empty(N_COORDINATES)
    within = quaternion.rotate(quaternion.conjugate(position_frame[3:]), position - position_frame[:3])
    x[:3] = task_space.coordinates(within, space)
    relative = quaternion.multiply(quaternion.conjugate(orientation_frame[3:]), orientation)
    x[3:6] = quaternion.to_rotation_vector(quaternion.multiply(relative, quaternion.conjugate(mean)))
    x[6:] = hand
    return x


@njit(cache=True)
def world_goal(
    x: Array, position_frame: Array, orientation_frame: Array, space: int, mean: Array
) -> tuple[Array, Array]:
    """Position (3,) and quaternion (4,) in the world of the coordinates x: inverse of task_coordinates."""
    position = position_frame[:3] + quaternion.rotate(position_frame[3:], task_space.point(x[:3], space))
    relative = quaternion.multiply(quaternion.from_rotation_vector(x[3:6]), mean)
    return position, quaternion.multiply(orientation_frame[3:], relative)


@njit(cache=True)
def deviation(x: Array, goal: Array, space: int) -> Array:
    """x - g (N_COORDINATES,), minus Delta of (2.16) [m], [rad], [rad]; an angle of the position counts along its arc."""
    result = x - goal
    result[:3] = task_space.difference(x[:3], goal[:3], goal[0], space)
    return result


@njit(cache=True)
def _trajectory(
    position: Array, orientation: Array, hand: Array, frames: Array, at: int, turned: int, space: int, mean: Array
) -> Array:
    x = np.empty((len(position), N_COORDINATES))
    for t in range(len(position)):
        x[t] = task_coordinates(position[t], orientation[t], hand[t], frames[t, at], frames[t, turned], space, mean)
    return x


def trajectory(measured: Measurement, table: PrimitiveTable, primitive: int, mean: Array) -> Array:
    """Coordinates (N, N_COORDINATES) of one primitive along a demonstration."""
    at, turned = int(table.position_frame[primitive]), int(table.orientation_frame[primitive])
    space = int(table.space[primitive])
    return _trajectory(measured.position, measured.quaternion, measured.hand, measured.frames, at, turned, space, mean)


@njit(cache=True)
def deviations(x: Array, goal: Array, space: int) -> Array:
    """`deviation` of every row (N, N_COORDINATES)."""
    result = np.empty_like(x)
    for t in range(len(x)):
        result[t] = deviation(x[t], goal, space)
    return result


def relative_quaternion(measured: Measurement, frame: int, t: int) -> Array:
    """Tool orientation (4,) relative to a frame at one instant, canonical (w >= 0)."""
    pose = measured.frames[t, frame]
    return quaternion.canonical(quaternion.multiply(quaternion.conjugate(pose[3:]), measured.quaternion[t]))


def mean_quaternion(quaternions: Array) -> Array:
    """Mean orientation (4,) of quaternions (N, 4): largest eigenvector of sum q q^T, indifferent to their signs."""
    return quaternion.canonical(np.ascontiguousarray(np.linalg.eigh(quaternions.T @ quaternions)[1][:, -1]))
