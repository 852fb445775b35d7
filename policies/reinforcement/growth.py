"""Reward for change instead of state: what every agent is paid in training."""

from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs


class Growth(gymnasium.Wrapper, RecordConstructorArgs):
    """Pays by how much the reward grew, r'_t = r_t - r_{t-1}, where r_{-1} is that of the state in which an episode begins.

    By summation by parts, sum gamma^t r'_t = (1 - gamma) sum gamma^t r_t - r_{-1}: the same policy is best, as under any
    shaping by a potential (Ng et al. 1999). But to stay where one is is worth 0 everywhere, so that values tell decisions
    apart rather than states, and a centimetre is not lost in what it is worth to hold the object at all.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)

    def reset(self, **kwargs: Any) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        observation, info = self.env.reset(**kwargs)
        self._before = float(self.env.unwrapped.reward())  # type: ignore[attr-defined]
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Step, and compare with the step before."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        grown, self._before = float(reward) - self._before, float(reward)
        return observation, grown, terminated, truncated, info
