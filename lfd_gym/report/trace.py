"""One reproduction as arrays, and motions in the frames of the primitives."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from lfd_gym.demonstration import EntityControl
from lfd_gym.registry import make
from lfd_gym.rollout import rollout


class Trace(NamedTuple):
    """What was observed during one episode of a skill."""

    seed: int
    observations: Mapping[str, np.ndarray]
    """Per name (T, d), before each action."""
    labels: np.ndarray
    """(T,) active primitive."""
    names: tuple[str, ...]
    """Name of every primitive."""
    dt: float
    """[s]."""
    success: bool


def trace(env_id: str, skill: Any, seed: int) -> Trace:
    """Run the skill in one episode and keep what was observed and which primitive was active."""
    env: Any = make(env_id)
    steps = list(rollout(env, skill, seed))
    observations = {name: np.stack([step.observation[name] for step in steps]) for name in steps[0].observation}
    labels = np.array([int(skill.active(step.state)[0]) for step in steps])
    success = bool(steps[-1].info["is_success"])
    env.close()
    return Trace(seed, observations, labels, tuple(skill.primitive_names), env.unwrapped.dt, success)


def stretches(labels: np.ndarray) -> Iterator[tuple[int, slice]]:
    """(label, steps) of every maximal stretch of one label."""
    cuts = [0, *(np.flatnonzero(np.diff(labels)) + 1).tolist(), len(labels)]
    for start, stop in pairwise(cuts):
        yield int(labels[start]), slice(start, stop)


def position_in_frame(observations: Mapping[str, np.ndarray], control: EntityControl) -> np.ndarray:
    """Tool position (T, 3) in the frame and space of a primitive, the frame taken where it stood at each step.

    Cartesian [m], or cylindrical: radius [m], angle [rad], height [m].
    """
    position = observations["tool_position"]
    if control.frame != "world":
        frame = observations[f"frame_{control.frame}"]
        rotation = Rotation.from_quat(frame[:, 3:], scalar_first=True)
        position = rotation.inv().apply(position - frame[:, :3])
    if control.space != "cylindrical":
        return position
    angle = np.unwrap(np.arctan2(position[:, 1], position[:, 0]))
    return np.column_stack([np.hypot(position[:, 0], position[:, 1]), angle, position[:, 2]])


def turn_in_frame(observations: Mapping[str, np.ndarray], control: EntityControl, mean: np.ndarray) -> np.ndarray:
    """Turn (T,) [rad] of the tool about the z axis of a primitive's frame, from the orientation `mean` (4,) in it."""
    rotation = Rotation.from_quat(observations["tool_quaternion"], scalar_first=True)
    if control.frame != "world":
        rotation = Rotation.from_quat(observations[f"frame_{control.frame}"][:, 3:], scalar_first=True).inv() * rotation
    away = rotation * Rotation.from_quat(mean, scalar_first=True).inv()
    return away.as_rotvec()[:, 2]


def turn(observations: Mapping[str, np.ndarray]) -> np.ndarray:
    """Angle (T,) [rad] of the tool's x axis in the horizontal plane of the world, without jumps."""
    rotation = Rotation.from_quat(observations["tool_quaternion"], scalar_first=True)
    axis = rotation.apply([1.0, 0.0, 0.0])
    return np.unwrap(np.arctan2(axis[:, 1], axis[:, 0]))
