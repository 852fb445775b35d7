"""What the Bayesian decomposition sees of an entity's segments: ends, ways and shapes in every task space, in its own units.

Lengths are in units of the entity, 1 cm, 0.05 rad (3 degrees) or 0.1 rad of a hand joint: about what a human's goals scatter
by. So one set of constants serves all entities.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from policies.decomposition.task_spaces import DIRECTION, EntitySegments, View, nearest_rotation, pressing

Array = NDArray[np.float64]

UNIT = {"position": 0.01, "orientation": 0.05, "hand": 0.1}
"""[m], [rad], [rad]."""
SMALLEST_EXTENT = 5.0
"""Of the box around all ends, per dimension, in units."""
POSE_SHAPE, FORCE_SHAPE = 4.0, 50.0
"""a0 of the variances: what a pose scatters by is learned, what a force does is known."""
LEAST = {"position": 0.0, "orientation": 0.7, "hand": 0.0}
"""A human scatters by at least this, in units: an orientation that is done again in the same way is done by habit."""
FORCE = slice(3, 7)
"""Where `pressing` stands behind a position."""
FORCE_LOG_VOLUME = float(np.log(4.0 / 3.0 * np.pi * DIRECTION**3))
"""log V of what `pressing` may be."""
REMAINS, REMAINS_INTERRUPTED = 1.5, 20.0
"""tau: mean way that remains where a movement was stopped early, in units; and where something happened to it."""
SHARES, SHARES_INTERRUPTED = (0.74, 0.08, 0.08, 0.04, 0.06), (0.05, 0.80, 0.05, 0.05, 0.05)
"""Prior probabilities of the kinds of segments, in their order in `result`; and where something happened to them."""
SHORT = 1.2
"""A segment that leads less far is still the arrival of the one before."""
CARRIED, FAR = 0.15, 3.0
"""A frame in which the entity moves by less than this share of the farthest way in any frame, where that is farther than so
many units, is carried along; so it is in short movements that follow."""
LEFT = 0.5
"""In longer ones it is until it moves by more than this share: what is put down may slip in the hand."""
CARRIED_PENALTY = -20.0
HINT_FLOOR = 0.05
"""Least weight of a hint: it may be wrong."""
BOW, WOBBLE = 0.07, 0.4
"""Spread of the sideways sine coefficients of a straight movement: share of its length, and in units."""
N_SINES = 2
AXIS_PENALTY, NEAR_AXIS = -20.0, 5.0
"""So near to the axis of a cylindrical space, in units, its angle says nothing."""
PRIOR = {"cartesian": 0.8, "cylindrical": 0.2, "rotation": 1.0, "joints": 1.0}
"""Prior weights of the task spaces of an object."""
HOLDS = ((True, True, False), (False, False, True))
"""Which axes of a Cartesian space a movement may leave as they are: it goes only up or down, or only across."""
HOLD_SHARE = 0.05
"""One movement in so many leaves an axis as it is: to control all axes corrects what the movement before left, so it is
preferred unless ends contradict."""
HELD, HELD_DRIFT, HELD_PENALTY = 1.0, 0.05, -20.0
"""How far a held axis strays, in units, and per way."""
TANGENT = 5.0
"""The direction in which an orientation arrives is that of the last so many units."""


class Space(NamedTuple):
    """A task space, and which of its axes are held."""

    number: int
    """Of the task space in `EntitySegments.spaces`."""
    held: tuple[bool, ...]
    """Per coordinate of the pose."""


class Group(NamedTuple):
    """Coordinates that share a variance."""

    part: slice
    dimensions: Array
    """(F,) degrees of freedom that are controlled: 3 for the 9 numbers of a rotation matrix."""
    shape: float
    """a0: the prior of the variance counts as 2 a0 observations."""
    least: float
    """A human scatters by at least this, in units."""


class Observed(NamedTuple):
    """L segments in F spaces."""

    spaces: tuple[Space, ...]
    ends: Array
    """(L, F, D) the pose, then `pressing` of the force; 0 along held axes."""
    starts: Array
    """(L, F, P) of the pose alone."""
    directions: Array
    """(L, F, P) unit vectors in which the segments arrive; of an orientation (L, F, 3) axes of rotation."""
    constants: Array
    """(L, F) log-Jacobian, shape of the path relative to the best space, how well held axes held, and penalties."""
    hints: Array
    """(L, F) log-probability of every space from what else is known of a segment, relative to the best space."""
    remains: Array
    """(L,) tau, see `incomplete`."""
    log_shares: Array
    """(L, 5) log prior of the kinds."""
    rotation: bool
    """Whether the pose is an orientation: the 9 numbers of a rotation matrix, so scaled that distances are units."""
    prior: Array
    """(F,) prior probability of the spaces."""
    groups: tuple[Group, ...]
    log_volume: Array
    """(F,) log V of the box in which goals are expected, in units."""
    moves: NDArray[np.bool_]
    """(L,)."""
    following: NDArray[np.int64]
    """(L,) index of the next segment of the same demonstration, or -1."""


def observe(data: EntitySegments, hints: Array | None = None, interrupted: NDArray[np.bool_] | None = None) -> Observed:
    """The segments of an entity as the model sees them.

    hints (L, number of task spaces): how probable the spaces are from what else is known of a segment; None: nothing is known.
    interrupted (L,): to which segments something happened; None: to none.
    """
    unit, rotation = UNIT[data.entity], data.entity == "orientation"
    scale = 1.0 / (np.sqrt(2.0) * unit if rotation else unit)
    size = len(data.views[0][0].end)
    spaces = [Space(i, (False,) * size) for i in range(len(data.spaces))]
    spaces += [Space(i, held) for i, space in enumerate(data.spaces) if space.space == "cartesian" for held in HOLDS]
    chosen, held = [space.number for space in spaces], np.array([space.held for space in spaces])
    moves = np.array([part.moves for part in data.segments])
    following = np.array(
        [
            i + 1 if i + 1 < len(data.segments) and data.segments[i + 1].demonstration == part.demonstration else -1
            for i, part in enumerate(data.segments)
        ]
    )
    happened = np.zeros(len(moves), dtype=bool) if interrupted is None else interrupted
    ends = np.array([[view.end for view in row] for row in data.views])[:, chosen] * scale
    starts = np.array([[view.start for view in row] for row in data.views])[:, chosen] * scale
    lengths = np.array([[view.length for view in row] for row in data.views])[:, rigid(data)] / unit
    directions = _directions(data, lengths, following, scale)
    constants = _constants(data, lengths, unit)[:, chosen] + _held(ends - starts, held, moves)
    log_hints = np.log((np.ones(lengths.shape) if hints is None else hints) + HINT_FLOOR)[:, chosen]
    extents = np.log(np.maximum(np.ptp(ends[:, 0], axis=0), SMALLEST_EXTENT))
    log_volume = (~held * extents).sum(axis=1)
    controlled = (~held).sum(axis=1).astype(np.float64)
    if rotation:
        log_volume, controlled = np.full(len(spaces), _turned_log_volume(data)), np.full(len(spaces), 3.0)
    groups = [Group(slice(0, size), controlled, POSE_SHAPE, LEAST[data.entity])]
    directions = directions[:, chosen] if rotation else directions[:, chosen] * ~held
    ends, starts = ends * ~held, starts * ~held
    if data.entity == "position":
        forces = pressing(np.array([[view.force_level for view in row] for row in data.views]))[:, chosen]
        groups.append(Group(FORCE, np.full(len(spaces), 4.0), FORCE_SHAPE, 0.0))
        log_volume = log_volume + FORCE_LOG_VOLUME
        ends = np.concatenate([ends, forces], axis=2)
    weights = [PRIOR[data.spaces[s.number].space] * (HOLD_SHARE if any(s.held) else 1.0) for s in spaces]
    return Observed(
        tuple(spaces),
        ends,
        starts,
        directions,
        constants,
        log_hints - log_hints.max(axis=1, keepdims=True),
        np.where(happened, REMAINS_INTERRUPTED, REMAINS),
        np.log(np.where(happened[:, None], SHARES_INTERRUPTED, SHARES)),
        rotation,
        np.array(weights) / sum(weights),
        tuple(groups),
        log_volume,
        moves,
        following,
    )


def _turned_log_volume(data: EntitySegments) -> float:
    """log of the box around the ends of all orientations, along its own axes, at most all rotations; in units."""
    ends = np.array([row[0].end for row in data.views])
    unit = UNIT["orientation"]
    turned = rotation_vectors(nearest_rotation(ends.mean(axis=0).reshape(3, 3)).ravel(), ends) / unit
    axes = np.linalg.svd(turned - turned.mean(axis=0))[2]
    extents = np.maximum(np.ptp(turned @ axes.T, axis=0), SMALLEST_EXTENT)
    return float(min(np.log(extents).sum(), np.log(8.0 * np.pi**2 / unit**3)))


def rigid(data: EntitySegments) -> list[int]:
    """Per task space the one that has distances of its frame: an angle about an axis that is near tells nothing of a way."""
    frames = [space.frame for space in data.spaces]
    return [frames.index(frame) for frame in frames]


def _constants(data: EntitySegments, lengths: Array, unit: float) -> Array:
    """(L, task spaces) what does not depend on the goal."""
    constants = np.array([[view.log_jacobian for view in row] for row in data.views])
    if data.entity == "position":
        shapes = np.array([[_shape(view, unit) for view in row] for row in data.views])
        constants += shapes - shapes.max(axis=1, keepdims=True)
    for i, space in enumerate(data.spaces):
        if space.space == "cylindrical":
            near = np.array([row[i].end[0] for row in data.views]) < NEAR_AXIS * unit
            constants[near, i] = AXIS_PENALTY
    farthest = lengths.max(axis=1, keepdims=True)
    carried = carried_along(lengths)
    for i in range(1, len(carried)):
        if data.segments[i].demonstration == data.segments[i - 1].demonstration:
            short = farthest[i, 0] <= FAR
            carried[i] = carried[i - 1] if short else carried[i] | carried[i - 1] & (lengths[i] < LEFT * farthest[i])
    return np.asarray(constants + CARRIED_PENALTY * carried)


def carried_along(ways: Array) -> NDArray[np.bool_]:
    """(..., F) whether a frame is carried, from the entity's ways (..., F) in all frames, in units."""
    farthest = ways.max(axis=-1, keepdims=True)
    return np.asarray((farthest > FAR) & (ways < CARRIED * farthest))


