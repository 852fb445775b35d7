"""Skills learned from three noise-1 demonstrations: global, local and fully connected graph, over teaching seeds."""

from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.experiments.rows import evaluated, markdown, rate
from lfd_gym.recording import record
from lfd_gym.registry import kebab_case, look_up
from policies.sequence_graph_learner import SequenceGraphLearner
from scripted_teachers import TEACHERS

TASKS = ("lfd_gym/LightBulb-v0", "lfd_gym/MoveObject-v0")
GRAPHS = {"global": (100, range(5)), "local": (50, range(2)), "fully-connected": (50, range(2))}
"""Episodes and teaching seeds per graph: the default is measured best."""
N_DEMONSTRATIONS = 3


def run(out: Path, quick: bool, jobs: int) -> str:
    """Teach, learn and evaluate on unseen setups for every task, graph and teaching seed."""
    rows = []
    for env_id in TASKS:
        for graph, (episodes, seeds) in GRAPHS.items():
            reports = []
            for seed in seeds[: 1 if quick else None]:

                def skill(env_id: str = env_id, graph: str = graph, seed: int = seed) -> Any:
                    return learned(env_id, graph, seed)

                path = out / f"{kebab_case(env_id)}-{graph}-{seed}.json"
                reports.append(evaluated(path, env_id, skill, quick, jobs, episodes=episodes))
            mean = np.mean([report["success_rate"] for report in reports])
            rates = ", ".join(rate(report) for report in reports)
            rows.append([kebab_case(env_id), graph, f"{100 * mean:.1f}", str(len(reports[0]["episodes"])), rates])
    return markdown(["task", "graph", "mean %", "episodes each", "% per teaching seed 0, 1, ..."], rows)


def learned(env_id: str, graph: str, seed: int) -> Any:
    """The skill of three noise-1 demonstrations."""
    teacher = look_up(TEACHERS, "teacher for", env_id)(noise=1.0)
    demonstrations = record(env_id, teacher, N_DEMONSTRATIONS, seed).demonstrations
    return SequenceGraphLearner(graph=graph, classifier="svm").fit(demonstrations).skill_
