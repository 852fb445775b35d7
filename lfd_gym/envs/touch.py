"""Which geoms touch which."""

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True)
def count_contacts(pairs: NDArray[np.int32], one: NDArray[np.bool_], other: NDArray[np.bool_]) -> int:
    """How many contacts join two sets of geoms.

    Args:
        pairs: geoms of every contact, `data.contact.geom`, shape (n, 2).
        one, other: which geoms belong to the sets, shape (n_geoms,).
    """
    n = 0
    for i in range(pairs.shape[0]):
        a, b = pairs[i]
        if a >= 0 and b >= 0 and ((one[a] and other[b]) or (one[b] and other[a])):
            n += 1
    return n
