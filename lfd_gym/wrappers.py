"""Views of an environment: the one that reinforcement learning gets, and episodes with fixed seeds."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike, NDArray

from lfd_gym.errors import InvalidArgumentError
from lfd_gym.view import BOUND, View


class RLView(gymnasium.Wrapper, RecordConstructorArgs):
    """The view that every reinforcement learning method gets: few dimensions, relative goals, ten decisions per second.

    **Action**: `Box(-1, 1)` with one component per entry of the task's `controls`:

    | name            | meaning                                                                               |
    |-----------------|---------------------------------------------------------------------------------------|
    | `x`, `y`, `z`   | goal minus reference, world axes, up to what moves the tool at the speed limit        |
    | `yaw`           | turn of the goal from the reference about the vertical, up to the turn limit's        |
    | `grip`          | from the task's open hand (-1) to its closed hand (1)                                 |
    | `press`         | above 0 a force along the task's `press_direction`, up to the force limit             |

    **Observation**: one flat array: tool position in the workspace, reference minus tool, velocities, sine and cosine of the
    yaw, wrench, hand, and every frame's position minus the tool's with its quaternion. All of it is in the environment's own
    observation. `lfd_gym.view.View` computes both, without the environment.

    **Reward**: the mean over the control steps of a decision. Success does not end an episode, so that waiting before it
    never pays. After a `set_state` below the view the next decision is still relative to the reference that was seen last.

    Args:
        env: a manipulation environment made with `terminate_on_success=False`.

    Raises:
        InvalidArgumentError: another environment, one that ends on success, or one whose spaces a wrapper has changed.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        world: Any = env.unwrapped
        if getattr(world, "terminate_on_success", True):
            raise InvalidArgumentError("the RL view needs an environment made with terminate_on_success=False")
        if env.action_space != world.action_space:
            raise InvalidArgumentError(
                "the RL view needs the environment's own actions; a wrapper below it changes them"
            )
        self.view = View.of(env)
        self._latest: dict[str, NDArray[np.float64]] = {}
        self.action_space = Box(-1.0, 1.0, (len(self.view.controls),), np.float32)
        seen = getattr(env.observation_space, "spaces", {})
        if missing := [name for name in self.view.observations if name not in seen]:
            raise InvalidArgumentError(
                f"the RL view needs the environment's own observation; '{missing[0]}' is not in it"
            )
        self.observation_space = Box(-BOUND, BOUND, (self.view.size,), np.float32)
        self.metadata = {**self.metadata, "render_fps": round(1.0 / (self.view.repeats * self.view.dt))}

    def reset(self, **kwargs: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode."""
        self._latest, info = self.env.reset(**kwargs)
        return self.view.flatten(self._latest), info

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold one decision for a tenth of a second. Raises ResetNeeded before the first reset."""
        if not self._latest:
            raise ResetNeeded("the RL view cannot step before its first reset")
        rewards: list[float] = []
        terminated = truncated = False
        while len(rewards) < self.view.repeats and not (terminated or truncated):
            self._latest, reward, terminated, truncated, info = self.env.step(
                self.view.native_action(action, self._latest)
            )
            rewards.append(float(reward))
        return self.view.flatten(self._latest), float(np.mean(rewards)), terminated, truncated, info


class SeededEpisodes(gymnasium.Wrapper, RecordConstructorArgs):
    """Episode i is `reset(seed=seed + i)`, so that other libraries judge a policy on the same setups as `evaluate`."""

    def __init__(self, env: gymnasium.Env, seed: int) -> None:
        RecordConstructorArgs.__init__(self, seed=seed)
        gymnasium.Wrapper.__init__(self, env)
        self._next = seed

    @property
    def next_seed(self) -> int:
        """The seed of the next episode."""
        return self._next

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin the next episode; a seed that is given starts the count anew."""
        self._next = self._next if seed is None else seed
        result = self.env.reset(seed=self._next, options=options)
        self._next += 1
        return result
