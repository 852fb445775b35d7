"""From how few demonstrations the frames are told apart: all 63 subsets of six (thesis 4.4.2, Figure 4.7).

Every subset of six whiteboard demonstrations trains a Mixture of Attractors. Its paths are compared with three demonstrations
on boards that none of them saw, step by step after alignment.
"""

import itertools
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.action import ActionLayout
from lfd_gym.experiments.figures import panels, save
from lfd_gym.experiments.learning import demonstrations
from lfd_gym.experiments.rows import Rows, markdown
from lfd_gym.experiments.writing import ENV_ID, N_DEMONSTRATIONS, paths
from policies.moa.alignment import align, warped
from policies.moa.mixture_of_attractors import MixtureOfAttractors
from policies.moa.tie_break import nearly_equal
from policies.sequence_graph_drawing import COLOURS

TEACHING_SEED, UNSEEN_SEED, N_UNSEEN = 0, 1, 3
SPACING = 0.15
"""Between support points [s], the default of the learner."""
SPARSE = 0.9
"""What the thesis found to be needed."""


def run(out: Path, quick: bool, jobs: int) -> str:
    """Fit all subsets, with and without the second-stage criterion."""
    rows, found = Rows(out, quick, jobs), {}
    for stage in (True, False):
        name = "second-stage" if stage else "first-stage"
        found[name] = rows.kept(name, lambda stage=stage: _subsets(stage, 2 if quick else None))  # type: ignore[misc]
    _draw(rows.folder / "subsets.png", found)
    table = []
    for name, subsets in found.items():
        for size in sorted({len(row["subset"]) for row in subsets}):
            own = [row for row in subsets if len(row["subset"]) == size]
            sparsity, error = (np.array([row[key] for row in own]) for key in ("sparsity", "error"))
            cells = [f"{np.median(sparsity):.3f} ({sparsity.min():.3f})", f"{100 * np.mean(sparsity >= SPARSE):.0f}"]
            table.append([name, str(size), str(len(own)), *cells, f"{np.median(error):.1f} ({error.max():.1f})"])
    seconds = {name: sum(row["seconds"] for row in subsets) for name, subsets in found.items()}
    header = ["criterion", "demonstrations", "subsets", "J_sparsity, median (least)", f"at least {SPARSE} [%]"]
    took = ", ".join(f"{name} {total:.0f} s" for name, total in seconds.items())
    return (
        markdown([*header, "error on unseen boards [mm], median (largest)"], table)
        + f"\n\nCPU time of all fits together: {took}."
    )


def _subsets(second_stage: bool, most: int | None) -> list[dict[str, Any]]:
    """Per subset its J_sparsity, the mean distance to unseen demonstrations [mm], and the CPU time of the fit [s]."""
    shown = demonstrations(ENV_ID, N_DEMONSTRATIONS, TEACHING_SEED)
    unseen = demonstrations(ENV_ID, N_DEMONSTRATIONS, UNSEEN_SEED)[:N_UNSEEN]
    points, frames = paths([*shown, *unseen])
    warps = align(points, frames, reference=0)
    pairs = [warped(x, frame, index) for x, frame, index in zip(points, frames, warps, strict=True)]
    layout, dt = ActionLayout.from_dict(shown[0].action_layout), shown[0].dt
    n_support = max(round(len(warps[0]) * dt / SPACING), 2)
    result = []
    for subset in _all_subsets(most):
        start = time.process_time()
        slack = nearly_equal(len(subset), points[0].shape[1])
        model = MixtureOfAttractors(
            n_support, layout.alpha, layout.beta, dt, aligned=True, second_stage=second_stage, slack=slack
        )
        model.fit([pairs[m][0] for m in subset], [pairs[m][1] for m in subset])
        seconds = time.process_time() - start
        errors = [
            np.linalg.norm(model.predict(frame, x[0], x[1]) - x, axis=1).mean() for x, frame in pairs[len(shown) :]
        ]
        error = 1000.0 * float(np.mean(errors))
        result.append({"subset": list(subset), "sparsity": model.sparsity_, "error": error, "seconds": seconds})
    return result


def _all_subsets(most: int | None) -> list[tuple[int, ...]]:
    sizes = range(1, N_DEMONSTRATIONS + 1)
    return [s for n in sizes for s in list(itertools.combinations(range(N_DEMONSTRATIONS), n))[:most]]


def _draw(path: Path, found: dict[str, Sequence[dict[str, Any]]]) -> None:
    figure, axes = panels(2)
    for panel, key, label in zip(
        axes, ("sparsity", "error"), ("J_sparsity", "error on unseen boards [mm]"), strict=True
    ):
        for i, (name, subsets) in enumerate(found.items()):
            sizes = np.array([len(row["subset"]) for row in subsets])
            values = np.array([row[key] for row in subsets])
            panel.plot(sizes + 0.1 * (i - 0.5), values, ".", color=COLOURS[i], markersize=4)
            each = np.unique(sizes)
            panel.plot(each, [np.median(values[sizes == n]) for n in each], color=COLOURS[i], label=name)
        panel.set_xlabel("demonstrations")
        panel.set_ylabel(f"{label}, lines: median")
    axes[0].axhline(SPARSE, color="0.5", linestyle="--", linewidth=0.8)
    axes[1].set_yscale("log")
    axes[1].legend(fontsize=8)
    save(figure, path)
