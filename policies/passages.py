"""Passages: the demonstrations cut at the transition points of a graph, and when each of them had arrived (thesis 2.4).

The thesis labels the data between the previous and the next transition point with the primitive that was active. A
teacher who pauses before the next movement makes this contradictory: the state just before the transition point is the
state just after it, and a skill that learned "before is stay" waits at the goal for ever. Two rules make it decidable:

1. *Arrival.* From the moment on from which a passage stays within `TOLERANCE` of its end, its samples count for the
   successor. What comes after the transition point is the successor's own doing and is not used.
2. *The demonstrator's own goal.* Goals differ by a centimetre from one demonstration to the next. Where a passage
   ended within `SCATTER` of the learned goal it had arrived, and its distances are taken to its own end; so transitions
   are as accurate as single demonstrations, not as their spread. (Not for the hand, which stalls where an object lets
   it.) Most passages to an exit that ended at rest had arrived wherever they are: the goals of a less careful
   demonstrator are farther apart. One that was stopped early, where most to the same exit arrived, says nothing about it.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.movement_primitives import MovementPrimitives
from policies.named_observations import NamedObservations
from policies.object_motion import MOTION
from policies.sequence_graph import SequenceGraph, TransitionPoint, segments
from policies.task_data import CONTROLLED, ENTITIES, FORCE, Measurement, deviations, trajectory

Array = NDArray[np.float64]

TOLERANCE = {"position": 0.004, "orientation": 0.035, "hand": 0.05, "force": 0.001}
"""[m], [rad], [rad], [m]: nearer than this is arrived; about twice the controller's residual error, so that the learned
goal itself is always well inside. Along a force axis nothing is reached: there it is the measurement's resolution."""
SCATTER = {"position": 0.05, "orientation": 0.26, "hand": 0.35}
"""[m], [rad], [rad]: farther from the learned goal a passage did not end at it. Five times the standard deviation of a human's
goals along one axis, three times that of their distance."""
WIDER = 2.0
"""Where most passages ended at rest: the same in medians of their distances."""
MOVING = 0.06
"""A passage that was nearer to its end for less than this did not rest there [s]."""
END, BROKEN_OFF = -1, -2
"""Exits of a passage with which a demonstration ended, and with which it broke off, which shows no exit."""


class Passage(NamedTuple):
    """One time that a demonstration went through a node."""

    demonstration: int
    node: int
    start: int
    """First observation."""
    stop: int
    """Last observation, which the teacher saw when it switched."""
    exit: int
    """Next node, END or BROKEN_OFF."""


def passages(
    graph: SequenceGraph, labels: Sequence[NDArray[np.int64]], broken_off: Collection[int] = ()
) -> list[Passage]:
    """Every demonstration cut at its transition points, in order; node 0 is left at its first observation."""
    node_at = {point: b for (_, b), points in graph.transitions.items() for point in points}
    result = []
    for m, sequence in enumerate(labels):
        parts = segments(sequence)
        nodes = [node_at[TransitionPoint(m, part.start)] for part in parts]
        last = BROKEN_OFF if m in broken_off else END
        result.append(Passage(m, 0, 0, 0, nodes[0]))
        for part, node, following in zip(parts, nodes, [*nodes[1:], last], strict=True):
            result.append(Passage(m, node, part.start, part.stop, following))
    return result


