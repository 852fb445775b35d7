"""What reinforcement learning sees and decides, from observations alone: the pure part of `lfd_gym.wrappers.RLView`.

An RL skill carries its view with it, so that it runs in the native environment like any other.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import load_env_creator
from numpy.typing import ArrayLike, NDArray

from lfd_gym import quaternion
from lfd_gym.action import ActionLayout
from lfd_gym.errors import InvalidActionError, InvalidArgumentError
from lfd_gym.registry import register

Array = NDArray[np.float64]

DECISION_TIME = 0.1
"""Time between two decisions [s]."""
LAG, LENGTH, SPEED, TORQUE = 0.05, 0.1, 0.5, 3.0
"""Scales of the observation: reference minus tool [m], distances [m], velocities [m/s], torques [N m]."""
BOUND = 20.0
"""Of every component of the observation."""
NO_PRESS = -1.0
"""Decision on `press` that stands for an action without a force."""


@dataclass(frozen=True)
class View:
    """Decisions of one environment, and its observation as one array; the table is in `lfd_gym.wrappers.RLView`."""

    env_id: str
    """Whose `press_direction` a press has."""
    controls: tuple[str, ...]
    """Names of a decision's components."""
    frames: tuple[str, ...]
    """Tracked objects, in the order of the flat observation."""
    layout: ActionLayout
    """Of the environment's own actions."""
    hand_open: tuple[float, ...]
    hand_closed: tuple[float, ...]
    """Ends of `grip` [rad]."""
    dt: float
    """The environment's control step [s]."""

    @classmethod
    def of(cls, env: gymnasium.Env) -> "View":
        """The view of an environment. Raises InvalidArgumentError for one that was not made by `gymnasium.make`."""
        world: Any = env.unwrapped
        if world.spec is None:
            raise InvalidArgumentError("the RL view needs an environment with a spec: make it with gymnasium.make")
        return cls.of_class(world.spec.id, world.action_layout, world.dt)

    @classmethod
    def of_class(cls, env_id: str, layout: ActionLayout, dt: float) -> "View":
        """The view of a registered environment that is not made.

        Raises InvalidArgumentError for an unknown id, and where no whole number of control steps makes a decision.
        """
        if abs(DECISION_TIME / dt - round(DECISION_TIME / dt)) > 1e-9:
            raise InvalidArgumentError(
                f"control_hz {1.0 / dt:g} does not make ten decisions per second; a multiple of 10 does, as 50 or 10"
            )
        world = environment_class(env_id)
        opened, closed = tuple(map(float, world.hand_open)), tuple(map(float, world.hand_closed))
        return cls(env_id, tuple(world.controls), tuple(world.frames), layout, opened, closed, float(dt))

    @property
    def observations(self) -> tuple[str, ...]:
        """Names of the observations that `flatten` reads."""
        hand = ("hand_position", "hand_torque") if self.layout.hand_low.size else ()
        arm = ("tool_position", "tool_quaternion", "tool_velocity", "reference_position", "wrench")
        return (*arm, *hand, *(f"frame_{name}" for name in self.frames))

    @property
    def size(self) -> int:
        """Length of the flat observation."""
        return 20 + 2 * self.layout.hand_low.size + 7 * len(self.frames)

    @property
    def repeats(self) -> int:
        """Control steps per decision."""
        return round(DECISION_TIME / self.dt)

    def native_action(self, decision: ArrayLike, observation: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
        """The environment's own action for a decision. Raises InvalidActionError for NaN and wrong shapes."""
        a = np.asarray(decision, dtype=np.float64)
        if a.shape != (len(self.controls),) or not np.isfinite(a).all():
            raise InvalidActionError(
                f"action {a}; expected {len(self.controls)} finite numbers: {', '.join(self.controls)}"
            )
        layout = self.layout
        value = dict(zip(self.controls, np.clip(a, -1.0, 1.0).tolist(), strict=True))
        shift = layout.speed_limit / layout.beta * np.array([value.get(axis, 0.0) for axis in "xyz"])
        turn = np.array([0.0, 0.0, layout.turn_limit / layout.beta * value.get("yaw", 0.0)])
        force = np.zeros(3)
        if value.get("press", 0.0) > 0.0:
            force = value["press"] * layout.force_limit * self.press_direction(observation)
        hand = np.empty(0)
        if layout.hand_low.size:
            share = 0.5 * (value.get("grip", -1.0) + 1.0)
            hand = (1.0 - share) * np.array(self.hand_open) + share * np.array(self.hand_closed)
        return layout.encode(
            observation["reference_position"] + shift,
            quaternion.multiply(quaternion.from_rotation_vector(turn), observation["reference_quaternion"]),
            force,
            hand,
        )

    def decision(self, action: ArrayLike, observation: Mapping[str, NDArray[Any]]) -> Array:
        """The decision (C,) that a native action amounts to: inverse of `native_action`, as far as the view's controls go.

        Goals beyond the attractor's speed limit count as far as they pull (see `lfd_gym.attractor.gain`), so that whatever
        the attractor does along the controls lies within [-1, 1].
        """
        layout, goal = self.layout, self.layout.decode(action)
        shift = _within(layout.beta / layout.speed_limit * (goal.position - observation["reference_position"]))
        before = np.asarray(observation["reference_quaternion"], dtype=np.float64)
        relative = quaternion.multiply(goal.quaternion, quaternion.conjugate(before))
        turn = _within(layout.beta / layout.turn_limit * quaternion.to_rotation_vector(relative))
        value = dict(zip("xyz", shift, strict=True)) | {"yaw": turn[2], "grip": -1.0, "press": NO_PRESS}
        if "grip" in self.controls:
            way = np.array(self.hand_closed) - np.array(self.hand_open)
            value["grip"] = 2.0 * float((goal.hand - np.array(self.hand_open)) @ way) / float(way @ way) - 1.0
        if "press" in self.controls and goal.force.any():
            value["press"] = float(goal.force @ self.press_direction(observation)) / layout.force_limit
        return np.clip([value[name] for name in self.controls], -1.0, 1.0)

    def flatten(self, observation: Mapping[str, NDArray[Any]]) -> NDArray[np.float32]:
        """The flat observation, every part of order one."""
        o, layout = observation, self.layout
        tool, yaw = o["tool_position"], quaternion.yaw(o["tool_quaternion"])
        parts = [
            2.0 * (tool - layout.workspace_low) / (layout.workspace_high - layout.workspace_low) - 1.0,
            (o["reference_position"] - tool) / LAG,
            o["tool_velocity"] / np.repeat([SPEED, layout.turn_limit], 3),
            [np.sin(yaw), np.cos(yaw)],
            o["wrench"] / np.repeat([layout.force_limit, TORQUE], 3),
        ]
        if layout.hand_low.size:
            parts += [o["hand_position"] / np.pi, o["hand_torque"] / TORQUE]
        for name in self.frames:
            pose = o[f"frame_{name}"]
            parts += [(pose[:3] - tool) / LENGTH, pose[3:]]
        return np.clip(np.concatenate(parts), -BOUND, BOUND).astype(np.float32)

    def press_direction(self, observation: Mapping[str, NDArray[Any]]) -> Array:
        """World direction (3,) of `press`, which the environment's class knows."""
        direction: Array = environment_class(self.env_id).press_direction(observation)
        return direction

    def to_dict(self) -> dict[str, Any]:
        """JSON-able fields; `from_dict` is the inverse."""
        return asdict(self) | {"layout": self.layout.to_dict()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "View":
        """The view that `to_dict` wrote."""
        lists = {name: tuple(values[name]) for name in ("controls", "frames", "hand_open", "hand_closed")}
        return cls(values["env_id"], layout=ActionLayout.from_dict(values["layout"]), dt=values["dt"], **lists)


def environment_class(env_id: str) -> Any:
    """The class of a registered environment. Raises InvalidArgumentError for an unknown id."""
    register()
    spec = gymnasium.registry.get(env_id.rpartition(":")[2])
    if spec is None or spec.entry_point is None:
        raise InvalidArgumentError(f"no environment '{env_id}' is registered; its RL view is not known")
    return load_env_creator(spec.entry_point) if isinstance(spec.entry_point, str) else spec.entry_point


def _within(vector: Array) -> Array:
    """The vector, shortened to length 1 if it is longer."""
    return vector / max(1.0, float(np.linalg.norm(vector)))
