"""Rows of an experiment: results that are kept on disk, and the table that they make."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import joblib

from lfd_gym.errors import InvalidArgumentError
from lfd_gym.evaluation import check_fits, evaluate, wilson_interval
from lfd_gym.paths import written_whole
from lfd_gym.progress import track
from lfd_gym.registry import environment_id, make
from lfd_gym.seeds import DEVELOPMENT_SEED, FINAL_SEED

QUICK_EPISODES = 2
CHUNK = 5
"""Episodes that one process performs at a time."""


@dataclass(frozen=True)
class Rows:
    """Rows kept in a folder: each is made once, so that an interrupted experiment goes on where it stopped."""

    out: Path
    """Folder of the experiment."""
    quick: bool = False
    """Few episodes on development seeds, in a folder of their own."""
    jobs: int = 1
    """Processes."""

    def kept(self, name: str, result: Callable[[], Any]) -> Any:
        """The JSON value of a row, from `result()` if it is not there yet. Raises InvalidArgumentError for a damaged one."""
        if not self.exists(name):
            self.write(name, result())
        try:
            return json.loads(self._path(name).read_text())
        except ValueError as error:
            raise InvalidArgumentError(
                f"the row '{self._path(name)}' is damaged; remove it to make it again"
            ) from error

    @property
    def folder(self) -> Path:
        """Where the rows lie."""
        return self.out / "quick" if self.quick else self.out

    def exists(self, name: str) -> bool:
        """Whether a row is there."""
        return self._path(name).exists()

    def write(self, name: str, value: Any) -> None:
        """Write a row, which is there whole or not at all."""
        text = _text(value)
        with written_whole(self._path(name)) as temporary:
            temporary.write_text(text)

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.json"

    def evaluated(
        self,
        name: str,
        env_id: str,
        policy: Callable[[], Any],
        episodes: int = 100,
        env_kwargs: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """One evaluation, as `EvaluationReport.to_dict`; `policy()` is called only if it has to be made.

        Raises InvalidArgumentError for a row of other setups or of an environment with other arguments.
        """
        report: dict[str, Any] = self.kept(name, lambda: self.report(env_id, policy(), episodes, env_kwargs))
        made = report["env_id"], report["env_kwargs"], [episode["seed"] for episode in report["episodes"]]
        asked = environment_id(env_id), json.loads(json.dumps(dict(env_kwargs or {}))), list(self.seeds(episodes))
        if made != asked:
            raise InvalidArgumentError(f"the row '{self._path(name)}' is of other setups; remove it to make it again")
        return report

    def report(
        self, env_id: str, policy: Any, episodes: int = 100, env_kwargs: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """One evaluation that is not kept."""
        seeds = self.seeds(episodes)
        return evaluate(
            env_id, policy, len(seeds), seeds[0], jobs=self.jobs, env_kwargs=env_kwargs, progress=True
        ).to_dict()

    def observed(
        self,
        name: str,
        env_id: str,
        policy: Callable[[], Any],
        episode: Callable[[Any, Any, int], NamedTuple],
        episodes: int,
        env_kwargs: Mapping[str, Any] | None = None,
    ) -> list[dict[str, Any]]:
        """Per episode what `episode(env, policy, seed)` returns, as dictionaries."""

        def results() -> list[dict[str, Any]]:
            seeds, shown = self.seeds(episodes), policy()
            run = joblib.delayed(_run)
            chunks = [seeds[i : i + CHUNK] for i in range(0, len(seeds), CHUNK)]
            finished = joblib.Parallel(n_jobs=self.jobs, return_as="generator", batch_size=1)(
                run(env_id, dict(env_kwargs or {}), shown, episode, chunk) for chunk in chunks
            )
            return list(track((row for rows in finished for row in rows), len(seeds), "episodes"))

        return self.kept(name, results)

    def seeds(self, episodes: int) -> range:
        """Seeds of the setups."""
        first, n = (DEVELOPMENT_SEED, min(episodes, QUICK_EPISODES)) if self.quick else (FINAL_SEED, episodes)
        return range(first, first + n)


def _text(value: Any) -> str:
    """JSON to be read by people: a list has one item per line."""
    if isinstance(value, list):
        return "[\n" + ",\n".join(json.dumps(item) for item in value) + "\n]\n"
    return json.dumps(value, indent=2) + "\n"


def _run(
    env_id: str, env_kwargs: dict[str, Any], policy: Any, episode: Callable[[Any, Any, int], NamedTuple], seeds: range
) -> list[dict[str, Any]]:
    env = make(env_id, **env_kwargs)
    try:
        check_fits(policy, env)
        return [episode(env, policy, seed)._asdict() for seed in seeds]
    finally:
        env.close()


def rate(successes: float, n: int) -> str:
    """ "97 [91, 99]": successes in percent with their 95 % Wilson interval."""
    low, high = wilson_interval(successes, n)
    return f"{100 * successes / n:.0f} [{100 * low:.0f}, {100 * high:.0f}]"


def over_setups(reached: Sequence[bool], seeds: Sequence[int]) -> tuple[float, int]:
    """Successes and setups of some episodes; what several skills do on one setup counts once, as their mean."""
    n = len(set(seeds))
    return n * sum(reached) / len(reached), n


def solved(episodes: Sequence[Mapping[str, Any]]) -> str:
    """`rate` of some episodes with its interval over setups."""
    return rate(*over_setups([episode["success"] for episode in episodes], [episode["seed"] for episode in episodes]))


def success(reports: Sequence[Mapping[str, Any]]) -> str:
    """`solved` of some policies on the same setups: their mean."""
    return solved([episode for report in reports for episode in report["episodes"]])


def missed(report: Mapping[str, Any]) -> str:
    """ "in_box 3, lifted 1": the first part of the task that failed episodes did not reach, most often first."""
    failed = [episode for episode in report["episodes"] if not episode["success"]]
    first = Counter(
        episode["error"] or next((part for part, reached in episode["subtasks"].items() if not reached), "the end")
        for episode in failed
    )
    return ", ".join(f"{part} {n}" for part, n in first.most_common())


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])
