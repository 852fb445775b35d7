"""Sequence graphs: which movement primitive may follow which (thesis 2.3).

A demonstration is a sequence of primitives. The local graph (2.3.1) has one node per primitive. The global graph
(2.3.2) lets a primitive appear several times: repetitions within a demonstration are folded into cycles (Algorithm 1,
repaired), the folded graphs are merged from their start on (Algorithm 2, repaired). The fully connected graph is the
baseline of Figure 2.11. Every construction is a quotient of the demonstrated chains, so each demonstration stays a walk
of its graph.
"""

import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import networkx
import numpy as np
from numpy.typing import ArrayLike

START = -1
"""Label of node 0, the explicit start: no primitive, left as soon as an episode begins."""


class TransitionPoint(NamedTuple):
    """Where a transition was observed (TP of thesis 2.3)."""

    demonstration: int
    """Index of the demonstration."""
    step: int
    """First step at which the new primitive was active; 0 for the transition out of the start node."""


class Segment(NamedTuple):
    """A stretch of one demonstration with one label."""

    label: int
    start: int
    """First step."""
    stop: int
    """One past the last step."""


Transitions = Mapping[tuple[int, int], tuple[TransitionPoint, ...]]


@dataclass(frozen=True)
class SequenceGraph:
    """Directed graph of nodes that each activate one movement primitive; node 0 is the start."""

    labels: tuple[int, ...]
    """Primitive of every node; labels[0] is START."""
    transitions: Transitions
    """(node, next node) -> the transition points at which this transition was observed, sorted."""

    def __post_init__(self) -> None:
        ordered = {edge: tuple(sorted(set(self.transitions[edge]))) for edge in sorted(self.transitions)}
        object.__setattr__(self, "transitions", ordered)

    @property
    def n_nodes(self) -> int:
        """Number of nodes, the start included."""
        return len(self.labels)

    def successors(self, node: int) -> tuple[int, ...]:
        """Nodes that may follow, in ascending order."""
        return tuple(b for a, b in self.transitions if a == node)

    def predecessors(self, node: int) -> tuple[int, ...]:
        """Nodes that may come before, in ascending order."""
        return tuple(a for a, b in self.transitions if b == node)

    def accepts(self, sequence: Iterable[int]) -> bool:
        """Whether a sequence of labels is a walk from the start node."""
        nodes = {0}
        for label in sequence:
            nodes = {n for node in nodes for n in self.successors(node) if self.labels[n] == label}
        return bool(nodes)

    def merged(self, parent: Sequence[int]) -> "SequenceGraph":
        """Quotient in which node i is represented by node parent[i]; nodes are renumbered in their old order.

        Input and output transitions of merged nodes are united, their transition points carried along (2.3.3).
        """
        kept = sorted(set(parent))
        if any(self.labels[node] != self.labels[parent[node]] for node in range(self.n_nodes)):
            raise ValueError("only nodes with the same primitive can be merged")
        index = {node: i for i, node in enumerate(kept)}
        transitions: dict[tuple[int, int], tuple[TransitionPoint, ...]] = {}
        for (a, b), points in self.transitions.items():
            edge = index[parent[a]], index[parent[b]]
            transitions[edge] = transitions.get(edge, ()) + points
        return SequenceGraph(tuple(self.labels[node] for node in kept), transitions)

    def to_networkx(self) -> "networkx.DiGraph":
        """networkx.DiGraph with node attribute `label` and edge attribute `points`."""
        graph = networkx.DiGraph()
        graph.add_nodes_from((node, {"label": label}) for node, label in enumerate(self.labels))
        graph.add_edges_from((a, b, {"points": points}) for (a, b), points in self.transitions.items())
        return graph

    def node_names(self, names: Sequence[str] | None = None) -> list[str]:
        """One readable name per node; names[label] is the primitive's. A primitive's later nodes get a number."""
        seen: dict[int, int] = {}
        result = []
        for label in self.labels:
            seen[label] = seen.get(label, 0) + 1
            name = "start" if label == START else (names[label] if names is not None else str(label))
            result.append(name if seen[label] == 1 else f"{name} ({seen[label]})")
        return result

    def to_dict(self) -> dict:
        """JSON-able form; from_dict inverts it."""
        edges = [[a, b, [list(point) for point in points]] for (a, b), points in self.transitions.items()]
        return {"labels": list(self.labels), "transitions": edges}

    @classmethod
    def from_dict(cls, data: Mapping) -> "SequenceGraph":
        """Graph from what to_dict returned."""
        edges = {(a, b): tuple(TransitionPoint(*point) for point in points) for a, b, points in data["transitions"]}
        return cls(tuple(data["labels"]), edges)


