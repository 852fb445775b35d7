"""An agent as a skill: a network on the RL view, in the native environment."""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lfd_gym.view import View
from policies.consistency import check_view
from policies.reinforcement.network import Network, check_network
from policies.skill import Observation, Skill, State


class Memory(NamedTuple):
    """State of an agent, one row per environment."""

    plan: NDArray[np.float64]
    """(n, K, C) decisions."""
    step: NDArray[np.int64]
    """(n,) control steps since it was made; -1 before the first observation."""


class AgentSkill(Skill):
    """A network from flat observations to the next K decisions, each held for a tenth of a second.

    It looks again after the first `executed` of them (K = executed = 1 but for action chunks).
    """

    kind: ClassVar[str] = "agent"

    def __init__(self, network: Network, view: View, executed: int = 1, **facts: Any) -> None:
        """The network's output (K * C,) is K decisions after another; facts as in `Skill`."""
        super().__init__(**facts)
        self.network, self.view, self.executed = network, view, executed
        self._shape = (len(network.biases[-1]) // len(view.controls), len(view.controls))

    @property
    def dt(self) -> float:
        """Control step that it was taught for [s]."""
        return self.view.dt

    def start(self, n: int) -> State:
        """No plan before the first observation."""
        return Memory(np.zeros((n, *self._shape)), np.full(n, -1))

    def decide(self, observation: Observation, state: State) -> tuple[NDArray[np.float32], State]:
        """The native action of the decision that is due."""
        plan, step = state
        if step < 0 or step >= self.executed * self.view.repeats:
            plan, step = self.network(self.view.flatten(observation)).reshape(self._shape), np.array(0)
        decision = plan[int(step) // self.view.repeats]
        return self.view.native_action(decision, observation), Memory(plan, step + 1)

    def to_arrays(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Network and view."""
        values, arrays = self.network.to_arrays()
        return {"network": values, "view": self.view.to_dict(), "executed": self.executed}, arrays

    @classmethod
    def from_arrays(cls, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], **facts: Any) -> Self:
        """The skill that `to_arrays` described."""
        network, view = Network.from_arrays(header["network"], arrays), View.from_dict(header["view"])
        check_view(view)
        executed, chunk = header["executed"], len(network.biases[-1]) // len(view.controls)
        check_network(network, view.size, chunk * len(view.controls))
        if not isinstance(executed, int) or not 1 <= executed <= chunk:
            raise ValueError(f"{executed} of {chunk} decisions")
        return cls(network, view, executed, **facts)
