"""When a tool pressed on something, how hard, and in which frame: learned from wrenches along an aligned path."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_opening

Array = NDArray[np.float64]

CONTACT_FORCE = 0.5
"""A stronger wrench is a contact [N]; a tool at rest in free space measures below 0.2 N."""
SHORTEST = 0.06
"""Contacts and gaps between them that are shorter count as chatter [s]."""
PRESS = 0.3
"""A shorter contact is no press: fingers that close give the tool a push [s]."""
YIELDS = 0.01
"""What moves further than this along the force [m] within one contact is no wall: it is carried, or pushed."""
MOVES = 0.01
"""Slower movements [m/s] have no direction."""
REMOTENESS = 0.02
"""Of two frames in which demonstrations differ equally the nearer one counts: a distance costs as much as this share of it in
spread."""


class PressSchedule(NamedTuple):
    """Per time step the force that the tool shall exert on the world."""

    force: Array
    """(N, 3) in the coordinates of a frame [N]; 0 where the tool does not press."""
    frame: NDArray[np.int64]
    """(N,) the frame."""


def in_contact(wrench: Array) -> NDArray[np.bool_]:
    """Whether the world pushes the tool, (N,), from wrenches (N, 6)."""
    return np.asarray(np.linalg.norm(wrench[:, :3], axis=1) > CONTACT_FORCE)


def learn_presses(local: Sequence[Array], axes: Sequence[Array], wrenches: Sequence[Array], dt: float) -> PressSchedule:
    """The schedule of aligned demonstrations.

    There is contact where most demonstrations had it. Of each contact the force is one vector: the median of what was
    measured across the movement, for along it there is friction, in the frame in which the places of the demonstrations
    differ least. Where the tool moved along the force, there was no wall to press on.

    Args:
        local: per demonstration the points in every frame (N, F, 3) [m].
        axes: per demonstration the axes (F, 3, 3) of its frames.
        wrenches: per demonstration (N, 6), world axes [N], [N m].
        dt: time step [s].
    """
    touched = np.mean([in_contact(wrench) for wrench in wrenches], axis=0) > 0.5
    chatter = np.ones(max(round(SHORTEST / dt), 1))
    pad = len(chatter)
    touched = binary_opening(binary_closing(np.pad(touched, pad), chatter), chatter)[pad:-pad]
    force, frame = np.zeros((len(touched), 3)), np.zeros(len(touched), dtype=np.int64)
    points = np.array(local)
    edges = np.flatnonzero(np.diff(np.pad(touched.astype(np.int64), 1)))
    for start, stop in edges.reshape(-1, 2):
        if (stop - start) * dt < PRESS:
            continue
        at = slice(start, stop)
        f = int(np.argmin(_spread(points[:, at]).mean(axis=0)))
        exerted = np.array([-wrench[at, :3] @ a[f] for wrench, a in zip(wrenches, axes, strict=True)])
        press = np.median(_across(exerted, points[:, at, f], dt).reshape(-1, 3), axis=0)
        if np.linalg.norm(press) < CONTACT_FORCE:
            continue
        if np.ptp(points[:, at, f] @ (press / np.linalg.norm(press)), axis=1).max() < YIELDS:
            force[at], frame[at] = press, f
    return PressSchedule(force, frame)


def _across(force: Array, points: Array, dt: float) -> Array:
    """Forces (M, N, 3) without what points along the movement of the points (M, N, 3), where it is faster than `MOVES`."""
    velocity = np.gradient(points, dt, axis=1) if points.shape[1] > 1 else np.zeros_like(points)
    speed = np.linalg.norm(velocity, axis=2, keepdims=True)
    along = np.where(speed > MOVES, velocity / np.maximum(speed, MOVES), 0.0)
    return np.asarray(force - (force * along).sum(axis=2, keepdims=True) * along)


def _spread(points: Array) -> Array:
    """How much M demonstrations (M, N, F, 3) differ in every frame, and how far away it is: (N, F) [m]."""
    deviation = np.sqrt(points.var(axis=0).sum(axis=2))
    return np.asarray(deviation + REMOTENESS * np.linalg.norm(points, axis=3).mean(axis=0))
