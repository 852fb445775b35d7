"""Training data of a node's classifier: features, samples, classes, weights (thesis 2.4).

What each exit depends on is decided in `conditions.py`, rules 3 to 5. Copies of the exit's samples say so, in which all
other features take the values that they had on the way to this exit (for an event, which may happen anywhere, those that
they had anywhere in this node), and features of the context those of any demonstrated situation; whether to stay does not
depend on the context either. These virtual samples are the feature selection that 2.5.2 asks for: without them a value that
an entity happened to have in three demonstrations would become a condition.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.conditions import Conditions, Seen, Waits
from policies.features import Feature, goal_distance_features, observed_features, whole_way_features
from policies.goal_distance import goal_distances
from policies.passages import BROKEN_OFF, END, Passage, PassageData

Array = NDArray[np.float64]

STAY = 0
"""Class of the samples on the way; class c > 0 is exit c - 1 of the node."""
N_COPIES, N_COPIED = 25, 10
"""Virtual samples per copied sample, and copied samples per passage."""


class NodeData(NamedTuple):
    """Training data of one node."""

    features: tuple[Feature, ...]
    exits: tuple[int, ...]
    """Next node, or END, of class 1, 2, ..."""
    samples: Array
    """(N, n) features."""
    classes: NDArray[np.int64]
    """(N,)."""
    weights: Array
    """(N,) with mean 1: every class weighs the same, and within it every passage."""
    rests: dict[int, int]
    """Exit -> shortest rest before it, in samples; 0 where it was not observed."""
    goal_states: dict[int, Array]
    """Exit -> features (n,) at the goal that it waits for: the decision here must not be to stay."""
    taken_by: dict[int, frozenset[int]]
    """Exit -> the demonstrations that took it."""

    @property
    def rare(self) -> list[int]:
        """Exits of a node with several that only one of several demonstrations took."""
        if len(self.taken_by) < 2 or len(frozenset().union(*self.taken_by.values())) < 2:
            return []
        return [e for e, own in self.taken_by.items() if len(own) == 1]

    def without(self, exit_: int) -> "NodeData":
        """The same node as if nobody had taken an exit."""
        kept = self.classes != self.exits.index(exit_) + 1
        weights = self.weights[kept]
        return self._replace(
            samples=self.samples[kept],
            classes=self.classes[kept],
            weights=weights * len(weights) / weights.sum(),
            goal_states={e: state for e, state in self.goal_states.items() if e != exit_},
            taken_by={e: own for e, own in self.taken_by.items() if e != exit_},
        )


class TransitionData:
    """Training data of every node of a graph."""

    def __init__(self, data: PassageData, kind: str) -> None:
        """kind of features, see `features.KINDS`."""
        self.data, self.kind = data, kind
        self.library = {k: goal_distance_features(data, k, kind) for k in data.labels}
        self.observed = observed_features(data)
        self.whole_way = {k: whole_way_features(data, k) for k in data.labels if kind == "entity"}
        self.several_starts = kind == "entity" and len({p.exit for p in data.passages if p.node == 0}) > 1

    def node(self, node: int) -> NodeData | None:
        """Training data of a node; None where it has no successor."""
        graph = self.data.graph
        exits = graph.successors(node)
        if not exits:
            return None
        if node != 0 and self._ends(node):
            exits = (*exits, END)
        candidates = self._candidates(node, exits)
        seen = self._passages(node, exits, candidates)
        if node == 0 and self.several_starts:
            waits = Conditions(self.data, node, candidates).at_the_start(seen)
        elif self.kind == "primitive" or node == 0 or not any(len(s.way) for s in seen):
            waits = {e: Waits(set(range(len(candidates))), set(), False) for e in exits}
        else:
            alike = [self._features(p, candidates) for p in self.data.passages if self.data.alike(p, node)]
            waits, seen = Conditions(self.data, node, candidates, alike).find(seen)
        return self._samples(node, exits, candidates, seen, waits)

    def _ends(self, node: int) -> bool:
        """Whether to stop here was shown. A recording ends when the task is solved: a single one that ended where all others
        went on shows nothing."""
        through = {p.demonstration for p in self.data.passages if p.node == node and p.exit != BROKEN_OFF}
        ended = {p.demonstration for p in self.data.passages if p.node == node and p.exit == END}
        return len(ended) > 1 or (len(ended) == 1 and len(through) == 1)

    def _candidates(self, node: int, exits: tuple[int, ...]) -> list[Feature]:
        graph = self.data.graph
        labels = dict.fromkeys(graph.labels[n] for n in (node, *exits) if n not in (0, END))
        if self.kind == "primitive" or (node == 0 and not self.several_starts):
            return [*(f for k in labels for f in self.library[k]), *self.observed * (self.kind == "primitive")]
        own = self.library[graph.labels[node]] if node else []
        others = [k for k in labels if node == 0 or k != graph.labels[node]]
        return [*own, *self.observed, *(f for k in others for f in self.whole_way[k])]

    def _passages(self, node: int, exits: tuple[int, ...], features: list[Feature]) -> list[Seen]:
        """Passages through a node. Those not stopped early show their exit; from anywhere if none was observed here.

        One that broke off shows no exit, but how to stay.
        """
        result = []
        for e in exits:
            to = [p for p in self.data.passages if p.exit == e]
            own = [p for p in to if p.node == node]
            leaving = [p for p in own if not self.data.stopped_early(p)] or own or [p for p in to if p.node != 0]
            for p in [*own, *(p for p in leaving if p not in own)]:
                rows, arrival = self._features(p, features), self.data.arrival(p)
                way = rows[:arrival] if p in own and node != 0 else rows[:0]
                result.append(Seen(e, p.demonstration, way, rows[arrival:] if p in leaving else rows[:0]))
        for p in self.data.passages:
            if p.node == node and p.exit == BROKEN_OFF:
                rows, arrival = self._features(p, features), self.data.arrival(p)
                result.append(Seen(BROKEN_OFF, p.demonstration, rows[:arrival], rows[:0]))
        return result

    def _features(self, p: Passage, features: list[Feature]) -> Array:
        observed = self.data.observed(p)
        columns = [
            observed[:, f.column]
            if f.column >= 0
            else goal_distances(self.data.deviations(p, f.primitive), f.gain, f.side)
            for f in features
        ]
        return np.stack(columns, axis=1) if columns else np.empty((p.stop - p.start + 1, 0))

    def _samples(
        self, node: int, exits: tuple[int, ...], features: list[Feature], seen: list[Seen], waits: dict[int, Waits]
    ) -> NodeData:
        used = sorted(set().union(*(w.own | w.context for w in waits.values())))
        context = sorted(set().union(*(w.context for w in waits.values())))
        situations = [s.go[-1:] for s in seen if len(s.go)]
        conditions = Conditions(self.data, node, features)
        blocks = [(STAY, _virtual(s.way, context, situations)) for s in seen if len(s.way)]
        goal_states: dict[int, Array] = {}
        for e in waits:
            own = [s for s in seen if s.exit == e and len(s.go)]
            at_goal = [i for i in waits[e].own if conditions.reached(e, i)]
            free = [i for i in used if i not in waits[e].own and i not in context]
            elsewhere = [i for i in context if i not in waits[e].own | waits[e].context]
            pool = [s.way for s in seen if waits[e].event or s.exit == e]
            pool += [s.go for s in seen if waits[e].event and s.exit != e]
            for s in own:
                there = s.go.copy()
                there[:, at_goal] = 0.0  # the goal itself is never a trap
                rows = _virtual(_virtual(np.concatenate([s.go, there]), free, pool), elsewhere, situations)
                blocks.append((exits.index(e) + 1, rows))
            if own and at_goal:
                goal_states[e] = np.mean([s.go[-1] for s in own], axis=0)
                goal_states[e][at_goal] = 0.0
        samples = np.concatenate([rows for _, rows in blocks])[:, used]
        classes = np.concatenate([np.full(len(rows), c) for c, rows in blocks])
        return NodeData(
            tuple(features[i] for i in used),
            exits,
            samples,
            classes,
            _weights(classes, [len(rows) for _, rows in blocks]),
            {e: min((len(s.go) - 1 for s in seen if s.exit == e and len(s.go)), default=0) for e in exits},
            {e: state[used] for e, state in goal_states.items()},
            {e: frozenset(s.demonstration for s in seen if s.exit == e) for e in waits},
        )


def _virtual(rows: Array, free: list[int], pool: list[Array]) -> Array:
    """Copies of samples in which the free features take values of the pool's passages ."""
    pool = [values for values in pool if len(values)]
    if not free or not pool:
        return rows
    values = _evenly(np.concatenate(pool), N_COPIES)
    copies = np.repeat(_evenly(rows, N_COPIED), len(values), axis=0)
    copies[:, free] = np.tile(values[:, free], (len(copies) // len(values), 1))
    return copies


def _evenly(rows: Array, n: int) -> Array:
    """At most n rows, evenly spaced."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, n).round().astype(int))]


def _weights(classes: NDArray[np.int64], lengths: list[int]) -> Array:
    """Weights with mean 1: every class the same, and within it every block of the given lengths."""
    weights = np.repeat(1.0 / np.array(lengths), lengths)
    for c in np.unique(classes):
        weights[classes == c] /= weights[classes == c].sum()
    return weights * len(weights) / weights.sum()
