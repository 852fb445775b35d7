"""Movement primitives learned from labelled demonstrations: attractor goals and desired forces (thesis 2.2, 3.2).

Frames and controlled variables are given by the primitive table (2.1.2); goals and forces are learned from what was
measured, entity by entity, in the frame of each.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym import quaternion
from lfd_gym.demonstration import Demonstration
from policies.features import (
    CONTROLLED,
    FORCE,
    HAND,
    N_COORDINATES,
    POSITION,
    Measurement,
    PrimitiveTable,
    mean_quaternion,
    relative_quaternions,
    trajectory,
)
from policies.goals import NormalisedTime, attractor_goal
from policies.sequence_graph import segments

Array = NDArray[np.float64]

DEAD_BAND = np.array([0.005] * 3 + [0.05] * 3 + [0.05] * 4)
"""Travel below which a segment points to no side (2.9): 5 mm, 3 degrees; above sensor noise, below any movement."""
PRESSES, GRIP = 0.5, 0.25
"""A hand joint whose drive bears more than this torque [N m] at the end of a movement presses against something; its
goal lies beyond where it stalled, by this angle [rad], which is enough for all the torque that a drive gives."""
CONTACT_FRACTION = 0.5
"""A force counts as steady contact above this fraction of its 90 % quantile within the segment."""


class MovementPrimitives(NamedTuple):
    """What is known about every row of the primitive table, as plain arrays."""

    names: tuple[str, ...]
    table: PrimitiveTable
    mean: Array
    """(K, 4) orientation R_mean about which rotation vectors are taken."""
    goal: Array
    """(K, N_COORDINATES) attractor goals g; along a force axis the position at which the contact was steady."""
    grip: Array
    """(K, 4) how far beyond the goal the hand is commanded [rad], so that it presses as it did; 0 where it is free."""
    force: Array
    """(K, 3) desired force of the tool on the world, axes of the position's frame [N]; 0 along other axes."""


def learn_primitives(
    names: Sequence[str],
    table: PrimitiveTable,
    demonstrations: Sequence[Demonstration],
    measurements: Sequence[Measurement],
    time: NormalisedTime,
) -> MovementPrimitives:
    """Goals and forces of every primitive from all its segments; rows never demonstrated stay zero."""
    n = len(names)
    mean = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    goal, grip, force = np.zeros((n, N_COORDINATES)), np.zeros((n, 4)), np.zeros((n, 3))
    parts = [(m, s) for m, demonstration in enumerate(demonstrations) for s in segments(demonstration.labels)]
    for k in range(n):
        own = [(m, slice(s.start, s.stop + 1)) for m, s in parts if s.label == k]
        if not own:
            continue
        frame = int(table.orientation_frame[k])
        ends = [Measurement(*(array[at.stop - 1 : at.stop] for array in measurements[m])) for m, at in own]
        mean[k] = mean_quaternion(np.concatenate([relative_quaternions(end, frame) for end in ends]))
        paths = [trajectory(Measurement(*(a[at] for a in measurements[m])), table, k, mean[k]) for m, at in own]
        for i in np.flatnonzero(table.modes[k] == CONTROLLED):
            goal[k, i] = attractor_goal([x[:, i] for x in paths], time, DEAD_BAND[i])
        if "hand_torque" in demonstrations[0].observations:
            torque = np.median([demonstrations[m].observations["hand_torque"][at.stop - 1] for m, at in own], axis=0)
            grip[k] = GRIP * np.sign(torque) * (np.abs(torque) > PRESSES) * (table.modes[k, HAND] == CONTROLLED)
        for i in np.flatnonzero(table.modes[k, POSITION] == FORCE):
            forces = [_pressed(demonstrations[m], measurements[m], at, table.position_frame[k])[:, i] for m, at in own]
            force[k, i], goal[k, i] = _steady_contact(forces, [x[:, i] for x in paths])
    return MovementPrimitives(tuple(names), table, mean, goal, grip, force)


def _pressed(demonstration: Demonstration, measured: Measurement, at: slice, frame: int) -> Array:
    """Force of the tool on the world in a frame (N, 3) [N]: the negative of what the wrench measures."""
    wrench = demonstration.observations["wrench"][at, :3]
    turns = measured.frames[at, frame, 3:]
    return np.array([quaternion.rotate(quaternion.conjugate(q), -f) for q, f in zip(turns, wrench, strict=True)])


def _steady_contact(forces: Sequence[Array], positions: Sequence[Array]) -> tuple[float, float]:
    """Median force [N] and median position [m] along a force axis while in contact; medians of segment medians.

    The build-up of the force, and the fall after the world gave way, do not count.
    """
    levels, places = [], []
    for f, x in zip(forces, positions, strict=True):
        steady = np.abs(f) >= CONTACT_FRACTION * np.quantile(np.abs(f), 0.9)
        levels.append(np.median(f[steady]))
        places.append(np.median(x[steady]))
    return float(np.median(levels)), float(np.median(places))
