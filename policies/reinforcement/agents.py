"""Stable-Baselines3's agents as they are trained here, and the network that is exported from them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.sac.policies import SACPolicy
from torch import nn

from policies.reinforcement.demonstrated_decisions import Transitions
from policies.reinforcement.network import Network
from policies.reinforcement.settings import TrainingSettings

WIDTH = 128
"""Units of each of two hidden layers."""


class DemonstrationBuffer(ReplayBuffer):
    """Half of every batch is drawn from demonstrations, the other half from what the agent did (Ball et al. 2023)."""

    demonstrations: Transitions | None = None

    def sample(self, batch_size: int, env: Any = None) -> ReplayBufferSamples:
        """Own transitions first, then demonstrated ones; only own ones without demonstrations."""
        if self.demonstrations is None:
            return super().sample(batch_size, env)
        own = super().sample(batch_size - batch_size // 2, env)
        rows = np.random.randint(0, len(self.demonstrations.rewards), size=batch_size // 2)  # noqa: NPY002
        seen, decisions, rewards, following, ended = (torch.as_tensor(part[rows]) for part in self.demonstrations)
        columns = (seen, decisions, following, ended[:, None], rewards[:, None])
        both = [torch.cat([a, b.to(a.device)]) for a, b in zip(own[:5], columns, strict=True)]
        return ReplayBufferSamples(*both)


class SteadySACPolicy(SACPolicy):
    """SAC with layer normalisation in the critics, which keeps values of unseen actions bounded (Ball et al. 2023).

    The bias of the actor's output may start where it is told to: `quiet` starts with the mean zero everywhere and a standard
    deviation of exp(quiet) before it is squashed.
    """

    def __init__(self, *arguments: Any, quiet: float | None = None, **further: Any) -> None:
        self.quiet = quiet
        super().__init__(*arguments, **further)

    def make_critic(self, features_extractor: Any = None) -> Any:
        """Layer normalisation after every hidden linear layer."""
        critic = super().make_critic(features_extractor)
        for i, network in enumerate(critic.q_networks):
            layers: list[nn.Module] = []
            for layer in network.children():
                layers.append(layer)
                if isinstance(layer, nn.Linear) and layer.out_features > 1:
                    layers.append(nn.LayerNorm(layer.out_features))
            critic.q_networks[i] = nn.Sequential(*layers).to(self.device)
            critic.add_module(f"qf{i}", critic.q_networks[i])
        return critic

    def make_actor(self, features_extractor: Any = None) -> Any:
        """The actor, quiet at the start if it is told to be."""
        actor: Any = super().make_actor(features_extractor)
        if self.quiet is not None:
            for layer, bias in ((actor.mu, 0.0), (actor.log_std, self.quiet)):
                nn.init.zeros_(layer.weight)
                nn.init.constant_(layer.bias, bias)
        return actor


def make_agent(settings: TrainingSettings, envs: VecEnv, quiet: float | None = None) -> Any:
    """An untrained agent. Its random numbers come from the generators of torch and numpy, which the caller seeds."""
    common: dict[str, Any] = {"gamma": settings.discount, "device": "cpu", "verbose": 0}
    parameters: Mapping[str, Any] = settings.hyperparameters
    if settings.algorithm == "ppo":
        shape = {"net_arch": {"pi": [WIDTH, WIDTH], "vf": [WIDTH, WIDTH]}}
        return PPO(
            "MlpPolicy", envs, n_steps=settings.rollout // settings.n_envs, policy_kwargs=shape, **common, **parameters
        )
    return SAC(
        SteadySACPolicy,
        envs,
        train_freq=settings.rollout // settings.n_envs,
        replay_buffer_class=DemonstrationBuffer,
        policy_kwargs={"net_arch": [WIDTH, WIDTH], "quiet": quiet},
        **common,
        **parameters,
    )


def load_agent(settings: TrainingSettings, path: str, envs: VecEnv) -> Any:
    """The agent of a checkpoint; it runs code from the file, which must be one's own."""
    return (PPO if settings.algorithm == "ppo" else SAC).load(path, env=envs, device="cpu")


def actor_network(agent: Any) -> Network:
    """What the agent does when it does not explore, as a network on flat observations."""
    policy = agent.policy
    if isinstance(agent, SAC):
        return Network.of([*_linear(policy.actor.latent_pi), policy.actor.mu], "relu", "tanh")
    return Network.of([*_linear(policy.mlp_extractor.policy_net), policy.action_net], "tanh", "clip")


def deterministic_actions(agent: Any, observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """What Stable-Baselines3 itself does for observations (N, D)."""
    actions: NDArray[np.float32] = agent.predict(observations, deterministic=True)[0]
    return actions


def _linear(network: Any) -> list[Any]:
    return [layer for layer in network.children() if isinstance(layer, nn.Linear)]
