"""Movement primitives learned from labelled demonstrations: attractor goals and desired forces (thesis 2.2, 3.2).

Frames and controlled variables are given by the primitive table (2.1.2); goals and forces are learned from what was
measured, entity by entity, in the frame of each.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym import quaternion
from lfd_gym.demonstration import Demonstration
from lfd_gym.errors import DemonstrationError
from policies.goals import NormalisedTime, attractor_goal
from policies.sequence_graph import segments
from policies.task_data import (
    CONTROLLED,
    FORCE,
    HAND,
    N_COORDINATES,
    ORIENTATION,
    POSITION,
    Measurement,
    PrimitiveTable,
    mean_quaternion,
    relative_quaternion,
    trajectory,
)
from policies.task_space import CYLINDRICAL, SMALLEST_RADIUS, coordinates, directions

Array = NDArray[np.float64]

DEAD_BAND = np.array([[0.005] * 3 + [0.05] * 7, [0.005, 0.05, 0.005] + [0.05] * 7])
"""Travel below which a segment points to no side (2.9), per space: 5 mm, 3 degrees; above sensor noise, below any
movement."""
APART = np.array([[0.15] * 3 + [1.0] * 7, [0.15, 0.5, 0.15] + [1.0] * 7])
"""Rows of the primitive table that end farther apart than this [m], [rad] cannot share a goal, per space; near a cylinder's
axis angles may differ by more, as long as the arc does not."""
REST_TIME, REST_SHARE = 0.1, 0.4
"""A segment that moved by less than this share of the dead band (2 mm, 1 degree) in the last time [s] rests at its goal."""
SMALLEST_SCATTER = 0.001
"""[m] or [rad]: below that a scatter of goals is not told from the controller's error."""
PRESSES, GRIP = 0.5, 0.25
"""A hand joint whose drive bears more than this torque [N m] at the end of a movement presses against something; its
goal lies beyond where it stalled, by this angle [rad], which is enough for all the torque that a drive gives."""
HELD_TIME = 0.2
"""What it bears is the median over the last time of a movement [s]."""
PRESSED_SHARE = 0.25
"""A joint presses if it did in this share of the segments: of fingers that oppose each other not all bear torque each time."""
SLOWEST, GENTLEST = 0.1, 0.5
"""[m/s], [m/s^2]: a primitive that hardly moved the tool may still have to move it so fast, and so suddenly."""
STEADY_SHARE = 0.5
"""A force counts as steady contact above this fraction of its 90 % quantile within the segment."""


class MovementPrimitives(NamedTuple):
    """What is known about every row of the primitive table, as plain arrays."""

    names: tuple[str, ...]
    table: PrimitiveTable
    mean: Array
    """(K, 4) orientation R_mean about which rotation vectors are taken."""
    goal: Array
    """(K, N_COORDINATES) attractor goals g; along a force axis the position at which the contact was steady, and for a
    radius that is held the median of where it ended."""
    grip: Array
    """(K, 4) how far beyond the goal the hand is commanded [rad], so that it presses as it did; 0 where it is free."""
    force: Array
    """(K, 3) desired force of the tool on the world along the coordinates of the position [N]; 0 along other axes."""
    speed: Array
    """(K,) speed of the tool [m/s] where it was demonstrated to move fast."""
    acceleration: Array
    """(K,) [m/s^2] with which it was demonstrated to come up to this speed."""


