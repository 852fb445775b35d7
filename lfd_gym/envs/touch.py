"""Which geoms touch which."""

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray


def robot_geoms(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which geoms belong to the arm and what it carries on its wrist, shape (n_geoms,)."""
    belongs: NDArray[np.bool_] = model.body_rootid[model.geom_bodyid] == model.body_rootid[model.body("wam_link_7").id]
    return belongs


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
