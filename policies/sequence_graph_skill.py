"""The skill of chapter 2: a sequence graph whose nodes activate attractors and decide when to move on."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym import quaternion
from lfd_gym.action import ActionLayout
from policies.consistency import check_graph
from policies.decisions import DECISIONS, Decision
from policies.goal_distance import goal_distance
from policies.movement_primitives import MovementPrimitives
from policies.named_observations import NamedObservations
from policies.object_motion import MOTION, motions, tool_in_frames
from policies.passages import END
from policies.primitive_attractor import Goals, command
from policies.sequence_graph import SequenceGraph
from policies.skill import Observation, Skill, State
from policies.task_data import WORLD, Measurement, PrimitiveTable, deviation, task_coordinates

Array = NDArray[np.float64]

STILL_POSITION, STILL_ANGLE = 0.002, 0.02
"""Motion [m], [rad] since it last moved within which the robot counts as still: in the world, or in its primitive's frame, for
what is held may creep with the hand that is to stay beside it."""


class Node(NamedTuple):
    """What one node knows, beside its primitive."""

    feature_names: tuple[str, ...]
    feature_primitives: NDArray[np.int64]
    """(n,) whose goal distance each feature is; -1 for a named observation."""
    feature_columns: NDArray[np.int64]
    """(n,) which component of the skill's named observations each feature is; -1 for a goal distance."""
    gains: Array
    """(n, N_COORDINATES)."""
    sides: Array
    """(n,)."""
    targets: NDArray[np.int64]
    """(C,) node to go to for every class of the decision: the node itself to stay."""
    dwell: Array
    """(C,) how long [s] the decision for a class has to last before it is followed."""
    decision: Decision | None
    """None in a terminal node."""
    patience: float
    """Stillness [s] after which the best exit is taken whatever the decision; infinite for never."""


TABLE_ARRAYS = tuple(name for name in PrimitiveTable._fields if name != "frames")
PRIMITIVE_ARRAYS = ("mean", "goal", "grip", "force", "speed", "acceleration")
OBSERVED_ARRAYS = ("indices", "low", "high")
NODE_ARRAYS = ("feature_primitives", "feature_columns", "gains", "sides", "targets", "dwell")


class Memory(NamedTuple):
    """State of a skill, one row per environment."""

    node: NDArray[np.int64]
    """(n,) active node; 0 before the first observation."""
    position: Array
    """(n, 3) last goal of the tool point, world frame [m]; what a primitive holds."""
    quaternion: Array
    """(n, 4) last goal orientation, world frame."""
    hand: Array
    """(n, 4) last goal of the hand [rad]."""
    pull: Array
    """(n, 3) where the attractor of the position pulled last, world frame [m]."""
    pace: Array
    """(n,) how fast that place moved [m/s]."""
    anchor: Array
    """(n, 18) what `stance` makes of the frame of the active primitive, when the robot last moved."""
    still: Array
    """(n,) time since then [s]."""
    chosen: NDArray[np.int64]
    """(n,) class that the node's decision chose last; 0 is to stay."""
    lasted: Array
    """(n,) since when it chose it [s]."""
    began: Array
    """(n, F, 3) tool point in every frame when the node became active [m]."""


