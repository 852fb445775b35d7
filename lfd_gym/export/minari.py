"""Demonstrations as a data set of Minari, from which libraries of offline reinforcement learning read."""

import os
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.demonstration import NO_LABEL, Demonstration
from lfd_gym.errors import InvalidArgumentError
from lfd_gym.export.data_set import check_exportable, imported, written_below
from lfd_gym.registry import make

ROOT = "MINARI_DATASETS_PATH"
"""Environment variable in which Minari looks for the folder of its data sets."""
DATASET_ID = re.compile(r"([\w-]+/)?[\w-]+-v\d+")


def to_minari(demonstrations: Sequence[Demonstration], root: str | os.PathLike[str], dataset_id: str) -> Path:
    """Write a data set below the folder `root`, whole or not at all, and return its own folder.

    `MINARI_DATASETS_PATH=root` lets `minari.load_dataset(dataset_id)` find it. Its environment is the one that was
    demonstrated in; seed and options of an episode reset it to the setup that was shown. The infos of an episode are "label",
    the primitive that led to an observation (-1 for the first and where there is none), and "state", which `set_state` takes.

    Raises MissingExtraError without the extra `data`, DemonstrationError for demonstrations of several environments, and
    InvalidArgumentError for an id that is malformed or taken and for an environment that is not registered by a string.
    """
    minari, root = imported("minari"), Path(root).absolute()
    env_id, first = check_exportable(demonstrations), demonstrations[0]
    if not DATASET_ID.fullmatch(dataset_id):
        raise InvalidArgumentError(f"'{dataset_id}' is no id of a data set; it must read name-v0, or task/name-v0")
    with (
        written_below(root, dataset_id) as temporary,
        closing(make(env_id, **first.env_kwargs)) as env,
        _below(str(temporary)),
        warnings.catch_warnings(),
    ):
        if env.spec is None or callable(env.spec.entry_point):
            raise InvalidArgumentError(
                f"{env_id} is registered by its class; register it as 'module:Class', which can be stored"
            )
        warnings.filterwarnings("ignore", "`(code_permalink|author|author_email|eval_env)` is set to None")
        minari.create_dataset_from_buffers(
            dataset_id,
            [_episode(minari, i, demonstration) for i, demonstration in enumerate(demonstrations)],
            env=env,
            algorithm_name=", ".join(f"{key} {value}" for key, value in first.teacher.items()) or "unknown",
            description="Demonstrations in an environment of lfd_gym.",
            requirements=[f"{name}=={version}" for name, version in first.versions.items() if name != "python"],
        )
    return root / dataset_id


@contextmanager
def _below(root: str) -> Iterator[None]:
    """Minari's folder, for as long as the block runs."""
    before = os.environ.get(ROOT)
    os.environ[ROOT] = root
    try:
        yield
    finally:
        if before is None:
            del os.environ[ROOT]
        else:
            os.environ[ROOT] = before


def _episode(minari: Any, i: int, demonstration: Demonstration) -> Any:
    ends = np.arange(1, len(demonstration) + 1) == len(demonstration)
    terminated = demonstration.success and demonstration.env_kwargs.get("terminate_on_success", True)
    return minari.data_collector.EpisodeBuffer(
        id=i,
        seed=demonstration.seed.get("reset"),
        options={"setup": demonstration.setup},
        observations=dict(demonstration.observations),
        actions=demonstration.actions,
        rewards=demonstration.rewards.tolist(),
        terminations=(ends & terminated).tolist(),
        truncations=(ends & (not terminated)).tolist(),
        infos={"label": np.concatenate([[NO_LABEL], demonstration.labels]), "state": demonstration.states},
    )