def segments(labels: ArrayLike) -> list[Segment]:
    """Maximal stretches of equal labels: equal neighbours collapse."""
    labels = np.asarray(labels)
    cuts = np.flatnonzero(np.diff(labels)) + 1
    bounds = [0, *cuts.tolist(), len(labels)]
    return [Segment(int(labels[a]), a, b) for a, b in itertools.pairwise(bounds) if b > a]


def chain(labels: ArrayLike, demonstration: int = 0) -> SequenceGraph:
    """Acyclic graph of one demonstration, step 1 of 2.3.3. labels (T,): the active primitive over time."""
    parts = segments(labels)
    points = {(i, i + 1): (TransitionPoint(demonstration, part.start),) for i, part in enumerate(parts)}
    return SequenceGraph((START, *(part.label for part in parts)), points)


def fold(graph: SequenceGraph) -> SequenceGraph:
    """Replace repetitions by cycles (Algorithm 1, repaired; step 2 of 2.3.3).

    The nodes are read in their order. Longest repetitions first: N_s .. N_{s+l-1} equal in label to the l nodes after
    them are merged node by node, so are further repetitions and an incomplete tail, which is a prefix of the cycle; the
    first chain is kept. This is repeated until nothing repeats, so folding twice is folding once.
    """
    parent = list(range(graph.n_nodes))
    rest = parent.copy()
    while (repetition := _find_repetition([graph.labels[node] for node in rest])) is not None:
        start, length = repetition
        cycle = rest[start : start + length]
        end = start + length
        while end < len(rest) and graph.labels[rest[end]] == graph.labels[cycle[(end - start) % length]]:
            parent[rest[end]] = cycle[(end - start) % length]
            end += 1
        del rest[start + length : end]
    return graph.merged([_root(parent, node) for node in range(graph.n_nodes)])


