"""Scores of a search, kept in a file of JSON: a search that was killed goes on and repeats no generation."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfd_gym.errors import InvalidArgumentError
from lfd_gym.paths import written_whole

Array = NDArray[np.float64]
SCHEMA = "lfd_gym.search/1"
ROW = ("candidates", "scores", "simulated_seconds", "seconds")
"""What is kept of a generation."""


class SearchLog:
    """The generations of one search, oldest first.

    A search that is told the same scores asks for the same candidates again, so that nothing else has to be kept of it. Raises
    InvalidArgumentError if the file is of another search, or damaged.
    """

    def __init__(self, path: Path, job: Mapping[str, Any]) -> None:
        """Read `path` if it is there; `job` says which search it is."""
        self._path, self._job = path, json.loads(json.dumps({"schema": SCHEMA, **job}))
        self.generations: list[dict[str, Any]] = []
        if path.exists():
            try:
                kept = json.loads(path.read_text())
                of_another = kept["job"] != self._job
                self.generations = [{name: row[name] for name in ROW} for row in kept["generations"]]
            except (ValueError, KeyError, TypeError) as error:
                raise InvalidArgumentError(f"'{path}' is damaged; remove it to search from the beginning") from error
            if of_another:
                raise self._of_another()

    def scored(self, generation: int, candidates: Sequence[Array], score: Callable[[], Mapping[str, Any]]) -> Array:
        """Scores (n,) of the candidates of generation 0, 1, ...; `score()` gives the rest of its row if it is not kept yet."""
        asked = [np.asarray(candidate, dtype=float).tolist() for candidate in candidates]
        if generation == len(self.generations):
            self.generations.append({"candidates": asked, **score()})
            with written_whole(self._path) as temporary:
                temporary.write_text(json.dumps({"job": self._job, "generations": self.generations}) + "\n")
        row = self.generations[generation]
        if row["candidates"] != asked:
            raise self._of_another()
        return np.array(row["scores"], dtype=np.float64)

    def _of_another(self) -> InvalidArgumentError:
        return InvalidArgumentError(f"'{self._path}' is of another search; remove it, or choose another --out")
