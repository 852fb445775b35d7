"""Methods of decomposition against the teacher's own primitives: ours, the thesis's and three baselines (thesis 3.5.2)."""

import functools
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.demonstration import Demonstration
from lfd_gym.experiments.decomposition_scores import score
from lfd_gym.experiments.figures import bar_place, panels, save
from lfd_gym.experiments.learning import teacher
from lfd_gym.experiments.rows import Rows, markdown
from lfd_gym.recording import record
from lfd_gym.registry import kebab_case
from policies.decomposition.methods import METHODS
from policies.decomposition.segmentation import ENTITIES
from policies.sequence_graph_drawing import COLOURS

TEACHING = {"lfd_gym/BoxFlipping-v0": (5, 1), "lfd_gym/BoxStacking-v0": (3, 1), "lfd_gym/LightBulb-v0": (9, 3)}
"""Demonstrations of each task, and how many of them of every setup, as in the thesis."""
MODES = ("commanded", "kinesthetic")
QUICK_SEED = 10
"""Teaching seed of quick trials."""
MEASURES = {"frame": "frame right", "rand": "adjusted Rand index"}


def run(out: Path, quick: bool, jobs: int, seeds: int = 5) -> str:
    """Teach, decompose by every method and compare with the primitive table, for the teaching seeds 0 to seeds - 1."""
    rows, table = Rows(out, quick, jobs), []
    results: dict[tuple[str, str, str], list[dict[str, Any]]] = {}
    for seed in (QUICK_SEED,) if quick else range(seeds):
        for env_id in TEACHING:
            for mode in MODES:
                for method in METHODS:
                    name = f"{kebab_case(env_id)}-{mode}-{method}-{seed}"
                    row = rows.kept(name, functools.partial(_scored, env_id, mode, seed, method))
                    results.setdefault((env_id, mode, method), []).append(row)
    for (env_id, mode, method), scored in results.items():
        table.append([kebab_case(env_id), mode, method, *_cells(scored)])
    figure, axes = panels(len(MEASURES))
    for panel, measure in zip(axes, MEASURES, strict=True):
        _draw(panel, results, measure)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=len(METHODS), frameon=False)
    save(figure, rows.folder / "decomposition-methods.png")
    header = [
        "task",
        "teaching",
        "method",
        "frame right % (position, orientation)",
        "task space right % (position)",
        "Rand index (position, orientation, hand)",
        "Rand index of goals (position)",
        "primitives found / planted (position, orientation, hand)",
        "force right",
        "force right % of time",
        "seconds",
    ]
    return markdown(header, table)


@functools.lru_cache(maxsize=1)
def shown(env_id: str, mode: str, seed: int) -> Sequence[Demonstration]:
    """Noise-1 demonstrations of one teaching seed."""
    n, repeat = TEACHING[env_id]
    return record(env_id, teacher(env_id, 1.0, mode), n, seed, repeat=repeat).demonstrations


def _scored(env_id: str, mode: str, seed: int, method: str) -> dict[str, Any]:
    demonstrations = shown(env_id, mode, seed)
    began = time.perf_counter()
    found = METHODS[method](demonstrations)
    seconds = time.perf_counter() - began
    result = score(demonstrations, found)
    entities = {entity: own._asdict() for entity, own in result.entities.items()}
    return result._asdict() | {"entities": entities, "seconds": round(seconds, 1)}


def _cells(scored: Sequence[dict[str, Any]]) -> list[str]:
    def mean(entity: str, measure: str) -> float:
        return float(np.mean([row["entities"][entity][measure] for row in scored]))

    return [
        ", ".join(f"{100 * mean(entity, 'frame'):.0f}" for entity in ENTITIES[:2]),
        f"{100 * mean('position', 'space'):.0f}",
        ", ".join(f"{mean(entity, 'rand'):.2f}" for entity in ENTITIES),
        f"{mean('position', 'rand_goals'):.2f}",
        ", ".join(f"{mean(entity, 'found'):.1f} / {mean(entity, 'planted'):.0f}" for entity in ENTITIES),
        f"{sum(row['forces'] for row in scored)} of {len(scored)}",
        f"{100 * np.mean([row['forces_time'] for row in scored]):.0f}",
        f"{np.mean([row['seconds'] for row in scored]):.0f}",
    ]


def _draw(axes: Any, results: dict[tuple[str, str, str], list[dict[str, Any]]], measure: str) -> None:
    """One bar per method, mean over position and orientation and both modes, a dot for every teaching seed."""
    for i, method in enumerate(METHODS):
        for t, env_id in enumerate(TEACHING):
            values = [
                np.mean([row["entities"][entity][measure] for entity in ENTITIES[:2]])
                for mode in MODES
                for row in results[env_id, mode, method]
            ]
            x = bar_place(t, i, len(METHODS))
            axes.bar(x, np.mean(values), 0.14, color=COLOURS[i], label=method if t == 0 else None)
            axes.plot(np.full(len(values), x), values, ".", color="black", markersize=2.5)
    axes.set_xticks(range(len(TEACHING)), [kebab_case(env_id) for env_id in TEACHING])
    axes.set_ylabel(f"{MEASURES[measure]} (position, orientation)")
    axes.set_ylim(min(0.0, axes.get_ylim()[0]), 1.02)
