"""Figures of the experiments: bars and curves with their intervals."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from lfd_gym.paths import written_whole
from lfd_gym.report.figures import GOAL, STYLE, png
from policies.sequence_graph_drawing import COLOURS


class Estimate(NamedTuple):
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        """ "97 [91, 99]", in percent."""
        return f"{100 * self.value:.1f} [{100 * self.low:.1f}, {100 * self.high:.1f}]"


def bars(axes: Any, groups: Sequence[str], series: Mapping[str, Sequence[Estimate]]) -> None:
    """Per group one bar of every series, with its interval; shares are drawn in percent."""
    for i, (name, estimates) in enumerate(series.items()):
        x = bar_place(np.arange(len(groups)), i, len(series))
        values, low, high = 100.0 * np.array(estimates).T
        axes.bar(x, values, 0.74 / len(series), color=COLOURS[i], label=name)
        axes.vlines(x, low, high, color=GOAL, linewidth=1.4)
    axes.set_xticks(range(len(groups)), groups)
    axes.set_ylim(0.0, 101.0)
    axes.grid(axis="x", visible=False)


def bar_place(group: Any, i: int, n_series: int) -> Any:
    """Where the bar of the i-th of n series stands in a group."""
    return group + 0.8 * (i - 0.5 * (n_series - 1)) / n_series


def curve(axes: Any, x: ArrayLike, values: ArrayLike, low: ArrayLike, high: ArrayLike, colour: int, name: str) -> None:
    """A line with a band."""
    axes.plot(x, values, color=COLOURS[colour], linewidth=1.6, marker="o", markersize=3, label=name)
    axes.fill_between(x, low, high, color=COLOURS[colour], alpha=0.2, linewidth=0)


def panels(n: int, width: float = 5.5, height: float = 3.6) -> tuple[Figure, Any]:
    """A figure with n panels side by side [inch], and its axes."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(n * width, height), layout="constrained")
        return figure, figure.subplots(1, n, squeeze=False)[0]


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG."""
    with matplotlib.rc_context(STYLE), written_whole(path) as temporary:
        temporary.write_bytes(png(figure))
