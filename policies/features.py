"""Features: goal distances (thesis 2.16, 2.17), one per primitive or one per entity, and named observations (2.5.3)."""

from collections.abc import Callable, Hashable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.goal_distance import goal_distance_width
from policies.passages import BROKEN_OFF, END, TOLERANCE, PassageData
from policies.task_data import CONTROLLED, ENTITIES, N_COORDINATES
from policies.task_space import AXES

Array = NDArray[np.float64]

KINDS = ("entity", "primitive")
"""One goal distance per entity and per side of a force axis; or the thesis's one of all dimensions."""


class Feature(NamedTuple):
    """A goal distance (2.17), f = 1 - exp(-1/2 sum_i (gain_i (x_i - g_i))^2), or a named observation."""

    name: str
    """What it is the distance of: an entity, or a force axis and its side; or the observation's name."""
    primitive: int
    """Whose goal; -1 for an observation."""
    gain: Array
    """(N_COORDINATES,) 1 / sigma_i, 0 where a coordinate does not count."""
    side: float
    """0, or the sign of the only deviations that count."""
    column: int = -1
    """Which of the named observations; -1 for a goal distance."""


def observed_features(data: PassageData) -> list[Feature]:
    """One feature per component of the named observations."""
    none = np.zeros(N_COORDINATES)
    return [Feature(data.named.name(c), -1, none, 0.0, c) for c in range(len(data.named.keys))]


def whole_way_features(data: PassageData, k: int) -> list[Feature]:
    """Goal distances of primitive k, one per entity, that grade all that was demonstrated: sigma is half the largest."""
    result = []
    for entity in data.controlled(k):
        largest = max(data.distance(k, entity, deviations).max() for deviations in data.everywhere(k))
        gain = np.zeros(N_COORDINATES)
        controlled = data.primitives.table.modes[k, ENTITIES[entity]] == CONTROLLED
        gain[ENTITIES[entity]] = controlled / max(0.5 * largest, TOLERANCE[entity])
        result.append(Feature(f"{entity}, whole way", k, gain, 0.0))
    return result


def goal_distance_features(data: PassageData, k: int, kind: str) -> list[Feature]:
    """Features of primitive k. Along a force axis the world may yield or contact be missing: two different events."""
    modes, total, result = data.primitives.table.modes[k], np.zeros(N_COORDINATES), []
    axes = AXES[data.primitives.table.space[k]]
    for entity in data.controlled(k):
        width = _width(data, k, partial(data.distance, k, entity), TOLERANCE[entity], kind)
        gain = np.zeros(N_COORDINATES)
        gain[ENTITIES[entity]] = (modes[ENTITIES[entity]] == CONTROLLED) / width
        result.append(Feature(entity, k, gain, 0.0))
        total += gain
    for i in data.forced(k):
        direction = float(np.sign(data.primitives.force[k, i])) or 1.0
        for name, side in (("contact missing", -direction), ("world yielded", direction)):
            width = _width(data, k, partial(_beyond, i, side), TOLERANCE["position"], kind)
            gain = np.zeros(N_COORDINATES)
            gain[i] = 1.0 / width
            result.append(Feature(f"{name} along {axes[i]}", k, gain, side))
        total = total + gain
    return [Feature("all", k, total, 0.0)] if kind == "primitive" and result else result


def _beyond(i: int, side: float, deviations: Array) -> Array:
    return np.maximum(side * deviations[:, i], 0.0)


def _width(data: PassageData, k: int, distance: Callable[[Array], Array], smallest: float, kind: str) -> float:
    """For one distance of all dimensions, one class: it has to grade the whole way, as the thesis's does."""
    groups: dict[Hashable, list[Array]] = {}
    for p in data.passages:
        if data.graph.labels[p.node] == k:
            d, arrival = distance(data.deviations(p, k)), data.arrival(p)
            if kind == "primitive":
                groups.setdefault("all", []).append(d)
            elif arrival > 0:
                groups.setdefault("on the way", []).append(d[:arrival])
            if kind == "entity" and p.exit != BROKEN_OFF and not data.stopped_early(p):
                groups.setdefault(END if p.exit == END else data.graph.labels[p.exit], []).append(d[arrival:])
    return goal_distance_width(groups, smallest) if groups else smallest
