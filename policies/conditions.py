"""What the exits of a node wait for (thesis 2.4, 2.5.2).

Beside the two rules of `passages.py`, three more keep accidents of a few demonstrations out of the decision:

3. *Events.* An exit at which the world yielded, or that interrupted the movement when a named observation changed or an
   object moved in the hand, waits for that alone; any other exit waits for the entities that moved and arrived.
4. *Reaction.* A demonstrator reacts to an event after it happened: from the moment on from which its feature stays on the
   other side of what it was elsewhere, the samples count for the successor.
5. *Context.* Distances to the goals of successors and named observations depend on the setup. They enter only where a node
   has several exits that what they wait for cannot tell apart, and as few of them as tell the exits apart
   (`feature_selection.telling_features`). Exits that lead to the same goal with all entities but one are alternatives: which
   kind of exit is a matter of what was observed, which of the alternatives one of how far its goal is ("the MP that is
   closer to its target orientation should be activated", 2.5.3).
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.feature_selection import Event, separation, telling_event, telling_features
from policies.features import Feature
from policies.object_motion import MOTION
from policies.passages import END, PassageData
from policies.task_data import ENTITIES

Array = NDArray[np.float64]

SEPARATED = 0.9
"""|2 AUC - 1| from which on a feature tells two classes apart."""


class Seen(NamedTuple):
    """One passage through a node, or into one of its exits, in terms of features."""

    exit: int
    demonstration: int
    way: Array
    """(N, n) before it had arrived, or before the event."""
    go: Array
    """(M, n) from then on; empty where the passage says nothing about its exit."""

    @property
    def rows(self) -> Array:
        """All samples (N + M, n)."""
        return np.concatenate([self.way, self.go])

    def cut(self, event: Event) -> "Seen":
        """The same passage, in which the successor's samples begin with the event."""
        at = min(event.onset(self.rows), len(self.way))
        return self._replace(way=self.rows[:at], go=self.rows[at:])


class Waits(NamedTuple):
    """What an exit depends on, as indices of features."""

    own: set[int]
    """Goal distances or events that must have come true."""
    context: set[int]
    """What tells it from other exits that wait for the same."""
    event: bool


