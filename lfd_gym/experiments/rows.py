"""Rows of an experiment: evaluations that are kept on disk, and the table that they make."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from lfd_gym.evaluation import EvaluationReport, evaluate
from lfd_gym.paths import written_whole

FINAL_SEED, DEVELOPMENT_SEED = 1000, 100000
"""First evaluation seed of the figures that are published, and of quick trials."""


def evaluated(
    path: Path,
    env_id: str,
    policy: Callable[[], Any],
    quick: bool,
    jobs: int,
    env_kwargs: Mapping[str, Any] | None = None,
    episodes: int = 100,
) -> dict[str, Any]:
    """One evaluation as a dictionary, read from `path` if it was made before.

    Args:
        path: JSON file of the row.
        policy: makes the policy; called only if the row has to be made.
        quick: few episodes on development seeds.
    """
    if not path.exists():
        n, seed = (3, DEVELOPMENT_SEED) if quick else (episodes, FINAL_SEED)
        report: EvaluationReport = evaluate(env_id, policy(), n, seed, jobs=jobs, env_kwargs=env_kwargs, progress=True)
        with written_whole(path) as temporary:
            temporary.write_text(report.to_json())
    return json.loads(path.read_text())


def rate(report: Mapping[str, Any]) -> str:
    """ "97 [91, 99]": successes in percent with their Wilson interval."""
    low, high = report["wilson"]
    return f"{100 * report['success_rate']:.0f} [{100 * low:.0f}, {100 * high:.0f}]"


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])
