"""A point on a line that must reach a target: the smallest environment, teacher and policy that fit the contracts."""

from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces

from lfd_gym.demonstration import EntityControl, Primitive


class Layout(NamedTuple):
    scale: float = 0.1

    def to_dict(self) -> dict[str, float]:
        return self._asdict()


class PointEnv(gymnasium.Env):
    """Observes its position and the target; the action is a velocity; success is a distance below 0.05."""

    dt = 0.1
    action_layout = Layout()
    observation_space = spaces.Dict(
        {"position": spaces.Box(-9, 9, (1,), np.float64), "frame_target": spaces.Box(-9, 9, (1,), np.float64)}
    )
    action_space = spaces.Box(-1, 1, (1,), np.float32)

    def __init__(self, speed: float = 1.0, render_mode: str | None = None) -> None:
        self.speed, self.render_mode = speed, render_mode

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        super().reset(seed=seed)
        drawn = self.np_random.uniform(0.5, 1.5)
        self.target = options["setup"]["target"]["position"][0] if options else drawn
        self.position = 0.0
        return self.observe(), self.info()

    def step(self, action: np.ndarray) -> tuple[dict, float, bool, bool, dict]:
        if not np.all(np.isfinite(action)):
            raise ValueError("the action is not finite")
        self.position += self.speed * self.dt * float(np.clip(action[0], -1, 1))
        info = self.info()
        return self.observe(), float(info["is_success"]), info["is_success"], False, info

    def observe(self) -> dict[str, np.ndarray]:
        return {"position": np.array([self.position]), "frame_target": np.array([self.target])}

    def info(self) -> dict[str, Any]:
        success = abs(self.position - self.target) < 0.05
        return {"is_success": success, "success": success, "subtask/halfway": self.position > 0.5 * self.target}

    def setup(self) -> dict[str, Any]:
        return {"target": {"position": [self.target]}}

    def get_state(self) -> np.ndarray:
        return np.array([self.position, self.target])


class PointTeacher:
    """Walks to the target with a speed of its own."""

    primitives = (
        Primitive(
            "reach",
            EntityControl(0, "target", "cartesian", ("position",) * 3),
            EntityControl(0, "world", "rotation", ("hold",) * 3),
            None,
        ),
    )

    def __init__(self, noise: float = 1.0, mode: str = "commanded", gives_up: bool = False) -> None:
        self.noise, self.gives_up = noise, gives_up

    def reset(self, rng: np.random.Generator, layout: Layout, dt: float) -> None:
        self.speed = 1.0 / (1.0 + self.noise * rng.uniform())
        self.stopped = self.gives_up and rng.uniform() < 0.5

    def act(self, observation: dict[str, np.ndarray]) -> tuple[np.ndarray, int]:
        error = observation["frame_target"] - observation["position"]
        return (0.0 if self.stopped else 1.0) * np.clip(10 * error, -self.speed, self.speed).astype(np.float32), 0


class PointPolicy:
    """Walks to the target; fails with an exception where it is told to."""

    def __init__(self, taught_seeds: tuple[int, ...] = (), fails_beyond: float = 9.0) -> None:
        self.taught_seeds, self.fails_beyond = taught_seeds, fails_beyond

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        if observation["frame_target"][0] > self.fails_beyond:
            raise RuntimeError("too far away")
        count = 0 if state is None or episode_start[0] else state[0][0] + 1
        error = observation["frame_target"] - observation["position"]
        return np.clip(10 * error, -1, 1).astype(np.float32), (np.array([count]),)


ENV_ID = "toy:Point-v0"
if "Point-v0" not in gymnasium.registry:
    gymnasium.register("Point-v0", entry_point="toy:PointEnv", max_episode_steps=40)
