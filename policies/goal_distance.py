"""Features: goal distances (thesis 2.16, 2.17), one per primitive or one per entity, and named observations (2.5.3)."""

from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.features import CONTROLLED, ENTITIES, N_COORDINATES
from policies.passages import END, TOLERANCE, PassageData
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
            if kind == "entity" and not data.stopped_early(p):
                groups.setdefault(END if p.exit < 0 else data.graph.labels[p.exit], []).append(d[arrival:])
    return goal_distance_width(groups, smallest)


def goal_distance_width(groups: Mapping[Hashable, Sequence[Array]], smallest: float) -> float:
    """Width sigma of a goal distance (2.17), found by a stated objective; the thesis gives it in words only.

    groups: per class (on the way, and one per exit) the distances d >= 0 of its passages. With f of (2.17),

        J(sigma) = mean over classes c of Var_c(f) + (min_c mean_c f)^2 + (1 - max_c mean_c f)^2

    is minimised on a logarithmic grid from `smallest` to 100 times it, where with a single class the minimum and the
    maximum are those of its samples: little variance, a minimum near 0 and a maximum near 1, as 2.5.1 asks, within and
    between the classes that have to be told apart. Passages weigh the same, whatever their length. With several classes
    f saturates a little beyond the point of decision and means the same in every setup.
    """
    widths = smallest * np.logspace(0, 2, 81)
    means, variances = [], []
    for own in groups.values():
        f = [1.0 - np.exp(-0.5 * (d[:, None] / widths) ** 2) for d in own]
        mean = np.mean([x.mean(axis=0) for x in f], axis=0)
        means += [mean] if len(groups) > 1 else [np.concatenate(f).min(axis=0), np.concatenate(f).max(axis=0)]
        variances.append(np.mean([((x - mean) ** 2).mean(axis=0) for x in f], axis=0))
    cost = np.mean(variances, axis=0) + np.min(means, axis=0) ** 2 + (1.0 - np.max(means, axis=0)) ** 2
    return float(widths[int(np.argmin(cost))])