def _held(ways: Array, held: NDArray[np.bool_], moves: NDArray[np.bool_]) -> Array:
    """(L, F) log-density of how far held axes strayed; only a movement can hold an axis."""
    spread = np.hypot(HELD, HELD_DRIFT * np.linalg.norm(ways, axis=-1))[..., None]
    strayed = (norm.logpdf(ways / spread) - np.log(spread)) * held
    return np.asarray(
        strayed.sum(axis=-1) + held.any(axis=1) * np.where(moves, np.log(HOLD_SHARE), HELD_PENALTY)[:, None]
    )


def _directions(data: EntitySegments, lengths: Array, following: NDArray[np.int64], scale: float) -> Array:
    result = np.array([[_direction(view, scale) for view in row] for row in data.views])
    before = {int(b): a for a, b in enumerate(following) if b >= 0}
    for i in range(len(result)):
        if i in before:
            short = lengths[i] < SHORT
            result[i, short] = result[before[i], short]
    return result


def _direction(view: View, scale: float) -> Array:
    way = view.way
    if len(way) == 9:
        away = np.linalg.norm(view.samples - view.end, axis=1) * scale
        far = np.flatnonzero(away > TANGENT)
        way = rotation_vectors(view.samples[far[-1] if len(far) else 0], view.end)
    return np.asarray(way / max(float(np.linalg.norm(way)), 1e-12))


