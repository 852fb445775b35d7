"""When the entities of a demonstration begin other movements, and which changes do not show (thesis 3.4).

A segment that belongs to another primitive than the one before is a change. Three rules:

- A contact that is made while another entity moves is that entity's doing: what begins with it begins with the next
  movement.
- A contact that is lost while another entity moves, so that the tool gives way, is an event to which the demonstrator reacts:
  what begins with it begins when that was noticed.
- An entity that is already where it is going does not move. Where all demonstrations are alike but for that, the change is
  added: with the same step of the position, an orientation takes the primitive whose goal it fits in most of them, other than
  by carrying its frame along.
"""

import itertools
from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.demonstration import Demonstration
from policies.decomposition.observed import UNIT, carried_along
from policies.decomposition.result import Decomposition, EntityDecomposition
from policies.decomposition.segmentation import SETTLING, contacts, motions, signals
from policies.decomposition.task_spaces import TaskSpace, coordinates

Array = NDArray[np.float64]

TOGETHER = 0.45
"""Changes within this time [s] are one."""
NOTICED = 0.25
"""A demonstrator has noticed an event after this time [s]."""
YIELDED = 0.03
"""What gives way leads the tool farther away than this [m]."""
CAUSE = 0.15
"""What makes a contact began to move at least this time [s] before."""
AHEAD = 0.05
"""What gives way because another entity moves does so at least this time [s] after that began."""
FITS = 0.15
"""An orientation so near to a goal [rad] is at it."""


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
    event: bool = False
    """Whether it is a reaction to what happened."""


class Visit(NamedTuple):
    """One time that the position went to a goal."""

    demonstration: int
    start: int
    stop: int
    """When the position or the orientation begins something else."""
    orientation: int
    """Primitive of the orientation meanwhile."""


def changes(demonstrations: Sequence[Demonstration], found: Decomposition) -> list[list[Change]]:
    """Per demonstration its changes in order."""
    shown = [_shown(demonstration, m, found) for m, demonstration in enumerate(demonstrations)]
    if "orientation" not in found.entities or len(demonstrations) < 2:
        return shown
    return [sorted([*own, *hidden]) for own, hidden in zip(shown, _hidden(demonstrations, found, shown), strict=True)]


def _shown(demonstration: Demonstration, m: int, found: Decomposition) -> list[Change]:
    dt = float(demonstration.dt)
    observed = {entity: signals(demonstration, entity) for entity in found.entities}
    moving = {entity: motions(values, entity, dt) for entity, values in observed.items()}
    touching = contacts(observed["position"])
    onsets = sorted(start for own in moving.values() for start, _ in own)
    result = []
    for entity, part in found.entities.items():
        others = [motion for other, parts in moving.items() if other != entity for motion in parts]
        for before, i in itertools.pairwise(part.data.of(m)):
            if part.assignment[before] != part.assignment[i]:
                segment = part.data.segments[i]
                change = Change(
                    segment.start,
                    entity,
                    int(part.assignment[i]),
                    segment.start,
                    max(segment.start + round(TOGETHER / dt), segment.rest),
                )
                pressed = "force" in part.primitives[part.assignment[before]].axes
                away = pressed and part.data.views[i][0].length > YIELDED
                starts = [start for start, _ in moving[entity]]
                due = _due(change, away, starts, touching, others, onsets, dt) if entity == "position" else change
                result.append(due)
    overtaken = {a for a in result for b in result if a.entity == b.entity and a.since < b.since and b.step <= a.step}
    return sorted(change for change in result if change not in overtaken and change.step < len(demonstration))


