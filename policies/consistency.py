"""Whether the parts of a skill's file fit each other: compiled code reads the arrays without looking.

Shapes are words with one letter per axis: a digit is a size, equal letters are equal sizes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from lfd_gym.action import ActionLayout
from lfd_gym.errors import is_number
from lfd_gym.view import DECISION_TIME, View
from policies.decisions import DECISIONS
from policies.movement_primitives import MovementPrimitives
from policies.named_observations import NamedObservations
from policies.task_data import N_COORDINATES

ROW_SHAPES = {
    "position_frame": (), "orientation_frame": (), "space": (), "modes": (N_COORDINATES,), "shared": (3,), "mean": (4,),
    "goal": (N_COORDINATES,), "grip": (4,), "force": (3,), "speed": (), "acceleration": (),
}  # fmt: skip
"""Of one primitive in every array of the table and of what was learned about it."""
DECISION_SHAPES: dict[str, dict[str, str]] = {
    "linear": {"weights": "CN", "offsets": "C"},
    "kernel": {"support": "SN", "gamma": "", "weights": "CS", "offsets": "C"},
    "votes": {"support": "SN", "gamma": "", "pairs": "P2", "weights": "PS", "offsets": "P", "slopes": "P"},
    "mixture": {"means": "MN", "whitening": "MNN", "offsets": "M", "starts": "C"},
}
"""Of a decision between C classes by N features."""
PATH_SHAPES: dict[str, dict[str, str]] = {
    "attractors": {"activations": "NF", "places": "NF3", "response": "3"},
    "mixture": {
        "prior": "K", "time": "N", "time_mean": "K", "time_variance": "K", "mean": "GK3", "slope": "GK3",
        "covariance": "GK33",
    },
    "dmp": {"start": "T", "frame": "S", "goal": "S3", "forcing": "N3", "scaled": "", "dt": ""},
    "promp": {"mean": "N3", "gain": "N33"},
    "fixed": {"points": "N3"},
}  # fmt: skip
"""Of a path of N steps in F frames."""
SCHEDULE_SHAPES = {
    "press_force": "N3", "press_frame": "N", "orientation_quaternion": "N4", "orientation_frame": "N", "hand": "NH",
}  # fmt: skip
"""Of N steps with H angles of a hand."""
LAYOUT_SHAPES = {
    "workspace_low": "3", "workspace_high": "3", "rotation_limit": "3", "hand_low": "H", "hand_high": "H",
    "reference_quaternion": "4",
}  # fmt: skip


def check_graph(
    labels: Sequence[int],
    primitives: MovementPrimitives,
    nodes: Sequence[Any],
    named: NamedObservations,
    layout: ActionLayout,
    dt: Any,
) -> None:
    """Raise ValueError where shapes differ from what they describe, an index leads to nothing, or a number is not finite."""
    _check_layout(layout, dt)
    n, table = len(primitives.names), primitives.table
    for name, shape in ROW_SHAPES.items():
        array = getattr(table if name in table._fields else primitives, name)
        check(array.shape == (n, *shape), name)
        _check_finite({name: array})
    for name in ("position_frame", "orientation_frame"):
        _check_index(getattr(table, name), 0, len(table.frames), name)
    check(len(named.indices) == len(named.low) == len(named.high) == len(named.keys), "observed")
    _check_finite({"observed_low": named.low, "observed_high": named.high})
    check(len(labels) == len(nodes), "nodes")
    _check_index(np.array(labels), -1, n, "labels")
    for node in nodes:
        size = len(node.feature_primitives)
        check(node.gains.shape == (size, N_COORDINATES) and node.sides.shape == (size,), "features")
        check(node.feature_columns.shape == (size,) and node.dwell.shape == node.targets.shape, "features")
        _check_index(node.feature_primitives, -1, n, "feature_primitives")
        _check_index(node.feature_columns, -1, len(named.keys), "feature_columns")
        check(bool(np.all((node.feature_primitives >= 0) | (node.feature_columns >= 0))), "features")
        _check_index(node.targets, 0, len(nodes), "targets")
        _check_finite({"gains": node.gains, "sides": node.sides, "dwell": node.dwell})
        check(is_number(node.patience) and node.patience > 0.0, "patience")
        if node.decision is not None:
            _check_decision(node.decision, size, len(node.targets))


def check_path(
    kind: str,
    path: Mapping[str, Any],
    schedules: Mapping[str, Any],
    frames: Sequence[str],
    layout: ActionLayout,
    dt: Any,
) -> None:
    """Raise ValueError, or TypeError, where a path, its schedules, its frames and its layout do not belong together.

    Args:
        kind: of the path's generator, a key of `PATH_SHAPES`.
        path: the generator's arrays.
        schedules: arrays of `SCHEDULE_SHAPES`.
        frames: names beside the world.
        layout: of the actions.
        dt: control step [s].
    """
    _check_layout(layout, dt)
    check(isinstance(frames, list) and all(isinstance(name, str) for name in frames), "frames")
    steps, n_frames = len(schedules["press_force"]), len(frames) + 1
    check(steps > 0, "press_force")
    _check_shapes(schedules, SCHEDULE_SHAPES, N=steps, H=layout.hand_low.size)
    _check_shapes(path, PATH_SHAPES[kind], N=steps, F=n_frames)
    _check_finite({**path, **schedules})
    for name in ("press_frame", "orientation_frame"):
        _check_index(schedules[name], 0, n_frames, name)
    if kind == "mixture":
        check(0 < len(path["mean"]) <= n_frames, "mean")
    if kind == "dmp":
        _check_index(path["frame"], 0, n_frames, "frame")
        _check_starts(path["start"][:-1], len(path["frame"]), steps)
        check(path["start"][-1] == steps, "start")
        check(math.isclose(path["dt"], dt), "dt")


def check_view(view: View) -> None:
    """Raise ValueError for a view with a layout, a control step or controls that cannot be."""
    _check_layout(view.layout, view.dt)
    check(view.repeats > 0 and math.isclose(view.repeats * view.dt, DECISION_TIME), "dt")
    check(bool(view.controls) and all(isinstance(name, str) for name in (*view.controls, *view.frames)), "controls")
    check(len(view.hand_open) == len(view.hand_closed) == 4, "hand_open")


def _check_layout(layout: ActionLayout, dt: Any) -> None:
    check(is_number(dt) and 0.0 < dt < np.inf, "dt")
    arrays = {name: getattr(layout, name) for name in LAYOUT_SHAPES}
    _check_shapes(arrays, LAYOUT_SHAPES, H=np.size(layout.hand_low))
    check(np.size(layout.hand_low) in (0, 4), "hand_low")
    for field in fields(layout):
        value = getattr(layout, field.name)
        check((field.name in arrays or is_number(value)) and bool(np.isfinite(value).all()), field.name)
    check(bool((layout.workspace_low < layout.workspace_high).all()), "workspace_low")
    check(bool((layout.hand_low < layout.hand_high).all()), "hand_low")
    for name in ("rotation_limit", "force_limit", "alpha", "beta", "speed_limit", "turn_limit"):
        check(bool(np.all(np.greater(getattr(layout, name), 0.0))), name)


def _check_decision(decision: Any, size: int, n_classes: int) -> None:
    kind, arrays = next(name for name, cls in DECISIONS.items() if cls is type(decision)), decision._asdict()
    _check_shapes(arrays, DECISION_SHAPES[kind], N=size, C=n_classes)
    _check_finite(arrays)
    if kind == "votes":
        every = np.argwhere(np.triu(np.ones((n_classes, n_classes)), 1))
        check(n_classes > 1 and np.array_equal(arrays["pairs"], every), "pairs")
    if kind == "mixture":
        _check_starts(arrays["starts"], n_classes, len(arrays["means"]))


def _check_shapes(arrays: Mapping[str, Any], shapes: Mapping[str, str], **sizes: int) -> None:
    for name, word in shapes.items():
        shape = np.shape(arrays[name])
        check(len(shape) == len(word), name)
        for letter, n in zip(word, shape, strict=True):
            check(n == (int(letter) if letter.isdigit() else sizes.setdefault(letter, n)), name)


def _check_finite(arrays: Mapping[str, Any]) -> None:
    for name, array in arrays.items():
        check(np.asarray(array).dtype.kind in "biuf" and bool(np.isfinite(array).all()), name)


def _check_starts(starts: Any, n: int, stop: int) -> None:
    """Of n parts in a row, none of them empty, that end at stop."""
    _check_index(starts, 0, stop, "start")
    check(len(starts) == n > 0 and starts[0] == 0 and bool((np.diff(starts) > 0).all()), "start")


def _check_index(array: Any, low: int, high: int, name: str) -> None:
    check(array.dtype.kind == "i" and bool(np.all((array >= low) & (array < high))), name)


def check(fits: bool, name: str) -> None:
    """Raise ValueError, naming what does not fit, unless it does."""
    if not fits:
        raise ValueError(f"'{name}' does not fit the rest")
