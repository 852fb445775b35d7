"""Steps that a method labels one by one, as segments: what a baseline that knows no segments returns (thesis 3.5.2)."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lfd_gym.demonstration import Demonstration
from policies.decomposition.segmentation import Segment
from policies.decomposition.task_spaces import EntitySegments, entity_segments

Integers = NDArray[np.int64]

SHORTEST_RUN = 0.2
"""A shorter run [s] belongs to the one before it."""


def steps_of(demonstration: Demonstration, period: float) -> Integers:
    """Samples that stand for a demonstration: one every `period` seconds."""
    return np.arange(0, len(demonstration) + 1, max(round(period / float(demonstration.dt)), 1))


def from_runs(
    demonstrations: Sequence[Demonstration], entity: str, labels: Sequence[Integers], period: float
) -> tuple[EntitySegments, Integers]:
    """Segments of equal labels, given at `steps_of`, and their labels."""
    parts, assignment = [], []
    for m, (demonstration, own) in enumerate(zip(demonstrations, labels, strict=True)):
        steps = steps_of(demonstration, period)
        shortest = SHORTEST_RUN / float(demonstration.dt)
        runs = [0, *(np.flatnonzero(np.diff(own)) + 1).tolist(), len(own)]
        kept: list[tuple[int, int]] = []
        for a, b in itertools.pairwise(runs):
            long = (steps[b - 1] - steps[a]) >= shortest
            if not kept or (long and kept[-1][1] != own[a]):
                kept.append((int(steps[a]), int(own[a])))
        cuts = [0, *(start for start, _ in kept[1:]), len(demonstration)]
        for start, stop, (_, label) in zip(cuts[:-1], cuts[1:], kept, strict=True):
            parts.append(Segment(m, start, stop, stop))
            assignment.append(label)
    return entity_segments(demonstrations, entity, parts), np.array(assignment)
