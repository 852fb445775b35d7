"""Segments of an entity: from one zero-velocity crossing or contact change to the next (thesis 3.2.1).

A segment begins with the onset of a motion; the rest that follows the motion belongs to it, for it shows where the motion
went. A contact that is made or lost while the entity rests begins a segment as well. The position is segmented together with
the force, the orientation and the hand each by itself.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from lfd_gym import quaternion
from lfd_gym.demonstration import Demonstration

Array = NDArray[np.float64]

ENTITIES = ("position", "orientation", "hand")
MOTION_WINDOW, FORCE_WINDOW = 0.2, 0.4
"""Lengths of the Hann filters of motions and of forces [s]."""
BEGIN = {"position": 0.03, "orientation": 0.30, "hand": 0.30}
"""Speed [m/s], [rad/s] above which a motion has begun."""
END_SHARE = 0.5
"""A motion has ended below this share of the speed at which one begins."""
SMALLEST = {"position": 0.008, "orientation": 0.15, "hand": 0.20}
"""A motion that leads nowhere farther than this [m], [rad] is a jolt, not a movement."""
TURNED = {"position": 0.10, "orientation": 0.15, "hand": 0.20}
"""What turns back leads farther than this [m], [rad]."""
WANDERED = 0.025
"""So far [m] a tool that presses wanders without going anywhere."""
SHORTEST_REST = 0.2
"""A slower moment shorter than this [s], after which the motion goes on in much the same direction, is no rest."""
CONTACT, CONTACT_LOST = 3.0, 1.5
"""Force [N] above which there is contact, and below which it is lost."""
PRESSED = 5.0
"""A contact whose force never comes to this [N] says nothing: force is chosen from here on (thesis 3.5)."""
SETTLING = 0.4
"""A contact change so short [s] after the onset of a motion is part of it; so short before, it is where the movement begins."""


def entities(demonstrations: Sequence[Demonstration]) -> tuple[str, ...]:
    """What there is to be decomposed: all of `ENTITIES`, without the hand where none is observed."""
    hand = demonstrations[0].observations.get("hand_position", np.empty((0, 0)))
    return ENTITIES if hand.shape[1] else ENTITIES[:2]


class Segment(NamedTuple):
    """A stretch of one demonstration in which an entity made one movement, or rested after a contact change."""

    demonstration: int
    start: int
    """First sample."""
    stop: int
    """First sample of the next segment, or the last sample of the demonstration: both ends belong to the movement."""
    rest: int
    """First sample after its last motion; its start if there is none."""

    @property
    def moves(self) -> bool:
        """Whether there is a motion in it."""
        return self.rest > self.start


class Signals(NamedTuple):
    """What an entity's segments are found in, of one demonstration."""

    values: Array
    """(T + 1, d) smoothed position [m], orientation (quaternion, not smoothed) or joint angles [rad]."""
    velocity: Array
    """(T + 1, d) [m/s] or [rad/s]; of an orientation (T + 1, 3), world axes."""
    speed: Array
    """(T + 1,) [m/s] or [rad/s]; of a hand that of the fastest joint."""
    force: Array
    """(T + 1, 3) smoothed force of the tool on the world, world frame [N]; zeros for orientation and hand."""


def segment(demonstrations: Sequence[Demonstration], entity: str) -> list[Segment]:
    """Segments of an entity in all demonstrations, in order; every sample of a demonstration lies in one."""
    found = []
    for m, demonstration in enumerate(demonstrations):
        observed = signals(demonstration, entity)
        moving = motions(observed, entity, float(demonstration.dt))
        cuts = _cuts(observed, moving, float(demonstration.dt))
        for start, stop in zip(cuts, [*cuts[1:], len(observed.speed) - 1], strict=True):
            ends = [end for onset, end in moving if start <= onset < stop]
            found.append(Segment(m, start, stop, min(max(ends, default=start), stop)))
    return found


def signals(demonstration: Demonstration, entity: str) -> Signals:
    """Smoothed signals of one entity; a hand or a wrench that was not observed is zero."""
    observations, dt = demonstration.observations, float(demonstration.dt)
    n = len(observations["tool_position"])
    force = np.zeros((n, 3))
    if entity == "orientation":
        values = np.array(observations["tool_quaternion"])
        turned = np.array([_rotation(a, b) for a, b in itertools.pairwise(values)])
        rates = smooth(np.vstack([turned, turned[-1:]]) / dt, MOTION_WINDOW / dt)
        return Signals(values, rates, np.linalg.norm(rates, axis=1), force)
    if entity == "position":
        values = smooth(observations["tool_position"], MOTION_WINDOW / dt)
        if "wrench" in observations:
            force = smooth(-observations["wrench"][:, :3], FORCE_WINDOW / dt)
        velocity = np.gradient(values, dt, axis=0)
        return Signals(values, velocity, np.linalg.norm(velocity, axis=1), force)
    values = smooth(observations.get("hand_position", np.zeros((n, 1))), MOTION_WINDOW / dt)
    velocity = np.gradient(values, dt, axis=0)
    return Signals(values, velocity, np.abs(velocity).max(axis=1), force)


def smooth(rows: Array, window: float) -> Array:
    """Rows (N, d) under a Hann filter of a length in samples; the first and the last row count beyond the ends."""
    n = 2 * max(round(window / 2.0), 1) + 1
    weights = np.hanning(n + 2)[1:-1]
    result: Array = convolve1d(np.asarray(rows, dtype=np.float64), weights / weights.sum(), axis=0, mode="nearest")
    return result


