"""Views of an environment: the one that reinforcement learning gets, and episodes with fixed seeds."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike, NDArray

from lfd_gym import quaternion
from lfd_gym.errors import InvalidActionError, InvalidArgumentError

DECISION_TIME = 0.1
"""Time between two decisions [s]."""
STEP = 0.05
"""Largest displacement of the goal from the reference [m]: at 10 Hz half a metre per second."""
TURN = 0.18
"""Largest turn of the goal from the reference [rad]."""
LENGTH, SPEED, TORQUE = 0.5, 0.5, 3.0
"""Scales of the observation [m, m/s, N m]."""

BOUND = 20.0
"""Of every component of the observation."""


class RLView(gymnasium.Wrapper, RecordConstructorArgs):
    """The view that every reinforcement learning method gets: few dimensions, relative goals, ten decisions per second.

    **Action**: `Box(-1, 1)` with one component per entry of the task's `controls`:

    | name            | meaning                                                                               |
    |-----------------|---------------------------------------------------------------------------------------|
    | `x`, `y`, `z`   | goal minus reference, world axes, up to 5 cm                                          |
    | `yaw`           | turn of the goal from the reference about the vertical, up to 0.18 rad                |
    | `grip`          | from the task's open hand (-1) to its closed hand (1)                                 |
    | `press`         | above 0 a force along the task's `press_direction`, up to the force limit             |

    **Observation**: one flat array: tool position in the workspace, reference minus tool, velocities, sine and cosine of the
    yaw, wrench, hand, and every frame's position minus the tool's with its quaternion. All of it is in the environment's own
    observation.

    **Reward**: the mean over the physics of a decision. Success does not end an episode, so that waiting before it never pays.

    Args:
        env: a manipulation environment made with `terminate_on_success=False`.

    Raises:
        InvalidArgumentError: another environment, or one that ends on success.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        world: Any = env.unwrapped
        self._world = world
        if getattr(world, "terminate_on_success", True):
            raise InvalidArgumentError("the RL view needs an environment made with terminate_on_success=False")
        self._layout, self.controls = world.action_layout, tuple(world.controls)
        self._repeats = max(round(DECISION_TIME / world.dt), 1)
        self._latest: dict[str, NDArray[np.float64]] = {}
        self.action_space = Box(-1.0, 1.0, (len(self.controls),), np.float32)
        observation, _ = env.reset(seed=0)
        self.observation_space = Box(-BOUND, BOUND, self.flatten(observation).shape, np.float32)

    def reset(self, **kwargs: Any) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode."""
        self._latest, info = self.env.reset(**kwargs)
        return self.flatten(self._latest), info

    def step(self, action: ArrayLike) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold one decision for a tenth of a second."""
        rewards: list[float] = []
        terminated = truncated = False
        while len(rewards) < self._repeats and not (terminated or truncated):
            self._latest, reward, terminated, truncated, info = self.env.step(self.native_action(action, self._latest))
            rewards.append(float(reward))
        return self.flatten(self._latest), float(np.mean(rewards)), terminated, truncated, info

    def native_action(self, action: ArrayLike, observation: dict[str, NDArray[np.float64]]) -> NDArray[np.float32]:
        """The environment's own action for a decision. Raises InvalidActionError for NaN and wrong shapes."""
        a = np.asarray(action, dtype=np.float64)
        if a.shape != self.action_space.shape or not np.isfinite(a).all():
            raise InvalidActionError(
                f"action {a}; expected {len(self.controls)} finite numbers: {', '.join(self.controls)}"
            )
        value = dict(zip(self.controls, np.clip(a, -1.0, 1.0).tolist(), strict=True))
        shift = STEP * np.array([value.get(axis, 0.0) for axis in "xyz"])
        turn = quaternion.from_rotation_vector(np.array([0.0, 0.0, TURN * value.get("yaw", 0.0)]))
        force = np.zeros(3)
        if value.get("press", 0.0) > 0.0:
            force = value["press"] * self._layout.force_limit * self._world.press_direction(observation)
        hand = np.empty(0)
        if self._layout.hand_low.size:
            share = 0.5 * (value.get("grip", -1.0) + 1.0)
            hand = (1.0 - share) * np.array(self._world.hand_open) + share * np.array(self._world.hand_closed)
        return self._layout.encode(
            observation["reference_position"] + shift,
            quaternion.multiply(turn, observation["reference_quaternion"]),
            force,
            hand,
        )

    def flatten(self, observation: dict[str, NDArray[np.float64]]) -> NDArray[np.float32]:
        """The flat observation, every part of order one."""
        o, layout = observation, self._layout
        tool, yaw = o["tool_position"], quaternion.yaw(o["tool_quaternion"])
        parts = [
            2.0 * (tool - layout.workspace_low) / (layout.workspace_high - layout.workspace_low) - 1.0,
            (o["reference_position"] - tool) / STEP,
            o["tool_velocity"] / np.repeat([SPEED, layout.turn_limit], 3),
            [np.sin(yaw), np.cos(yaw)],
            o["wrench"] / np.repeat([layout.force_limit, TORQUE], 3),
        ]
        if "hand_position" in o:
            parts += [o["hand_position"] / np.pi, o["hand_torque"] / TORQUE]
        for name in self._world.frames:
            pose = o[f"frame_{name}"]
            parts += [(pose[:3] - tool) / LENGTH, pose[3:]]
        return np.clip(np.concatenate(parts), -BOUND, BOUND).astype(np.float32)


class SeededEpisodes(gymnasium.Wrapper, RecordConstructorArgs):
    """Episode i is `reset(seed=seed + i)`, so that other libraries judge a policy on the same setups as `evaluate`."""

    def __init__(self, env: gymnasium.Env, seed: int) -> None:
        RecordConstructorArgs.__init__(self, seed=seed)
        gymnasium.Wrapper.__init__(self, env)
        self._next = seed

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin the next episode; a seed that is given starts the count anew."""
        self._next = self._next if seed is None else seed
        result = self.env.reset(seed=self._next, options=options)
        self._next += 1
        return result
