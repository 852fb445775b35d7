"""A decomposition as labels and a primitive table: at every step the primitives of all entities at once (thesis 3.4).

The entities of a movement seldom begin at the same instant. Changes that follow each other within `TOGETHER` are one change.
Three more rules say when a change is due:

- A contact that is made while another entity moves is that entity's doing: what begins with it begins with the next
  movement.
- A contact that is lost while another entity moves, so that the tool gives way, is an event to which the demonstrator reacts:
  what begins with it begins when that was noticed, together with all changes within `REACTION`.
- A movement stays what it was while it pauses.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.demonstration import Demonstration, EntityControl, Primitive
from policies.decomposition.result import Decomposition, EntityDecomposition
from policies.decomposition.segmentation import SETTLING, contacts, motions, signals

Integers = NDArray[np.int64]

TOGETHER = 0.45
"""[s]."""
REACTION = (0.25, 1.0)
"""A demonstrator has noticed an event after the first time, and what begins until the second belongs to the reaction [s]."""
ENTITIES = ("position", "orientation", "hand")


class Change(NamedTuple):
    """An entity begins another movement."""

    step: int
    """When it counts."""
    entity: str
    primitive: int
    since: int
    """When its segment begins."""
    reach: int
    """Until when other changes are part of it."""


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
    for m, demonstration in enumerate(demonstrations):
        own = np.empty(len(demonstration), dtype=np.int64)
        active = {entity: int(part.assignment[part.data.of(m)[0]]) for entity, part in found.entities.items()}
        since, begun = 0, tuple(found.entities)
        for group in _together(_changes(demonstration, m, found)):
            own[since : group[0].step] = rows.setdefault(Row(tuple(active.values()), begun), len(rows))
            since, begun = group[0].step, tuple(e for e in found.entities if e in {change.entity for change in group})
            active |= {change.entity: change.primitive for change in group}
        own[since:] = rows.setdefault(Row(tuple(active.values()), begun), len(rows))
        labels.append(own)
    return Labels(labels, tuple(_primitive(found, row) for row in rows))


def _changes(demonstration: Demonstration, m: int, found: Decomposition) -> list[Change]:
    """When the entities of a demonstration begin another primitive, in order."""
    dt = float(demonstration.dt)
    observed = {entity: signals(demonstration, entity) for entity in found.entities}
    moving = {entity: motions(values, entity, dt) for entity, values in observed.items()}
    touching = contacts(observed["position"])
    onsets = sorted(start for own in moving.values() for start, _ in own)
    result = []
    for entity, part in found.entities.items():
        own = part.data.of(m)
        others = [motion for other, parts in moving.items() if other != entity for motion in parts]
        for before, i in itertools.pairwise(own):
            if part.assignment[before] == part.assignment[i]:
                continue
            since = part.data.segments[i].start
            step, reach = since, since + round(TOGETHER / dt)
            if entity == "position":
                step, reach = _due(since, touching, others, onsets, dt)
            result.append(Change(step, entity, int(part.assignment[i]), since, reach))
    overtaken = {a for a in result for b in result if a.entity == b.entity and a.since < b.since and b.step <= a.step}
    return sorted(change for change in result if change not in overtaken and change.step < len(demonstration))


def _due(
    step: int,
    touching: Sequence[tuple[int, int]],
    others: Sequence[tuple[int, int]],
    onsets: Sequence[int],
    dt: float,
) -> tuple[int, int]:
    """When a change of the position is due that comes with a contact change and with the movement of another entity, and
    until when other changes are part of it."""
    near, settling = round(TOGETHER / dt), round(SETTLING / dt)
    made = any(abs(start - step) <= settling for start, _ in touching)
    lost = any(abs(stop - step) <= settling for _, stop in touching)
    during = [stop for start, stop in others if start <= step <= stop + near // 2]
    if made and during:
        step = next((onset for onset in onsets if onset > step), step)
    elif lost and any(start + near // 2 < step <= stop for start, stop in others):
        return step + round(REACTION[0] / dt), step + round(REACTION[1] / dt)
    return step, step + near


def _together(changes: Sequence[Change]) -> list[list[Change]]:
    """Changes grouped; the first of a group says when it happened."""
    groups: list[list[Change]] = []
    for change in changes:
        known = {other.entity for other in groups[-1]} if groups else set()
        if groups and change.entity not in known and change.step <= groups[-1][0].reach:
            groups[-1].append(change)
        else:
            groups.append([change])
    return groups


def _primitive(found: Decomposition, row: Row) -> Primitive:
    controls: dict[str, EntityControl | None] = dict.fromkeys(ENTITIES)
    names = {}
    for (entity, part), k in zip(found.entities.items(), row.primitives, strict=True):
        controls[entity], names[entity] = control(part, k), f"{entity} {k + 1}"
    position, orientation = controls["position"], controls["orientation"]
    assert position is not None
    assert orientation is not None
    kept = [name for entity, name in names.items() if entity not in row.begun]
    name = ", ".join(names[entity] for entity in row.begun) + (f" (keeping {', '.join(kept)})" if kept else "")
    return Primitive(name, position, orientation, controls["hand"])


def control(part: EntityDecomposition, k: int) -> EntityControl:
    """One primitive of an entity as a primitive table says it."""
    primitive = part.primitives[k]
    return EntityControl(k, primitive.space.frame, primitive.space.space, primitive.axes)
