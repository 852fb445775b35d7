"""How much was simulated."""

from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs


class SimulationClock(gymnasium.Wrapper, RecordConstructorArgs):
    """Counts the simulated time of all episodes, as `simulated_seconds`."""

    def __init__(self, env: gymnasium.Env) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        self.simulated_seconds = 0.0

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step, and count."""
        self.simulated_seconds += self.unwrapped.dt  # type: ignore[attr-defined]
        return self.env.step(action)
