"""What of a skill is practised without gradients: a vector of numbers, zero for the skill as it is.

| skill | parameters |
|---|---|
| sequence graph | offsets of the goals of the position, one per primitive of that entity and coordinate that it controls |
| Mixture of Attractors | logits of every frame's attractors at knots in time, and offsets of its attractors in its axes |

One unit is a step that a person would try: `SHIFT`, `TURN`, `LOGIT`.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.errors import InvalidArgumentError
from policies.path_generators import AttractorPath
from policies.path_skill import PathSkill
from policies.sequence_graph_skill import SequenceGraphSkill
from policies.skill import Skill
from policies.task_data import CONTROLLED
from policies.task_space import CYLINDRICAL

Array = NDArray[np.float64]

SHIFT, TURN, LOGIT = 0.01, 0.05, 1.0
"""[m], [rad], and one e-fold of a frame's share."""
FINE = 0.2
"""Of these steps for a path: it is followed all the way, and not only to its goals."""
KNOTS = 5
"""Of the logits over time."""


class Parameters(NamedTuple):
    """The parameters of a skill."""

    size: int
    applied: Callable[[Array], Skill]
    """The skill for a vector (size,); the metadata stays."""


def parameters_of(skill: Skill) -> Parameters:
    """The parameters of a skill; InvalidArgumentError for one that has none."""
    if isinstance(skill, SequenceGraphSkill):
        return _goal_offsets(skill)
    if isinstance(skill, PathSkill) and isinstance(skill.generator, AttractorPath):
        return _activations(skill, skill.generator)
    raise InvalidArgumentError(
        f"a skill of kind '{skill.kind}' has no goals or activations to practise; possible: sequence-graph, moa"
    )


def _goal_offsets(skill: SequenceGraphSkill) -> Parameters:
    """Primitives that share a goal share its offset; a coordinate counts in metres, the angle of a cylinder in rad."""
    table, used = skill.primitives.table, {label for label in skill.graph.labels if label >= 0}
    owners: dict[tuple[int, int], list[int]] = {}
    for k in sorted(used):
        for i in np.flatnonzero(table.modes[k, :3] == CONTROLLED):
            owners.setdefault((int(table.shared[k, 0]), int(i)), []).append(k)
    places = [(rows, i, _unit(int(table.space[rows[0]]), i)) for (_, i), rows in owners.items()]

    def applied(x: Array) -> Skill:
        goal = skill.primitives.goal.copy()
        for value, (rows, i, unit) in zip(x, places, strict=True):
            goal[rows, i] += unit * value
        values, arrays = skill.to_arrays()
        return type(skill).from_arrays(values, arrays | {"goal": goal}, **skill.facts)

    return Parameters(len(places), applied)


def _unit(space: int, coordinate: int) -> float:
    return TURN if space == CYLINDRICAL and coordinate == 1 else SHIFT


def _activations(skill: PathSkill, path: AttractorPath) -> Parameters:
    """Adding u_f to the logits of all attractors of frame f turns activations a into a_f exp(u_f) / sum_g a_g exp(u_g).

    The world's logits stay, since adding a number to all changes nothing.
    """
    n, n_frames, d = path.places.shape
    n_knots = min(KNOTS, n)
    n_logits = n_knots * (n_frames - 1)

    def applied(x: Array) -> Skill:
        fine = FINE * x
        logits, offsets = fine[:n_logits].reshape(n_knots, n_frames - 1), fine[n_logits:].reshape(n_frames, d)
        return PathSkill(
            shifted(path, LOGIT * logits, SHIFT * offsets), skill.frames, skill.press, skill.orientation, skill.hand,
            skill.layout, skill.dt, **skill.facts,
        )  # fmt: skip

    return Parameters(n_logits + n_frames * d, applied)


def shifted(path: AttractorPath, logits: Array, offsets: Array) -> AttractorPath:
    """A path with logits (K, F - 1) at equally spaced knots added to its frames but the first, and offsets (F, d) [m]."""
    n = len(path.activations)
    time, knots = np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, len(logits))
    added = np.stack([np.zeros(n), *(np.interp(time, knots, column) for column in logits.T)], axis=1)
    weighed = np.exp(added - added.max(axis=1, keepdims=True))
    total = (path.activations * weighed).sum(axis=1, keepdims=True) / path.activations.sum(axis=1, keepdims=True)
    share = weighed / total
    activations = path.activations * share
    places = path.places * share[..., None] + activations[..., None] * offsets
    return path._replace(activations=activations, places=places)