def rotation_vectors(start: Array, end: Array) -> Array:
    """Rotation vectors (..., 3) [rad] that turn rotation matrices (..., 9) into others, axes of the frame."""
    matrices = np.broadcast_arrays(end, start)
    to, back = (m.reshape(-1, 3, 3) for m in matrices)
    turned = Rotation.from_matrix(to @ back.transpose(0, 2, 1)).as_rotvec()
    return np.asarray(turned.reshape(*matrices[0].shape[:-1], 3))


def _shape(view: View, unit: float) -> float:
    """Log-density of the sideways sine coefficients of a path about its chord."""
    length, d = view.length / unit, len(view.start)
    if length < SHORT:
        return 0.0
    along = view.way / view.length
    x = (view.samples - view.start) / unit
    progress = x @ along
    sideways = x - np.outer(progress, along)
    s = np.clip(progress / length, 0.0, 1.0)
    steps = np.diff(s, prepend=0.0)
    total = 0.0
    for j in range(1, N_SINES + 1):
        b = 2.0 * (sideways * (np.sin(np.pi * j * s) * steps)[:, None]).sum(axis=0)
        spread = np.hypot(BOW * length / j, WOBBLE)
        total += float(norm.logpdf(np.linalg.norm(b), scale=spread)) - (d - 2) * float(np.log(spread))
    return total
