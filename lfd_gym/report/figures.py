"""The report's figures, as PNG."""

import io
from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from lfd_gym.demonstration import Demonstration, Primitive
from lfd_gym.evaluation import EvaluationReport, wilson_interval
from lfd_gym.report.trace import Trace, position_in_frame, stretches, turn, turn_in_frame
from policies.sequence_graph_drawing import COLOURS

SHOWN, REPRODUCED, GOAL = "#0072B2", "#D55E00", "#222222"
LEAST_METRES, LEAST_RADIANS = 0.03, 0.15
"""Least span of an axis."""
STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "figure.dpi": 130,
}
ROWS = {
    "cartesian": ("x [m]", "y [m]", "z [m]"),
    "cylindrical": ("radius [m]", "angle [rad]", "z [m]"),
}


def success(evaluation: EvaluationReport) -> bytes:
    """Bars of success and of every part of the task."""
    n = len(evaluation.episodes)
    names = list(dict.fromkeys(name for episode in evaluation.episodes for name in episode.subtasks))
    counts = {name: sum(e.subtasks.get(name, False) for e in evaluation.episodes) for name in names}
    counts["success"] = evaluation.successes
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7, 0.5 + 0.42 * len(counts)), layout="constrained")
        axes = figure.subplots()
        for i, (name, count) in enumerate(counts.items()):
            low, high = wilson_interval(count, n)
            rate = count / n
            axes.barh(i, rate, color=COLOURS[2] if name == "success" else COLOURS[5], height=0.65)
            axes.plot([low, high], [i, i], color=GOAL, linewidth=1.5)
            axes.text(1.02, i, f"{count}/{n}", va="center")
        axes.set_yticks(range(len(counts)), [name.replace("_", " ") for name in counts])
        axes.set_xlim(0, 1.0)
        axes.set_xlabel("share of unseen setups")
        axes.grid(axis="y", visible=False)
        return png(figure)


def goals(demonstrations: Sequence[Demonstration], reproduction: Trace, skill: Any) -> bytes:
    """Thesis Figure 2.9: one column per primitive, one row per dimension, over normalised time."""
    primitives = demonstrations[0].primitives
    used = [label for label in range(len(primitives)) if any(label in demo.labels for demo in demonstrations)]
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(1.2 + 1.9 * len(used), 7.6), layout="constrained")
        grid = figure.subplots(5, len(used), squeeze=False, sharex=True)
        for column, label in enumerate(used):
            primitive = primitives[label]
            goal, mean = _learned(skill, primitive, label)
            runs = [(demo.observations, demo.labels, SHOWN) for demo in demonstrations]
            runs.append((reproduction.observations, reproduction.labels, REPRODUCED))
            for observations, labels, shade in runs:
                motion = _motion(observations, primitive, mean)
                for _, steps in (part for part in stretches(labels) if part[0] == label):
                    part = motion[: len(labels)][steps]
                    for row in range(part.shape[1]):
                        grid[row, column].plot(np.linspace(0, 1, len(part)), part[:, row], color=shade, linewidth=1.1)
            for row in np.flatnonzero(np.isfinite(goal)).tolist():
                grid[row, column].axhline(goal[row], color=GOAL, linestyle="--", linewidth=1.1)
            frame = primitive.position.frame.replace("_", " ")
            grid[0, column].set_title(f"{primitive.name.replace('_', ' ')}\nin {frame}", fontsize=8.5)
            names = [*ROWS.get(primitive.position.space, ROWS["cartesian"]), "turn about z [rad]", "fingers [rad]"]
            for row, name in enumerate(names):
                if column == 0 or name != grid[row, column - 1].get_ylabel():
                    grid[row, column].set_ylabel(name)
                grid[row, column].tick_params(labelsize=7)
                _widen(grid[row, column], LEAST_METRES if name.endswith("[m]") else LEAST_RADIANS)
            grid[-1, column].set_xlabel("normalised time")
        handles = [matplotlib.lines.Line2D([], [], color=c, linestyle=s) for c, s in LEGEND]
        figure.legend(handles, ["demonstrations", "reproduction", "learned goal"], loc="outside upper center", ncols=3)
        return png(figure)


