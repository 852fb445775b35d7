"""Dynamic time warping of a matrix of costs (Sakoe and Chiba 1978)."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym.errors import InvalidArgumentError

Array = NDArray[np.float64]


def warping_path(cost: Array) -> NDArray[np.int64]:
    """Pairs (i, j), (n, 2), of the cheapest path from (0, 0) to the last row and column of a cost matrix (N, M).

    A step goes on by one in i, in j, or in both; the last counts twice (symmetric pattern P = 0), so that paths of all shapes
    have the same total weight. Of equally cheap ways back, the one in both is taken, then the one in j.

    Raises:
        InvalidArgumentError: no matrix, an empty one, or a cost that is not finite.
    """
    cost = np.asarray(cost, dtype=np.float64)
    if cost.ndim != 2 or not cost.size:
        raise InvalidArgumentError(
            f"costs of time warping have the shape {cost.shape}; needed: (N, M), neither of them 0"
        )
    wrong = np.argwhere(~np.isfinite(cost))
    if len(wrong):
        i, j = wrong[0]
        raise InvalidArgumentError(
            f"{len(wrong)} costs of time warping are not finite, the first is {cost[i, j]} at ({i}, {j}); "
            "points and scales must be small enough to be squared"
        )
    return np.asarray(_way_back(_came_by(np.ascontiguousarray(cost))))


@njit(cache=True)
def _came_by(cost: Array) -> NDArray[np.int8]:
    """Per pair the last step of the cheapest path to it: 0 both, 1 in j, 2 in i."""
    n, m = cost.shape
    step = np.zeros((n, m), dtype=np.int8)
    step[0, 1:], step[1:, 0] = 1, 2
    above, row = np.full(m + 1, np.inf), np.full(m + 1, np.inf)
    for i in range(n):
        for j in range(m):
            best = cost[i, j] if i == 0 and j == 0 else above[j] + 2.0 * cost[i, j]
            if row[j] + cost[i, j] < best:
                best, step[i, j] = row[j] + cost[i, j], 1
            if above[j + 1] + cost[i, j] < best:
                best, step[i, j] = above[j + 1] + cost[i, j], 2
            row[j + 1] = best
        above, row = row, above
    return step


@njit(cache=True)
def _way_back(step: NDArray[np.int8]) -> NDArray[np.int64]:
    i, j = step.shape[0] - 1, step.shape[1] - 1
    path = np.zeros((i + j + 1, 2), dtype=np.int64)
    at = len(path) - 1
    path[at] = i, j
    while i or j:
        last = step[i, j]
        i -= last != 1
        j -= last != 2
        at -= 1
        path[at] = i, j
    return path[at:]
