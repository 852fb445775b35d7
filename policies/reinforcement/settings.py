"""What is trained with which settings: one visible row per method, the same for every task."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from lfd_gym.errors import UnknownNameError


@dataclass(frozen=True)
class TrainingSettings:
    """How a method trains on the RL view."""

    algorithm: str
    """"sac" or "ppo" of Stable-Baselines3, or "maskable-ppo" of sb3-contrib."""
    reward_type: str = "dense"
    """Of the environment."""
    demonstrations: bool = False
    """Half of every batch is drawn from demonstrations."""
    discount: float = 0.99
    """Per decision; 0.99 looks 10 s ahead."""
    reward_scale: float = 1.0
    """Factor of the reward."""
    n_envs: int = 1
    """Environments that are stepped together."""
    rollout: int = 8
    """Decisions between two rounds of updates, of all environments together."""
    hyperparameters: Mapping[str, Any] = field(default_factory=dict)
    """Further arguments of the algorithm."""


SAC: Mapping[str, Any] = {
    "learning_rate": 3e-4,
    "batch_size": 256,
    "buffer_size": 300_000,
    "learning_starts": 2000,
    "gradient_steps": 4,
    "tau": 0.005,
    "ent_coef": "auto_0.1",
}
PPO: Mapping[str, Any] = {
    "learning_rate": 3e-4,
    "batch_size": 256,
    "n_epochs": 10,
    "gae_lambda": 0.95,
    "ent_coef": 0.001,
    "clip_range": 0.2,
}
_SHOWN = {**SAC, "learning_starts": 600, "gradient_steps": 8}
_ON_POLICY = TrainingSettings("ppo", n_envs=8, rollout=4096, reward_scale=0.01, hyperparameters=PPO)

GRAPH_PPO = TrainingSettings(
    "maskable-ppo", discount=0.998, n_envs=4, rollout=1024,
    hyperparameters={"learning_rate": 3e-4, "batch_size": 128, "n_epochs": 10, "target_kl": 0.03, "ent_coef": 0.0},
)  # fmt: skip
"""Of a sequence graph's decisions, one per 0.2 s; not a method of its own, see `policies.reinforcement.finetuning`."""
RESIDUAL_SAC = TrainingSettings("sac", hyperparameters={**SAC, "learning_starts": 600})
"""Of a residual around a skill, likewise."""

METHODS: dict[str, TrainingSettings] = {
    "sac": TrainingSettings("sac", hyperparameters=SAC),
    "sac-sparse": TrainingSettings("sac", "sparse", hyperparameters=SAC),
    "sac-demos": TrainingSettings("sac", demonstrations=True, hyperparameters=_SHOWN),
    "sac-demos-sparse": TrainingSettings("sac", "sparse", demonstrations=True, hyperparameters=_SHOWN),
    "ppo": _ON_POLICY,
    "ppo-sparse": replace(_ON_POLICY, reward_type="sparse"),
}
"""Name of the method -> its settings."""


def method(name: str) -> TrainingSettings:
    """The settings of a method; UnknownNameError lists what there is."""
    if name not in METHODS:
        raise UnknownNameError("method", name, METHODS)
    return METHODS[name]
