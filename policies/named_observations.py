"""Named observations as features: any measured quantity that is not a pose (thesis 2.5.3, Table 2.2).

Goal distances say how far a movement has come. What kind of object lies there, or whether the hand still holds it, shows
in other quantities: features of an object, joint angles and torques of the hand, the wrench. They are scaled by what was
demonstrated, f = (o - o_low) / (o_high - o_low), with the smallest and largest value in all demonstrations, and clipped to
[0, 1]: a value beyond what was demonstrated counts as its border, as a goal distance saturates. They are as they were observed,
a wrench in the axes of the world: what is felt sideways is not recognised where the scene is turned.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.errors import DemonstrationError, UnknownNameError

Array = NDArray[np.float64]

POSES = ("tool_", "reference_", "frame_", "joint_", "time")
"""Beginnings of names that are no features: where the robot and the objects are enters by goal distances; the reference
is the controller's, and what depends on the time does not depend on the world."""
SMALLEST_RANGE = 1e-3
"""A component that varied less in all demonstrations tells nothing [its unit]."""


class NamedObservations(NamedTuple):
    """Components of named observations, and how they are scaled."""

    keys: tuple[str, ...]
    """(D,) name of the observation that each component is from."""
    indices: NDArray[np.int64]
    """(D,) which of its components."""
    low: Array
    """(D,) smallest demonstrated value [the unit of the observation]."""
    high: Array
    """(D,) largest demonstrated value."""

    def name(self, column: int) -> str:
        """For reports: "hand_torque[2]"."""
        return f"{self.keys[column]}[{self.indices[column]}]"

    def scaled(self, observations: Mapping[str, NDArray[Any]]) -> Array:
        """Features (..., D) in [0, 1] of observations (..., d) by name."""
        columns = [observations[key][..., i] for key, i in zip(self.keys, self.indices, strict=True)]
        if not columns:
            return np.empty((*np.shape(next(iter(observations.values())))[:-1], 0))
        values = np.stack(columns, axis=-1)
        return np.clip((values - self.low) / (self.high - self.low), 0.0, 1.0)

    def only(self, columns: Sequence[int]) -> "NamedObservations":
        """Some of the components, in the given order."""
        at = list(columns)
        return NamedObservations(tuple(self.keys[c] for c in at), self.indices[at], self.low[at], self.high[at])


def named_observations(
    demonstrated: Sequence[Mapping[str, NDArray[Any]]], names: Sequence[str] | None
) -> NamedObservations:
    """All components of the named observations that vary; names None: of every observation that is not a pose.

    Raises UnknownNameError for a name that was not observed, or that is a pose, and DemonstrationError for values that are
    not finite.
    """
    possible = sorted(name for name in demonstrated[0] if not name.startswith(POSES))
    keys, indices, low, high = [], [], [], []
    for name in possible if names is None else names:
        if name not in possible:
            raise UnknownNameError("observation for features", name, possible)
        values = np.concatenate([observations[name] for observations in demonstrated])
        if not np.isfinite(values).all():
            raise DemonstrationError(
                f"the observation '{name}' is not finite; repeat the demonstration, or leave it out"
            )
        for i in np.flatnonzero(np.ptp(values, axis=0) > SMALLEST_RANGE):
            keys.append(name)
            indices.append(i)
            low.append(values[:, i].min())
            high.append(values[:, i].max())
    return NamedObservations(tuple(keys), np.array(indices, dtype=np.int64), np.array(low), np.array(high))
