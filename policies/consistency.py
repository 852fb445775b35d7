"""Whether the parts of a sequence graph's file fit each other: compiled code reads the arrays without looking."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from policies.features import N_COORDINATES
from policies.movement_primitives import MovementPrimitives
from policies.named_observations import NamedObservations

ROW_SHAPES = {
    "position_frame": (), "orientation_frame": (), "space": (), "modes": (N_COORDINATES,), "shared": (3,), "mean": (4,),
    "goal": (N_COORDINATES,), "grip": (4,), "force": (3,), "speed": (), "acceleration": (),
}  # fmt: skip
"""Of one primitive in every array of the table and of what was learned about it."""


def check_consistent(
    labels: Sequence[int], primitives: MovementPrimitives, nodes: Sequence[Any], named: NamedObservations
) -> None:
    """Raise ValueError where shapes differ from what they describe, or an index leads to nothing."""
    n, table = len(primitives.names), primitives.table
    for name, shape in ROW_SHAPES.items():
        array = getattr(table if name in table._fields else primitives, name)
        _check(array.shape == (n, *shape), name)
    for name in ("position_frame", "orientation_frame"):
        _check_index(getattr(table, name), 0, len(table.frames), name)
    _check(len(named.indices) == len(named.low) == len(named.high) == len(named.keys), "observed")
    _check(len(labels) == len(nodes), "nodes")
    _check_index(np.array(labels), -1, n, "labels")
    for node in nodes:
        size = len(node.feature_primitives)
        _check(node.gains.shape == (size, N_COORDINATES) and node.sides.shape == (size,), "features")
        _check(node.feature_columns.shape == (size,) and node.dwell.shape == node.targets.shape, "features")
        _check_index(node.feature_primitives, -1, n, "feature_primitives")
        _check_index(node.feature_columns, -1, len(named.keys), "feature_columns")
        _check(bool(np.all((node.feature_primitives >= 0) | (node.feature_columns >= 0))), "features")
        _check_index(node.targets, 0, len(nodes), "targets")
        _check_decision({} if node.decision is None else node.decision._asdict(), size, len(node.targets))


def _check_decision(arrays: Mapping[str, Any], size: int, n_classes: int) -> None:
    for name in ("support", "means"):
        _check(name not in arrays or arrays[name].shape[1:] == (size,), name)
    if "whitening" in arrays:
        n = len(arrays["means"])
        _check(arrays["whitening"].shape == (n, size, size) and arrays["offsets"].shape == (n,), "whitening")
    if "pairs" in arrays:
        _check(arrays["pairs"].ndim == 2 and arrays["pairs"].shape[1] == 2 and len(arrays["pairs"]) > 0, "pairs")
        _check_index(arrays["pairs"], 0, n_classes, "pairs")


def _check_index(array: Any, low: int, high: int, name: str) -> None:
    _check(array.dtype.kind == "i" and bool(np.all((array >= low) & (array < high))), name)


def _check(fits: bool, name: str) -> None:
    if not fits:
        raise ValueError(f"'{name}' does not fit the rest")
