"""Our own decomposition: Bayesian evidence of end points with incomplete segments, searched deterministically.

The position comes first. The task space of the position primitive that is active while an orientation segment arrives is a hint
for the space of its primitive: what the hand goes to is what it aligns with. Ends of a single demonstration do not tell frames
apart; there a goal is likely to be about an object that is near it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lfd_gym.demonstration import Demonstration
from policies.decomposition.extraction import extract
from policies.decomposition.objective import Assignment, Objective
from policies.decomposition.observed import observe, rigid
from policies.decomposition.result import Decomposition, EntityDecomposition
from policies.decomposition.search import search
from policies.decomposition.segmentation import entities, interrupted
from policies.decomposition.task_spaces import EntitySegments, entity_segments

Array = NDArray[np.float64]

NEAR, WORLD = 0.1, 0.5
"""Mean distance of a goal from the object that it is about [m], and how far away the world counts as."""


def decompose(demonstrations: Sequence[Demonstration]) -> Decomposition:
    """Position, orientation and, where there is one, hand."""
    position = decompose_entity(demonstrations, entity_segments(demonstrations, "position"))
    data = entity_segments(demonstrations, "orientation")
    found = {"position": position, "orientation": decompose_entity(demonstrations, data, _aligned(data, position))}
    if "hand" in entities(demonstrations):
        found["hand"] = decompose_entity(demonstrations, entity_segments(demonstrations, "hand"))
    return Decomposition(found, "bayesian")


def decompose_entity(
    demonstrations: Sequence[Demonstration], data: EntitySegments, hints: Array | None = None
) -> EntityDecomposition:
    """One entity; hints (L, F) as in `observe`."""
    observed = observe(data, hints, interrupted(demonstrations, data.entity, data.segments))
    best, objective = search(observed)
    posterior = _posterior(objective, best)
    spaces = np.array([space.number for space in observed.spaces])
    per_space = np.stack([posterior[:, spaces == f].sum(axis=1) for f in range(len(data.spaces))], axis=1)
    if data.entity == "position":
        per_space = _near(data, best, per_space)
    held = []
    for k, row in enumerate(per_space):
        own = np.where(spaces == np.argmax(row), posterior[k], 0.0)
        held.append(observed.spaces[int(np.argmax(own))].held)
    primitives = extract(data, best.primitive, best.kind, list(per_space), held)
    return EntityDecomposition(data, primitives, best.primitive, best.kind)


def _posterior(objective: Objective, best: Assignment) -> Array:
    """(K, F) probability of every space."""
    log = objective.evidence.spaces(objective.sets(best))
    weights = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _near(data: EntitySegments, best: Assignment, posterior: Array) -> Array:
    """The posterior (K, F) after a prior exp(-distance / NEAR) for primitives that one demonstration showed."""
    result = posterior.copy()
    for k in range(len(result)):
        own = np.flatnonzero(best.primitive == k)
        if len({data.segments[i].demonstration for i in own}) == 1:
            ends = np.array([[data.views[i][f].end for f in rigid(data)] for i in own])
            away = np.median(np.linalg.norm(ends, axis=2), axis=0)
            away[0] = WORLD
            result[k] *= np.exp(-away / NEAR)
            result[k] /= result[k].sum()
    return result


def _aligned(data: EntitySegments, position: EntityDecomposition) -> Array:
    """(L, F) hints for orientation segments from the frames of the position primitives that are active when they arrive."""
    frames = [space.frame for space in data.spaces]
    hints = np.ones((len(data.segments), len(frames)))
    for i, part in enumerate(data.segments):
        own = [j for j in position.data.of(part.demonstration) if position.data.segments[j].start <= part.rest]
        posterior = position.primitives[position.assignment[own[-1]]].posterior
        for f, frame in enumerate(frames):
            hints[i, f] = sum(posterior[g] for g, space in enumerate(position.data.spaces) if space.frame == frame)
    return hints
