"""The learner of chapter 2: goals, graph, transitions (Figure 2.2), from labelled demonstrations."""

import warnings
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lfd_gym.demonstration import Demonstration, check_measured, taught_seeds
from lfd_gym.errors import DemonstrationError, InvalidArgumentError, UnknownNameError
from policies.arguments import check_flag, check_number
from policies.features import KINDS
from policies.goals import TIMES, NormalisedTime
from policies.late_labels import on_time
from policies.learner import Learner
from policies.movement_primitives import MovementPrimitives, learn_primitives
from policies.named_observations import NamedObservations, named_observations
from policies.node_learner import NodeLearner
from policies.object_motion import motion_observations
from policies.outliers import LEAST_FORCE, find_outliers
from policies.passages import BROKEN_OFF, PassageData
from policies.sequence_graph import GRAPHS, MATCHES, SequenceGraph, global_graph
from policies.sequence_graph_skill import Node, SequenceGraphSkill, longest_stillness
from policies.task_data import CONTROLLED, FORCE, HAND, POSITION, measure, primitive_table
from policies.task_space import AXES
from policies.transition_data import TransitionData
from policies.transitions import CLASSIFIERS, KERNELS

OUTLIERS = ("warn", "drop", "keep")


class OutlierWarning(UserWarning):
    """A demonstration is unlike the others."""


class ForceWarning(UserWarning):
    """A primitive that is to press never did."""


