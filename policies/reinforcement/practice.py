"""Practice: what a method of fine-tuning is given, and how well skills do on the same training setups."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import joblib
import numpy as np
from numpy.typing import NDArray

from lfd_gym.registry import make
from lfd_gym.rollout import rollout
from lfd_gym.seeds import PRACTICE_SEED, SEEDS_PER_RUN
from policies.skill import Skill

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Practice:
    """What a method of fine-tuning is given."""

    skill: Skill
    """The one to start from."""
    env_id: str
    env_kwargs: Mapping[str, Any]
    episodes: int
    """How many it may do, about."""
    folder: Path
    """For checkpoints."""
    seed: int = 0
    jobs: int = 1
    """Processes, for methods that use them."""
    progress: bool = False
    """A bar on a terminal."""

    @property
    def first_seed(self) -> int:
        """Reset seed of its first episode."""
        return PRACTICE_SEED + SEEDS_PER_RUN * self.seed


def identity(skill: Skill) -> dict[str, str]:
    """Kind and hash of a skill, for what is kept of its practice; what its metadata say does not count."""
    values, arrays = skill.to_arrays()
    contents = values, {name: np.array(array, order="C") for name, array in arrays.items()}
    return {"skill": skill.kind, "contents": joblib.hash(contents)}


Practised = tuple[Skill, dict[str, Any]]
"""The skill that came of it, and "episodes", "updates", "simulated_hours", "seconds" and other facts."""


class Episode(NamedTuple):
    """One episode of practice."""

    score: float
    """1 for success, else the dense reward at the end, below 1."""
    seconds: float
    """Simulated time [s]."""


def practise(
    skills: Sequence[Skill], env_id: str, env_kwargs: Mapping[str, Any], seeds: Sequence[int], jobs: int = 1
) -> list[list[Episode]]:
    """Per skill one episode per seed, the same for all; in `jobs` processes."""
    run = joblib.delayed(_episodes)
    return list(joblib.Parallel(n_jobs=jobs)(run(skill, env_id, dict(env_kwargs), list(seeds)) for skill in skills))


def scores(episodes: Sequence[Sequence[Episode]]) -> Array:
    """Mean score (n,) of n skills."""
    return np.array([np.mean([episode.score for episode in row]) for row in episodes])


def _episodes(skill: Skill, env_id: str, env_kwargs: Mapping[str, Any], seeds: Sequence[int]) -> list[Episode]:
    env = make(env_id, reward_type="dense", **env_kwargs)
    try:
        return [_episode(env, skill, seed) for seed in seeds]
    finally:
        env.close()


def _episode(env: Any, skill: Skill, seed: int) -> Episode:
    steps, reward = 0, 0.0
    for step in rollout(env, skill, seed):
        steps, reward = steps + 1, step.reward
    return Episode(reward, steps * env.unwrapped.dt)
