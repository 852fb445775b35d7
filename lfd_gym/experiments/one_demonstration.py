"""What a single demonstration teaches, and where it fails."""

from pathlib import Path
from typing import Any

from lfd_gym.evaluation import wilson_interval
from lfd_gym.experiments.figures import Estimate, bars, panels, save
from lfd_gym.experiments.learning import learned
from lfd_gym.experiments.rows import Rows, markdown, missed, success
from lfd_gym.registry import kebab_case

TASKS = ("lfd_gym/LightBulb-v0", "lfd_gym/MoveObject-v0")
TEACHING_SEEDS = range(3)


def run(out: Path, quick: bool, jobs: int) -> str:
    """Learn from one noise-1 demonstration of each teaching seed; evaluate on 100 setups."""
    rows, table = Rows(out, quick, jobs), []
    figure, axes = panels(len(TASKS))
    for panel, env_id in zip(axes, TASKS, strict=True):
        series = {}
        for seed in TEACHING_SEEDS[: 1 if quick else None]:

            def skill(env_id: str = env_id, seed: int = seed) -> Any:
                return learned(env_id, seed, n=1)

            report = rows.evaluated(f"{kebab_case(env_id)}-{seed}", env_id, skill)
            table.append([kebab_case(env_id), str(seed), success([report]), missed(report)])
            parts = {name: [e["subtasks"].get(name, False) for e in report["episodes"]] for name in _parts(report)}
            parts["success"] = [e["success"] for e in report["episodes"]]
            series[f"teaching seed {seed}"] = [
                Estimate(sum(flags) / len(flags), *wilson_interval(sum(flags), len(flags))) for flags in parts.values()
            ]
        bars(panel, [name.replace("_", " ") for name in parts], series)
        panel.set_title(kebab_case(env_id), fontsize=9)
        panel.set_ylabel("setups [%]")
    handles = axes[-1].get_legend_handles_labels()
    figure.legend(*handles, fontsize=8, ncols=len(TEACHING_SEEDS), loc="outside lower center")
    save(figure, rows.folder / "one-demonstration.png")
    return markdown(["task", "teaching seed", "success %", "failed before"], table)


def _parts(report: dict[str, Any]) -> list[str]:
    return list(dict.fromkeys(name for episode in report["episodes"] for name in episode["subtasks"]))
