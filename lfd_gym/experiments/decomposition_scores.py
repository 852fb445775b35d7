"""How well a decomposition agrees with the teacher's own primitive table, which no method sees.

A step counts for an entity while the teacher controls it: where all of its axes are held, nothing is there to be found. The
teacher's table gives a number to every goal; where it controls other axes with the same goal ("over the box, at any height"
and "at the box"), that is another primitive, for it ends elsewhere. Both counts are kept.

Frames that the data cannot tell apart count as equal. Frame g is as good as the teacher's f for a row of the table if its
goal could as well have been constant in g: the mean goal, carried along by g instead of f, is off by no more than a human's
goals scatter, 1 cm or 3 degrees (root mean square over the visits, along the axes that the teacher controls). A cylindrical
space is never equal to a Cartesian one: the paths differ.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from sklearn.metrics import adjusted_rand_score

from lfd_gym.demonstration import NO_LABEL, Demonstration, EntityControl
from policies.decomposition.result import Decomposition, EntityDecomposition
from policies.decomposition.segmentation import segment

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

TOLERANCE = {"position": 0.01, "orientation": np.radians(3.0)}
"""What a human's goals scatter by [m], [rad]."""
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
    """Share of the time in which the axes with force are the teacher's."""


def score(demonstrations: Sequence[Demonstration], found: Decomposition) -> Score:
    """Of demonstrations with the teacher's labels."""
    entities = {entity: _entity(demonstrations, entity, part) for entity, part in found.entities.items()}
    truth = [planted(demonstration, "position") for demonstration in demonstrations]
    right: list[bool] = []
    time: list[bool] = []
    axes = found.entities["position"]
    for k in sorted({int(k) for own in truth for k in own} - {NOTHING}):
        active: list[Integers] = []
        wanted: list[tuple[int, ...]] = []
        for m, (demonstration, own) in enumerate(zip(demonstrations, truth, strict=True)):
            steps = np.flatnonzero(own == k)
            active.append(axes.active(m, len(demonstration))[steps])
            wanted += [_forced(_control(demonstration, "position", int(at)).axes) for at in steps]
        chosen = [_forced(axes.primitives[j].axes) for j in np.concatenate(active)]
        time += [a == b for a, b in zip(chosen, wanted, strict=True)]
        most = int(np.argmax(np.bincount(np.concatenate(active))))
        right.append(_forced(axes.primitives[most].axes) == max(set(wanted), key=wanted.count))
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
    places = [
        (demonstration, int(at))
        for demonstration in demonstrations
        for at in np.flatnonzero((demonstration.labels == row) & np.append(demonstration.labels[1:] != row, True))
    ]
    controlled = np.array([axis != "hold" for axis in control.axes])
    names = ["world", *(n.removeprefix("frame_") for n in places[0][0].observations if n.startswith("frame_"))]
    own = [_pose(demonstration, control.frame, at) for demonstration, at in places]
    equal = {control.frame}
    for name in names:
        others = [_pose(demonstration, name, at) for demonstration, at in places]
        if _off(places, own, others, entity, controlled) <= TOLERANCE[entity]:
            equal.add(name)
    return equal


def _off(
    places: Sequence[tuple[Demonstration, int]],
    own: Sequence[tuple[Rotation, Array]],
    others: Sequence[tuple[Rotation, Array]],
    entity: str,
    controlled: NDArray[np.bool_],
) -> float:
    """Root mean square of how far the mean goal, constant in the teacher's frame, is from being constant in another."""
    if entity == "orientation":
        tools = [Rotation.from_quat(d.observations["tool_quaternion"][at], scalar_first=True) for d, at in places]
        goal = Rotation.concatenate([r.inv() * tool for (r, _), tool in zip(own, tools, strict=True)]).mean()
        seen = Rotation.concatenate([r.inv() * own_r * goal for (r, _), (own_r, _) in zip(others, own, strict=True)])
        return float(np.sqrt(np.mean((seen * seen.mean().inv()).magnitude() ** 2)))
    ends = [d.observations["tool_position"][at] for d, at in places]
    goal = np.mean([r.inv().apply(end - p) for (r, p), end in zip(own, ends, strict=True)], axis=0)
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


def _forced(axes: Sequence[str]) -> tuple[int, ...]:
    return tuple(i for i, axis in enumerate(axes) if axis == "force")