class Conditions:
    """Finds what the exits of one node wait for."""

    def __init__(self, data: PassageData, node: int, features: Sequence[Feature], alike: Sequence[Array] = ()) -> None:
        """alike: features (N, n) of passages of the same primitive through other nodes."""
        self.data, self.node, self.features, self.alike = data, node, features, alike
        self.own = [i for i, f in enumerate(features) if node != 0 and f.primitive == data.graph.labels[node]]
        self.events = [i for i, feature in enumerate(features) if feature.column >= 0]
        self.observed = [i for i in self.events if not features[i].name.startswith(MOTION)]

    def reached(self, exit_: int, i: int) -> bool:
        """Whether feature i is the distance of an entity whose goal the exit waits for."""
        return i in self.own and self.features[i].name in self.data.arrived(self.node, exit_)

    def find(self, seen: list[Seen]) -> tuple[dict[int, Waits], list[Seen]]:
        """What every exit waits for, and the passages cut where their events happened."""
        moved, way = self.data.moved(self.node), np.concatenate([s.way for s in seen])
        waits = {}
        for e in dict.fromkeys(s.exit for s in seen if len(s.go)):
            rows = np.concatenate([s.go for s in seen if s.exit == e])
            happened = {i for i in self.own if self.features[i].side and separation(rows[:, i], way[:, i]) >= SEPARATED}
            arrived = {i for i in self.own if self.reached(e, i) and self.features[i].name in moved}
            if not happened and self.data.interrupted(self.node, e) and (event := self._event(seen, e)):
                seen = [s.cut(event) if s.exit == e else s for s in seen]
                happened = {event.feature}
            waits[e] = Waits(happened or arrived or set(self.own), set(), bool(happened))
        confused = _confused(seen, waits)
        for e, context in self._context([s for s in seen if s.exit in confused and len(s.go)]).items():
            waits[e] = waits[e]._replace(context=context)
        return waits, seen

    def at_the_start(self, seen: list[Seen]) -> dict[int, Waits]:
        """What tells the exits of node 0 apart, which wait for nothing; all features where nothing does."""
        context = self._context([s for s in seen if len(s.go)])
        needed = any(context.values())
        return {e: Waits(set(), own if needed else set(range(len(self.features))), False) for e, own in context.items()}

    def _event(self, seen: list[Seen], exit_: int) -> Event | None:
        """The named observation whose change ended the passages to an exit."""
        through = [s for s in seen if len(s.way)]
        ended = [s.rows for s in through if s.exit == exit_]
        others = [s.rows for s in through if s.exit != exit_]
        return telling_event(ended, others, self.alike, self.events) if ended else None

    def _context(self, seen: list[Seen]) -> dict[int, set[int]]:
        """For each of the exits that wait for the same, the features that tell it from the others."""
        groups = self._alternatives(list(dict.fromkeys(s.exit for s in seen)))
        others = [i for i in range(len(self.features)) if i not in self.own and i not in self.observed]
        kind = {e: number for number, (exits, _) in enumerate(groups) for e in exits}
        needed = _telling(seen, [kind[s.exit] for s in seen], (self.observed, others))
        context = {e: needed[kind[e]] for e in kind}
        for exits, distances in groups:
            among = [s for s in seen if s.exit in exits]
            for e, features in _telling(among, [s.exit for s in among], (distances, self.observed, others)).items():
                nearer = set(distances) if features & set(distances) else set()
                context[e] = context[e] | features | nearer
        return context

    def _alternatives(self, exits: list[int]) -> list[tuple[list[int], list[int]]]:
        """The exits in groups of alternatives, and the features that are the distances to their goals; none for one."""
        groups: list[tuple[list[int], list[int]]] = []
        while exits:
            candidates: list[tuple[list[int], list[int]]] = [([exits[0]], [])]
            for entity in ENTITIES:
                same = [e for e in exits if e == exits[0] or self._differ_in(entity, exits[0], e)]
                labels = {self.data.graph.labels[e] for e in same}
                name = f"{entity}, whole way"
                distances = [i for i, f in enumerate(self.features) if f.name == name and f.primitive in labels]
                candidates += [(same, distances)] * (len(distances) == len(same) > 1)
            groups.append(max(candidates, key=lambda group: len(group[0])))
            exits = [e for e in exits if e not in groups[-1][0]]
        return groups

    def _differ_in(self, entity: str, a: int, b: int) -> bool:
        """Whether two exits have different goals of one entity in the same frame, and the same goals of the others."""
        if END in (a, b):
            return False
        table, labels = self.data.primitives.table, [self.data.graph.labels[e] for e in (a, b)]
        (one, other), frames = table.shared[labels], table.entity_frames()[labels]
        e = list(ENTITIES).index(entity)
        return bool((one != other).sum() == 1 and one[e] != other[e] and frames[0, e] == frames[1, e])


def _telling(seen: list[Seen], classes: list[int], stages: Sequence[Sequence[int]]) -> dict[int, set[int]]:
    if len(set(classes)) < 2:
        return {c: set() for c in classes}
    needed = telling_features(
        np.array([s.go.mean(axis=0) for s in seen]),
        np.array(classes),
        np.array([s.demonstration for s in seen]),
        stages,
    )
    return {c: set(features) for c, features in needed.items()}


def _confused(seen: list[Seen], waits: dict[int, Waits]) -> set[int]:
    """Exits that what they wait for does not tell from each other."""
    at = {e: np.concatenate([s.go for s in seen if s.exit == e]) for e in waits}
    pairs = [
        (a, b)
        for a, b in combinations(waits, 2)
        if max(separation(at[a][:, i], at[b][:, i]) for i in waits[a].own | waits[b].own) < SEPARATED
    ]
    return {e for pair in pairs for e in pair}
