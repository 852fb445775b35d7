"""Words on boards that stand where they never stood before: MoA and what it is compared with (Figures 4.5 and 4.6)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lfd_gym.alphabet import sample, strokes
from lfd_gym.experiments.learning import demonstrations, teacher
from lfd_gym.experiments.rows import Rows, markdown, rate
from lfd_gym.ink import SPACING
from lfd_gym.registry import load
from lfd_gym.rollout import TeacherPolicy, rollout
from policies import LEARNERS
from policies.trajectory_baselines import BASELINES

ENV_ID = "lfd_gym/Whiteboard-v0"
METHODS = {"moa": LEARNERS["moa"], **BASELINES}
N_DEMONSTRATIONS = 6
TEACHING_SEEDS = range(3)
EPISODES = 100


class Written(NamedTuple):
    """What one episode left on the boards."""

    seed: int
    success: bool
    coverage: float
    precision: float
    distance: float | None
    """Median distance of the ink to the nearest wanted stroke [m]; None without ink."""


def run(out: Path, quick: bool, jobs: int) -> str:
    """Learn from six noise-1 demonstrations of each teaching seed; write on 100 boards. The teacher is shown for comparison."""
    rows, table = Rows(out, quick, jobs), []
    shown = rows.observed("teacher", ENV_ID, lambda: TeacherPolicy(teacher(ENV_ID, 1.0)), write, EPISODES)
    table.append(["teacher", *_cells([shown])])
    for method in METHODS:
        written = []
        for seed in TEACHING_SEEDS[: 1 if quick else None]:

            def skill(method: str = method, seed: int = seed) -> Any:
                learner = load(METHODS[method])()
                return learner.fit(demonstrations(ENV_ID, N_DEMONSTRATIONS, seed)).skill_

            written.append(rows.observed(f"{method}-{seed}", ENV_ID, skill, write, EPISODES))
        table.append([method, *_cells(written)])
    return markdown(
        ["method", "success %", "of each teaching seed", "coverage %", "precision %", "ink to stroke [mm]"], table
    )


def write(env: Any, policy: Any, seed: int) -> Written:
    """One episode: its success and figures, and the distance from every inked cell to the nearest wanted stroke."""
    info: dict[str, Any] = {}
    for step in rollout(env, policy, seed):
        info = step.info
    world = env.unwrapped
    measures = world.measures()
    off = np.concatenate(
        [distances(board.points(), word) for board, word in zip(world.boards, world.words, strict=True)]
    )
    return Written(
        seed,
        bool(info["is_success"]),
        measures["coverage"],
        measures["precision"],
        float(np.median(off)) if off.size else None,
    )


def distances(points: np.ndarray, word: str) -> np.ndarray:
    """Of points (n, 2) of a board to the nearest point of a word's strokes (n,) [m]."""
    wanted = np.concatenate([sample(stroke, SPACING) for stroke in strokes(word)])
    return np.asarray(np.linalg.norm(points[:, None] - wanted, axis=2).min(axis=1))


def _cells(written: Sequence[Sequence[dict[str, Any]]]) -> list[str]:
    episodes = [episode for rows in written for episode in rows]
    solved = [sum(episode["success"] for episode in rows) for rows in written]
    inked = [1000.0 * episode["distance"] for episode in episodes if episode["distance"] is not None]
    return [
        rate(sum(solved), len(episodes)),
        ", ".join(map(str, solved)),
        *(f"{100.0 * np.mean([episode[name] for episode in episodes]):.1f}" for name in ("coverage", "precision")),
        f"{np.median(inked):.1f}" if inked else "no ink",
    ]
