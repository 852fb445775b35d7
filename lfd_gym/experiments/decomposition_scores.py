"""What was found without labels, against the teacher's own primitive table, which no learner sees (thesis 3.5).

The truth of a step is the entity's row of the table that was active, its control. An entity that holds in every axis has no
goal that could be seen: such steps belong to the control before them, and those before the first movement are not judged. Rows
that share a primitive but control other axes of it (over a box at any height, and down to it) are one primitive to the teacher
and two movements to whoever sees them, so both counts and both indices are given. What is judged:

    frame     share of time in which the frame is right; frames that the data cannot tell apart count as equal, `equal_frames`
    rand      adjusted Rand index of the segments of 3.2.1, each labelled by what was active for most of it
    found     number of primitives, beside the teacher's
    force     share of pressing time with force along the right axis, and share of the other time with force along any
"""

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from sklearn.metrics import adjusted_rand_score

from lfd_gym.demonstration import NO_LABEL, Demonstration, EntityControl
from policies.decomposition.result import Decomposition, EntityDecomposition
from policies.decomposition.segmentation import segment
from policies.decomposition.task_spaces import TaskSpace

Array = NDArray[np.float64]

UNKNOWN = -1
"""Steps that are not judged."""
SAME_PLACE, SAME_TURN = 0.01, np.radians(3.0)
"""A goal that varies less than the goals of a human do [m], [rad] is where it was."""
SAME_AXIS = np.cos(np.radians(25.0))
"""|cosine| of two axes that count as the same."""


class EntityScore(NamedTuple):
    """Of one entity."""

    frame: float
    """Share of judged time in a frame that is right."""
    rand: float
    """Adjusted Rand index of the segments, against the teacher's primitives."""
    rand_controls: float
    """The same against its controls."""
    found: int
    """Number of primitives that are ever active."""
    taught: int
    """The teacher's number of primitives."""
    taught_controls: int
    """Its number of controls."""


class ForceScore(NamedTuple):
    """Of the position."""

    pressed: float
    """Share of the time in which the teacher presses with force along the same axis; NaN if it never does."""
    elsewhere: float
    """Share of the time in which it does not with force along any axis."""


class Passage(NamedTuple):
    """One performance of an entity's control."""

    demonstration: int
    control: int
    start: int
    stop: int
    """One past the last step in which it was not held."""


def entity_scores(demonstrations: Sequence[Demonstration], found: Decomposition) -> dict[str, EntityScore]:
    """Per entity that was decomposed."""
    return {entity: _entity_score(demonstrations, entity, part) for entity, part in found.entities.items()}


def force_score(demonstrations: Sequence[Demonstration], found: EntityDecomposition) -> ForceScore:
    """Whether force was chosen where the teacher pressed, and nowhere else; steps that hold are not judged."""
    right, pressing, wrong, other = 0, 0, 0, 0
    for m, demonstration in enumerate(demonstrations):
        active = found.active(m, len(demonstration))
        for t, label in enumerate(demonstration.labels):
            if label == NO_LABEL or _holds(demonstration.primitives[label].position):
                continue
            row, primitive = demonstration.primitives[label].position, found.primitives[active[t]]
            meant = _force_axes(demonstration, t, TaskSpace(row.frame, row.space), row.axes)
            chosen = _force_axes(demonstration, t, primitive.space, primitive.axes)
            if len(meant):
                pressing += 1
                along = np.abs(meant @ chosen.T) > SAME_AXIS
                right += bool(along.any(axis=1).all() and along.any(axis=0).all() and along.size)
            else:
                other += 1
                wrong += len(chosen) > 0
    return ForceScore(right / pressing if pressing else np.nan, wrong / max(other, 1))


def controls(demonstration: Demonstration, entity: str) -> list[EntityControl]:
    """The distinct rows of the table for one entity, without those that hold in every axis."""
    rows: list[EntityControl | None] = [getattr(primitive, entity) for primitive in demonstration.primitives]
    return list(dict.fromkeys(row for row in rows if row is not None and not _holds(row)))


def taught(demonstration: Demonstration, entity: str) -> NDArray[np.int64]:
    """(T,) index into `controls` at every step, `UNKNOWN` before the first movement."""
    rows = controls(demonstration, entity)
    result = np.full(len(demonstration), UNKNOWN)
    now = UNKNOWN
    for t, label in enumerate(demonstration.labels):
        row = None if label == NO_LABEL else getattr(demonstration.primitives[label], entity)
        now = rows.index(row) if row in rows else now
        result[t] = now
    return result


def equal_frames(demonstrations: Sequence[Demonstration], entity: str) -> list[set[str]]:
    """Per control of the teacher the frames that are right: its own, and those that the data cannot tell from it.

    The mean of where its performances end, in its own frame, is fixed to another frame. If it then stays within the scatter
    of a human's goals (root mean square over beginnings and ends of all performances, along the axes that are controlled), the
    other frame says the same. An object that is carried does not: it is elsewhere at the beginning.
    """
    tracked = [name.removeprefix("frame_") for name in demonstrations[0].observations if name.startswith("frame_")]
    passages = [p for m, demonstration in enumerate(demonstrations) for p in _passages(demonstration, entity, m)]
    result = []
    for k, row in enumerate(controls(demonstrations[0], entity)):
        own = [p for p in passages if p.control == k]
        others = [frame for frame in ("world", *tracked) if frame != row.frame]
        result.append({row.frame} | {f for f in others if own and _same(demonstrations, own, row, f, entity)})
    return result


