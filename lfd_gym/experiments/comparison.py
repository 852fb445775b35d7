"""Skills and reinforcement learning side by side: environments x methods x seeds, one row per job on disk.

A job teaches, learns or trains, and evaluates. Its row is written whole when it is done, so that a comparison that was killed
goes on without repeating a finished one; an unfinished training goes on from its last checkpoint. Jobs run through joblib:
another back end is a switch.
"""

import contextlib
import importlib.util
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import joblib

from lfd_gym.errors import InvalidArgumentError, LfdGymError, UnknownNameError
from lfd_gym.evaluation import evaluate
from lfd_gym.experiments.comparison_report import draw, summary, table
from lfd_gym.experiments.learning import TEACHING, demonstrations, teacher
from lfd_gym.experiments.rows import Rows
from lfd_gym.progress import track
from lfd_gym.registry import kebab_case, load
from lfd_gym.rollout import RandomPolicy, TeacherPolicy
from policies import LEARNERS
from policies.reinforcement.settings import METHODS

TASKS = ("MoveObject", "LightBulb", "BoxStacking", "BoxFlipping", "Whiteboard")
COMPARED = ("sequence-graph", "decomposition", "moa", "bc", "bc-chunks", "sac-demos", "ppo", "teacher", "random")
"""Methods of a comparison if none are named; the first is what the others are tested against."""
MORE: Mapping[str, Sequence[str]] = {"lfd_gym/MoveObject-v0": ("sac", "sac-sparse", "sac-demos-sparse")}
"""Further ones for some tasks."""
SHOWN = 3
"""Demonstrations where a task has no number of its own."""
SHOWN_TO: Mapping[str, Mapping[str, int]] = {"decomposition": {"lfd_gym/LightBulb-v0": 9}}
"""Demonstrations of a method that needs more than `TEACHING` says: without labels, turns of a bulb are told apart by many."""
DECISIONS: Mapping[str, Mapping[str, int]] = {
    "lfd_gym/MoveObject-v0": {"sac-demos": 750_000, "sac": 300_000, "ppo": 3_000_000},
    "": {"sac": 100_000, "ppo": 100_000},
}
"""Decisions that a method, or else its algorithm, trains for in a task, and in the others."""
QUICK_DECISIONS = 64
BACKENDS = ("loky", "ray")
"""Of joblib; "ray" needs the package ray."""
UNTAUGHT = ("teacher", "random")
"""Methods that learn nothing: one seed is enough."""


@dataclass(frozen=True)
class Job:
    """One row of a comparison."""

    env_id: str
    method: str
    seed: int
    """Of the demonstrations and the training."""
    demonstrations: int
    decisions: int
    """Of a training; 0 for what does not train."""
    episodes: int
    """Setups of the evaluation."""

    @property
    def name(self) -> str:
        """Of its row."""
        return f"{kebab_case(self.env_id)}-{self.method}-{self.seed}"


@dataclass(frozen=True)
class Comparison:
    """What is compared."""

    envs: Sequence[str]
    methods: Sequence[str] = ()
    """`COMPARED` and `MORE` if empty."""
    seeds: Sequence[int] = range(3)
    episodes: int = 100
    demonstrations: int | None = None
    """Per learner; `TEACHING` and `SHOWN_TO` if left out."""
    decisions: int | None = None
    """Per training; `DECISIONS` if left out."""
    backend: str = "loky"
    """Of `BACKENDS`."""

    def jobs(self) -> list[Job]:
        """Every job, once, by task, method and seed. Raises UnknownNameError for its methods."""
        found = []
        for env_id in dict.fromkeys(self.envs):
            for method in dict.fromkeys(self.methods or (*COMPARED, *MORE.get(env_id, ()))):
                if method not in (*LEARNERS, *METHODS, *UNTAUGHT):
                    raise UnknownNameError("method", method, (*LEARNERS, *METHODS, *UNTAUGHT))
                for seed in self.seeds[:1] if method in UNTAUGHT else self.seeds:
                    found.append(self._job(env_id, method, seed))
        return found

    def _job(self, env_id: str, method: str, seed: int) -> Job:
        needed = SHOWN_TO.get(method, {}).get(env_id, TEACHING.get(env_id, SHOWN))
        shown, decisions = self.demonstrations or needed, 0
        if method in METHODS:
            own = DECISIONS.get(env_id, DECISIONS[""])
            decisions = own.get(method, own[METHODS[method].algorithm]) if self.decisions is None else self.decisions
        if method in UNTAUGHT or (method in METHODS and not METHODS[method].demonstrations):
            shown = 0
        return Job(env_id, method, seed, shown, decisions, self.episodes)


def run(out: Path, quick: bool, jobs: int) -> str:
    """The comparison of all tasks and methods, as an experiment."""
    return compare(Comparison([f"lfd_gym/{task}-v0" for task in TASKS]), out, quick, jobs)


