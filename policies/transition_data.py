"""Training data of a node's classifier: features, samples, classes, weights (thesis 2.4).

Beside the two rules of `passages.py`, two more keep accidents of a few demonstrations out of the decision:

3. *Events.* An exit at which the world yielded waits for that alone; any other exit waits for the entities that moved
   and arrived. Copies of the exit's samples say so, in which the other features take the values that they had on the
   way to this exit (for an event, which may happen anywhere, to any exit). These virtual samples are the feature
   selection that 2.5.2 asks for: without them a value that an entity happened to have in three demonstrations would
   become a condition.
4. *Fewest features.* Distances to the goals of successors depend on the setup. They enter only where a node has several
   exits that the features they wait for cannot tell apart.
"""

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.features import goal_distances
from policies.goal_distance import Feature, goal_distance_features
from policies.passages import END, Passage, PassageData

Array = NDArray[np.float64]

STAY = 0
"""Class of the samples on the way; class c > 0 is exit c - 1 of the node."""
SEPARATED = 0.9
"""|2 AUC - 1| from which on a feature tells two classes apart."""
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


class TransitionData:
    """Training data of every node of a graph."""

    def __init__(self, data: PassageData, kind: str) -> None:
        """kind of features, see `goal_distance.KINDS`."""
        self.data, self.kind = data, kind
        self.library = {k: goal_distance_features(data, k, kind) for k in data.labels}

    def node(self, node: int) -> NodeData | None:
        """Training data of a node; None where it has no successor."""
        graph = self.data.graph
        exits = graph.successors(node)
        if not exits:
            return None
        if node != 0 and any(p.node == node and p.exit == END for p in self.data.passages):
            exits = (*exits, END)
        labels = dict.fromkeys([graph.labels[node], *(graph.labels[e] for e in exits if e != END)])
        candidates = [feature for k in labels if k >= 0 for feature in self.library[k]]
        way = self._on_the_way(node, candidates)
        go = {e: [self._features(p, candidates)[self.data.arrival(p) :] for p in self._leaving(node, e)] for e in exits}
        go = {e: rows for e, rows in go.items() if rows}
        waits = self._waits(node, candidates, way, go)
        used = sorted(set().union(*waits.values()))
        blocks = [(STAY, rows) for passages in way.values() for rows in passages]
        goal_states = {}
        for e, passages in go.items():
            at_goal = [i for i in waits[e] if self._reached(node, e, candidates[i])]
            free = [i for i in used if i not in waits[e]]
            event = any(candidates[i].side != 0.0 for i in waits[e])
            pool = [rows for to, passages_ in way.items() if event or to == e for rows in passages_]
            for rows in passages:
                there = rows.copy()
                there[:, at_goal] = 0.0  # the goal itself is never a trap
                blocks.append((exits.index(e) + 1, _virtual(np.concatenate([rows, there]), free, pool)))
            if at_goal:
                goal_states[e] = np.mean([rows[-1] for rows in passages], axis=0)
                goal_states[e][at_goal] = 0.0
        samples = np.concatenate([rows for _, rows in blocks])[:, used]
        classes = np.concatenate([np.full(len(rows), c) for c, rows in blocks])
        return NodeData(
            tuple(candidates[i] for i in used),
            exits,
            samples,
            classes,
            _weights(classes, [len(rows) for _, rows in blocks]),
            {e: min((len(rows) - 1 for rows in go.get(e, [])), default=0) for e in exits},
            {e: state[used] for e, state in goal_states.items()},
        )

    def _on_the_way(self, node: int, features: list[Feature]) -> dict[int, list[Array]]:
        """Exit -> features of its passages through a node, up to their arrival."""
        way: dict[int, list[Array]] = {}
        for p in self.data.passages:
            if p.node == node and (arrival := self.data.arrival(p)):
                way.setdefault(p.exit, []).append(self._features(p, features)[:arrival])
        return way

    def _leaving(self, node: int, exit_: int) -> list[Passage]:
        """Passages from a node to an exit, those not stopped early; from anywhere if none was observed here."""
        to = [p for p in self.data.passages if p.exit == exit_]
        own = [p for p in to if p.node == node]
        return [p for p in own if not self.data.stopped_early(p)] or own or [p for p in to if p.node != 0]

    def _features(self, p: Passage, features: list[Feature]) -> Array:
        columns = [goal_distances(self.data.deviations(p, f.primitive), f.gain, f.side) for f in features]
        return np.stack(columns, axis=1) if columns else np.empty((p.stop - p.start + 1, 0))

    def _reached(self, node: int, exit_: int, feature: Feature) -> bool:
        """Whether a feature is the distance of an entity whose goal the exit waits for."""
        own = feature.primitive == self.data.graph.labels[node]
        return own and (feature.name in self.data.arrived(node, exit_))

    def _waits(
        self, node: int, features: list[Feature], on_the_way: dict[int, list[Array]], go: dict[int, list[Array]]
    ) -> dict[int, set[int]]:
        """Exit -> indices of the features that it depends on (rules 3 and 4)."""
        everything = set(range(len(features)))
        if self.kind == "primitive" or node == 0 or not on_the_way:
            return {exit_: everything for exit_ in go}
        at = {exit_: np.concatenate(rows) for exit_, rows in go.items()}
        way, k = (
            np.concatenate([rows for passages in on_the_way.values() for rows in passages]),
            self.data.graph.labels[node],
        )
        own = [i for i in everything if features[i].primitive == k]
        waits = {}
        for e, rows in at.items():
            forced = {i for i in own if features[i].side != 0.0}
            events = {i for i in forced if separation(rows[:, i], way[:, i]) >= SEPARATED}
            moved = self.data.moved(node)
            reached = {i for i in own if self._reached(node, e, features[i]) and features[i].name in moved}
            waits[e] = events or reached or set(own)
        for a, b in combinations(at, 2):
            told = {i: separation(at[a][:, i], at[b][:, i]) for i in sorted(everything)}
            if max((told[i] for i in waits[a] | waits[b]), default=0.0) < SEPARATED:
                best = max(told, key=lambda i: told[i])
                waits[a].add(best)
                waits[b].add(best)
        return waits


def _virtual(rows: Array, free: list[int], pool: list[Array]) -> Array:
    """Copies of samples in which the free features take values of the pool's passages (rule 3)."""
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


def separation(a: Array, b: Array) -> float:
    """|2 AUC - 1| of one feature (N,), (M,) between two classes: 0 tells nothing, 1 separates them."""
    b = np.sort(b)
    below, upto = np.searchsorted(b, a - 1e-6), np.searchsorted(b, a + 1e-6, side="right")
    return float(abs(np.mean(below + upto) / len(b) - 1.0))
