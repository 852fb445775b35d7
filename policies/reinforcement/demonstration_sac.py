"""Soft actor-critic from demonstrations: a share of every batch is demonstrated, and so is what the actor is pulled to."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import NStepReplayBuffer
from stable_baselines3.common.policies import BaseModel
from stable_baselines3.common.type_aliases import ReplayBufferSamples
from stable_baselines3.common.utils import update_learning_rate
from stable_baselines3.sac.policies import SACPolicy
from torch import Tensor, nn

from policies.reinforcement.demonstrated_decisions import Transitions

LOG_STD = (-20.0, 2.0)
"""Bounds of the actor's logarithmic standard deviation, those of Stable-Baselines3."""


class DemonstrationBuffer(NStepReplayBuffer):
    """A share of every batch is drawn from demonstrations, the rest from what the agent did (Ball et al. 2023: half)."""

    demonstrations: Transitions | None = None

    def __init__(self, *arguments: Any, share: float = 0.5, **further: Any) -> None:
        super().__init__(*arguments, **further)
        self.share = share

    def interrupt(self) -> None:
        """Say that what comes next does not follow what came last: another episode begins, and no sum may run across."""
        last = self.pos - 1
        self.timeouts[last] = np.maximum(self.timeouts[last], 1.0 - self.dones[last])

    def demonstrated(self, batch_size: int) -> int:
        """How many of a batch are demonstrated; they are its last ones."""
        return 0 if self.demonstrations is None else int(self.share * batch_size)

    def sample(self, batch_size: int, env: Any = None) -> ReplayBufferSamples:
        """Own transitions first, then demonstrated ones; only own ones without demonstrations."""
        n = self.demonstrated(batch_size)
        if self.demonstrations is None or n == 0:
            return super().sample(batch_size, env)
        own = super().sample(batch_size - n, env)
        rows = np.random.randint(0, len(self.demonstrations.rewards), size=n)  # noqa: NPY002
        seen, decisions, rewards, following, ended, discounts = (
            torch.as_tensor(part[rows]) for part in self.demonstrations
        )
        columns = (seen, decisions, following, ended[:, None], rewards[:, None], discounts[:, None])
        parts: Any = zip(own, columns, strict=True)
        both = [torch.cat([a, b.to(a.device)]) for a, b in parts]
        return ReplayBufferSamples(*both)


class StackedCritic(BaseModel):
    """Critics of equal shape, multiplied in one batch, with layer normalisation after every hidden linear layer.

    The normalisation keeps values of unseen actions bounded (Ball et al. 2023).
    """

    def __init__(self, n_critics: int, net_arch: list[int], features_dim: int, action_dim: int, **facts: Any) -> None:
        super().__init__(**facts)
        sizes = (features_dim + action_dim, *net_arch, 1)
        self.weights = nn.ParameterList(_uniform((n_critics, a, b), a) for a, b in pairwise(sizes))
        self.biases = nn.ParameterList(_uniform((n_critics, 1, b), a) for a, b in pairwise(sizes))
        self.gains = nn.ParameterList(torch.ones((n_critics, 1, width)) for width in net_arch)
        self.shifts = nn.ParameterList(torch.zeros((n_critics, 1, width)) for width in net_arch)

    def values(self, observations: Tensor, actions: Tensor) -> Tensor:
        """(n_critics, B, 1)."""
        x = torch.cat([observations, actions], dim=1).expand(len(self.biases[0]), -1, -1)
        hidden = zip(self.weights, self.biases, self.gains, self.shifts, strict=False)
        for weight, bias, gain, shift in hidden:
            x = nn.functional.layer_norm(torch.baddbmm(bias, x, weight), bias.shape[-1:])
            x = torch.relu(torch.addcmul(shift, x, gain))
        return torch.baddbmm(self.biases[-1], x, self.weights[-1])

    def forward(self, observations: Tensor, actions: Tensor) -> tuple[Tensor, ...]:
        """One (B, 1) per critic, as Stable-Baselines3 has them."""
        return tuple(self.values(observations, actions))


class SteadySACPolicy(SACPolicy):
    """SAC's networks with `StackedCritic`.

    The bias of the actor's output may start where it is told to: `quiet` starts with the mean zero everywhere and a standard
    deviation of exp(quiet) before it is squashed.
    """

    def __init__(self, *arguments: Any, quiet: float | None = None, **further: Any) -> None:
        self.quiet = quiet
        super().__init__(*arguments, **further)

    def make_critic(self, features_extractor: Any = None) -> Any:
        """Critics of the same shapes."""
        given = self._update_features_extractor(self.critic_kwargs, features_extractor)
        names = ("observation_space", "action_space", "features_extractor", "normalize_images")
        size = int(np.prod(self.action_space.shape or ()))
        critic = StackedCritic(
            given["n_critics"], given["net_arch"], given["features_dim"], size, **{name: given[name] for name in names}
        )
        return critic.to(self.device)

    def make_actor(self, features_extractor: Any = None) -> Any:
        """The actor, quiet at the start if it is told to be."""
        actor: Any = super().make_actor(features_extractor)
        if self.quiet is not None:
            for layer, bias in ((actor.mu, 0.0), (actor.log_std, self.quiet)):
                nn.init.zeros_(layer.weight)
                nn.init.constant_(layer.bias, bias)
        return actor