def motions(observed: Signals, entity: str, dt: float) -> list[tuple[int, int]]:
    """Motions (first, one past the last sample): speed hysteresis, cut where they turn back, without jolts and slow moments.

    A tool that presses wanders: what it moves meanwhile has to lead farther to be a motion. What springs back when a contact
    is lost belongs to the motion that follows without a rest.
    """
    parts: list[tuple[int, int]] = []
    touching, settling = contacts(observed), SETTLING / dt
    for start, stop in _above(observed.speed, BEGIN[entity], END_SHARE * BEGIN[entity]):
        if parts and (start - parts[-1][1]) * dt < SHORTEST_REST:
            before = parts[-1]
            springs = before[1] - before[0] <= settling and any(
                abs(lost - before[0]) <= settling for _, lost in touching
            )
            if springs or _goes_on(observed, before, (start, stop)):
                start = parts.pop()[0]
        parts.append((start, stop))
    turned = [part for whole in parts for part in _turned(observed, entity, whole, round(SHORTEST_REST / dt))]
    found = []
    for start, stop in turned:
        pressed = any(a - SHORTEST_REST / dt < stop <= b for a, b in touching)
        if _way(observed.values[start:stop], entity) >= (WANDERED if pressed else SMALLEST[entity]):
            found.append((start, stop))
    return found


def _turned(observed: Signals, entity: str, whole: tuple[int, int], lag: int) -> list[tuple[int, int]]:
    """A motion in parts, between the slowest samples where it turns back without a rest; what bounces does not turn back."""
    start, stop = whole
    v, speed = observed.velocity, observed.speed
    back = [
        t
        for t in range(start + lag, stop - lag)
        if v[t - lag] @ v[t + lag] < 0.0 and speed[t] == speed[t - lag : t + lag + 1].min()
    ]
    ways = {part: _way(observed.values[slice(*part)], entity) for part in itertools.pairwise([start, *back, stop])}
    bounces = [part for part, way in ways.items() if way < TURNED[entity]]
    return list(itertools.pairwise([start, *(t for t in back if not any(t in part for part in bounces)), stop]))


def _goes_on(observed: Signals, before: tuple[int, int], after: tuple[int, int]) -> bool:
    way, next_way = observed.velocity[slice(*before)].sum(axis=0), observed.velocity[slice(*after)].sum(axis=0)
    return bool(way @ next_way > 0.0)


def contacts(observed: Signals) -> list[tuple[int, int]]:
    """Stretches of contact (first, one past the last sample) in which something was pressed."""
    strength = np.linalg.norm(observed.force, axis=1)
    return [part for part in _above(strength, CONTACT, CONTACT_LOST) if strength[slice(*part)].max() >= PRESSED]


def interrupted(demonstrations: Sequence[Demonstration], entity: str, parts: Sequence[Segment]) -> NDArray[np.bool_]:
    """Per segment whether a contact was lost while the entity moved: something happened before it was at its goal."""
    result = np.zeros(len(parts), dtype=bool)
    for m, demonstration in enumerate(demonstrations):
        dt = float(demonstration.dt)
        settling = round(SETTLING / dt)
        lost = [stop for _, stop in contacts(signals(demonstration, "position"))]
        for i, part in enumerate(parts):
            if part.demonstration == m and part.moves:
                first = part.start + settling if entity == "position" else part.start
                result[i] = any(first <= at <= part.rest + settling for at in lost)
    return result


def _cuts(observed: Signals, moving: Sequence[tuple[int, int]], dt: float) -> list[int]:
    n = len(observed.speed)
    onsets, touching = [start for start, _ in moving], contacts(observed)
    settling = round(SETTLING / dt)
    in_rest = sorted(
        at
        for at in {at for part in touching for at in part if 0 < at < n - 1}
        if not any(start <= at < max(stop, start + settling) for start, stop in moving)
    )
    begun = {onset: _begun(onset, stop, in_rest, touching, settling) for onset, stop in moving}
    cuts = sorted({*in_rest, *(onset for onset in onsets if begun[onset] == onset)})
    if cuts and cuts[0] <= settling:
        cuts = cuts[1:]
    return [0, *(at for at in cuts if at < n - 1)]


def _begun(onset: int, end: int, changes: Sequence[int], touching: Sequence[tuple[int, int]], settling: int) -> int:
    """Where the motion from `onset` to `end` begins: at the last contact change before it, if that is just before or if it
    made a contact that lasts as long as the motion."""
    last = max((at for at in changes if at < onset), default=0)
    lasts = any(start == last and stop >= max(end - settling, onset + settling) for start, stop in touching)
    return last if last and (lasts or onset - last <= settling) else onset


def _above(values: Array, begin: float, end: float) -> list[tuple[int, int]]:
    """Stretches that begin above one value and end below another; each is widened to where it rose above the latter."""
    beyond = np.concatenate([[False], values > end, [False]])
    edges = np.flatnonzero(beyond[1:] != beyond[:-1])
    parts = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(start, stop) for start, stop in parts if values[start:stop].max() > begin]


def _way(values: Array, entity: str) -> float:
    """How far a motion leads from its start."""
    if entity == "orientation":
        return max(float(np.linalg.norm(_rotation(values[0], other))) for other in values)
    return float(np.linalg.norm(values - values[0], axis=1).max())


def _rotation(start: Array, end: Array) -> Array:
    """Rotation vector (3,) [rad] from one orientation to another, world axes."""
    return quaternion.to_rotation_vector(quaternion.multiply(end, quaternion.conjugate(start)))
