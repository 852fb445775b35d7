"""What the experiments teach and learn."""

import functools
from collections.abc import Sequence
from typing import Any

from lfd_gym.demonstration import Demonstration
from lfd_gym.recording import record
from lfd_gym.registry import look_up
from policies.sequence_graph_learner import SequenceGraphLearner
from scripted_teachers import TEACHERS

TEACHING = {
    "lfd_gym/LightBulb-v0": 3,
    "lfd_gym/MoveObject-v0": 3,
    "lfd_gym/BoxStacking-v0": 3,
    "lfd_gym/BoxFlipping-v0": 5,
    "lfd_gym/CylinderGrasp-v0": 17,
}
"""Demonstrations that each task is taught with, as many as in the thesis."""


@functools.lru_cache(maxsize=3)
def demonstrations(env_id: str, n: int, seed: int, mode: str = "commanded") -> Sequence[Demonstration]:
    """Noise-1 demonstrations of a teaching seed; the first of them are those of a smaller n."""
    return tuple(record(env_id, teacher(env_id, 1.0, mode), n, seed).demonstrations)


def learned(env_id: str, seed: int, n: int | None = None, mode: str = "commanded", **parameters: Any) -> Any:
    """The sequence-graph skill of n demonstrations, by default of as many as `TEACHING` says."""
    return learned_from(demonstrations(env_id, n or TEACHING[env_id], seed, mode), **parameters)


def learned_from(shown: Sequence[Demonstration], **parameters: Any) -> Any:
    """The sequence-graph skill of these demonstrations."""
    return SequenceGraphLearner(**parameters).fit(shown).skill_


def teacher(env_id: str, noise: float, mode: str = "commanded") -> Any:
    """The scripted teacher of a task."""
    return look_up(TEACHERS, "teacher for", env_id)(noise=noise, mode=mode)