def learn_primitives(
    names: Sequence[str],
    table: PrimitiveTable,
    demonstrations: Sequence[Demonstration],
    measurements: Sequence[Measurement],
    time: NormalisedTime,
) -> MovementPrimitives:
    """Goals and forces of every primitive from all its segments; rows never demonstrated stay zero.

    Rows that share a primitive of the position or the orientation (in the same frame and space) share its goal, and learn it
    from all of their segments. Where the hand ends depends on what it holds. Raises DemonstrationError for rows that share
    a primitive and end far apart.
    """
    n, dt = len(names), float(demonstrations[0].dt)
    mean = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    goal, grip, force = np.zeros((n, N_COORDINATES)), np.zeros((n, 4)), np.zeros((n, 3))
    speed, acceleration = np.zeros((2, n))
    shown = _shown(demonstrations)
    for k in shown:
        ends = [(m, at.stop - 1) for j in table.alike(k, ORIENTATION, shown) for m, at in shown[j]]
        frame = int(table.orientation_frame[k])
        mean[k] = mean_quaternion(np.array([relative_quaternion(measurements[m], frame, t) for m, t in ends]))
    paths = {
        k: [trajectory(Measurement(*(a[at] for a in measurements[m])), table, k, mean[k]) for m, at in own]
        for k, own in shown.items()
    }
    for k, gone in paths.items():
        for x in gone:
            _unwrap_rotation(x[:, ORIENTATION])
            if table.space[k] == CYLINDRICAL:
                x[:, 1] = np.unwrap(x[:, 1])
    broken_off = {
        k: [
            at.stop > len(demonstrations[m]) and _breaks_off(x, DEAD_BAND[table.space[k]], dt)
            for (m, at), x in zip(own, paths[k], strict=True)
        ]
        for k, own in shown.items()
    }
    for k, own in shown.items():
        pairs = list(zip(own, paths[k], strict=True))
        whole = [pair for pair, off in zip(pairs, broken_off[k], strict=True) if not off] or pairs
        paces = np.median([_pace(measurements[m].position[at], dt) for (m, at), _ in whole], axis=0)
        speed[k], acceleration[k] = np.maximum(paces, (SLOWEST, GENTLEST))
        if table.space[k] == CYLINDRICAL:
            _same_turn([x for j in table.alike(k, slice(1, 2), shown) for x in paths[j]])
            goal[k, 0] = np.median([x[-1, 0] for x in paths[k]])
        for i in np.flatnonzero(table.modes[k] == CONTROLLED):
            rows = [k] if i >= HAND.start else table.alike(k, slice(i, i + 1), shown)
            dead_band = DEAD_BAND[table.space[k], i]
            begun = _begun({j: [x[:, i] for x in paths[j]] for j in rows}, broken_off, dead_band)
            _check_shared(names, begun, _apart(table, goal, k, int(i)))
            goal[k, i] = _goal(list(begun.values()), time, dead_band, dt)
        if "hand_torque" in demonstrations[0].observations:
            last = max(round(HELD_TIME / dt), 1)
            held = (demonstrations[m].observations["hand_torque"][at][-last:] for (m, at), _ in whole)
            torque = np.array([np.median(rows, axis=0) for rows in held])
            grip[k] = _grip(torque) * (table.modes[k, HAND] == CONTROLLED)
        for i in np.flatnonzero(table.modes[k, POSITION] == FORCE):
            forces = [_pressed(demonstrations[m], measurements[m], at, table, k)[:, i] for (m, at), _ in whole]
            force[k, i], goal[k, i] = _steady_contact(forces, [x[:, i] for _, x in whole])
    return MovementPrimitives(tuple(names), table, mean, goal, grip, force, speed, acceleration)


def _grip(torque: Array) -> Array:
    """How far beyond its goal the hand goes (4,) [rad], from the torques of its drives where segments ended (M, 4) [N m]."""
    presses = np.abs(torque) > PRESSES
    sign = np.sign((torque * presses).sum(axis=0))
    return np.asarray(GRIP * sign * (presses.mean(axis=0) >= PRESSED_SHARE))


def _shown(demonstrations: Sequence[Demonstration]) -> dict[int, list[tuple[int, slice]]]:
    """Primitive -> its segments, as indices of demonstrations and slices of their observations.

    Where a failed demonstration broke off says nothing about a primitive that a successful one shows: its last segment is
    left out there.
    """
    parts = [(m, s) for m, demonstration in enumerate(demonstrations) for s in segments(demonstration.labels)]
    solved = {s.label for m, s in parts if demonstrations[m].success}
    shown: dict[int, list[tuple[int, slice]]] = {k: [] for k in sorted({s.label for _, s in parts})}
    for m, s in parts:
        if demonstrations[m].success or s.stop < len(demonstrations[m]) or s.label not in solved:
            shown[s.label].append((m, slice(s.start, s.stop + 1)))
    return shown


def _breaks_off(x: Array, dead_band: Array, dt: float) -> bool:
    """Whether a path (N, N_COORDINATES) ends before it moves, or at more than half of its greatest speed."""
    n = min(max(round(REST_TIME / dt), 1), len(x) - 1)
    speed = (np.abs(x[n:] - x[:-n]) / dead_band).max(axis=1)
    return bool((np.ptp(x, axis=0) <= dead_band).all() or speed[-1] > 0.5 * speed.max())


def _begun(
    shown: dict[int, list[Array]], broken_off: Mapping[int, Sequence[bool]], dead_band: float
) -> dict[int, list[Array]]:
    """Segments (N,) of one coordinate without those that broke off before they moved along it, unless all did.

    Where such a segment stands is where the movement before it ended, and no goal.
    """
    begun = {
        k: [x for x, off in zip(own, broken_off[k], strict=True) if not off or np.ptp(x) > dead_band]
        for k, own in shown.items()
    }
    return {k: own for k, own in begun.items() if own} or shown


def _goal(groups: Sequence[Sequence[Array]], time: NormalisedTime, dead_band: float, dt: float) -> float:
    """Goal of one coordinate from the segments (N,) of every row that shares it."""
    rest = round(REST_TIME / dt) + 1, REST_SHARE * dead_band
    weights = precisions([np.array([x[-1] for x in own]) for own in groups])
    return attractor_goal([x for own in groups for x in own], time, dead_band, rest, weights)


