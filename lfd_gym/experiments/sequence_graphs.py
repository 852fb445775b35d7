"""Skills learned from labelled noise-1 demonstrations of every task of chapter 2 and 3, over graphs and teaching seeds."""

from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.experiments.learning import TEACHING, learned
from lfd_gym.experiments.rows import Rows, markdown, success
from lfd_gym.experiments.slips import recovered, watch_for_slips
from lfd_gym.registry import kebab_case

CYLINDER = "lfd_gym/CylinderGrasp-v0"
SETUPS = {"global": 100, "local": 50, "fully-connected": 50}
SEEDS = {task: {"global": range(3)} for task in TEACHING} | {
    task: {"global": range(5), "local": range(2), "fully-connected": range(2)}
    for task in ("lfd_gym/LightBulb-v0", "lfd_gym/MoveObject-v0")
}
"""Graphs and teaching seeds of each task: the default is measured best."""


def run(out: Path, quick: bool, jobs: int) -> str:
    """Teach, learn and evaluate on unseen setups for every task, graph and teaching seed."""
    rows, table, slips = Rows(out, quick, jobs), [], []
    for env_id, graphs in SEEDS.items():
        for graph, seeds in graphs.items():
            reports = []
            for seed in seeds[: 1 if quick else None]:

                def skill(env_id: str = env_id, graph: str = graph, seed: int = seed) -> Any:
                    return learned(env_id, seed, graph=graph)

                name = f"{kebab_case(env_id)}-{graph}-{seed}"
                reports.append(rows.evaluated(name, env_id, skill, SETUPS[graph]))
                if env_id == CYLINDER:
                    slips += rows.observed(f"{name}-slips", env_id, skill, watch_for_slips, SETUPS[graph])
            rates = [report["success_rate"] for report in reports]
            summary = [f"{100 * np.mean(rates):.1f}", f"{100 * min(rates):.0f}", str(len(reports[0]["episodes"]))]
            each = ", ".join(success([report]) for report in reports)
            table.append([kebab_case(env_id), graph, str(TEACHING[env_id]), *summary, each])
    header = ["task", "graph", "demonstrations", "mean %", "worst %", "setups each", "% per teaching seed 0, 1, ..."]
    return (
        markdown(header, table)
        + f"\n\nEpisodes of {kebab_case(CYLINDER)} with a slip that ended well: {recovered(slips)}"
    )