def compare(comparison: Comparison, out: Path, quick: bool = False, processes: int = 1, finished: bool = False) -> str:
    """Perform what is missing, write `comparison.json` and the learning curves, and return the table.

    With `finished` nothing is performed: the table is that of the rows that are there, and says how many are not.

    Raises, before any job is performed, UnknownNameError for its methods and back end, MissingExtraError for methods that
    cannot be run here, and InvalidArgumentError where ray is missing or a row was made for another comparison;
    InvalidArgumentError if no row is finished; and LfdGymError, after all other jobs are done, if a job failed.
    """
    jobs, rows = comparison.jobs(), Rows(out, quick)
    missing = [job for job in jobs if _row(rows, job) is None]
    if comparison.backend not in BACKENDS:
        raise UnknownNameError("back end", comparison.backend, BACKENDS)
    if comparison.backend == "ray" and importlib.util.find_spec("ray") is None:
        raise InvalidArgumentError("the back end 'ray' needs the package ray: pip install 'lfd-gym[cluster]'")
    if not finished:
        for method in dict.fromkeys(job.method for job in missing):
            check_can_run(method)
        _perform_all(rows, missing, comparison.backend, processes)
        missing = []
    made = [row for row in (_row(rows, job) for job in jobs) if row is not None]
    if not made:
        raise InvalidArgumentError(f"none of the {len(jobs)} rows is in '{out}'; leave --finished out to make them")
    rows.write("comparison", summary(made) | {"missing": [job.name for job in missing]})
    draw(made, rows.folder)
    remark = f"\n\n{len(missing)} of {len(jobs)} jobs have not been run." if missing else ""
    return table(made) + remark


def _row(rows: Rows, job: Job) -> dict[str, Any] | None:
    """A finished row, None if it is not there; InvalidArgumentError if it was made for another comparison."""
    if not rows.exists(job.name):
        return None
    row: Any = rows.kept(job.name, dict)
    made_for = row.get("job") if isinstance(row, dict) else None
    if made_for != _asked(rows, job):
        raise InvalidArgumentError(
            f"the row '{job.name}' in '{rows.out}' was made for {made_for}; choose another --out"
        )
    return dict(row)


def _perform_all(rows: Rows, jobs: Sequence[Job], backend: str, processes: int) -> None:
    """Make these rows; LfdGymError names the jobs that failed."""
    with _backend(backend):
        done = joblib.Parallel(n_jobs=processes, return_as="generator_unordered", batch_size=1)(
            joblib.delayed(_attempt)(rows, job) for job in jobs
        )
        errors = [error for error in track(done, len(jobs), "jobs") if error is not None]
    if errors:
        raise LfdGymError(f"{len(errors)} of {len(jobs)} jobs failed, the others are done: {'; '.join(errors)}")


def check_can_run(method: str) -> None:
    """Raise MissingExtraError for a method that cannot be run here."""
    if method in METHODS:
        load("policies.reinforcement.training:train")
    elif method in LEARNERS:
        load(LEARNERS[method])


def _attempt(rows: Rows, job: Job) -> str | None:
    """What went wrong with a job, in one line; None if its row is there."""
    try:
        rows.kept(job.name, lambda: _perform(rows, job))
    except Exception as error:
        return f"{job.name}: {type(error).__name__}: {error}"
    return None


def _asked(rows: Rows, job: Job) -> dict[str, Any]:
    decisions = min(job.decisions, QUICK_DECISIONS) if rows.quick else job.decisions
    settings = {"settings": asdict(METHODS[job.method])} if job.method in METHODS else {}
    return {**asdict(job), "decisions": decisions, "episodes": len(rows.seeds(job.episodes)), **settings}


def _perform(rows: Rows, job: Job) -> dict[str, Any]:
    """Teach, learn or train, and evaluate."""
    asked = _asked(rows, job)
    shown = demonstrations(job.env_id, job.demonstrations, job.seed) if job.demonstrations else ()
    taught_hours = sum(demonstration.duration for demonstration in shown) / 3600.0
    curve: list[dict[str, Any]] = []
    since = time.monotonic()
    facts = {"demonstrations": len(shown), "updates": 0, "decisions": 0, "simulated_hours": taught_hours}
    if job.method == "teacher":
        policy: Any = TeacherPolicy(teacher(job.env_id, 1.0))
    elif job.method == "random":
        policy = RandomPolicy()
    elif job.method in LEARNERS:
        seeded = {"seed": job.seed} if "seed" in load(LEARNERS[job.method])().get_params() else {}
        policy = load(LEARNERS[job.method])(**seeded).fit(shown).skill_
        facts["updates"] = policy.metadata.get("updates", 0)
    else:
        policy, curve = _train(rows, job, asked["decisions"], shown)
        facts |= {name: policy.metadata[name] for name in ("updates", "decisions")}
        facts["simulated_hours"] += policy.metadata["simulated_hours"]
    trained = getattr(policy, "metadata", {}).get("seconds")
    facts["seconds"] = round(time.monotonic() - since, 2) if trained is None else trained
    seeds = rows.seeds(job.episodes)
    report = evaluate(job.env_id, policy, len(seeds), seeds[0]).to_dict()
    return {"job": asked, "facts": facts, "curve": curve, "report": report}


def _train(rows: Rows, job: Job, decisions: int, shown: Sequence[Any]) -> tuple[Any, list[dict[str, Any]]]:
    training, folder = load("policies.reinforcement.training:train"), rows.folder / "training" / job.name
    every, episodes = (decisions, 1) if rows.quick else (max(decisions // 5, 1), 20)
    schedule = load("policies.reinforcement.training:Schedule")(
        decisions, checkpoint_every=25_000, evaluate_every=every, evaluation_episodes=episodes
    )
    policy = training(job.method, job.env_id, schedule, folder, seed=job.seed, demonstrations=shown)
    kept = load("policies.reinforcement.checkpoint:read_log")(folder)
    policy.save(rows.folder / "skills" / f"{job.name}.npz")
    return policy, kept


@contextlib.contextmanager
def _backend(name: str) -> Iterator[None]:
    """Joblib's back end; ray is registered first."""
    if name == "ray":
        load("ray.util.joblib:register_ray")()
    with joblib.parallel_config(backend=name):
        yield