def _apart(table: PrimitiveTable, goal: Array, k: int, i: int) -> float:
    """How far apart rows may end along coordinate i of row k, whose radius is known [m], [rad]."""
    apart = APART[table.space[k]]
    if table.space[k] == CYLINDRICAL and i == 1:
        return float(max(apart[1], apart[0] / max(goal[k, 0], SMALLEST_RADIUS)))
    return float(apart[i])


def _check_shared(names: Sequence[str], shown: Mapping[int, Sequence[Array]], apart: float) -> None:
    middle = {row: float(np.median([x[-1] for x in own])) for row, own in shown.items()}
    one, other = sorted((min(middle, key=middle.__getitem__), max(middle, key=middle.__getitem__)))
    if abs(middle[one] - middle[other]) > apart:
        raise DemonstrationError(
            f"'{names[one]}' and '{names[other]}' share a primitive in the primitive table, but end "
            f"{abs(middle[one] - middle[other]):.2f} m or rad apart; primitives with different goals need different numbers"
        )


def precisions(ends: Sequence[Array]) -> Array:
    """Weights (M,) of segments that share a goal, from how far the ends (M_j,) of each group scatter, in their order.

    The inverse of a group's variance, in which the mean variance of all groups counts as one more segment: a careful
    approach weighs more than a casual one to the same place, and one segment alone is neither.
    """
    squares = [float(((own - own.mean()) ** 2).sum()) for own in ends]
    common = (sum(squares) + SMALLEST_SCATTER**2) / (sum(len(own) - 1 for own in ends) + 1)
    return np.concatenate([np.full(len(own), len(own) / (s + common)) for own, s in zip(ends, squares, strict=True)])


def _pace(position: Array, dt: float) -> tuple[float, float]:
    """90 % quantile of the speed [m/s] along a path (N, 3), and the mean acceleration [m/s^2] from a tenth of it to 90 %."""
    speeds = np.linalg.norm(np.diff(position, axis=0), axis=1) / dt
    fast = float(np.quantile(speeds, 0.9))
    reached = int(np.argmax(speeds >= 0.9 * fast))
    slow = np.flatnonzero(speeds[:reached] <= 0.1 * fast)
    since = int(slow[-1]) if len(slow) else 0
    return fast, 0.8 * fast / (dt * max(reached - since, 1))


def _same_turn(paths: Sequence[Array]) -> None:
    """Shift the angles of cylindrical paths (N, N_COORDINATES) by whole turns, so that they end within half a turn."""
    middle = np.angle(np.mean([np.exp(1j * x[-1, 1]) for x in paths]))
    for x in paths:
        x[:, 1] -= 2.0 * np.pi * np.round((x[-1, 1] - middle) / (2.0 * np.pi))


def _unwrap_rotation(vectors: Array) -> None:
    """Make rotation vectors (N, 3) continuous, back from the last one: a turn of more than half a turn does not jump."""
    if (np.abs(np.diff(vectors, axis=0)) < 1.0).all():
        return
    for t in range(len(vectors) - 2, -1, -1):
        angle = float(np.linalg.norm(vectors[t]))
        if angle > 0.0:
            axis = vectors[t] / angle
            turns = np.round((vectors[t + 1] @ axis - angle) / (2.0 * np.pi))
            vectors[t] += 2.0 * np.pi * turns * axis


def _pressed(demonstration: Demonstration, measured: Measurement, at: slice, table: PrimitiveTable, k: int) -> Array:
    """Force of the tool on the world along the coordinates of primitive k (N, 3) [N]: the negative of the wrench."""
    wrench, space = demonstration.observations["wrench"][at, :3], int(table.space[k])
    rows = zip(measured.position[at], measured.frames[at, table.position_frame[k]], wrench, strict=True)
    result = np.empty_like(wrench)
    for t, (position, frame, force) in enumerate(rows):
        to_frame = quaternion.conjugate(frame[3:])
        y = coordinates(quaternion.rotate(to_frame, position - frame[:3]), space)
        result[t] = directions(y, space).T @ quaternion.rotate(to_frame, -force)
    return result


def _steady_contact(forces: Sequence[Array], positions: Sequence[Array]) -> tuple[float, float]:
    """Median force [N] and median position [m] along a force axis while in contact; medians of segment medians.

    The build-up of the force, and the fall after the world gave way, do not count.
    """
    levels, places = [], []
    for f, x in zip(forces, positions, strict=True):
        steady = np.abs(f) >= STEADY_SHARE * np.quantile(np.abs(f), 0.9)
        levels.append(np.median(f[steady]))
        places.append(np.median(x[steady]))
    return float(np.median(levels)), float(np.median(places))