def _due(
    change: Change,
    away: bool,
    own: Sequence[int],
    touching: Sequence[tuple[int, int]],
    others: Sequence[tuple[int, int]],
    onsets: Sequence[int],
    dt: float,
) -> Change:
    """A change of the position that comes with a contact change and with the movement of another one.

    away: it leads away from what was pressed; own: onsets of the position; onsets: of all entities; others: motions of the
    other entities.
    """
    step, near, settling = change.step, round(TOGETHER / dt), round(SETTLING / dt)
    made = any(abs(start - step) <= settling for start, _ in touching)
    lost = min((stop for _, stop in touching if step - settling <= stop <= change.reach), default=None)
    ahead = round(CAUSE / dt)
    if made and any(start + ahead <= step <= stop + near // 2 for start, stop in others):
        due = next((onset for onset in onsets if onset > step), step)
        if due in own:
            due = max(stop for start, stop in others if start + ahead <= step <= stop + near // 2)
        return change._replace(step=due, reach=due + near)
    if lost is not None and away and any(start + round(AHEAD / dt) <= step <= stop for start, stop in others):
        return change._replace(step=max(step, lost) + round(NOTICED / dt), event=True)
    return change


def together(own: Sequence[Change]) -> list[list[Change]]:
    """Changes of one demonstration in groups: what begins while another entity is on its way begins with it. An event begins a
    group. The first of a group says when it happened, the last of an entity what that does."""
    groups: list[list[Change]] = []
    for change in own:
        within = bool(groups) and not change.event and change.step <= max(other.reach for other in groups[-1])
        if within or (groups and change.step == groups[-1][0].step):
            groups[-1].append(change)
        else:
            groups.append([change])
    return groups


def _hidden(
    demonstrations: Sequence[Demonstration], found: Decomposition, shown: Sequence[Sequence[Change]]
) -> list[list[Change]]:
    """Changes of the orientation that do not show."""
    part = found.entities["orientation"]
    errors = [_errors(demonstration, part) for demonstration in demonstrations]
    places = [_places(demonstration, part) for demonstration in demonstrations]
    visits: dict[tuple[int, int], list[Visit]] = defaultdict(list)
    for m, own in enumerate(shown):
        for between, visit in _visits(own, m, found, len(demonstrations[m])):
            visits[between].append(visit)
    wanted: list[dict[int, int]] = [{} for _ in demonstrations]
    for alike in visits.values():
        fits = np.array(
            [(errors[v.demonstration][v.stop] < FITS) & ~_carried(places[v.demonstration], part, v) for v in alike]
        )
        used = np.bincount([v.orientation for v in alike], minlength=fits.shape[1])
        best = int(np.lexsort((used, fits.sum(axis=0) * (used > 0)))[-1])
        for v, fit in zip(alike, fits, strict=True):
            wanted[v.demonstration][v.start] = best if fit[best] else v.orientation
    result: list[list[Change]] = []
    for m, own in enumerate(shown):
        active = int(part.assignment[part.data.of(m)[0]])
        active = wanted[m].get(0, active)
        added = [Change(0, "orientation", active, 0, 0)]
        for group in together(own):
            step = group[0].step
            active = next((c.primitive for c in reversed(group) if c.entity == "orientation"), active)
            if wanted[m].get(step, active) != active:
                active = wanted[m][step]
                added.append(Change(step, "orientation", active, len(demonstrations[m]), step, event=True))
        result.append(added)
    return result


def _visits(
    own: Sequence[Change], m: int, found: Decomposition, n_steps: int
) -> Iterator[tuple[tuple[int, int], Visit]]:
    """Visits of one demonstration, by the primitives of the position before and during each."""
    active = {entity: int(part.assignment[part.data.of(m)[0]]) for entity, part in found.entities.items()}
    groups = [group for group in together(own) if {c.entity for c in group} & {"position", "orientation"}]
    steps = [0, *(group[0].step for group in groups), n_steps]
    before = -1
    for group, start, stop in zip([[], *groups], steps[:-1], steps[1:], strict=True):
        active |= {change.entity: change.primitive for change in group}
        if active["position"] != before:
            yield (before, active["position"]), Visit(m, start, stop, active["orientation"])
            before = active["position"]


def _carried(places: Array, part: EntityDecomposition, visit: Visit) -> NDArray[np.bool_]:
    """(K,) whether the frame of a primitive of the orientation is carried on a visit: what is held always fits."""
    ways = np.linalg.norm(places[:, visit.stop] - places[:, visit.start], axis=1)
    carried = carried_along(ways / UNIT["position"])
    return carried[[part.data.spaces.index(primitive.space) for primitive in part.primitives]]


def _places(demonstration: Demonstration, part: EntityDecomposition) -> Array:
    """(F, T + 1, 3) the tool in the frame of every task space of the orientation [m]."""
    spaces = [TaskSpace(space.frame, "cartesian") for space in part.data.spaces]
    return np.stack([coordinates(demonstration, "position", space)[0] for space in spaces])


def _errors(demonstration: Demonstration, part: EntityDecomposition) -> Array:
    """(T + 1, K) angle [rad] from the goal of every primitive of the orientation."""
    columns = []
    for primitive in part.primitives:
        x, _ = coordinates(demonstration, "orientation", primitive.space)
        columns.append(np.arccos(np.clip(0.5 * (x @ primitive.goal - 1.0), -1.0, 1.0)))
    return np.stack(columns, axis=1)
