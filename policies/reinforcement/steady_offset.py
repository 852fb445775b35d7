"""Exploration that lets a robot come to rest."""

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.noise import ActionNoise


class SteadyOffset(ActionNoise):
    """Adds the same random vector to all decisions of an episode, besides the agent's own small noise.

    A residual that jumps around keeps a skill that waits for rest from ever going on, and a small one shows little of what a
    larger one would do. An offset that stays does neither (cf. noise on parameters, Plappert et al. 2018).

    Args:
        size: components of a decision.
        deviation: standard deviation of each, drawn from torch's generator.
    """

    def __init__(self, size: int, deviation: float) -> None:
        super().__init__()
        self.size, self.deviation = size, deviation
        self.reset()

    def reset(self) -> None:
        """Draw the next episode's."""
        self._offset = self.deviation * torch.randn(self.size).numpy()

    def __call__(self) -> NDArray[np.float32]:
        """The offset (C,)."""
        offset: NDArray[np.float32] = self._offset
        return offset
