"""The figure of a decomposition: signals, segments, active primitives, goals in their frames (Figures 3.7, 3.9, 3.12)."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from lfd_gym.demonstration import Demonstration
from lfd_gym.experiments.figures import save
from lfd_gym.report.figures import STYLE
from policies.decomposition.result import Decomposition
from policies.decomposition.segmentation import signals

COMPONENTS = {
    "position": ["x", "y", "z"],
    "orientation": ["w", "x", "y", "z"],
    "hand": ["spread", "finger 1", "finger 2", "finger 3"],
}
SIGMAS = 2.0
"""Radius of the ellipses of goals, in standard deviations."""


def draw(demonstration: Demonstration, found: Decomposition, path: Path) -> None:
    """One demonstration of those that were decomposed (the first), and all goals of the position."""
    colours = matplotlib.colormaps["tab20"].colors  # type: ignore[attr-defined]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(12.0, 9.0), layout="constrained")
        grid = figure.add_gridspec(5, 3)
        first = figure.add_subplot(grid[0, :2])
        axes = [first, *(figure.add_subplot(grid[row, :2], sharex=first) for row in range(1, 5))]
    time = np.arange(len(demonstration) + 1) * demonstration.dt
    names = {"position": "position [m]", "orientation": "quaternion", "hand": "hand [rad]"}
    plotted: dict[str, Any] = {entity: signals(demonstration, entity).values for entity in found.entities}
    for ax, (entity, values) in zip((axes[0], axes[2], axes[3]), plotted.items(), strict=False):
        ax.plot(time, values, linewidth=1.0, label=COMPONENTS[entity][: values.shape[1]])
        ax.set_ylabel(names[entity])
        for segment in found.entities[entity].data.segments:
            if segment.demonstration == 0:
                ax.axvline(segment.start * demonstration.dt, color="0.6", linestyle="--", linewidth=0.6)
    axes[1].plot(time, signals(demonstration, "position").force, linewidth=1.0, label=COMPONENTS["position"])
    axes[1].set_ylabel("force [N]")
    for ax in axes[:4]:
        ax.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7, frameon=False)
    for height, part in enumerate(found.entities.values()):
        for i in part.data.of(0):
            start, stop = (t * demonstration.dt for t in part.data.segments[i][1:3])
            k = int(part.assignment[i])
            axes[4].barh(-height, stop - start, left=start, color=colours[k % len(colours)], edgecolor="white")
            axes[4].text(0.5 * (start + stop), -height, str(k + 1), ha="center", va="center", fontsize=7)
    axes[4].set_yticks([-h for h in range(len(found.entities))], list(found.entities))
    axes[4].set_xlabel("time [s]")
    axes[4].set_xlim(0.0, time[-1])
    _goals(figure.add_subplot(grid[:, 2]), found, colours)
    save(figure, path)


def _goals(ax: Any, found: Decomposition, colours: Any) -> None:
    """Goals of the position, away from the origin of their frames over height, with ellipses of `SIGMAS`; bands where only the
    height matters."""
    for k, primitive in enumerate(found.entities["position"].primitives):
        style = {
            "alpha": 0.5,
            "color": colours[k % len(colours)],
            "label": f"{k + 1}: {primitive.space.frame}, {primitive.confidence:.0%}",
        }
        x, z = float(primitive.goal[0]), float(primitive.goal[2])
        covariance = primitive.covariance[np.ix_([0, 2], [0, 2])]
        if primitive.axes[0] == "hold":
            spread = SIGMAS * float(np.sqrt(covariance[1, 1]))
            ax.axhspan(z - spread, z + spread, **style)
            ax.annotate(str(k + 1), (0.98, z), xycoords=("axes fraction", "data"), fontsize=7)
            continue
        values, vectors = np.linalg.eigh(covariance)
        angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
        width, height = 2.0 * SIGMAS * np.sqrt(np.maximum(values[::-1], 1e-6))
        ax.add_patch(Ellipse((x, z), width, height, angle=angle, **style))
        ax.annotate(str(k + 1), (x, z), fontsize=7)
    ax.autoscale_view()
    ax.locator_params(axis="x", nbins=4)
    ax.set_xlabel("x or radius in its frame [m]")
    ax.set_ylabel("z in its frame [m]")
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.08), fontsize=7, ncols=2, frameon=False)
