"""How well a decomposition agrees with the teacher's own primitive table, which no method sees.

A step counts for an entity while the teacher controls it: where all of its axes are held, nothing is there to be found. The
teacher's table gives a number to every goal; where it controls other axes with the same goal ("over the box, at any height"
and "at the box"), that is another primitive, for it ends elsewhere. Both counts are kept.

Frames that the data cannot tell apart count as equal. Frame g is as good as the teacher's f for a row of the table if its
goal could as well have been constant in g: the mean goal, carried along by g instead of f, is off by no more than a human's
goals scatter, 1 cm or 3 degrees (root mean square over beginnings and ends of the visits, along the axes that the teacher
controls). What the hand carries is at its goal in the end, but not in the beginning: no movement is about it. A cylindrical
space is never equal to a Cartesian one: the paths differ. Axes of force are compared by where they point in the world.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from sklearn.metrics import adjusted_rand_score

from lfd_gym.demonstration import NO_LABEL, Demonstration, EntityControl
from policies.decomposition.result import Decomposition, EntityDecomposition, EntityPrimitive
from policies.decomposition.segmentation import segment

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

TOLERANCE = {"position": 0.01, "orientation": np.radians(3.0)}
"""What a human's goals scatter by [m], [rad]."""
SAME_AXIS = np.cos(np.radians(25.0))
"""|cosine| of the directions of two axes that count as the same."""
NOTHING = -1


class EntityScore(NamedTuple):
    """Of one entity."""

    frame: float
    """Share of the time in which the active primitive has the teacher's frame, or one as good; 1 for a hand."""
    space: float
    """The same, with the choice between Cartesian and cylindrical."""
    rand: float
    """Adjusted Rand index of the segments (of our segmentation, the same for all methods)."""
    found: int
    """Number of primitives."""
    planted: int
    """Of the teacher."""
    rand_goals: float
    """The index where only the teacher's goals count, whatever axes it controls."""
    planted_goals: int
    """Number of these goals."""


class Score(NamedTuple):
    """Of a decomposition."""

    entities: dict[str, EntityScore]
    forces: bool
    """Whether force was chosen in the primitives and along the axes of the teacher, and nowhere else: for each of the
    teacher's primitives of the position by the primitive that is active most of its time."""
    forces_time: float
    """Share of the time in which force acts along the teacher's axes, and along no other."""


def score(demonstrations: Sequence[Demonstration], found: Decomposition) -> Score:
    """Of demonstrations with the teacher's labels."""
    entities = {entity: _entity(demonstrations, entity, part) for entity, part in found.entities.items()}
    truth = [planted(demonstration, "position") for demonstration in demonstrations]
    part = found.entities["position"]
    active = [part.active(m, len(demonstration)) for m, demonstration in enumerate(demonstrations)]
    right: list[bool] = []
    time: list[bool] = []
    for k in sorted({int(k) for own in truth for k in own} - {NOTHING}):
        visits = [(m, int(at)) for m, own in enumerate(truth) for at in np.flatnonzero(own == k)]
        chosen = np.array([active[m][at] for m, at in visits])
        used = [part.primitives[j] for j in chosen]
        agree = [_forces_agree(demonstrations[m], at, own) for (m, at), own in zip(visits, used, strict=True)]
        time += agree
        right.append(bool(np.mean(np.array(agree)[chosen == np.argmax(np.bincount(chosen))]) > 0.5))
    return Score(entities, all(right), float(np.mean(time)))


def planted(demonstration: Demonstration, entity: str) -> Integers:
    """(T,) the entity's own primitive at every step: the first row of the table with its goal and axes; -1 where nothing is
    controlled."""
    controls: list[EntityControl | None] = [getattr(row, entity) for row in demonstration.primitives]
    table = []
    for control in controls:
        alike = [c is not None and control is not None and c[::3] == control[::3] for c in controls]
        held = control is None or all(axis == "hold" for axis in control.axes)
        table.append(NOTHING if held else alike.index(True))
    labels = demonstration.labels
    return np.where(labels == NO_LABEL, NOTHING, np.array(table)[labels])


def _entity(demonstrations: Sequence[Demonstration], entity: str, part: EntityDecomposition) -> EntityScore:
    truth = [planted(demonstration, entity) for demonstration in demonstrations]
    active = [part.active(m, len(demonstration)) for m, demonstration in enumerate(demonstrations)]
    frames, spaces = [1.0], [1.0]
    if entity != "hand":
        frames, spaces = [], []
        for row, control in _rows(demonstrations, entity).items():
            equal = _as_good(demonstrations, entity, row, control)
            for demonstration, chosen in zip(demonstrations, active, strict=True):
                used = [part.primitives[k].space for k in chosen[demonstration.labels == row]]
                frames += [float(space.frame in equal) for space in used]
                spaces += [float(space.frame in equal and space.space == control.space) for space in used]
    planted_, found_ = [], []
    for piece in segment(demonstrations, entity):
        at = slice(piece.start, piece.stop)
        own, chosen = truth[piece.demonstration][at], active[piece.demonstration][at]
        counted = own[own != NOTHING]
        if 2 * len(counted) > len(own):
            planted_.append(int(np.argmax(np.bincount(counted))))
            found_.append(int(np.argmax(np.bincount(chosen))))
    rows = _rows(demonstrations, entity)
    goals = [getattr(demonstrations[0].primitives[k], entity).primitive for k in planted_]
    return EntityScore(
        float(np.mean(frames)),
        float(np.mean(spaces)),
        float(adjusted_rand_score(planted_, found_)),
        len(part.primitives),
        len({(control.primitive, control.axes) for control in rows.values()}),
        float(adjusted_rand_score(goals, found_)),
        len({control.primitive for control in rows.values()}),
    )


