"""Any 100,000 actions: no exception, nothing that is not finite, no warning of MuJoCo."""

import mujoco
import numpy as np
import pytest

from lfd_gym.registry import ENVIRONMENTS, make

N_STEPS = 100_000
KEEP = 0.95
"""Probability to keep an action: kept for 0.4 s on average, it takes the arm to all ends of the workspace."""


@pytest.mark.slow
@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_random_actions_never_break_the_simulation(env_id: str) -> None:
    env = make(env_id, terminate_on_success=False)
    world, rng = env.unwrapped, np.random.default_rng(0)
    env.reset(seed=400000)
    env.action_space.seed(0)
    action, n_episodes = env.action_space.sample(), 1
    for _ in range(N_STEPS):
        if rng.random() > KEEP:
            action = np.clip(rng.uniform(-1.3, 1.3, env.action_space.shape), -1.0, 1.0).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        assert all(np.isfinite(value).all() for value in observation.values()), (n_episodes, info)
        assert np.isfinite(reward)
        assert not info["broken"]
        if terminated or truncated:
            warned = {str(mujoco.mjtWarning(i)): w.number for i, w in enumerate(world.data.warning) if w.number}
            assert not warned, (n_episodes, warned)
            env.reset(seed=400000 + n_episodes)
            n_episodes += 1