class DemonstrationSAC(SAC):
    """SAC (Haarnoja et al. 2018) whose actor is also pulled to demonstrated decisions that its critics prefer.

        loss = mean(alpha log pi(a | s) - min Q(s, a)) + cloning * mean over demonstrated (s, d) of
               [min Q(s, d) > min Q(s, a)] |mode(s) - d|^2 + resting * mean of [min Q(s, 0) > min Q(s, a)] |mode(s)|^2

    The filter is that of Nair et al. (2018): what was demonstrated counts only where it is better than what the agent does.
    The last term pulls a residual to the zero that it starts from. The actor learns after the critics' first `critic_first`
    updates. With both weights and `critic_first` 0 it is SAC.
    """

    def __init__(
        self, *arguments: Any, cloning: float = 0.0, resting: float = 0.0, critic_first: int = 0, **further: Any
    ) -> None:
        self.cloning, self.resting, self.critic_first = cloning, resting, critic_first
        super().__init__(*arguments, **further)

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Updates of critics, actor, temperature and target critics."""
        self.policy.set_training_mode(True)
        temperature: Any = self.ent_coef_optimizer
        for optimizer in (self.actor.optimizer, self.critic.optimizer, temperature):
            update_learning_rate(optimizer, self.lr_schedule(self._current_progress_remaining))
        for _ in range(gradient_steps):
            self._update(batch_size)
            self._n_updates += 1

    def _update(self, batch_size: int) -> None:
        buffer: Any = self.replay_buffer
        log_alpha: Any = self.log_ent_coef
        batch, shown = buffer.sample(batch_size, env=self._vec_normalize_env), buffer.demonstrated(batch_size)
        critic: Any = self.critic
        with torch.no_grad():
            target: Any = self.critic_target
            following, log_prob, _ = self._decide(batch.next_observations)
            value = target.values(batch.next_observations, following).amin(dim=0) - log_alpha.exp() * log_prob
            goal = batch.rewards + (1.0 - batch.dones) * batch.discounts * value
        present = critic.values(batch.observations, batch.actions)
        _descend(self.critic.optimizer, 0.5 * (present - goal).square().mean(dim=(1, 2)).sum())
        if self._n_updates >= self.critic_first:
            self._improve(batch, present.detach().amin(dim=0), shown)
        with torch.no_grad():
            torch._foreach_lerp_(list(self.critic_target.parameters()), list(self.critic.parameters()), self.tau)

    def _improve(self, batch: ReplayBufferSamples, present: Tensor, shown: int) -> None:
        """One step of actor and temperature; `present` (B, 1) values what was done, and the last `shown` are demonstrated."""
        log_alpha: Any = self.log_ent_coef
        critic: Any = self.critic
        actions, log_prob, mean = self._decide(batch.observations)
        mode = torch.tanh(mean)
        self.critic.requires_grad_(False)
        reached = critic.values(batch.observations, actions).amin(dim=0)
        loss = (log_alpha.detach().exp() * log_prob - reached).mean()
        if self.cloning and shown:
            last = slice(-shown, None)
            loss = loss + self.cloning * _pull(mode[last], batch.actions[last], present[last] > reached[last])
        if self.resting:
            rest = torch.zeros_like(mode)
            at_rest = critic.values(batch.observations, rest).amin(dim=0)
            loss = loss + self.resting * _pull(mode, rest, at_rest > reached)
        _descend(self.actor.optimizer, loss)
        self.critic.requires_grad_(True)
        entropy_error = (log_prob.detach() + float(self.target_entropy)).mean()
        _descend(self.ent_coef_optimizer, -(log_alpha * entropy_error).sum())

    def _decide(self, observations: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Random decisions, their log-densities (N, 1), and the mean before it is squashed."""
        actor: Any = self.actor
        latent = actor.latent_pi(observations)
        mean, log_std = actor.mu(latent), actor.log_std(latent).clamp(*LOG_STD)
        noise = torch.randn_like(mean)
        raw = mean + log_std.exp() * noise
        squashing = 2.0 * (math.log(2.0) - raw - nn.functional.softplus(-2.0 * raw))
        density = -0.5 * noise.square() - log_std - 0.5 * math.log(2.0 * math.pi) - squashing
        return torch.tanh(raw), density.sum(dim=1, keepdim=True), mean


def _pull(mode: Tensor, wanted: Tensor, better: Tensor) -> Tensor:
    """Mean squared distance where what is wanted is better (B, 1)."""
    return (better.detach() * (mode - wanted).square().sum(dim=1, keepdim=True)).mean()


def _descend(optimizer: Any, loss: Tensor) -> None:
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()


def _uniform(shape: tuple[int, ...], inputs: int) -> Tensor:
    """Torch's own initial values of a linear layer."""
    bound = 1.0 / math.sqrt(inputs)
    return torch.empty(shape).uniform_(-bound, bound)
