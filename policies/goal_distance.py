"""The goal distance of a primitive (thesis 2.16, 2.17), and how wide it has to be."""

from collections.abc import Hashable, Mapping, Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def goal_distance(deviation: Array, gain: Array, side: float) -> float:
    """Goal distance f = 1 - exp(-1/2 Delta^T Sigma^-1 Delta) in [0, 1] (2.17).

    deviation (N_COORDINATES,) is x - g, minus Delta of (2.16); gain (N_COORDINATES,) the square roots of the diagonal
    of Sigma^-1, 0 where a coordinate does not count. side 0 counts deviations to both sides, +1 or -1 only those of
    that sign.
    """
    total = 0.0
    for i in range(len(deviation)):
        z = deviation[i] * gain[i]
        if z * side >= 0.0:
            total += z * z
    return 1.0 - np.exp(-0.5 * total)


@njit(cache=True)
def goal_distances(deviations: Array, gain: Array, side: float) -> Array:
    """goal_distance of every row (N, N_COORDINATES)."""
    result = np.empty(len(deviations))
    for t in range(len(deviations)):
        result[t] = goal_distance(deviations[t], gain, side)
    return result


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
