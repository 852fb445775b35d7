"""Episodes that begin in the middle of a demonstration."""

from collections.abc import Sequence
from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs

from lfd_gym.demonstration import Demonstration


class DemonstratedStarts(gymnasium.Wrapper, RecordConstructorArgs):
    """A share of the episodes begins in a state that was demonstrated, at any of its times (Nair et al. 2018, section V).

    For training only: what is hard to reach by chance, a grasped object, is met from the beginning.

    Args:
        env: a native manipulation environment.
        demonstrations: whose states are those of this environment.
        share: of the episodes, 0 to 1.
    """

    def __init__(self, env: gymnasium.Env, demonstrations: Sequence[Demonstration], share: float) -> None:
        RecordConstructorArgs.__init__(self, _disable_deepcopy=True, demonstrations=demonstrations, share=share)
        gymnasium.Wrapper.__init__(self, env)
        self.demonstrations, self.share = tuple(demonstrations), share

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; the environment's own random numbers choose where."""
        observation, info = self.env.reset(seed=seed, options=options)
        world: Any = self.env.unwrapped
        if world.np_random.random() >= self.share:
            return observation, info
        demonstration = self.demonstrations[world.np_random.integers(len(self.demonstrations))]
        t = int(world.np_random.integers(len(demonstration)))
        world.set_state(demonstration.states[t])
        world.set_guidance(None)
        return {name: values[t] for name, values in demonstration.observations.items()}, info