class SequenceGraphLearner(Learner):
    """Sequence graph of movement primitives with a classifier in every node (thesis 2.2-2.4).

    Parameters:
        graph: "global", "local" or "fully-connected" (2.3).
        classifier: "svm", "lr", "klr" (kernel logistic regression), "ivm" (import vector machine) or "gmm" (2.4).
        kernel: of the SVM, "rbf" or "linear"; a class that lies on both sides of another needs the former.
        C: inverse strength of the classifier's regularisation.
        feature: "entity", one goal distance per entity and side of a force axis, chosen per node; or "primitive", the
            thesis's one scalar per primitive, of the node and all its successors.
        observations: names of the observations that may be features beside goal distances (2.5.3), see
            `named_observations` and `object_motion`; None: all that are not poses. With feature="entity" a node looks at few
            of them, where it has to (see `transition_data`); with "primitive" at all that are named.
        time: normalised time of goal learning, "squared" as printed in (2.4), "arclength" or "real".
        fold: whether repetitions become cycles (2.3.2).
        match: how folded graphs are merged, see `sequence_graph.merge`.
        dwell: the decision for an exit has to last for this many times the shortest rest that was demonstrated before
            it: what takes a moment to show is waited for as the demonstrator did. 0: it is followed at once.
        patience: a robot that stands still in a node for longer than this many times the longest stillness demonstrated
            there, plus half a second, takes its best exit, for it cannot reach what it waits for. None: never.
        outliers: what to do with a demonstration that is unlike the others (5.2.4, see `outliers`): "warn" names it and
            uses it, "drop" names it and leaves it out, "keep" does not look.
    """

    reads = ("hand_position", "hand_torque")

    def __init__(
        self,
        graph: str = "global",
        classifier: str = "svm",
        kernel: str = "rbf",
        C: float = 10.0,
        feature: str = "entity",
        observations: tuple[str, ...] | None = None,
        time: NormalisedTime = "arclength",
        fold: bool = True,
        match: Literal["label", "inputs"] = "label",
        dwell: float = 1.0,
        patience: float | None = 1.0,
        outliers: str = "warn",
    ) -> None:
        self.graph, self.classifier, self.kernel, self.C = graph, classifier, kernel, C
        self.feature, self.observations, self.time, self.fold, self.match = feature, observations, time, fold, match
        self.dwell, self.patience, self.outliers = dwell, patience, outliers

    def learn(self, demonstrations: Sequence[Demonstration]) -> SequenceGraphSkill:
        """Goals first, then the graph, then one classifier per node."""
        self.check_arguments()
        first = demonstrations[0]
        names = tuple(primitive.name for primitive in first.primitives)
        table = primitive_table(first.primitives, list(first.observations))
        needed = [f"frame_{name}" for name in table.frames[1:]] + ["wrench"] * bool((table.modes == FORCE).any())
        needed += ["hand_position"] * bool((table.modes[:, HAND] == CONTROLLED).any())
        for i, demonstration in enumerate(demonstrations):
            check_measured(f"demonstration {i}", demonstration, needed)
        demonstrations = self._alike(demonstrations)
        measurements = [measure(demonstration.observations, table.frames) for demonstration in demonstrations]
        demonstrations = [on_time(d, own, table) for d, own in zip(demonstrations, measurements, strict=True)]
        labels = [demonstration.labels for demonstration in demonstrations]
        primitives = learn_primitives(names, table, demonstrations, measurements, self.time)
        _warn_of_missing_forces(primitives, labels)
        failed = [m for m, demonstration in enumerate(demonstrations) if not demonstration.success]
        broken_off = failed if len(failed) < len(demonstrations) else []
        graph = self._sequence_graph(labels, broken_off)
        wanted = () if self.observations is None and self.feature == "primitive" else self.observations
        seen = [
            {**demonstration.observations, **motion_observations(measured, demonstration.labels, table.frames)}
            for demonstration, measured in zip(demonstrations, measurements, strict=True)
        ]
        named = named_observations(seen, wanted)
        scaled = [named.scaled(values) for values in seen]
        data = PassageData(graph, primitives, measurements, labels, named, scaled, float(first.dt), broken_off)
        transitions = TransitionData(data, self.feature)
        settings: dict[str, Any] = {"C": self.C} | ({"kernel": self.kernel} if self.classifier == "svm" else {})
        node_learner = NodeLearner(
            self.classifier, settings, self.dwell, self.patience, float(first.dt), graph.node_names(names)
        )
        nodes = []
        for node in range(graph.n_nodes):
            own = [p for p in data.passages if p.node == node and p.exit != BROKEN_OFF]
            frame = int(table.position_frame[graph.labels[node]]) if node else 0
            still = [longest_stillness(measurements[p.demonstration], p.start, p.stop, frame) for p in own]
            nodes.append(node_learner.learn(node, transitions.node(node), max(still, default=0)))
        return SequenceGraphSkill(
            graph,
            primitives,
            *_in_use(nodes, named),
            first.layout,
            float(first.dt),
            env_id=first.env_id,
            taught_seeds=taught_seeds(demonstrations),
            metadata={"learner": self._summary(), "parameters": self.get_params(), "taught_with": len(demonstrations)},
        )

    def check_arguments(self) -> None:
        """Raise UnknownNameError or InvalidArgumentError for an argument of the constructor that is not possible."""
        possible = {"graph": tuple(GRAPHS), "classifier": tuple(CLASSIFIERS), "kernel": KERNELS, "feature": KINDS}
        for name, values in (possible | {"time": TIMES, "match": MATCHES, "outliers": OUTLIERS}).items():
            if getattr(self, name) not in values:
                raise UnknownNameError(name, str(getattr(self, name)), values)
        check_flag("fold", self.fold)
        if not (self.observations is None or isinstance(self.observations, list | tuple)):
            raise InvalidArgumentError(f"observations is {self.observations!r}; possible: None, a list of names")
        check_number("C", self.C, 1e-9, 1e9)
        check_number("dwell", self.dwell, 0.0, 1e9)
        if self.patience is not None:
            check_number("patience", self.patience, 0.0, 1e9)

    def _alike(self, demonstrations: Sequence[Demonstration]) -> Sequence[Demonstration]:
        """The demonstrations to learn from, outliers named."""
        found = [] if self.outliers == "keep" else find_outliers(demonstrations)
        for outlier in found:
            done = "is left out" if self.outliers == "drop" else "is used all the same; outliers='drop' leaves it out"
            warnings.warn(f"{outlier}; it {done}", OutlierWarning, stacklevel=4)
        left_out = {outlier.index for outlier in found} if self.outliers == "drop" else set()
        if len(left_out) == len(demonstrations):
            raise DemonstrationError("every demonstration is an outlier; outliers='keep' learns from them all the same")
        return [demonstration for i, demonstration in enumerate(demonstrations) if i not in left_out]

    def _sequence_graph(self, labels: Sequence[NDArray[np.int64]], broken_off: Sequence[int]) -> SequenceGraph:
        if self.graph == "global":
            return global_graph(labels, self.fold, self.match, broken_off)
        return GRAPHS[self.graph](labels)

    def _summary(self) -> str:
        classifier = f"{self.kernel} {self.classifier}" if self.classifier == "svm" else self.classifier
        return f"sequence-graph, {self.graph}, {classifier}"


def _in_use(nodes: Sequence[Node], named: NamedObservations) -> tuple[list[Node], NamedObservations]:
    """The nodes with the named observations that one of them looks at, and those alone."""
    columns = sorted({int(c) for node in nodes for c in node.feature_columns if c >= 0})
    position = {column: i for i, column in enumerate([-1, *columns], start=-1)}
    renumbered = [
        node._replace(feature_columns=np.array([position[c] for c in node.feature_columns], dtype=np.int64))
        for node in nodes
    ]
    return renumbered, named.only(columns)


def _warn_of_missing_forces(primitives: MovementPrimitives, labels: Sequence[NDArray[np.int64]]) -> None:
    for k in np.unique(np.concatenate(labels)):
        axes = AXES[primitives.table.space[k]]
        for i in np.flatnonzero(primitives.table.modes[k, POSITION] == FORCE):
            if abs(primitives.force[k, i]) < LEAST_FORCE:
                warnings.warn(
                    f"'{primitives.names[k]}' shall press along {axes[i]}, but its demonstrations show no force there, and the "
                    "skill will not press; let the primitive table control the position, or check the force sensor",
                    ForceWarning,
                    stacklevel=4,
                )
