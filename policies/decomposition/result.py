"""What every method of decomposition returns: segments assigned to primitives, and what each primitive is (thesis 3.2.3)."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.decomposition.task_spaces import EntitySegments, TaskSpace

Array = NDArray[np.float64]

COMPLETE, STOPPED, PAUSE, ACCIDENT, LOOSE = range(5)
"""Kinds of segments: at the goal; stopped early; pause inside a movement; at the goal, pressing by accident; near the goal."""
AMBIGUOUS = 0.95
"""A frame with less posterior probability than this is ambiguous."""


class EntityPrimitive(NamedTuple):
    """A movement primitive of one entity: a linear attractor in one task space."""

    space: TaskSpace
    """The most probable task space, in which goal, covariance and force are given."""
    posterior: Array
    """(F,) probability of every task space of the entity."""
    goal: Array
    """(d,) x of `task_spaces`; of an orientation the rows of a rotation matrix."""
    covariance: Array
    """(d, d) uncertainty of where movements to the goal end; of an orientation (3, 3), of the rotation vector about the goal
    [rad^2]."""
    axes: tuple[str, ...]
    """Per coordinate "position", "force" or "hold", as in a primitive table (3 for an orientation)."""
    force: Array
    """(3,) desired force of the tool on the world along the coordinates of a position [N]; 0 where position is controlled."""

    @property
    def confidence(self) -> float:
        """Probability of the chosen space."""
        return float(self.posterior.max())


class EntityDecomposition(NamedTuple):
    """The decomposition of one entity."""

    data: EntitySegments
    primitives: tuple[EntityPrimitive, ...]
    assignment: NDArray[np.int64]
    """(L,) primitive of every segment."""
    kinds: NDArray[np.int64]
    """(L,) `COMPLETE`, `STOPPED`, `PAUSE`, `ACCIDENT`, `LOOSE`; all complete where a method does not tell."""

    def active(self, demonstration: int, n_steps: int) -> NDArray[np.int64]:
        """(T,) primitive that was active at every step of one demonstration."""
        result = np.empty(n_steps, dtype=np.int64)
        for i in self.data.of(demonstration):
            part = self.data.segments[i]
            result[part.start : part.stop + 1] = self.assignment[i]
        return result


class Decomposition(NamedTuple):
    """The decomposition of a task."""

    entities: Mapping[str, EntityDecomposition]
    """By "position", "orientation", "hand"; what was not observed is missing."""
    method: str
    """Which method found it."""

    @property
    def ambiguous(self) -> list[str]:
        """Primitives whose frame or space is less than `AMBIGUOUS` probable: "position 2 (box_red, 61 %)"."""
        return [
            f"{entity} {k} ({primitive.space.frame}, {primitive.confidence:.0%})"
            for entity, found in self.entities.items()
            for k, primitive in enumerate(found.primitives, start=1)
            if primitive.confidence < AMBIGUOUS
        ]

    def active(self, n_steps: Sequence[int]) -> list[dict[str, NDArray[np.int64]]]:
        """Per demonstration and entity the active primitive (T,) at every step."""
        return [{entity: found.active(m, n) for entity, found in self.entities.items()} for m, n in enumerate(n_steps)]