def _entity_score(demonstrations: Sequence[Demonstration], entity: str, found: EntityDecomposition) -> EntityScore:
    truth = [taught(demonstration, entity) for demonstration in demonstrations]
    active = [found.active(m, len(demonstration)) for m, demonstration in enumerate(demonstrations)]
    frames = equal_frames(demonstrations, entity)
    right = [
        found.primitives[g].space.frame in frames[k]
        for own, guess in zip(truth, active, strict=True)
        for k, g in zip(own, guess, strict=True)
        if k != UNKNOWN
    ]
    labels = []
    for part in segment(demonstrations, entity):
        at = slice(part.start, part.stop)
        own = truth[part.demonstration][at]
        if (own != UNKNOWN).any():
            labels.append((_most(own[own != UNKNOWN]), _most(active[part.demonstration][at])))
    primitives = np.array([row.primitive for row in controls(demonstrations[0], entity)])
    meant, guessed = np.array(labels).T
    shown = sorted(set(np.concatenate(truth).tolist()) - {UNKNOWN})
    return EntityScore(
        float(np.mean(right)),
        float(adjusted_rand_score(primitives[meant], guessed)),
        float(adjusted_rand_score(meant, guessed)),
        len(np.unique(np.concatenate(active))),
        len(np.unique(primitives[shown])),
        len(shown),
    )


def _holds(row: EntityControl | None) -> bool:
    return row is None or all(axis == "hold" for axis in row.axes)


def _most(labels: NDArray[np.int64]) -> int:
    values, counts = np.unique(labels, return_counts=True)
    return int(values[np.argmax(counts)])


def _passages(demonstration: Demonstration, entity: str, m: int) -> Iterator[Passage]:
    own = taught(demonstration, entity)
    edges = np.flatnonzero(np.diff(own, prepend=UNKNOWN - 1, append=UNKNOWN - 1))
    held = np.array(
        [
            label == NO_LABEL or _holds(getattr(demonstration.primitives[label], entity))
            for label in demonstration.labels
        ]
    )
    for start, stop in itertools.pairwise(edges):
        if own[start] != UNKNOWN:
            yield Passage(m, int(own[start]), int(start), int(start + np.flatnonzero(~held[start:stop])[-1] + 1))


def _same(
    demonstrations: Sequence[Demonstration], passages: Sequence[Passage], row: EntityControl, frame: str, entity: str
) -> bool:
    """Whether a goal that is fixed to another frame stays where it is in its own."""
    if entity == "hand":
        return True
    own, other, ends = [], [], []
    for p in passages:
        for t in (p.start, p.stop):
            own.append(_pose(demonstrations[p.demonstration], row.frame, t))
            other.append(_pose(demonstrations[p.demonstration], frame, t))
        ends.append((p.demonstration, p.stop))
    if entity == "orientation":
        seen = [_pose(demonstrations[m], row.frame, t)[1].inv() * _tool(demonstrations[m], t)[1] for m, t in ends]
        goal = Rotation.concatenate(seen).mean()
        fixed = Rotation.concatenate([b.inv() * a * goal for (_, a), (_, b) in zip(own, other, strict=True)]).mean()
        off = [(a.inv() * b * fixed * goal.inv()).as_rotvec() for (_, a), (_, b) in zip(own, other, strict=True)]
        return bool(np.sqrt(np.mean(np.sum(np.square(off), axis=1))) < SAME_TURN)
    points = [_into(_pose(demonstrations[m], row.frame, t), _tool(demonstrations[m], t)[0]) for m, t in ends]
    mean = np.mean(points, axis=0)
    fixed_point = np.mean([_into(b, _out(a, mean)) for a, b in zip(own, other, strict=True)], axis=0)
    away = np.array([_into(a, _out(b, fixed_point)) - mean for a, b in zip(own, other, strict=True)])
    controlled = np.array([axis != "hold" for axis in row.axes]) | (row.space != "cartesian")
    return bool(np.sqrt(np.mean(away**2, axis=0))[controlled].max() < SAME_PLACE)


def _pose(demonstration: Demonstration, frame: str, t: int) -> tuple[Array, Rotation]:
    if frame == "world":
        return np.zeros(3), Rotation.identity()
    row = demonstration.observations[f"frame_{frame}"][t]
    return row[:3], Rotation.from_quat(row[3:], scalar_first=True)


def _tool(demonstration: Demonstration, t: int) -> tuple[Array, Rotation]:
    seen = demonstration.observations
    return seen["tool_position"][t], Rotation.from_quat(seen["tool_quaternion"][t], scalar_first=True)


def _into(pose: tuple[Array, Rotation], point: Array) -> Array:
    return np.asarray(pose[1].inv().apply(point - pose[0]))


def _out(pose: tuple[Array, Rotation], point: Array) -> Array:
    return np.asarray(pose[1].apply(point) + pose[0])


def _force_axes(demonstration: Demonstration, t: int, space: TaskSpace, axes: Sequence[str]) -> Array:
    """(n, 3) world directions of the axes that are controlled by force."""
    forced = [i for i, axis in enumerate(axes) if axis == "force"]
    if not forced:
        return np.empty((0, 3))
    pose = _pose(demonstration, space.frame, t)
    directions = np.eye(3)
    if space.space == "cylindrical":
        x, y, _ = _into(pose, demonstration.observations["tool_position"][t])
        radial = np.array([x, y, 0.0]) / max(np.hypot(x, y), 1e-9)
        directions = np.array([radial, np.cross([0.0, 0.0, 1.0], radial), [0.0, 0.0, 1.0]])
    return np.asarray(pose[1].apply(directions[forced]))
