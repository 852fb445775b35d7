"""The agent of a sequence graph's decisions: MaskablePPO whose logits are frozen log-probabilities and a residual."""

from typing import Any

import torch
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.policies import MaskableActorCriticPolicy
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from policies.reinforcement.network import Network
from policies.reinforcement.refined_graph import BOUND
from policies.reinforcement.settings import TrainingSettings

WIDTH = 64
"""Units of the hidden layer."""


class _Inputs(nn.Module):
    """Hands the residual everything, and the value the same."""

    def __init__(self, size: int) -> None:
        super().__init__()
        self.latent_dim_pi, self.latent_dim_vf = size, WIDTH
        self.value = nn.Sequential(nn.Linear(size, WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh())

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Latent codes of policy and value."""
        return x, self.value(x)

    def forward_actor(self, x: torch.Tensor) -> torch.Tensor:
        """Latent code of the policy."""
        return x

    def forward_critic(self, x: torch.Tensor) -> torch.Tensor:
        """Latent code of the value."""
        code: torch.Tensor = self.value(x)
        return code


class _Residual(nn.Module):
    """Logits l + b tanh(z / b), z = W2 tanh(W1 x + b1) + b2, for inputs (x, l); W2 and b2 start at zero."""

    def __init__(self, n_inputs: int, n_classes: int) -> None:
        super().__init__()
        self.n_inputs = n_inputs
        self.first, self.last = nn.Linear(n_inputs, WIDTH), nn.Linear(WIDTH, n_classes)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """The logits."""
        z = self.last(torch.tanh(self.first(x[:, : self.n_inputs])))
        logits: torch.Tensor = x[:, self.n_inputs :] + BOUND * torch.tanh(z / BOUND)
        return logits


class GraphPolicy(MaskableActorCriticPolicy):
    """Policy over the observations of `GraphDecisions`."""

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor: Any = _Inputs(self.features_dim)

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        n_classes = int(self.action_space.n)  # type: ignore[attr-defined]
        self.action_net: Any = _Residual(self.features_dim - n_classes, n_classes)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)  # type: ignore[call-arg]


def make_graph_agent(settings: TrainingSettings, envs: VecEnv) -> MaskablePPO:
    """An agent whose residual is zero."""
    steps = settings.rollout // settings.n_envs
    return MaskablePPO(
        GraphPolicy, envs, n_steps=steps, gamma=settings.discount, device="cpu", **dict(settings.hyperparameters)
    )


def load_graph_agent(path: str, envs: VecEnv) -> MaskablePPO:
    """The agent of a checkpoint; it runs code from the file, which must be one's own."""
    return MaskablePPO.load(path, env=envs, device="cpu")


def residual_network(agent: Any) -> Network:
    """The residual, as a network of node and features."""
    residual = agent.policy.action_net
    return Network.of([residual.first, residual.last], "tanh", "linear")
