"""The sequence graph as a semi-Markov decision process: frozen classifiers, and a residual that is learned on top.

What is decided is which class of the active node's classifier is followed: to stay, or to go to one of its successors. Its
logarithmic probabilities are the frozen part; a network of node and features adds to them (thesis 5.2.3, Sutton et al. 1999).
What it adds is bounded: a choice that fails while an earlier decision is not yet right stays possible until it is.
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Discrete
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from policies.decisions import Decision, VotingDecision
from policies.reinforcement.network import Network, check_network
from policies.sequence_graph_skill import SequenceGraphSkill

Array = NDArray[np.float64]

LEAST = 5.0
"""Logarithmic probabilities below minus this are drawn nearer: two classes 50 apart are then 17 apart."""
BOUND = 5.0
"""The residual is r = b tanh(z / b) of the network's output z; it overrules what is less than 2 b apart."""
CLASS_TIME = 0.2
"""While it is learned, a class that was chosen is kept for this time [s], or for its dwell, which is longer, or until it leads
to another node."""


def log_probabilities(decision: Decision, features: Array) -> Array:
    """Logarithmic probabilities (C,) of the classes, in the very order of their scores.

    l below -5 becomes -5 - 5 log(1 + (-5 - l) / 5), which keeps the order. Votes are not probabilities: the coupled ones of a
    `VotingDecision` are given to its classes in the order of their votes.
    """
    scores = decision.scores(features)
    if isinstance(decision, VotingDecision):
        log_p = np.empty_like(scores)
        log_p[np.argsort(scores, kind="stable")] = np.sort(np.log(decision.probabilities(features) + 1e-300))
    else:
        log_p = scores - scores.max()
        log_p -= np.log(np.exp(log_p).sum())
    below = np.minimum(log_p, -LEAST)
    return np.where(log_p < -LEAST, -LEAST - LEAST * np.log1p((-LEAST - below) / LEAST), log_p)


class GraphInputs:
    """Node and features of a skill as one array of constant size: one-hot node, then features, then log-probabilities."""

    def __init__(self, skill: SequenceGraphSkill) -> None:
        self.n_nodes = len(skill.nodes)
        self.n_features = max(len(node.feature_primitives) for node in skill.nodes)
        self.n_classes = max(len(node.targets) for node in skill.nodes)
        self.size = self.n_nodes + self.n_features + self.n_classes

    def residual_inputs(self, node: int, features: Array) -> Array:
        """What the residual is a function of (n_nodes + n_features,)."""
        x = np.zeros(self.n_nodes + self.n_features)
        x[node] = 1.0
        x[self.n_nodes : self.n_nodes + len(features)] = features
        return x

    def whole(self, node: int, features: Array, log_p: Array) -> NDArray[np.float32]:
        """The observation (size,) while it is learned."""
        padded = np.zeros(self.n_classes)
        padded[: len(log_p)] = log_p
        return np.concatenate([self.residual_inputs(node, features), padded]).astype(np.float32)


class RefinedGraphSkill(SequenceGraphSkill):
    """A sequence graph whose nodes decide by the frozen log-probabilities and a network's residual."""

    kind: ClassVar[str] = "refined-graph"

    def __init__(self, *parts: Any, network: Network, **facts: Any) -> None:
        """Parts and facts as in `SequenceGraphSkill`; the network maps node and features to a residual per class."""
        super().__init__(*parts, **facts)
        self.network, self._inputs = network, GraphInputs(self)

    @classmethod
    def of(cls, skill: SequenceGraphSkill, network: Network, metadata: Mapping[str, Any]) -> Self:
        """The skill with a residual."""
        parts = (skill.graph, skill.primitives, skill.nodes, skill.named, skill.layout, skill.dt)
        return cls(*parts, network=network, **(skill.facts | {"metadata": metadata}))

    def scores(self, node: int, decision: Decision, features: Array) -> Array:
        """Frozen log-probabilities and residual."""
        log_p = log_probabilities(decision, features)
        z = self.network(self._inputs.residual_inputs(node, features))[: len(log_p)]
        return log_p + BOUND * np.tanh(z / BOUND)

    def to_arrays(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """The graph's, and the network's."""
        values, arrays = super().to_arrays()
        network_values, network_arrays = self.network.to_arrays()
        return values | {"network": network_values}, arrays | network_arrays

    @classmethod
    def from_arrays(cls, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], **facts: Any) -> Self:
        """The skill that `to_arrays` described."""
        network = Network.from_arrays(header["network"], arrays)
        skill = super().from_arrays(header, arrays, network=network, **facts)
        check_network(network, skill._inputs.n_nodes + skill._inputs.n_features, skill._inputs.n_classes)
        return skill


