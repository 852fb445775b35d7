"""Skills learned from labelled noise-1 demonstrations of every task of chapter 2 and 3, commanded and kinesthetic."""

from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.experiments.learning import TEACHING, learned
from lfd_gym.experiments.rows import Rows, markdown, success
from lfd_gym.registry import kebab_case

SEEDS = {task: {"commanded": range(3)} for task in TEACHING}
SEEDS["lfd_gym/LightBulb-v0"]["kinesthetic"] = range(2)
"""Modes and teaching seeds of each task. Other graphs and classifiers have experiments of their own."""


def run(out: Path, quick: bool, jobs: int) -> str:
    """Teach, learn and evaluate on 100 unseen setups for every task, mode and teaching seed."""
    rows, table = Rows(out, quick, jobs), []
    for env_id, modes in SEEDS.items():
        for mode, seeds in modes.items():
            reports = []
            for seed in seeds[: 1 if quick else None]:

                def skill(env_id: str = env_id, mode: str = mode, seed: int = seed) -> Any:
                    return learned(env_id, seed, mode=mode)

                name = f"{kebab_case(env_id)}-{mode}-{seed}"
                reports.append(rows.evaluated(name, env_id, skill))
            rates = [report["success_rate"] for report in reports]
            summary = [f"{100 * np.mean(rates):.1f}", f"{100 * min(rates):.0f}", str(len(reports[0]["episodes"]))]
            each = ", ".join(success([report]) for report in reports)
            table.append([kebab_case(env_id), mode, str(TEACHING[env_id]), *summary, each])
    header = ["task", "teaching", "demonstrations", "mean %", "worst %", "setups each", "% per teaching seed 0, 1, ..."]
    return markdown(header, table)
