"""A bounded residual around a frozen skill: as a skill, and as the environment in which it is learned."""

from collections.abc import Mapping
from typing import Any, ClassVar, Self

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike, NDArray

from lfd_gym.action import ActionLayout
from lfd_gym.registry import load
from lfd_gym.view import BOUND, View
from policies.consistency import check_view
from policies.reinforcement.network import Network, check_network
from policies.skill import SKILLS, Observation, Skill, State

SHIFT, TURN, GRIP, PRESS = 0.02, 0.1, 0.1, 0.5
"""Largest residual: of a goal [m], about the vertical [rad], of the way from the open to the closed hand, and of the force."""


def adjusted(view: View, action: NDArray[np.float32], residual: ArrayLike) -> NDArray[np.float32]:
    """A native action (A,) with a residual (C,) in [-1, 1] per control of the view; zero leaves every bit as it is.

    A force [N] is scaled, never begun and never ended: without the skill's own force `press` does nothing.
    """
    layout, result = view.layout, action.astype(np.float64)
    value = dict(zip(view.controls, np.clip(residual, -1.0, 1.0).tolist(), strict=True))
    shift = SHIFT * np.array([value.get(axis, 0.0) for axis in "xyz"])
    result[ActionLayout.position] += 2.0 * shift / (layout.workspace_high - layout.workspace_low)
    result[ActionLayout.rotation.stop - 1] += TURN * value.get("yaw", 0.0) / layout.rotation_limit[2]
    result[ActionLayout.force] *= layout.force_scale(action, 1.0 + PRESS * value.get("press", 0.0))
    if "grip" in value:
        way = np.array(view.hand_closed) - np.array(view.hand_open)
        result[ActionLayout.hand] += 2.0 * GRIP * value["grip"] * way / (layout.hand_high - layout.hand_low)
    return np.clip(result, -1.0, 1.0).astype(np.float32)


def inputs(view: View, observation: Observation, action: NDArray[np.float32]) -> NDArray[np.float32]:
    """What a residual is decided from: the flat observation and what the skill does now."""
    return np.concatenate([view.flatten(observation), action]).astype(np.float32)


class ResidualSkill(Skill):
    """A frozen skill, and ten times per second a network's residual."""

    kind: ClassVar[str] = "residual"

    def __init__(self, base: Skill, network: Network, view: View, **facts: Any) -> None:
        """The network maps `inputs` to a residual (C,); facts as in `Skill`."""
        super().__init__(**facts)
        self.base, self.network, self.view = base, network, view

    @property
    def dt(self) -> float:
        """Control step that it was taught for [s]."""
        return self.view.dt

    def start(self, n: int) -> State:
        """No residual before the first observation, then the state of the frozen skill."""
        return (np.zeros((n, len(self.view.controls))), np.full(n, -1), *self.base.start(n))

    def decide(self, observation: Observation, state: State) -> tuple[NDArray[np.float32], State]:
        """The frozen skill's action, adjusted."""
        residual, step, *inner = state
        action, following = self.base.decide(observation, tuple(inner))
        if step < 0 or step >= self.view.repeats:
            residual, step = self.network(inputs(self.view, observation, action)), np.array(0)
        return adjusted(self.view, action, residual), (residual, step + 1, *following)

    def to_arrays(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Both parts; the frozen skill's arrays are prefixed."""
        values, arrays = self.network.to_arrays()
        base_values, base_arrays = self.base.to_arrays()
        arrays |= {f"base_{name}": array for name, array in base_arrays.items()}
        return {"network": values, "view": self.view.to_dict(), "base": [self.base.kind, base_values]}, arrays

    @classmethod
    def from_arrays(cls, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], **facts: Any) -> Self:
        """The skill that `to_arrays` described."""
        kind, values = header["base"]
        inner = {name.removeprefix("base_"): array for name, array in arrays.items() if name.startswith("base_")}
        base = load(SKILLS[kind]).from_arrays(values, inner, **facts)
        network, view = Network.from_arrays(header["network"], arrays), View.from_dict(header["view"])
        check_view(view)
        check_network(network, view.size + view.layout.size, len(view.controls))
        return cls(base, network, view, **facts)


class ResidualView(gymnasium.Wrapper, RecordConstructorArgs):
    """The RL view of a skill's residual: observations are `inputs`, actions residuals (C,), ten per second.

    **Reward**: the environment's own, at the end of a decision.

    Args:
        env: a manipulation environment.
        skill: the frozen one.
    """

    def __init__(self, env: gymnasium.Env, skill: Skill) -> None:
        RecordConstructorArgs.__init__(self, skill=skill)
        gymnasium.Wrapper.__init__(self, env)
        self.skill, self.view = skill, View.of(env)
        self.action_space = Box(-1.0, 1.0, (len(self.view.controls),), np.float32)
        self.observation_space = Box(-BOUND, BOUND, self.reset(seed=0)[0].shape, np.float32)

    def reset(self, **kwargs: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode, and start the skill."""
        self._seen, info = self.env.reset(**kwargs)
        self._state = tuple(array[0] for array in self.skill.start(1))
        self._advance()
        return inputs(self.view, self._seen, self._action), info

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold one residual for a tenth of a second, while the skill goes on."""
        steps, ended = 0, False
        while steps < self.view.repeats and not ended:
            native = adjusted(self.view, self._action, action)
            self._seen, reward, terminated, truncated, info = self.env.step(native)
            steps, ended = steps + 1, terminated or truncated
            self._advance()
        return inputs(self.view, self._seen, self._action), float(reward), terminated, truncated, info

    def _advance(self) -> None:
        """What the skill does for what is seen now."""
        self._action, self._state = self.skill.decide(self._seen, self._state)
