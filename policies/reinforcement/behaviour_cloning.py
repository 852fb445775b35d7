"""Behaviour cloning on the RL view: one decision at a time, or chunks of them."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from lfd_gym.demonstration import Demonstration, taught_seeds
from lfd_gym.errors import DemonstrationError, InvalidArgumentError
from policies.arguments import check_count, check_flag, check_number
from policies.learner import Learner
from policies.reinforcement.agent_skill import AgentSkill
from policies.reinforcement.demonstrated_decisions import check_observed, decisions, flat_observations, moving, view_of
from policies.reinforcement.network import Network

SMALLEST_SCALE = 0.02
"""Of an input, so that what hardly varied while it was demonstrated does not become large when it does."""
LOSSES = {"squared": nn.functional.mse_loss, "absolute": nn.functional.l1_loss}


class BehaviourCloning(Learner):
    """Regression of the demonstrated decisions on the flat observations, deterministic.

    Every control step of a demonstration is an example, with the decision that begins there.

    Parameters:
        updates: gradient steps.
        batch: examples of each.
        width: units of each of two hidden layers.
        rate: learning rate of AdamW at the beginning; it falls to zero along a cosine.
        decay: weight decay.
        noise: standard deviation of noise on the standardised inputs, so that small errors are seen in training.
        loss: "squared" or "absolute".
        chunk: decisions that are predicted at a time.
        executed: how many of them are made before it looks again.
        skips_pauses: leave out the steps of a demonstration in which nothing moves.
        seed: of the initial weights and the batches.

    Attributes:
        losses_: training loss of every update.
    """

    needs = ("tool_position", "tool_quaternion", "reference_position", "reference_quaternion", "wrench")
    reads = ("",)
    needs_labels = False
    reads_actions = True
    is_baseline = True

    losses_: list[float]

    def __init__(
        self,
        updates: int = 5000,
        batch: int = 256,
        width: int = 256,
        rate: float = 1e-3,
        decay: float = 1e-4,
        noise: float = 0.05,
        loss: str = "squared",
        chunk: int = 1,
        executed: int = 1,
        skips_pauses: bool = True,
        seed: int = 0,
    ) -> None:
        self.updates, self.batch, self.width, self.rate, self.decay = updates, batch, width, rate, decay
        self.noise, self.loss, self.chunk, self.executed, self.seed = noise, loss, chunk, executed, seed
        self.skips_pauses = skips_pauses

    def learn(self, demonstrations: Sequence[Demonstration]) -> AgentSkill:
        """Fit the network and export it."""
        if self.loss not in LOSSES:
            raise InvalidArgumentError(f"loss '{self.loss}'; possible: {', '.join(LOSSES)}")
        for name in ("updates", "batch", "width", "chunk", "executed"):
            check_count(name, getattr(self, name), 1)
        for name in ("rate", "decay", "noise"):
            check_number(name, getattr(self, name), 0.0, 1e3)
        check_count("seed", self.seed, 0)
        check_flag("skips_pauses", self.skips_pauses)
        if not 1 <= self.executed <= self.chunk:
            raise InvalidArgumentError(f"executed is {self.executed}; possible: 1 to chunk, {self.chunk}")
        view = view_of(demonstrations[0])
        check_observed(demonstrations, view)
        kept = [moving(d, view) if self.skips_pauses else np.full(len(d), True) for d in demonstrations]
        examples = [
            (flat_observations(d, view)[:-1][rows], decisions(d, view)[rows])
            for d, rows in zip(demonstrations, kept, strict=True)
        ]
        if not any(rows.any() for rows in kept):
            raise DemonstrationError("nothing moves in the demonstrations; skips_pauses=False learns to stay")
        inputs = np.concatenate([seen for seen, _ in examples]).astype(np.float64)
        targets = np.concatenate([_chunks(shown, self.chunk, view.repeats) for _, shown in examples])
        mean, scale = inputs.mean(axis=0), np.maximum(inputs.std(axis=0), SMALLEST_SCALE)
        network = self._fit((inputs - mean) / scale, targets, mean, scale)
        seeds = taught_seeds(demonstrations)
        metadata = {"learner": type(self).__name__, "demonstrations": len(demonstrations), "updates": self.updates}
        return AgentSkill(
            network, view, self.executed, env_id=demonstrations[0].env_id, taught_seeds=seeds, metadata=metadata
        )

    def _fit(
        self,
        inputs: NDArray[np.float64],
        targets: NDArray[np.float64],
        mean: NDArray[np.float64],
        scale: NDArray[np.float64],
    ) -> Network:
        generator = torch.Generator().manual_seed(self.seed)
        x, y = torch.as_tensor(inputs, dtype=torch.float32), torch.as_tensor(targets, dtype=torch.float32)
        sizes = (x.shape[1], self.width, self.width, y.shape[1])
        layers = [_linear(n, m, generator) for n, m in pairwise(sizes)]
        model = nn.Sequential(layers[0], nn.ReLU(), layers[1], nn.ReLU(), layers[2], nn.Tanh())
        optimiser = torch.optim.AdamW(model.parameters(), lr=self.rate, weight_decay=self.decay)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, self.updates)
        self.losses_ = []
        for _ in range(self.updates):
            rows = torch.randint(len(x), (self.batch,), generator=generator)
            noise = self.noise * torch.randn((self.batch, x.shape[1]), generator=generator)
            error = LOSSES[self.loss](model(x[rows] + noise), y[rows])
            optimiser.zero_grad()
            error.backward()
            optimiser.step()
            schedule.step()
            self.losses_.append(float(error.detach()))
        return Network.of(layers, "relu", "tanh", mean, scale)


class ChunkedBehaviourCloning(BehaviourCloning):
    """Behaviour cloning of chunks: the decisions of the next 0.8 s at a time, of which the first half is made (Zhao et al.
    2023). Pauses and other habits of a teacher that one observation does not explain disturb it less.

    Parameters as in `BehaviourCloning`.
    """

    def __init__(
        self,
        updates: int = 5000,
        batch: int = 256,
        width: int = 256,
        rate: float = 1e-3,
        decay: float = 1e-4,
        noise: float = 0.05,
        loss: str = "absolute",
        chunk: int = 8,
        executed: int = 4,
        skips_pauses: bool = True,
        seed: int = 0,
    ) -> None:
        super().__init__(updates, batch, width, rate, decay, noise, loss, chunk, executed, skips_pauses, seed)


def _chunks(shown: NDArray[np.float64], chunk: int, every: int) -> NDArray[np.float64]:
    """The decisions (T, chunk * C) that begin at each step and at every later decision; the last one goes on."""
    last = len(shown) - 1
    steps = np.minimum(np.arange(len(shown))[:, None] + every * np.arange(chunk), last)
    return shown[steps].reshape(len(shown), chunk * shown.shape[1])


def _linear(n: int, m: int, generator: torch.Generator) -> nn.Linear:
    """A layer with Kaiming's uniform weights, drawn from the generator."""
    layer = nn.Linear(n, m)
    nn.init.kaiming_uniform_(layer.weight, nonlinearity="relu", generator=generator)
    nn.init.zeros_(layer.bias)
    return layer
