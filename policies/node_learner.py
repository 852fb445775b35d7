"""One node of a sequence graph: its classifier from its training data, and what is doubtful about it (thesis 2.4)."""

import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.decisions import Decision, constant_decision
from policies.passages import END
from policies.sequence_graph_skill import Node, class_targets
from policies.task_data import N_COORDINATES
from policies.transition_data import STAY, NodeData
from policies.transitions import CLASSIFIERS

Array = NDArray[np.float64]

PATIENCE_MARGIN = 0.5
"""Stillness [s] allowed beyond `patience` times the longest one demonstrated in a node."""
CONFUSED = 0.3
"""Share of the samples of one exit that are decided for another one, from which on the two are not told apart."""
RARE = 1.0 / 3.0
"""Of two exits that are not told apart one is left out if less than this share of the other's demonstrations took it."""
N_JUDGED = 50
"""Samples per class by which this is judged."""


class TransitionWarning(UserWarning):
    """A transition is doubtful: shown too rarely, or not told apart from others."""


class NodeLearner(NamedTuple):
    """Turns the training data of a node into what the skill needs of it."""

    classifier: str
    settings: dict[str, Any]
    """Arguments of the classifier."""
    dwell: float
    patience: float | None
    dt: float
    """Control step [s]."""
    names: Sequence[str]
    """Name of every node of the graph."""

    def learn(self, node: int, data: NodeData | None, stillness: int) -> Node:
        """The node; stillness is the longest one demonstrated, in samples.

        Where nothing tells a rare exit from a usual one, the rare one is left out. Warns of this and of what else is doubtful.
        """
        if data is None:
            none, no_gains, no_index = np.empty(0), np.empty((0, N_COORDINATES)), np.empty(0, dtype=np.int64)
            return Node((), no_index, no_index, no_gains, none, class_targets(node, ()), np.zeros(1), None, np.inf)
        targets = class_targets(node, data.exits)
        seen, decision = self._decision(data)
        while (exits := _rarer(data, confused := _confused(data, seen, decision))) is not None:
            rarer, usual = exits
            left_out = f"{self._to(rarer)} is left out, for most demonstrations went on to {self._to(usual)}"
            _warn(f"node '{self.names[node]}': no feature that was observed tells its exits apart; {left_out}")
            data = data.without(rarer)
            seen, decision = self._decision(data)
        self._warn(node, data, seen, decision, confused)
        patience = np.inf
        if self.patience is not None and not (targets[1:] == node).any():
            patience = self.patience * stillness * self.dt + PATIENCE_MARGIN
        rests = np.array([0, *(data.rests[exit_] if node else 0 for exit_ in data.exits)])[seen]
        return Node(
            tuple(feature.name for feature in data.features),
            np.array([feature.primitive for feature in data.features], dtype=np.int64),
            np.array([feature.column for feature in data.features], dtype=np.int64),
            np.array([feature.gain for feature in data.features]).reshape(-1, N_COORDINATES),
            np.array([feature.side for feature in data.features]),
            targets[seen],
            self.dwell * self.dt * rests,
            decision,
            patience,
        )

    def _decision(self, data: NodeData) -> tuple[NDArray[np.int64], Decision]:
        """The classes (C,) that there are samples of, and what decides between them."""
        seen, classes = np.unique(data.classes, return_inverse=True)
        if len(seen) == 1 or not data.features:
            return seen, constant_decision(len(seen), len(data.features))
        return seen, CLASSIFIERS[self.classifier](data.samples, classes, data.weights, **self.settings)[1]

    def _warn(
        self, node: int, data: NodeData, seen: NDArray[np.int64], decision: Decision, confused: list[tuple[int, int]]
    ) -> None:
        name = self.names[node]
        for exit_, goal in data.goal_states.items():
            if seen[int(np.argmax(decision.scores(goal)))] == STAY:
                _warn(f"node '{name}' cannot tell its goal, where {self._to(exit_)} follows, from the way there")
        for exit_ in data.rare:
            _warn(f"at node '{name}' only one demonstration went on to {self._to(exit_)}")
        for one, other in confused:
            taken = f"{self._to(one)} for {self._to(other)}"
            _warn(f"node '{name}' takes {taken}: no feature that was observed tells them apart")

    def _to(self, exit_: int) -> str:
        return "the end" if exit_ == END else f"'{self.names[exit_]}'"


def _rarer(data: NodeData, confused: list[tuple[int, int]]) -> tuple[int, int] | None:
    """An exit that is seldom right, see `RARE`, and the one that it is not told apart from; None if there are none."""
    pairs = [(len(data.taken_by[a]) / len(data.taken_by[b]), a, b) for pair in confused for a, b in (pair, pair[::-1])]
    share, rarer, usual = min(pairs, default=(1.0, END, END))
    return (rarer, usual) if share < RARE else None


def _confused(data: NodeData, seen: NDArray[np.int64], decision: Decision) -> list[tuple[int, int]]:
    """Exits that are taken for another one, and that one."""
    pairs = [(seen[i], seen[j]) for i, j in np.argwhere(_decided(data, seen, decision) >= CONFUSED)]
    return [(data.exits[a - 1], data.exits[b - 1]) for a, b in pairs if STAY not in (a, b) and a != b]


def _decided(data: NodeData, seen: NDArray[np.int64], decision: Decision) -> Array:
    """Share (C, C) of the samples of the first class that are decided for the second."""
    shares = np.zeros((len(seen), len(seen)))
    for i, c in enumerate(seen):
        own = np.flatnonzero(data.classes == c)
        for row in own[np.unique(np.linspace(0, len(own) - 1, N_JUDGED).round().astype(int))]:
            shares[i, int(np.argmax(decision.scores(data.samples[row])))] += 1.0
    return shares / shares.sum(axis=1, keepdims=True)


def _warn(message: str) -> None:
    warnings.warn(message, TransitionWarning, stacklevel=2)
