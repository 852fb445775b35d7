"""An agent of Stable-Baselines3 among the policies: it sees the RL view and acts in the environment itself."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfd_gym.view import View

State = tuple[np.ndarray, ...]


class ViewPolicy:
    """What was trained in `RLView`, as a policy of the environment below it.

    Its state is the decision (C,) that it holds and for how many control steps it has, (1,).

    Args:
        agent: anything with `predict(flat observation, deterministic=...) -> (decision, _)` that remembers nothing.
        view: that of the environment it was trained in, `RLView.view`.
    """

    def __init__(self, agent: Any, view: View) -> None:
        self.agent, self.view, self.metadata = agent, view, {"learner": type(agent).__name__}

    @property
    def env_id(self) -> str:
        """The task that it was trained for."""
        return self.view.env_id

    @property
    def dt(self) -> float:
        """Control step of the environment [s]."""
        return self.view.dt

    def predict(
        self,
        observation: Any,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, State]:
        """The native action of the decision that is due; the agent decides anew ten times per second."""
        starts = episode_start is not None and bool(np.any(episode_start))
        if state is None or starts or state[1][0] >= self.view.repeats:
            decision, _ = self.agent.predict(self.view.flatten(observation), deterministic=deterministic)
            state = np.asarray(decision), np.zeros(1, dtype=np.int64)
        decision, held = state
        return self.view.native_action(decision, observation), (decision, held + 1)