LEGEND: Any = ((SHOWN, "-"), (REPRODUCED, "-"), (GOAL, "--"))


def timeline(reproduction: Trace) -> bytes:
    """Height of the tool, wrist force and fingers over time, on a band of the active primitive."""
    seconds = reproduction.dt * np.arange(len(reproduction.labels))
    observations = reproduction.observations
    signals = [
        ("tool height [m]", observations["tool_position"][:, 2:]),
        ("wrist force [N]", np.linalg.norm(observations["wrench"][:, :3], axis=1)[:, None]),
        ("tool turn [rad]", turn(observations)[:, None]),
    ]
    if "hand_position" in observations:
        signals.append(("fingers [rad]", observations["hand_position"][:, 1:]))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10, 1.2 + 1.35 * len(signals)), layout="constrained")
        rows = figure.subplots(len(signals), 1, sharex=True)
        for axes, (name, rows_of_signal) in zip(rows, signals, strict=True):
            axes.plot(seconds, rows_of_signal, color=GOAL, linewidth=1.0)
            axes.set_ylabel(name)
            for label, steps in stretches(reproduction.labels):
                if label >= 0:
                    end = seconds[steps][-1] + reproduction.dt
                    axes.axvspan(seconds[steps.start], end, color=colour(label), alpha=0.25, linewidth=0)
        rows[-1].set_xlabel("time [s]")
        rows[-1].set_xlim(0, max(seconds[-1], reproduction.dt))
        shown = sorted({int(label) for label in reproduction.labels if label >= 0})
        patches = [matplotlib.patches.Patch(color=colour(label), alpha=0.45) for label in shown]
        names = [reproduction.names[label].replace("_", " ") for label in shown]
        figure.legend(patches, names, loc="outside upper center", ncols=min(7, max(1, len(shown))), fontsize=8)
        return png(figure)


def film_strip(pictures: Sequence[np.ndarray]) -> bytes:
    """Pictures side by side, in two rows."""
    columns = (len(pictures) + 1) // 2
    figure = Figure(figsize=(3.4 * columns, 5.2), layout="constrained")
    cells = figure.subplots(2, columns, squeeze=False).ravel()
    for axes in cells:
        axes.axis("off")
    for axes, picture in zip(cells, pictures, strict=False):
        axes.imshow(picture)
    return png(figure)


def png(figure: Figure) -> bytes:
    """A figure as PNG without time stamp."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def colour(label: int) -> str:
    """The colour of a primitive, the same in all figures."""
    return COLOURS[label % len(COLOURS)]


def _motion(observations: Any, primitive: Primitive, mean: np.ndarray) -> np.ndarray:
    """(T, 5): position in the primitive's frame, turn about its frame's z axis, mean angle of the fingers."""
    turned = turn_in_frame(observations, primitive.orientation, mean)[:, None]
    columns = [position_in_frame(observations, primitive.position), turned]
    if "hand_position" in observations:
        columns.append(observations["hand_position"][:, 1:].mean(axis=1, keepdims=True))
    return np.hstack(columns)


def _learned(skill: Any, primitive: Primitive, label: int) -> tuple[np.ndarray, np.ndarray]:
    """Goals (5,) of the figure's rows, NaN where none was learned, and the mean orientation they are relative to."""
    rows = np.full(5, np.nan)
    learned = getattr(skill, "primitives", None)
    if learned is None:
        return rows, np.array([0.0, 1.0, 0.0, 0.0])
    goal = learned.goal[label]
    for i, axis in enumerate(primitive.position.axes):
        if axis == "position":
            rows[i] = goal[i]
    if primitive.orientation.axes[2] == "position":
        rows[3] = goal[5]
    if primitive.hand is not None and "position" in primitive.hand.axes[1:]:
        rows[4] = goal[7:10].mean()
    return rows, learned.mean[label]


def _widen(axes: Any, least: float) -> None:
    """Show at least `least` of the axis, so that noise on a resting dimension stays small."""
    low, high = axes.get_ylim()
    if high - low < least:
        centre = 0.5 * (low + high)
        axes.set_ylim(centre - 0.5 * least, centre + 0.5 * least)
