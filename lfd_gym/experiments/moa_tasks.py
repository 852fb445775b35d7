"""Paths over time where a task needs hand and orientation: stacking works, unscrewing cannot (thesis 4.4, 5.1).

A path over time repeats what was demonstrated as often as it was demonstrated. BoxStacking always takes the same movements. How
often LightBulb has to be turned is hidden and differs from setup to setup: demonstrations of different numbers of turns are
brought to one time all the same, and the skill turns as often as one of them.
"""

from pathlib import Path
from typing import Any

from lfd_gym.experiments.learning import TEACHING, demonstrations
from lfd_gym.experiments.rows import Rows, markdown, missed, success
from lfd_gym.registry import kebab_case
from policies.moa_learner import MoALearner

SETUPS = {"lfd_gym/BoxStacking-v0": 100, "lfd_gym/LightBulb-v0": 20}
TEACHING_SEEDS = range(3)


def run(out: Path, quick: bool, jobs: int) -> str:
    """Learn from three noise-1 demonstrations of each teaching seed and evaluate."""
    rows, table = Rows(out, quick, jobs), []
    for env_id, setups in SETUPS.items():
        for seed in TEACHING_SEEDS[: 1 if quick else None]:

            def skill(env_id: str = env_id, seed: int = seed) -> Any:
                return MoALearner().fit(demonstrations(env_id, TEACHING[env_id], seed)).skill_

            report = rows.evaluated(f"{kebab_case(env_id)}-{seed}", env_id, skill, setups)
            table.append([kebab_case(env_id), str(TEACHING[env_id]), str(seed), success([report]), missed(report)])
    return markdown(["task", "demonstrations", "teaching seed", "success %", "failed before"], table)
