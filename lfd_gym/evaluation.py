"""One line that judges a teacher, a skill, a baseline or an agent on the same unseen setups."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral
from typing import Any, NamedTuple

import gymnasium
import joblib

from lfd_gym.errors import InvalidArgumentError, SeedOverlapError
from lfd_gym.json_values import json_values
from lfd_gym.progress import track
from lfd_gym.registry import environment_id, make, task_id
from lfd_gym.rollout import Policy, as_policy, rollout
from lfd_gym.versions import versions

SCHEMA = "lfd_gym.evaluation/1"
Z_95 = 1.959963984540054
"""97.5 % quantile of the standard normal distribution: a two-sided interval of 95 %."""


class Episode(NamedTuple):
    """How one episode went."""

    seed: int
    success: bool
    """The task was solved when the episode ended."""
    subtasks: dict[str, bool]
    """Per part of the task whether it was reached at any time."""
    steps: int
    seconds: float
    """Simulated time [s]."""
    return_: float
    """Sum of rewards."""
    error: str | None
    """What was raised, if the episode died of it."""


@dataclass(frozen=True)
class EvaluationReport:
    """What `evaluate` returns: one row per episode and the success rate with its uncertainty."""

    env_id: str
    env_kwargs: Mapping[str, Any]
    policy: str
    """What was evaluated, in words."""
    episodes: tuple[Episode, ...]
    versions: Mapping[str, str] = field(default_factory=versions)

    @property
    def successes(self) -> int:
        """Number of solved episodes."""
        return sum(episode.success for episode in self.episodes)

    @property
    def success_rate(self) -> float:
        """Solved episodes over all."""
        return self.successes / len(self.episodes)

    @property
    def wilson(self) -> tuple[float, float]:
        """95 % interval of the success rate."""
        return wilson_interval(self.successes, len(self.episodes))

    def to_dict(self) -> dict[str, Any]:
        """The report as JSON values; nothing in it depends on the clock, so equal runs give equal reports."""
        rows = [{name.rstrip("_"): value for name, value in e._asdict().items()} for e in self.episodes]
        return {
            "schema": SCHEMA,
            "env_id": self.env_id,
            "env_kwargs": dict(self.env_kwargs),
            "policy": self.policy,
            "episodes": rows,
            "success_rate": self.success_rate,
            "wilson": list(self.wilson),
            "versions": dict(self.versions),
        }

    def to_json(self) -> str:
        """The report as indented JSON."""
        return json.dumps(self.to_dict(), indent=2) + "\n"

    def table(self) -> str:
        """The report as a few lines of text."""
        low, high = self.wilson
        n = len(self.episodes)
        lines = [
            f"{self.policy} in {self.env_id}",
            f"  {'success':<20}{self.successes:>5} / {n}   {self.success_rate:6.1%}   95 % [{low:.1%}, {high:.1%}]",
        ]
        for name in self.episodes[0].subtasks or next((e.subtasks for e in self.episodes if e.subtasks), {}):
            reached = sum(episode.subtasks.get(name, False) for episode in self.episodes)
            lines.append(f"  {name:<20}{reached:>5} / {n}   {reached / n:6.1%}")
        solved = [episode.seconds for episode in self.episodes if episode.success]
        if solved:
            lines.append(f"  {'seconds if solved':<20}{sum(solved) / len(solved):>5.1f}")
        failed = [str(episode.seed) for episode in self.episodes if not episode.success]
        if failed:
            more = f" and {len(failed) - 10} more" if len(failed) > 10 else ""
            lines.append(f"  failed seeds: {', '.join(failed[:10])}{more}")
        errors = [episode.error for episode in self.episodes if episode.error]
        if errors:
            lines.append(f"  {len(errors)} episodes ended in an error, the first: {errors[0]}")
        return "\n".join(lines)


def evaluate(
    env_id: str,
    policy: Any,
    episodes: int,
    seed: int,
    jobs: int = 1,
    env_kwargs: Mapping[str, Any] | None = None,
    progress: bool = False,
) -> EvaluationReport:
    """Run a policy or a teacher in `episodes` episodes, the i-th of them reset with `seed + i`, in `jobs` processes.

    `jobs` changes nothing but time; for more than one the policy must be picklable. An exception in an episode makes it
    a failed one that keeps the exception's text as `error`. Raises SeedOverlapError if the policy was taught on one of
    the seeds, and InvalidArgumentError if it does not fit the environment (`check_fits`) or a number is out of range.
    """
    check_numbers(episodes=episodes, seed=seed, jobs=jobs)
    policy = as_policy(policy)
    env_id, env_kwargs = environment_id(env_id), dict(env_kwargs or {})
    written = json_values(env_kwargs)
    seeds = range(seed, seed + episodes)
    overlap = sorted(set(getattr(policy, "taught_seeds", ())).intersection(seeds))
    if overlap:
        shown = ", ".join(str(s) for s in overlap[:5])
        raise SeedOverlapError(
            f"the skill was taught on {len(overlap)} of the seeds {seed} to {seed + episodes - 1} ({shown}); "
            f"choose a block of seeds without them, such as --seed {overlap[-1] + 1}"
        )
    finished = _run_all(env_id, env_kwargs, policy, seeds, jobs)
    rows = tuple(track(finished, episodes, "episodes", progress))
    return EvaluationReport(env_id, written, describe(policy), rows)


def check_fits(policy: Any, env: gymnasium.Env) -> None:
    """Raise InvalidArgumentError for a skill or teacher of another task, another control step, or an environment without."""
    native, taught_for, dt = env.unwrapped, getattr(policy, "env_id", None), getattr(policy, "dt", None)
    env_id, step = env.spec.id if env.spec else type(native).__name__, getattr(native, "dt", None)
    if step is None:
        raise InvalidArgumentError(f"{env_id} is no environment of this suite: it has no control step `dt`")
    if taught_for is not None and task_id(taught_for) != task_id(env_id):
        raise InvalidArgumentError(f"this skill was taught for {taught_for}, not for {env_id}")
    teacher = getattr(policy, "teacher", None)
    observed = getattr(native.observation_space, "spaces", {})
    missing = sorted(name for name in _frames(teacher) if f"frame_{name}" not in observed)
    if missing:
        raise InvalidArgumentError(f"{type(teacher).__name__} cannot teach {env_id}: no frame {', '.join(missing)}")
    seen = getattr(policy, "observation_space", native.observation_space)
    if seen != native.observation_space:
        raise InvalidArgumentError(
            f"this agent sees {seen} and not what {env_id} shows; for one of the RL view, make a ViewPolicy(agent, env.view)"
        )
    if dt is not None and not math.isclose(dt, step):
        raise InvalidArgumentError(
            f"this skill was taught at {1.0 / dt:g} decisions per second, not at {1.0 / step:g}; set control_hz={1.0 / dt:g}"
        )


def wilson_interval(successes: float, n: int, z: float = Z_95) -> tuple[float, float]:
    """Wilson's score interval of a success rate (Wilson 1927); z is the normal quantile, 95 % by default."""
    rate = successes / n
    centre = (rate + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(rate * (1 - rate) / n + z * z / (4 * n * n))
    return max(0.0, centre - half), min(1.0, centre + half)


def describe(policy: Any) -> str:
    """A policy in words: its class, and what its `metadata`, or its teacher's noise and mode, say."""
    teacher = getattr(policy, "teacher", None)
    if teacher is not None:
        guided = ", kinesthetic" if getattr(teacher, "mode", "") == "kinesthetic" else ""
        return f"{type(teacher).__name__} (noise {getattr(teacher, 'noise', 0.0):g}{guided})"
    learner = dict(getattr(policy, "metadata", {})).get("learner")
    return f"{type(policy).__name__} ({learner})" if isinstance(learner, str) else type(policy).__name__


def _frames(teacher: Any) -> set[str]:
    """Names of the frames in which a teacher's primitives are."""
    table = getattr(teacher, "primitives", ())
    return {entity.frame for row in table for entity in row[1:] if entity is not None} - {"world"}


def check_numbers(**numbers: Any) -> None:
    """Raise InvalidArgumentError unless all are whole numbers, a `seed` from 0 and what else there is from 1 on."""
    for name, value in numbers.items():
        least = 0 if name == "seed" else 1
        if not isinstance(value, Integral) or value < least:
            raise InvalidArgumentError(f"{name} is {value!r}; it must be a whole number, {least} or more")


def _run_all(
    env_id: str, env_kwargs: Mapping[str, Any], policy: Policy, seeds: Sequence[int], jobs: int
) -> Iterator[Episode]:
    if jobs == 1:
        yield from _run(env_id, env_kwargs, policy, seeds)
        return
    size = max(1, min(10, math.ceil(len(seeds) / (2 * jobs))))
    chunks = [seeds[i : i + size] for i in range(0, len(seeds), size)]
    run = joblib.delayed(_run_list)
    finished = joblib.Parallel(n_jobs=jobs, return_as="generator", batch_size=1)(
        run(env_id, env_kwargs, policy, chunk) for chunk in chunks
    )
    for rows in finished:
        yield from rows


def _run_list(env_id: str, env_kwargs: Mapping[str, Any], policy: Policy, seeds: Sequence[int]) -> list[Episode]:
    return list(_run(env_id, env_kwargs, policy, seeds))


def _run(env_id: str, env_kwargs: Mapping[str, Any], policy: Policy, seeds: Sequence[int]) -> Iterator[Episode]:
    env = make(env_id, **env_kwargs)
    try:
        check_fits(policy, env)
        for seed in seeds:
            yield _episode(env, policy, seed)
    finally:
        env.close()


def _episode(env: Any, policy: Policy, seed: int) -> Episode:
    steps, total, success, error = 0, 0.0, False, None
    subtasks: dict[str, bool] = {}
    try:
        for step in rollout(env, policy, seed):
            steps, total = steps + 1, total + step.reward
            success = bool(step.info["is_success"])
            for name, reached in step.info.items():
                if name.startswith("subtask/"):
                    key = name.removeprefix("subtask/")
                    subtasks[key] = subtasks.get(key, False) or bool(reached)
    except Exception as exception:
        success, error = False, f"{type(exception).__name__}: {exception}"
    return Episode(seed, success, subtasks, steps, round(steps * env.unwrapped.dt, 9), total, error)
