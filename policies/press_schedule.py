"""When a tool pressed on something, how hard, and in which frame: learned from wrenches along an aligned path."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_opening

from policies.task_space import SMALLEST_RADIUS

Array = NDArray[np.float64]

CONTACT_FORCE = 0.5
"""A stronger wrench is a contact [N]; a tool at rest in free space measures below 0.2 N."""
SHORTEST = 0.06
"""Contacts and gaps between them that are shorter count as chatter, and so do the ends of a contact [s]."""
PRESS = 0.3
"""A shorter contact is no press: fingers that close give the tool a push [s]."""
YIELDS = 0.01
"""What moves further than this along the force [m] within one contact is no wall: it is carried, or pushed."""
STRONG = 0.9
"""Quantile of the forces of a contact that counts as the strongest."""
HALF = 0.5
"""A press about an axis lasts while this share of the strongest is exerted."""
SLIDES = 0.25
"""Share of the arc by which the tool may slide along a press that turns."""
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
    differ least. Where the tool moved along the force, there was no wall to press on, unless the force turned with the
    tool about the frame's z axis: what is flipped bears a press towards its edge.

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
        here = points[:, at, f]
        pressed = _straight(_across(exerted, here, dt), here, pad)
        if not pressed.any():
            pressed = _about_the_axis(exerted, here)
        if pressed.any():
            force[at], frame[at] = pressed, f
    return PressSchedule(force, frame)


def _straight(across: Array, points: Array, pad: int) -> Array:
    """One force (N, 3) [N] for a whole contact, or 0: from those across the movement (M, N, 3), and its points (M, N, 3).

    It needs a wall: the tool does not move along the force. In the first and last `pad` steps it may arrive and withdraw.
    """
    press = np.median(across.reshape(-1, 3), axis=0)
    strength = float(np.linalg.norm(press))
    n = points.shape[1]
    edge = min(pad, (n - 1) // 2)
    depth = points[:, edge : n - edge] @ (press / max(strength, CONTACT_FORCE))
    wall = strength >= CONTACT_FORCE and np.ptp(depth, axis=1).max() < YIELDS
    return np.broadcast_to(press * wall, points.shape[1:])


def _about_the_axis(exerted: Array, points: Array) -> Array:
    """Of what was exerted, (M, N, 3): a force to the frame's z axis, or away from it, that turns with the tool.

    It lasts from the first to the last step at which `HALF` of the strongest was exerted: before, the tool may push, and
    withdraw afterwards. On what turns the tool may slide: in most demonstrations along the force by less than the share
    `SLIDES` of its arc, which is more than a wall `YIELDS`.
    """
    pressed = np.zeros(points.shape[1:])
    radius = np.linalg.norm(points[..., :2], axis=-1)
    outward = points * (1.0, 1.0, 0.0) / np.maximum(radius, SMALLEST_RADIUS)[..., None]
    felt = np.median((exerted * outward).sum(axis=-1), axis=0)
    steps = np.flatnonzero(np.abs(felt) >= HALF * np.quantile(np.abs(felt), STRONG))
    lasts = slice(steps[0], steps[-1] + 1)
    press = np.median(felt[lasts])
    angle = np.unwrap(np.arctan2(points[:, lasts, 1], points[:, lasts, 0]), axis=1)
    slack = SLIDES * np.ptp(angle, axis=1) * radius[:, lasts].mean(axis=1)
    borne = (slack > YIELDS) & (np.ptp(radius[:, lasts], axis=1) < slack)
    if abs(press) >= CONTACT_FORCE and borne.mean() > 0.5:
        pressed[lasts] = press * np.median(outward[:, lasts], axis=0)
    return pressed


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