def _rows(demonstrations: Sequence[Demonstration], entity: str) -> dict[int, EntityControl]:
    """Rows of the primitive table that occur and control the entity."""
    occur = sorted({int(k) for demonstration in demonstrations for k in demonstration.labels} - {NO_LABEL})
    controls = {row: getattr(demonstrations[0].primitives[row], entity) for row in occur}
    return {row: own for row, own in controls.items() if own and any(axis != "hold" for axis in own.axes)}


def _as_good(demonstrations: Sequence[Demonstration], entity: str, row: int, control: EntityControl) -> set[str]:
    """Frames in which the goal of a row of the primitive table could as well be constant."""
    places: list[tuple[Demonstration, int]] = []
    ends: list[tuple[Demonstration, int]] = []
    for demonstration in demonstrations:
        during = np.concatenate([[False], demonstration.labels == row, [False]])
        edges = np.flatnonzero(during[1:] != during[:-1])
        places += [(demonstration, int(at)) for at in edges]
        ends += [(demonstration, int(at)) for at in edges[1::2]]
    controlled = np.array([axis != "hold" for axis in control.axes])
    names = ["world", *(n.removeprefix("frame_") for n in places[0][0].observations if n.startswith("frame_"))]
    goal = _goal(ends, control.frame, entity)
    own = [_pose(demonstration, control.frame, at) for demonstration, at in places]
    equal = {control.frame}
    for name in names:
        others = [_pose(demonstration, name, at) for demonstration, at in places]
        if _off(goal, own, others, controlled) <= TOLERANCE[entity]:
            equal.add(name)
    return equal


def _goal(ends: Sequence[tuple[Demonstration, int]], frame: str, entity: str) -> Rotation | Array:
    """Where movements end in a frame, in the mean."""
    poses = [_pose(demonstration, frame, at) for demonstration, at in ends]
    if entity == "orientation":
        tools = [Rotation.from_quat(d.observations["tool_quaternion"][at], scalar_first=True) for d, at in ends]
        return Rotation.concatenate([r.inv() * tool for (r, _), tool in zip(poses, tools, strict=True)]).mean()
    seen = [d.observations["tool_position"][at] for d, at in ends]
    return np.mean([r.inv().apply(end - p) for (r, p), end in zip(poses, seen, strict=True)], axis=0)


def _off(
    goal: Rotation | Array,
    own: Sequence[tuple[Rotation, Array]],
    others: Sequence[tuple[Rotation, Array]],
    controlled: NDArray[np.bool_],
) -> float:
    """Root mean square of how far a goal that is constant in the teacher's frame is from being constant in another."""
    if isinstance(goal, Rotation):
        seen = Rotation.concatenate([r.inv() * own_r * goal for (r, _), (own_r, _) in zip(others, own, strict=True)])
        return float(np.sqrt(np.mean((seen * seen.mean().inv()).magnitude() ** 2)))
    wanted = [r.apply(goal) + p for r, p in own]
    there = np.mean([r.inv().apply(x - p) for (r, p), x in zip(others, wanted, strict=True)], axis=0)
    off = [
        own_r.inv().apply(r.apply(there) + p - x)[controlled]
        for (r, p), (own_r, _), x in zip(others, own, wanted, strict=True)
    ]
    return float(np.sqrt(np.mean(np.sum(np.square(off), axis=1))))


def _pose(demonstration: Demonstration, frame: str, at: int) -> tuple[Rotation, Array]:
    if frame == "world":
        return Rotation.identity(), np.zeros(3)
    pose = demonstration.observations[f"frame_{frame}"][at]
    return Rotation.from_quat(pose[3:], scalar_first=True), pose[:3]


def _control(demonstration: Demonstration, entity: str, at: int) -> EntityControl:
    control: EntityControl = getattr(demonstration.primitives[demonstration.labels[at]], entity)
    return control


def _forces_agree(demonstration: Demonstration, at: int, primitive: EntityPrimitive) -> bool:
    """Whether a primitive presses along the axes along which the teacher presses at a step, and along no other."""
    control = _control(demonstration, "position", at)
    meant = _pressed_axes(demonstration, at, control.frame, control.space, control.axes)
    chosen = _pressed_axes(demonstration, at, primitive.space.frame, primitive.space.space, primitive.axes)
    same = np.abs(meant @ chosen.T) > SAME_AXIS
    return bool(same.any(axis=0).all() and same.any(axis=1).all())


def _pressed_axes(demonstration: Demonstration, at: int, frame: str, space: str, axes: Sequence[str]) -> Array:
    """(n, 3) world directions of the axes with force."""
    rotation, origin = _pose(demonstration, frame, at)
    directions = np.eye(3)
    if space == "cylindrical":
        x, y, _ = rotation.inv().apply(demonstration.observations["tool_position"][at] - origin)
        c, s = np.array([x, y]) / max(float(np.hypot(x, y)), 1e-9)
        directions = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    forced = [i for i, axis in enumerate(axes) if axis == "force"]
    return np.asarray(rotation.apply(directions[forced])) if forced else np.empty((0, 3))
