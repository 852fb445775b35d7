"""Stable-Baselines3's agents as they are trained here, and the network that is exported from them."""

from typing import Any

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from policies.reinforcement.demonstration_sac import DemonstrationBuffer, DemonstrationSAC, SteadySACPolicy
from policies.reinforcement.network import Network
from policies.reinforcement.settings import TrainingSettings

WIDTH = 128
"""Units of each of two hidden layers."""
NORMAL_ENTROPY = 0.5 * np.log(2.0 * np.pi * np.e)
"""Of a standard normal variable."""


def make_agent(settings: TrainingSettings, envs: VecEnv, quiet: float | None = None) -> Any:
    """An untrained agent. Its random numbers come from the generators of torch and numpy, which the caller seeds.

    quiet: logarithm of the standard deviation with which soft actor-critic explores after its first, random decisions, and
        which it aims at.
    """
    common: dict[str, Any] = {"gamma": settings.discount, "device": "cpu", "verbose": 0}
    parameters = dict(settings.hyperparameters)
    if quiet is not None:
        parameters["target_entropy"] = float(np.prod(envs.action_space.shape or ())) * (quiet + NORMAL_ENTROPY)
    if settings.algorithm == "ppo":
        shape = {"net_arch": {"pi": [WIDTH, WIDTH], "vf": [WIDTH, WIDTH]}}
        return PPO(
            "MlpPolicy", envs, n_steps=settings.rollout // settings.n_envs, policy_kwargs=shape, **common, **parameters
        )
    return DemonstrationSAC(
        SteadySACPolicy,
        envs,
        cloning=settings.cloning,
        resting=settings.resting,
        critic_first=settings.critic_first,
        train_freq=settings.rollout // settings.n_envs,
        replay_buffer_class=DemonstrationBuffer,
        replay_buffer_kwargs={
            "n_steps": settings.n_steps,
            "gamma": settings.discount,
            "share": settings.demonstrated_batch,
        },
        policy_kwargs={"net_arch": [WIDTH, WIDTH], "quiet": quiet, "optimizer_kwargs": {"fused": True}},
        **common,
        **parameters,
    )


def load_agent(settings: TrainingSettings, path: str, envs: VecEnv) -> Any:
    """The agent of a checkpoint; it runs code from the file, which must be one's own."""
    return (PPO if settings.algorithm == "ppo" else DemonstrationSAC).load(path, env=envs, device="cpu")


def actor_network(agent: Any) -> Network:
    """What the agent does when it does not explore, as a network on flat observations."""
    policy = agent.policy
    if isinstance(agent, DemonstrationSAC):
        return Network.of([*_linear(policy.actor.latent_pi), policy.actor.mu], "relu", "tanh")
    return Network.of([*_linear(policy.mlp_extractor.policy_net), policy.action_net], "tanh", "clip")


def _linear(network: Any) -> list[Any]:
    return [layer for layer in network.children() if isinstance(layer, nn.Linear)]
