"""Every registered environment, and trajectories in it."""

from typing import Any

import gymnasium
import numpy as np

from lfd_gym.registry import ENVIRONMENTS

IDS = tuple(ENVIRONMENTS)
Observation = dict[str, np.ndarray]


def make(env_id: str, **kwargs: Any) -> Any:
    """The environment without wrappers."""
    return gymnasium.make(env_id, **kwargs).unwrapped


def actions(env: Any, n: int, seed: int = 0) -> np.ndarray:
    """Random goals (n, A), each kept for a fifth of a second."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.uniform(-1, 1, (-(-n // 10), env.action_space.shape[0])), 10, axis=0)[:n].astype(np.float32)


def assert_equal(a: Observation, b: Observation) -> None:
    """Bitwise."""
    assert set(a) == set(b)
    for key in a:
        np.testing.assert_array_equal(a[key], b[key], err_msg=key)


def trajectory(env: Any, commands: np.ndarray) -> np.ndarray:
    """All observations along some actions, flat."""
    return np.concatenate([value for a in commands for value in env.step(a)[0].values()])
