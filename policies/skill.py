"""Skills: learned policies, their predictor protocol and their files.

A skill's file is one `npz` of plain arrays and a JSON header with a schema version. Loading never runs code from it.
"""

import json
import os
import tokenize
import zipfile
import zlib
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from lfd_gym.errors import InvalidArgumentError, SkillFileError
from lfd_gym.paths import written_whole

SCHEMA = "lfd_gym.skill/4"
HEADER = "header"
"""Name of the array that holds the JSON header."""
DAMAGED = (
    OSError, TypeError, ValueError, KeyError, EOFError, RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error,
    tokenize.TokenError,
)  # fmt: skip
"""What a file that is no skill, or is damaged, raises as it is read."""
SKILLS: dict[str, str] = {
    "sequence-graph": "policies.sequence_graph_skill:SequenceGraphSkill",
    "path": "policies.path_skill:PathSkill",
    "agent": "policies.reinforcement.agent_skill:AgentSkill",
    "residual": "policies.reinforcement.residual:ResidualSkill",
    "refined-graph": "policies.reinforcement.refined_graph:RefinedGraphSkill",
}
"""Kind written in a skill's file -> the class that reads it."""

Observation = Mapping[str, NDArray[Any]]
State = tuple[NDArray[Any], ...]


class Skill(ABC):
    """A learned policy: immutable, picklable, and a predictor in Stable-Baselines3's sense.

    The arrays that it is given become read-only, those of a copy or a pickle are not.
    A subclass states `kind`, the key under which `SKILLS` finds it, and implements `start`, `decide`,
    `to_arrays` and `from_arrays`.
    """

    kind: ClassVar[str]

    def __init__(self, env_id: str, taught_seeds: tuple[int, ...], metadata: Mapping[str, Any]) -> None:
        """env_id it was taught in, reset seeds of the demonstrations, and JSON-able facts for reports."""
        if not isinstance(env_id, str):
            raise InvalidArgumentError(f"env_id is {env_id!r}; it must be the id of an environment")
        self.env_id, self.taught_seeds, self.metadata = env_id, tuple(taught_seeds), dict(metadata)

    def __setattr__(self, name: str, value: Any) -> None:
        _freeze(value)
        super().__setattr__(name, value)

    @property
    def facts(self) -> dict[str, Any]:
        """The arguments of this class's constructor."""
        return {"env_id": self.env_id, "taught_seeds": self.taught_seeds, "metadata": self.metadata}

    def with_facts(self, **changed: Any) -> Self:
        """The same skill, some of its facts changed."""
        values, arrays = self.to_arrays()
        return type(self).from_arrays(values, arrays, **(self.facts | changed))

    @abstractmethod
    def start(self, n: int) -> State:
        """State before the first observation: arrays with one row per environment."""

    @abstractmethod
    def decide(self, observation: Observation, state: State) -> tuple[NDArray[np.float32], State]:
        """Action (A,) for one observation of (d,) arrays; state holds one row without its leading axis."""

    @abstractmethod
    def to_arrays(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """What was learned, as JSON values and arrays."""

    @classmethod
    @abstractmethod
    def from_arrays(cls, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], **facts: Any) -> Self:
        """The skill that `to_arrays` described; facts are the arguments of this class's constructor."""

    def predict(
        self,
        observation: Observation,
        state: State | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[NDArray[np.float32], State]:
        """Action and next state; observation arrays (d,) give (A,), arrays (n, d) give (n, A).

        state has one row per environment (one for unvectorised observations); None starts. Rows are started over where
        episode_start is True. `deterministic` changes nothing: skills are deterministic.
        """
        first = next(iter(observation.values()))
        if np.ndim(first) == 1:
            if state is None or (episode_start is not None and np.any(episode_start)):
                state = self.start(1)
            action, following = self.decide(observation, tuple(array[0] for array in state))
            return action, tuple(np.asarray(value)[np.newaxis] for value in following)
        n = len(first)
        fresh = self.start(n)
        state = fresh if state is None else state
        started = np.zeros(n, dtype=bool) if episode_start is None else np.atleast_1d(episode_start)
        actions, rows = [], []
        for i in range(n):
            seen = {name: values[i] for name, values in observation.items()}
            action, row = self.decide(seen, tuple(array[i] for array in (fresh if started[i] else state)))
            actions.append(action)
            rows.append(row)
        return np.stack(actions), tuple(np.stack(arrays) for arrays in zip(*rows, strict=True))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the skill to one file, which is there whole or not at all.

        Raises SkillFileError for a kind that is not in `SKILLS`: nothing could read the file.
        """
        kind = getattr(self, "kind", None)
        if kind not in SKILLS:
            row = f'"{kind}": "{type(self).__module__}:{type(self).__name__}"'
            raise SkillFileError(f"SKILLS in policies/skill.py has no row {row}; nothing could read the file")
        values, arrays = self.to_arrays()
        described = {"schema": SCHEMA, "kind": kind, "facts": self.facts, "values": values}
        header = json.dumps(described, sort_keys=True, default=lambda value: value.tolist())
        with written_whole(path) as temporary, open(temporary, "wb") as file:
            everything: dict[str, Any] = {HEADER: np.array(header), **arrays}
            np.savez(file, **everything)


def _freeze(value: Any) -> None:
    """Make every array in nested tuples and lists read-only."""
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    elif isinstance(value, tuple | list):
        for part in value:
            _freeze(part)


def read_skill_file(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Header and arrays of a skill's file; SkillFileError says in one line what is wrong with it."""
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        header = json.loads(str(arrays.pop(HEADER)))
    except FileNotFoundError:
        raise SkillFileError(f"no skill at '{path}'; 'lfd-gym learn' writes one") from None
    except DAMAGED as error:
        raise SkillFileError(f"'{path}' is no skill, or is damaged; 'lfd-gym learn' writes skills") from error
    if not isinstance(header, dict) or header.get("schema") != SCHEMA:
        found = header.get("schema") if isinstance(header, dict) else None
        raise SkillFileError(f"'{path}' has the schema {found!r}; this version reads {SCHEMA!r}")
    return header, arrays