class PassageData:
    """Task-space data of every passage through a graph, relative to the learned goals."""

    def __init__(
        self,
        graph: SequenceGraph,
        primitives: MovementPrimitives,
        measurements: Sequence[Measurement],
        labels: Sequence[NDArray[np.int64]],
        named: NamedObservations,
        observed: Sequence[Array],
        dt: float,
        broken_off: Collection[int] = (),
    ) -> None:
        """observed: per demonstration the scaled named observations (T + 1, D); dt: time step [s]; broken_off: demonstrations
        without an end."""
        self.graph, self.primitives, self.named, self._observed, self._dt = graph, primitives, named, observed, dt
        self._motions = [c for c, key in enumerate(named.keys) if key.startswith(MOTION)]
        self.passages = passages(graph, labels, broken_off)
        self.labels = sorted({label for label in graph.labels if label >= 0})
        self._deviations = {
            (m, k): deviations(
                trajectory(measured, primitives.table, k, primitives.mean[k]),
                primitives.goal[k],
                int(primitives.table.space[k]),
            )
            for m, measured in enumerate(measurements)
            for k in self.labels
        }
        self._scatter: dict[tuple[int, int], dict[str, float]] = {}
        self._arrived: dict[tuple[int, int], set[str]] = {}
        for node, exit_ in {(p.node, p.exit) for p in self.passages if p.node != 0}:
            own = [p for p in self.passages if (p.node, p.exit) == (node, exit_)]
            self._scatter[node, exit_] = self._widened(own)
            entities = self.controlled(graph.labels[node])
            self._arrived[node, exit_] = {e for e in entities if np.mean([self._at_goal(p, e) for p in own]) >= 0.5}

    def observed(self, p: Passage) -> Array:
        """Scaled named observations (N, D) along a passage; nothing has moved when it begins."""
        rows = self._observed[p.demonstration][p.start : p.stop + 1].copy()
        rows[0, self._motions] = 0.0
        return rows

    def everywhere(self, k: int) -> list[Array]:
        """x - g (T + 1, N_COORDINATES) of primitive k along every whole demonstration."""
        return [deviations for (_, own), deviations in self._deviations.items() if own == k]

    def controlled(self, k: int) -> list[str]:
        """Entities that primitive k moves to a goal."""
        return [e for e, part in ENTITIES.items() if (self.primitives.table.modes[k, part] == CONTROLLED).any()]

    def forced(self, k: int) -> list[int]:
        """Coordinates along which primitive k presses."""
        return np.flatnonzero(self.primitives.table.modes[k] == FORCE).tolist()

    def distance(self, k: int, entity: str, deviations: Array) -> Array:
        """Norm over the controlled axes of one entity of deviations (..., N_COORDINATES)."""
        return _distance(deviations, self.primitives.table.modes[k], entity)

    def arrived(self, node: int, exit_: int) -> set[str]:
        """Entities at whose goal most passages from a node to an exit ended: the exit waits for them."""
        return self._arrived.get((node, exit_), set())

    def moved(self, node: int) -> set[str]:
        """Entities that a node moves, not merely keeps: in most passages by more than half of `SCATTER`, or the one
        that moves most."""
        k, own = self.graph.labels[node], [p for p in self.passages if p.node == node]
        travel = {
            e: np.median([self.distance(k, e, self.deviations(p, k)).max() for p in own]) / SCATTER[e]
            for e in self.controlled(k)
        }
        return {e for e, way in travel.items() if way >= 0.5 or way == max(travel.values())}

    def alike(self, p: Passage, node: int) -> bool:
        """Whether a passage performed the primitive of a node elsewhere in the graph, and went on to none of its exits'."""
        labels = self.graph.labels
        following = {labels[e] for e in self.graph.successors(node)}
        elsewhere = p.node != node and labels[p.node] == labels[node]
        return elsewhere and (p.exit < 0 or labels[p.exit] not in following)

    def stopped_early(self, p: Passage) -> bool:
        """Whether a passage missed a goal that most passages to its exit reached (rule 2)."""
        return any(not self._at_goal(p, entity) for entity in self.arrived(p.node, p.exit))

    def interrupted(self, node: int, exit_: int) -> bool:
        """Whether most passages from a node to an exit ended in motion: something happened before the goal."""
        own = [p for p in self.passages if (p.node, p.exit) == (node, exit_)]
        rests = [p.stop - p.start - _settled(self._outside(p)) for p in own]
        return bool(own) and float(np.mean(np.array(rests) < max(round(MOVING / self._dt), 1))) > 0.5

    def arrival(self, p: Passage) -> int:
        """Number of samples on the way; from there on the passage stays within tolerance of its end (rule 1)."""
        if p.node == 0:
            return 0
        outside, to_end = self._outside(p), self._to_end(p)
        for i in self.forced(self.graph.labels[p.node]):
            outside |= np.abs(to_end[:, i]) > TOLERANCE["force"]
        return _settled(outside)

    def _to_end(self, p: Passage) -> Array:
        x = self._deviations[p.demonstration, self.graph.labels[p.node]][p.start : p.stop + 1]
        return x - x[-1]

    def _outside(self, p: Passage) -> NDArray[np.bool_]:
        """Per sample whether an entity that is moved to a goal is farther from its end than `TOLERANCE`."""
        return away(self._to_end(p), self.primitives.table.modes[self.graph.labels[p.node]])

    def deviations(self, p: Passage, k: int) -> Array:
        """x - g (N, N_COORDINATES) of primitive k along a passage; to its own goal where that is known (rule 2)."""
        x = self._deviations[p.demonstration, k][p.start : p.stop + 1].copy()
        if p.node != 0 and k == self.graph.labels[p.node]:
            own = np.zeros(x.shape[1])
            for entity in self.arrived(p.node, p.exit) - {"hand"}:
                if self._at_goal(p, entity):
                    own[ENTITIES[entity]] = x[-1, ENTITIES[entity]]
            x -= own * (self.primitives.table.modes[k] == CONTROLLED)
        return x

    def _at_goal(self, p: Passage, entity: str) -> bool:
        return self._missed(p, entity) <= self._scatter[p.node, p.exit][entity]

    def _missed(self, p: Passage, entity: str) -> float:
        """Distance of the end of a passage to the learned goal."""
        k = self.graph.labels[p.node]
        return float(self.distance(k, entity, self._deviations[p.demonstration, k][p.stop]))

    def _widened(self, own: list[Passage]) -> dict[str, float]:
        """`SCATTER`, or more where most of the passages ended at rest; the hand also rests where an object stops it."""
        if self.interrupted(own[0].node, own[0].exit):
            return SCATTER
        ends = {e: WIDER * float(np.median([self._missed(p, e) for p in own])) for e in ("position", "orientation")}
        return {e: max(most, ends.get(e, 0.0)) for e, most in SCATTER.items()}


def away(deviations: Array, modes: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Per row (N, N_COORDINATES) whether an entity is farther than `TOLERANCE` along axes that are controlled."""
    return np.any([_distance(deviations, modes, entity) > TOLERANCE[entity] for entity in ENTITIES], axis=0)


def _distance(deviations: Array, modes: NDArray[np.int64], entity: str) -> Array:
    part = ENTITIES[entity]
    return np.linalg.norm(deviations[..., part] * (modes[part] == CONTROLLED), axis=-1)


def _settled(outside: NDArray[np.bool_]) -> int:
    """First sample from which on nothing is outside."""
    return int(np.flatnonzero(outside)[-1]) + 1 if outside.any() else 0