def _find_repetition(labels: Sequence[int]) -> tuple[int, int] | None:
    """(start, length) of the longest, then first, chain of at least two labels that occurs twice in a row."""
    for length in range(len(labels) // 2, 1, -1):
        for start in range(len(labels) - 2 * length + 1):
            if labels[start : start + length] == labels[start + length : start + 2 * length]:
                return start, length
    return None


def _root(parent: Sequence[int], node: int) -> int:
    while parent[node] != node:
        node = parent[node]
    return node


def merge(a: SequenceGraph, b: SequenceGraph, match: Literal["label", "inputs"] = "label") -> SequenceGraph:
    """Unite two graphs from their start on, branching at the latest possible point (Algorithm 2, repaired).

    match="inputs" is the thesis's rule: a node of b is merged into a node of a on equal paths from the start if both
    have the same primitive and inputs from the same primitives. A cycle that only one demonstration went through then
    leaves a node with two successors of the same primitive, between which no feature can decide. match="label" asks for
    the same primitive only and unites such successors until every node has at most one per primitive; then the result
    does not depend on the order of the demonstrations.
    """
    union = _union(a, b)
    if match == "label":
        at_start = [0 if node == a.n_nodes else node for node in range(union.n_nodes)]
        return _ordered(_unite_equal_successors(union.merged(at_start)))
    return _ordered(union.merged(_on_equal_paths(union, a.n_nodes)))


def _on_equal_paths(union: SequenceGraph, start: int) -> list[int]:
    """Algorithm 2: per node the one that it becomes; the second graph begins at node `start`."""
    parent = list(range(union.n_nodes))
    parent[start] = 0
    queue, mapped = [(0, start)], {0}
    while queue:
        node_a, node_b = queue.pop(0)
        for next_b in union.successors(node_b):
            inputs = _input_labels(union, next_b)
            for next_a in union.successors(node_a):
                same = union.labels[next_a] == union.labels[next_b] and _input_labels(union, next_a) == inputs
                if same and parent[next_b] == next_b and next_a not in mapped:
                    parent[next_b] = next_a
                    mapped.add(next_a)
                    queue.append((next_a, next_b))
    return parent


def _union(a: SequenceGraph, b: SequenceGraph) -> SequenceGraph:
    shifted = {(i + a.n_nodes, j + a.n_nodes): points for (i, j), points in b.transitions.items()}
    return SequenceGraph(a.labels + b.labels, {**a.transitions, **shifted})


def _input_labels(graph: SequenceGraph, node: int) -> set[int]:
    return {graph.labels[n] for n in graph.predecessors(node)}


def _unite_equal_successors(graph: SequenceGraph) -> SequenceGraph:
    """Smallest quotient in which the successors of a node all have different primitives."""
    while True:
        for node in range(graph.n_nodes):
            first: dict[int, int] = {}
            parent = list(range(graph.n_nodes))
            for successor in graph.successors(node):
                parent[successor] = first.setdefault(graph.labels[successor], successor)
            if parent != list(range(graph.n_nodes)):
                graph = graph.merged(parent)
                break
        else:
            return graph


def _ordered(graph: SequenceGraph) -> SequenceGraph:
    """Same graph with its nodes numbered breadth first from the start, successors by label."""
    order = [0]
    for node in order:
        order += sorted((n for n in graph.successors(node) if n not in order), key=lambda n: (graph.labels[n], n))
    index = {node: i for i, node in enumerate(order)}
    transitions = {(index[i], index[j]): points for (i, j), points in graph.transitions.items()}
    return SequenceGraph(tuple(graph.labels[node] for node in order), transitions)


def global_graph(
    demonstrations: Sequence[ArrayLike],
    fold_repetitions: bool = True,
    match: Literal["label", "inputs"] = "label",
    broken_off: Collection[int] = (),
) -> SequenceGraph:
    """Global sequence graph (2.3.2) of the labels (T_m,) of every demonstration.

    fold_repetitions=False keeps a demonstrated number of repetitions (end of 2.3.2). With match="label", demonstrations that
    end with the same primitive end in the same node: what follows there does not depend on the way to it, so that an error
    recovery (2.5.3) that one of them shows is known to all. Those that are broken off, by their indices, show no end.
    """
    graphs = [chain(labels, m) for m, labels in enumerate(demonstrations)]
    if fold_repetitions:
        graphs = [fold(graph) for graph in graphs]
    result = graphs[0] if match == "inputs" else _unite_equal_successors(graphs[0])
    for graph in graphs[1:]:
        result = merge(result, graph, match)
    return _ordered(_unite_ends(result, broken_off) if match == "label" else result)


def _unite_ends(graph: SequenceGraph, broken_off: Collection[int]) -> SequenceGraph:
    """Quotient in which the nodes of one primitive with which demonstrations end are one."""
    last: dict[int, tuple[int, int]] = {}
    for (_, node), points in graph.transitions.items():
        for point in points:
            last[point.demonstration] = max(last.get(point.demonstration, (-1, -1)), (point.step, node))
    parent, first = list(range(graph.n_nodes)), dict[int, int]()
    for node in sorted({node for m, (_, node) in last.items() if m not in broken_off}):
        parent[node] = first.setdefault(graph.labels[node], node)
    return _unite_equal_successors(graph.merged(parent))


def local_graph(demonstrations: Sequence[ArrayLike]) -> SequenceGraph:
    """Local sequence graph (2.3.1): one node per primitive, one transition per observed pair."""
    graph = chain(demonstrations[0], 0)
    for m, labels in enumerate(demonstrations[1:], start=1):
        graph = _union(graph, chain(labels, m))
    first: dict[int, int] = {}
    return _ordered(graph.merged([first.setdefault(label, node) for node, label in enumerate(graph.labels)]))


def fully_connected_graph(demonstrations: Sequence[ArrayLike]) -> SequenceGraph:
    """Baseline of Figure 2.11(a): from the start and from every primitive to every other one.

    A transition that was never observed carries no transition point.
    """
    local = local_graph(demonstrations)
    everything = {(a, b): () for a in range(local.n_nodes) for b in range(1, local.n_nodes) if a != b}
    return SequenceGraph(local.labels, {**everything, **local.transitions})


MATCHES = ("label", "inputs")
GRAPHS: dict[str, Callable[..., SequenceGraph]] = {
    "global": global_graph,
    "local": local_graph,
    "fully-connected": fully_connected_graph,
}
