"""A decomposition as labels and a primitive table: at every step the primitives of all entities at once (thesis 3.4).

Every group of changes (`changes.py`) begins a label.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.demonstration import Demonstration, EntityControl, Primitive
from policies.decomposition.changes import changes, together
from policies.decomposition.result import Decomposition, EntityDecomposition
from policies.decomposition.segmentation import ENTITIES
from policies.decomposition.task_spaces import TaskSpace, coordinates
from policies.sequence_graph import Segment, segments

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

COMMON = 3
"""What so many demonstrations have is common."""
APART = {"position": 0.08, "orientation": 0.5}
"""A label that ends farther than this [m], [rad] from its goal pauses on the way."""


class Row(NamedTuple):
    """What a label stands for.

    Labels of the same primitives that were begun by different entities differ: they wait for different things.
    """

    primitives: tuple[int, ...]
    """Of every entity."""
    begun: tuple[str, ...]
    """Which entities began their movement with the label."""


class Labels(NamedTuple):
    """What the learner of sequence graphs learns from."""

    labels: list[Integers]
    """Per demonstration (T,)."""
    primitives: tuple[Primitive, ...]
    """Every `Row` that occurs."""


def labelled(demonstrations: Sequence[Demonstration], found: Decomposition) -> Labels:
    """Labels of every step, and the primitive table that they stand for."""
    rows: dict[Row, int] = {}
    labels = []
    for m, (demonstration, own) in enumerate(zip(demonstrations, changes(demonstrations, found), strict=True)):
        result = np.empty(len(demonstration), dtype=np.int64)
        active = {entity: int(part.assignment[part.data.of(m)[0]]) for entity, part in found.entities.items()}
        since, begun = 0, tuple(found.entities)
        for group in together(own):
            if group[0].step == 0:
                active |= {change.entity: change.primitive for change in group}
                continue
            result[since : group[0].step] = rows.setdefault(Row(tuple(active.values()), begun), len(rows))
            since, begun = group[0].step, tuple(e for e in found.entities if e in {change.entity for change in group})
            active |= {change.entity: change.primitive for change in group}
        result[since:] = rows.setdefault(Row(tuple(active.values()), begun), len(rows))
        labels.append(result)
    labels = absorbed(labels, list(rows))
    used = sorted({int(label) for own in labels for label in own})
    labels = [np.searchsorted(used, own) for own in labels]
    chosen = [list(rows)[k] for k in used]
    alone = _ending_elsewhere(demonstrations, found, labels, chosen)
    return Labels(labels, tuple(_primitive(found, row, k, alone) for k, row in enumerate(chosen)))


def absorbed(labels: Sequence[Integers], rows: Sequence[Row]) -> list[Integers]:
    """Rare labels give way to common ones.

    Labels in a row that fewer than `COMMON` demonstrations have become those that another demonstration has between the same
    two labels, if at least `COMMON` have each of these, and the position goes to the same goals: the other entities were kept
    from what they do there.
    """
    parts = [segments(own) for own in labels]
    shown = Counter(k for own in labels for k in set(own.tolist()))
    between: dict[tuple[int, int, tuple[int, ...]], Counter[tuple[int, ...]]] = defaultdict(Counter)
    runs = [list(_runs(own, [shown[part.label] < COMMON for part in own])) for own in parts]
    lengths = {len(run) for rare in runs for run in rare}
    for own in parts:
        for n in lengths:
            for i in range(len(own) - n + 1):
                run = own[i : i + n]
                names = tuple(part.label for part in run[1:-1])
                if min(shown[k] for k in names) >= COMMON:
                    between[run[0].label, run[-1].label, _goals(names, rows)][names] += 1
    result = [own.copy() for own in labels]
    for m, rare in enumerate(runs):
        for rare_run in rare:
            goals = _goals([part.label for part in rare_run[1:-1]], rows)
            for names, _ in between[rare_run[0].label, rare_run[-1].label, goals].most_common(1):
                for part, k in zip(rare_run[1:-1], names, strict=True):
                    result[m][part.start : part.stop] = k
    return result


def agreeing(labels: Sequence[Integers]) -> list[int]:
    """Demonstrations to learn from: all, or those in which no label follows another as in no other demonstration, where these
    are at least `COMMON` and most."""
    steps = [set(pairwise(part.label for part in segments(own))) for own in labels]
    shown = Counter(step for own in steps for step in own)
    kept = [m for m, own in enumerate(steps) if all(shown[step] > 1 for step in own)]
    return kept if len(kept) >= max(COMMON, len(labels) // 2 + 1) else list(range(len(labels)))


def _runs(parts: Sequence[Segment], rare: Sequence[bool]) -> Iterator[Sequence[Segment]]:
    """Rare parts in a row, with the part before and the part after."""
    i = 1
    while i < len(parts) - 1:
        stop = i
        while stop < len(parts) - 1 and rare[stop]:
            stop += 1
        if stop > i and not (rare[i - 1] or rare[stop]):
            yield parts[i - 1 : stop + 1]
        i = stop + 1


def _goals(names: Sequence[int], rows: Sequence[Row]) -> tuple[int, ...]:
    return tuple(rows[k].primitives[0] for k in names)


def control(part: EntityDecomposition, k: int, number: int) -> EntityControl:
    """One primitive of an entity as a primitive table says it, under a number."""
    primitive = part.primitives[k]
    return EntityControl(number, primitive.space.frame, primitive.space.space, primitive.axes)


def _ending_elsewhere(
    demonstrations: Sequence[Demonstration], found: Decomposition, labels: Sequence[Integers], rows: Sequence[Row]
) -> set[tuple[int, str]]:
    """Labels and entities that do not end at the goal of their primitive: where they pause on the way is a goal of its own."""
    result = set()
    for e, (entity, part) in enumerate(found.entities.items()):
        spaces = {primitive.space for primitive in part.primitives} if entity in APART else set()
        seen = {space: [coordinates(d, entity, space)[0] for d in demonstrations] for space in spaces}
        for k, row in enumerate(rows):
            if entity in APART:
                goal, space = part.primitives[row.primitives[e]].goal, part.primitives[row.primitives[e]].space
                ends = [(m, s.stop) for m, own in enumerate(labels) for s in segments(own) if s.label == k]
                errors = [
                    _distance(seen[space][m][t], goal, space, part.primitives[row.primitives[e]].axes) for m, t in ends
                ]
                if np.median(errors) > APART[entity]:
                    result.add((k, entity))
    return result


def _distance(x: Array, goal: Array, space: TaskSpace, axes: Sequence[str]) -> float:
    """Distance from a goal along the axes that are controlled [m], [rad]."""
    if space.space == "rotation":
        return float(np.arccos(np.clip(0.5 * (x @ goal - 1.0), -1.0, 1.0)))
    if space.space == "cylindrical":
        turn = space.radius * np.arctan2(x[1], x[0]) - goal[1]
        turn -= 2.0 * np.pi * space.radius * np.round(turn / (2.0 * np.pi * space.radius))
        x = np.array([np.hypot(x[0], x[1]), goal[1] + turn, x[2]])
    return float(np.linalg.norm((x - goal) * (np.array(axes) == "position")))


def _primitive(found: Decomposition, row: Row, label: int, alone: set[tuple[int, str]]) -> Primitive:
    controls: dict[str, EntityControl | None] = dict.fromkeys(ENTITIES)
    names = {}
    for (entity, part), k in zip(found.entities.items(), row.primitives, strict=True):
        number = len(part.primitives) + label if (label, entity) in alone else k
        controls[entity], names[entity] = control(part, k, number), f"{entity} {k + 1}"
    position, orientation = controls["position"], controls["orientation"]
    assert position is not None
    assert orientation is not None
    kept = [name for entity, name in names.items() if entity not in row.begun]
    name = ", ".join(names[entity] for entity in row.begun) + (f" (keeping {', '.join(kept)})" if kept else "")
    return Primitive(name, position, orientation, controls["hand"])
