"""What is trained with which settings: one visible row per method, the same for every task."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from lfd_gym.errors import InvalidArgumentError, UnknownNameError

DECIDED = ("reward_type", "terminate_on_success")
"""Arguments of an environment that the method decides."""


@dataclass(frozen=True)
class TrainingSettings:
    """How a method trains on the RL view."""

    algorithm: str
    """"sac" or "ppo" of Stable-Baselines3, or "maskable-ppo" of sb3-contrib."""
    reward_type: str = "dense"
    """Of the environment."""
    demonstrations: bool = False
    """Whether it learns from demonstrations."""
    demonstrated_batch: float = 0.5
    """Share of every batch that is drawn from them."""
    cloning: float = 0.0
    """Weight of the pull to demonstrated decisions that the critics prefer, see `DemonstrationSAC`."""
    resting: float = 0.0
    """Weight of the pull of a residual to zero where the critics prefer that."""
    critic_first: int = 0
    """Updates of the critics before the actor learns."""
    demonstrated_starts: float = 0.0
    """Share of the training's episodes that begin in a demonstrated state."""
    n_steps: int = 1
    """Decisions whose rewards are summed before a critic's value is trusted."""
    episode: int = 0
    """Decisions after which an episode of the training is cut off; 0 for the environment's time limit."""
    discount: float = 0.99
    """Per decision; 0.97 looks 3 s ahead, 0.99 looks 10 s."""
    reward_scale: float = 1.0
    """Factor of the reward's growth, see `Growth`."""
    n_envs: int = 1
    """Environments that are stepped together."""
    annealing: float = 0.0
    """Last share of the training in which the learning rate falls, linearly to zero."""
    rollout: int = 8
    """Decisions between two rounds of updates, of all environments together."""
    hyperparameters: Mapping[str, Any] = field(default_factory=dict)
    """Further arguments of the algorithm."""

    @property
    def counted_updates(self) -> int:
        """Steps of the optimiser in what Stable-Baselines3 counts as one update: one off policy, on policy those of a whole
        epoch, which `target_kl` may cut short."""
        return 1 if self.algorithm == "sac" else math.ceil(self.rollout / int(self.hyperparameters["batch_size"]))

    def learning_rate(self, done: float) -> float:
        """After this share of the training's decisions."""
        rate = float(self.hyperparameters["learning_rate"])
        return rate * min(1.0, (1.0 - done) / self.annealing) if self.annealing else rate


SAC: Mapping[str, Any] = {"batch_size": 128, "buffer_size": 300_000, "gradient_steps": 8, "tau": 0.005}
"""What all methods that learn off policy share."""
PPO: Mapping[str, Any] = {
    "learning_rate": 3e-4,
    "batch_size": 256,
    "n_epochs": 10,
    "gae_lambda": 0.95,
    "ent_coef": 0.001,
    "clip_range": 0.2,
}
_OFF_POLICY = TrainingSettings(
    "sac", discount=0.97, n_steps=5, reward_scale=10.0, episode=100, annealing=0.3,
    hyperparameters={**SAC, "learning_rate": 1e-3, "learning_starts": 2000, "ent_coef": "auto_0.01"},
)  # fmt: skip
_SHOWN = replace(
    _OFF_POLICY, demonstrations=True, demonstrated_batch=0.25, demonstrated_starts=0.25, cloning=1.0,
    hyperparameters={**_OFF_POLICY.hyperparameters, "learning_starts": 600},
)  # fmt: skip
_ON_POLICY = TrainingSettings("ppo", n_envs=8, rollout=4096, hyperparameters=PPO)

GRAPH_PPO = TrainingSettings(
    "maskable-ppo", discount=0.998, n_envs=4, rollout=1024,
    hyperparameters={"learning_rate": 1e-3, "batch_size": 128, "n_epochs": 10, "target_kl": 0.03, "ent_coef": 0.01},
)  # fmt: skip
"""Of a sequence graph's decisions, up to 0.2 s each; not a method of its own, see `policies.reinforcement.finetuning`."""
RESIDUAL_SAC = TrainingSettings(
    "sac", resting=1.0, critic_first=4000, n_steps=5, reward_scale=10.0,
    hyperparameters={**SAC, "learning_rate": 3e-4, "learning_starts": 100, "ent_coef": "auto_0.001"},
)  # fmt: skip
"""Of a residual around a skill, likewise."""

METHODS: dict[str, TrainingSettings] = {
    "sac": _OFF_POLICY,
    "sac-sparse": replace(_OFF_POLICY, reward_type="sparse"),
    "sac-demos": _SHOWN,
    "sac-demos-sparse": replace(_SHOWN, reward_type="sparse"),
    "ppo": _ON_POLICY,
    "ppo-sparse": replace(_ON_POLICY, reward_type="sparse"),
}
"""Name of the method -> its settings."""


def checked_kwargs(env_kwargs: Mapping[str, Any]) -> dict[str, Any]:
    """A copy of an environment's arguments; InvalidArgumentError for one that the method decides."""
    for name in DECIDED:
        if name in env_kwargs:
            raise InvalidArgumentError(f"'{name}' is decided by the method; leave it out, or choose another method")
    return dict(env_kwargs)


def method(name: str) -> TrainingSettings:
    """The settings of a method; UnknownNameError lists what there is."""
    if name not in METHODS:
        raise UnknownNameError("method", name, METHODS)
    return METHODS[name]