class _DirectedSkill(SequenceGraphSkill):
    """Follows the class that it is told, where the frozen skill would follow the one that scores most."""

    chosen: int = 0

    def scores(self, node: int, decision: Decision, features: Array) -> Array:
        """The frozen log-probabilities, with the chosen class in front."""
        scores = log_probabilities(decision, features)
        scores[self.chosen] = scores.max() + 1.0
        return scores


class GraphDecisions(gymnasium.Wrapper, RecordConstructorArgs):
    """A sequence graph's decisions as an environment: actions are classes of the active node, see `action_masks`.

    One action lasts `hold` control steps, or until another node is active, or, where the graph ends, as long as the episode.
    A discount counts actions and not their time.
    **Reward**: the environment's own, at the end of an action.

    Args:
        env: a manipulation environment.
        skill: the frozen one.
        hold: control steps; if left out `CLASS_TIME`, or the dwell of the class if that is longer, so that a single action
            can leave a node.
    """

    def __init__(self, env: gymnasium.Env, skill: SequenceGraphSkill, hold: int | None = None) -> None:
        RecordConstructorArgs.__init__(self, skill=skill, hold=hold)
        gymnasium.Wrapper.__init__(self, env)
        parts = (skill.graph, skill.primitives, skill.nodes, skill.named, skill.layout, skill.dt)
        self.skill = _DirectedSkill(*parts, env_id=skill.env_id, taught_seeds=(), metadata={})
        self.inputs = GraphInputs(skill)
        self._hold = hold
        self.action_space = Discrete(self.inputs.n_classes)
        self.observation_space = Box(-np.inf, np.inf, (self.inputs.size,), np.float32)

    def reset(self, **kwargs: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode."""
        self._seen, info = self.env.reset(**kwargs)
        self._state = tuple(array[0] for array in self.skill.start(1))
        return self._look(), info

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Follow a class for a while; where no decision is left, to the end of the episode, which nothing comes after."""
        self.skill.chosen, node = int(action), self._node
        ends = self.skill.nodes[node].decision is None
        hold = math.inf if ends else self._steps(node, int(action))
        steps, ended = 0, False
        while not ended and steps < hold and (ends or self._node == node):
            native, self._state = self.skill.decide(self._seen, self._state)
            self._seen, reward, terminated, truncated, info = self.env.step(native)
            steps, ended = steps + 1, terminated or truncated
            observation = self._look()
        return observation, float(reward), terminated or ends, truncated and not ends, info

    def action_masks(self) -> NDArray[np.bool_]:
        """(n_classes,) which classes the active node has."""
        return np.arange(self.inputs.n_classes) < len(self.skill.nodes[self._node].targets)

    def _steps(self, node: int, action: int) -> int:
        """How many control steps a class is kept for."""
        if self._hold is not None:
            return self._hold
        dwell = float(self.skill.nodes[node].dwell[action])
        return max(1, round(CLASS_TIME / self.skill.dt), math.ceil(dwell / self.skill.dt - 1e-9) + 1)

    def _look(self) -> NDArray[np.float32]:
        self._node, features = self.skill.look(self._seen, self._state)
        decision = self.skill.nodes[self._node].decision
        log_p = np.zeros(1) if decision is None else log_probabilities(decision, features)
        return self.inputs.whole(self._node, features, log_p)
