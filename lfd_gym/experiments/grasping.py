"""Grasping cylinders as they ask for, after one to seventeen demonstrations (thesis 2.5.3, Figure 2.15).

The skill is taught again after each demonstration, on the local graph as in the thesis, with logistic regression and with
support vectors. An episode counts if the cylinder was lifted by the grasp that is demonstrated for it: a power grasp of the
lying cylinder of medium length may hold too, but "is not the behavior that was demonstrated" (2.5.3). What was lifted at all
stands beside it.
"""

from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.evaluation import wilson_interval
from lfd_gym.experiments.figures import curve, panels, save
from lfd_gym.experiments.learning import TEACHING, demonstrations, learned_from
from lfd_gym.experiments.rows import Rows, markdown, over_setups, rate

TASK = "lfd_gym/CylinderGrasp-v0"
SETUPS, TEACHING_SEEDS = 20, (0, 1, 2)
KINDS = {"SVM": "svm", "LR": "lr"}
SCORES = {"as demonstrated": "demonstrated_grasp", "lifted": "lifted"}


def run(out: Path, quick: bool, jobs: int) -> str:
    """Teach, learn and evaluate for every number of demonstrations, both classifiers and every teaching seed."""
    rows = Rows(out, quick, jobs)
    counts = range(1, 3) if quick else range(1, TEACHING[TASK] + 1)
    episodes = {
        (kind, n): _episodes(rows, classifier, n, counts[-1]) for kind, classifier in KINDS.items() for n in counts
    }
    reached = {
        (kind, score, n): over_setups([e["subtasks"].get(flag, False) for e in own], [e["seed"] for e in own])
        for (kind, n), own in episodes.items()
        for score, flag in SCORES.items()
    }
    columns = [(kind, score) for score in SCORES for kind in KINDS]
    _draw(rows.folder / "grasping.png", list(counts), reached)
    table = [[str(n), *(rate(*reached[kind, score, n]) for kind, score in columns)] for n in counts]
    return markdown(["demonstrations", *(f"{kind}, {score}, %" for kind, score in columns)], table)


def _episodes(rows: Rows, classifier: str, n: int, most: int) -> list[dict[str, Any]]:
    """Episodes of the skills of all teaching seeds."""
    episodes = []
    for seed in TEACHING_SEEDS[: 1 if rows.quick else None]:

        def skill(seed: int = seed) -> Any:
            return learned_from(demonstrations(TASK, most, seed)[:n], graph="local", classifier=classifier)

        episodes += rows.evaluated(f"{classifier}-{seed}-{n}", TASK, skill, SETUPS)["episodes"]
    return episodes


def _draw(path: Path, counts: list[int], reached: dict[tuple[str, str, int], tuple[float, int]]) -> None:
    figure, axes = panels(len(SCORES))
    for panel, score in zip(axes, SCORES, strict=True):
        for i, kind in enumerate(KINDS):
            low, high = np.transpose([wilson_interval(*reached[kind, score, n]) for n in counts])
            share = np.array([np.divide(*reached[kind, score, n]) for n in counts])
            curve(panel, counts, 100.0 * share, 100.0 * low, 100.0 * high, i, kind)
        panel.set_title(score, fontsize=9)
        panel.set_xlabel("demonstrations")
        panel.set_ylabel("episodes [%]")
        panel.set_ylim(0.0, 101.0)
        panel.legend(fontsize=8, loc="lower right")
    save(figure, path)