class SequenceGraphSkill(Skill):
    """Activates the attractor of the current node and asks its classifier whether to move on (thesis 2.1.2)."""

    kind: ClassVar[str] = "sequence-graph"

    def __init__(
        self,
        graph: SequenceGraph,
        primitives: MovementPrimitives,
        nodes: Sequence[Node],
        named: NamedObservations,
        layout: ActionLayout,
        dt: float,
        **facts: Any,
    ) -> None:
        """Parts as learned; named are the observations that the nodes look at; dt is the control step [s]; facts as in
        `Skill`."""
        super().__init__(**facts)
        self.graph, self.primitives, self.nodes, self.named = graph, primitives, tuple(nodes), named
        self.layout, self.dt = layout, dt
        self.primitive_names = primitives.names
        self._frame_keys = ["frame_" + name for name in primitives.table.frames[1:]]
        self._motions = {
            MOTION + name: f for f, name in enumerate(primitives.table.frames) if MOTION + name in named.keys
        }

    def active(self, state: State) -> NDArray[np.int64]:
        """Label of the active primitive of every row; -1 before the first observation."""
        return np.array(self.graph.labels)[Memory(*state).node]

    def start(self, n: int) -> State:
        """Before the first observation nothing is active; the first one fills the goals."""
        identity = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
        none, zero = np.zeros(n, dtype=np.int64), np.zeros(n)
        place = np.zeros((n, 3))
        began = np.zeros((n, len(self.primitives.table.frames), 3))
        return Memory(none, place, identity, np.zeros((n, 4)), place, zero, np.zeros((n, 18)), zero, none, zero, began)

    def decide(self, observation: Observation, state: State) -> tuple[NDArray[np.float32], State]:
        """One control step: classify, then the goal of the node that is active now."""
        seen, frames, place, memory = self._perceive(observation, state)
        now = self._stance(seen, frames, int(memory.node))
        still = _is_still(now, memory.anchor)
        memory = memory._replace(
            anchor=memory.anchor if still else now, still=memory.still + self.dt if still else np.array(0.0)
        )
        observed = self._named(observation, place, memory.began)
        memory = self._move_on(seen, frames, place, observed, memory)
        label = self.graph.labels[int(memory.node)]
        before = Goals(memory.position, memory.quaternion, memory.hand, memory.pull, memory.pace)
        goals, force = command(self.primitives, label, seen, frames, before, observation, self.dt)
        action = self.layout.encode(goals.pull, goals.quaternion, force, goals.hand[: self.layout.hand_low.size])
        return action, memory._replace(**goals._asdict())

    def look(self, observation: Observation, state: State) -> tuple[int, Array]:
        """The node that is active before this step, and its features (n,)."""
        seen, frames, place, memory = self._perceive(observation, state)
        node = int(memory.node)
        return node, self.features(node, seen, frames, self._named(observation, place, memory.began))

    def scores(self, node: int, decision: Decision, features: Array) -> Array:
        """Activation (C,) of every class of a node, whose decision this is."""
        return decision.scores(features)

    def features(self, node: int, seen: Array, frames: Array, observed: Array) -> Array:
        """Features (n,) of a node for one measurement."""
        this, p = self.nodes[node], self.primitives
        table = p.table
        return _features(
            seen, frames, observed, this.feature_primitives, this.feature_columns, this.gains, this.sides,
            table.position_frame, table.orientation_frame, table.space, p.mean, p.goal,
        )  # fmt: skip

    def _perceive(self, observation: Observation, state: State) -> tuple[Array, Array, Array, Memory]:
        """What `_measure` returns, and the memory, which the first observation fills."""
        seen, frames, place = self._measure(observation)
        memory = Memory(*state)
        if memory.node == 0:
            memory = memory._replace(
                position=seen[:3], quaternion=seen[3:7], hand=seen[7:], pull=seen[:3],
                anchor=self._stance(seen, frames, 0), began=place,
            )  # fmt: skip
        return seen, frames, place, memory

    def _measure(self, observation: Observation) -> tuple[Array, Array, Array]:
        """Position, quaternion and hand (11,), the frames (F, 7), and the tool point in them (F, 3)."""
        seen = np.zeros(11)
        seen[:3] = observation["tool_position"]
        seen[3:7] = observation["tool_quaternion"]
        if self.layout.hand_low.size:
            seen[7:] = observation["hand_position"]
        frames = np.empty((len(self._frame_keys) + 1, 7))
        frames[0] = WORLD
        for i, key in enumerate(self._frame_keys, start=1):
            frames[i] = observation[key]
        return seen, frames, tool_in_frames(seen[:3], frames)

    def _stance(self, seen: Array, frames: Array, node: int) -> Array:
        """What the anchor is compared with (18,)."""
        return stance(seen, frames[self.primitives.table.position_frame[self.graph.labels[node]] if node else 0])

    def _named(self, observation: Observation, place: Array, began: Array) -> Array:
        """The scaled named observations (D,)."""
        if not self._motions:
            return self.named.scaled(observation)
        moved = motions(place, began)
        return self.named.scaled({**observation, **{key: moved[f : f + 1] for key, f in self._motions.items()}})

    def _move_on(self, seen: Array, frames: Array, place: Array, observed: Array, memory: Memory) -> Memory:
        """Follow the largest activation once it has lasted; the best exit where the robot was still for too long."""
        current, zero = int(memory.node), np.array(0.0)
        node = self.nodes[current]
        if node.decision is None:
            return memory
        scores = self.scores(current, node.decision, self.features(current, seen, frames, observed))
        chosen = int(np.argmax(scores))
        lasted = memory.lasted + self.dt if chosen == memory.chosen else zero
        if memory.still > node.patience:
            chosen = int(np.argmax(np.where(node.targets == current, -np.inf, scores)))
        elif lasted < node.dwell[chosen] - 1e-9:
            return memory._replace(chosen=np.array(chosen), lasted=lasted)
        if (following := int(node.targets[chosen])) == current:
            return memory._replace(chosen=np.array(chosen), lasted=lasted)
        return memory._replace(
            node=np.array(following), pace=zero, anchor=self._stance(seen, frames, following), still=zero,
            chosen=np.array(0), lasted=zero, began=place,
        )  # fmt: skip

    def to_arrays(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Graph, primitives and nodes."""
        p = self.primitives
        arrays: dict[str, NDArray[Any]] = {name: getattr(p.table, name) for name in TABLE_ARRAYS}
        arrays |= {name: getattr(p, name) for name in PRIMITIVE_ARRAYS}
        arrays |= {f"observed_{name}": getattr(self.named, name) for name in OBSERVED_ARRAYS}
        described = []
        kinds = {cls: name for name, cls in DECISIONS.items()}
        for i, node in enumerate(self.nodes):
            for name in NODE_ARRAYS:
                arrays[f"node{i}_{name}"] = getattr(node, name)
            decision: Any = node.decision
            kind = None if decision is None else kinds[type(decision)]
            if decision is not None:
                arrays |= {f"node{i}_decision_{name}": np.asarray(a) for name, a in decision._asdict().items()}
            patience = node.patience if np.isfinite(node.patience) else None
            described.append({"features": list(node.feature_names), "decision": kind, "patience": patience})
        values = {
            "graph": self.graph.to_dict(), "names": list(p.names), "frames": list(p.table.frames),
            "observations": list(self.named.keys),
            "layout": self.layout.to_dict(), "dt": self.dt, "nodes": described,
        }  # fmt: skip
        return values, arrays

    @classmethod
    def from_arrays(cls, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], **facts: Any) -> Self:
        """The skill that `to_arrays` described."""
        table = PrimitiveTable(**{name: arrays[name] for name in TABLE_ARRAYS}, frames=tuple(header["frames"]))
        primitives = MovementPrimitives(
            tuple(header["names"]), table, **{name: arrays[name] for name in PRIMITIVE_ARRAYS}
        )
        nodes = []
        for i, node in enumerate(header["nodes"]):
            prefix = f"node{i}_decision_"
            parts = {name.removeprefix(prefix): a for name, a in arrays.items() if name.startswith(prefix)}
            decision = None if node["decision"] is None else DECISIONS[node["decision"]](**parts)
            plain = {name: arrays[f"node{i}_{name}"] for name in NODE_ARRAYS}
            patience = np.inf if node["patience"] is None else node["patience"]
            nodes.append(Node(tuple(node["features"]), decision=decision, patience=patience, **plain))
        graph, layout = SequenceGraph.from_dict(header["graph"]), ActionLayout.from_dict(header["layout"])
        bounds = {name: arrays[f"observed_{name}"] for name in OBSERVED_ARRAYS}
        named = NamedObservations(tuple(header["observations"]), **bounds)
        check_graph(graph.labels, primitives, nodes, named, layout, header["dt"])
        return cls(graph, primitives, nodes, named, layout, header["dt"], **facts)


def class_targets(node: int, exits: Sequence[int]) -> NDArray[np.int64]:
    """Node that each class stands for: class 0 and the end of the demonstration are to stay."""
    return np.array([node, *(node if e == END else e for e in exits)], dtype=np.int64)


def longest_stillness(measured: Measurement, start: int, stop: int, frame: int) -> int:
    """Largest number of samples between two steps during which the robot counted as still, in the world or in a frame."""
    position, turned, hand, frames = (values[start : stop + 1] for values in measured)
    world = np.concatenate([position, turned, hand], axis=1)
    seen = np.array([stance(x, poses[frame]) for x, poses in zip(world, frames, strict=True)])
    longest, since, anchor = 0, 0, seen[0]
    for t in range(1, len(seen)):
        if not _is_still(seen[t], anchor):
            anchor, since = seen[t], t
        longest = max(longest, t - since)
    return longest


@njit(cache=True)
def stance(seen: Array, frame: Array) -> Array:
    """Position, quaternion and hand (11,), followed by position and quaternion in a frame (7,): (18,)."""
    result = np.empty(18)
    back = quaternion.conjugate(frame[3:])
    result[:11] = seen
    result[11:14] = quaternion.rotate(back, seen[:3] - frame[:3])
    result[14:] = quaternion.multiply(back, seen[3:7])
    return result


@njit(cache=True)
def _turned(one: Array, other: Array) -> bool:
    return 2.0 * np.sqrt(max(0.0, 1.0 - np.dot(one, other) ** 2)) > STILL_ANGLE


@njit(cache=True)
def _is_still(seen: Array, anchor: Array) -> bool:
    if np.abs(seen[7:11] - anchor[7:11]).max() > STILL_ANGLE:
        return False
    away = seen[11:14] - anchor[11:14]
    in_world = np.abs(seen[:3] - anchor[:3]).max() <= STILL_POSITION and not _turned(seen[3:7], anchor[3:7])
    return bool(in_world or (away @ away <= STILL_POSITION**2 and not _turned(seen[14:], anchor[14:])))


@njit(cache=True)
def _features(
    seen: Array,
    frames: Array,
    observed: Array,
    primitives: NDArray[np.int64],
    columns: NDArray[np.int64],
    gains: Array,
    sides: Array,
    position_frame: NDArray[np.int64],
    orientation_frame: NDArray[np.int64],
    space: NDArray[np.int64],
    mean: Array,
    goal: Array,
) -> Array:
    result = np.empty(len(primitives))
    for j in range(len(primitives)):
        k = primitives[j]
        if k < 0:
            result[j] = observed[columns[j]]
            continue
        at, turned = frames[position_frame[k]], frames[orientation_frame[k]]
        x = task_coordinates(seen[:3], seen[3:7], seen[7:], at, turned, space[k], mean[k])
        result[j] = goal_distance(deviation(x, goal[k], space[k]), gains[j], sides[j])
    return result
