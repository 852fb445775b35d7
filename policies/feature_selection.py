"""Which features a transition depends on (thesis 2.5.2: "a feature selection method may be helpful").

Two questions, two measures. When does something *happen* (an object slips, a screw comes loose)? One feature leaves the
values that it had before: `separation`, `telling_event`. And which way *leads on* from one and the same goal? Several
features may be needed together, and a class may lie on both sides of another (short and long objects, not the medium
ones): `telling_features`.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

RESOLUTION = 0.05
"""Distance, in features of range 1, that is worth half of a very large one."""
LEAST_GAP = 0.05
"""An event takes a feature of range 1 at least so far beyond what it was elsewhere."""
LEAST_GAIN = 0.05
"""Gain of a class's mean margin, which lies in [-1, 1], below which another feature is not worth its having."""


def separation(a: Array, b: Array) -> float:
    """|2 AUC - 1| of one feature (N,), (M,) between two classes: 0 tells nothing, 1 separates them."""
    b = np.sort(b)
    below, upto = np.searchsorted(b, a - 1e-6), np.searchsorted(b, a + 1e-6, side="right")
    return float(abs(np.mean(below + upto) / len(b) - 1.0))


class Event(NamedTuple):
    """A feature crosses a border to a side."""

    feature: int
    border: float
    side: float
    """1 for above the border, -1 for below."""

    def onset(self, rows: Array) -> int:
        """First sample from which on the feature in rows (N, n) stays beyond the border; N - 1 if its end does not."""
        before = np.flatnonzero(self.side * (rows[:, self.feature] - self.border) <= 0.0)
        return min(int(before[-1]) + 1, len(rows) - 1) if len(before) else 0


def telling_event(
    ended: Sequence[Array], others: Sequence[Array], alike: Sequence[Array], possible: Sequence[int]
) -> Event | None:
    """What happened at the end of some passages and not in others; None if nothing did.

    At the end of the passages (N, n) that it ended, a feature is beyond all that it was in the others and in their own first
    third, and it has changed since the first third by more than it ever did in the others and in passages alike, which are
    from elsewhere in the graph. Of the possible features the one with the widest gap is chosen; the border is in the middle
    of the gap.
    """
    ends = np.stack([rows[-1] for rows in ended])
    calm = np.concatenate([*others, *(_beginning(rows) for rows in ended)])
    changed = np.stack([_change(rows)[-1] for rows in ended])
    drift = np.concatenate([_change(rows) for rows in (*others, *alike, *(_beginning(rows) for rows in ended))])
    best, result = LEAST_GAP, None
    for i in possible:
        for side in (-1.0, 1.0):
            gap = _gap(side * ends[:, i], side * calm[:, i])
            evidence = min(gap, _gap(side * changed[:, i], side * drift[:, i]))
            if evidence > best:
                best, result = evidence, Event(i, float(np.median(ends[:, i])) - 0.5 * side * gap, side)
    return result


def _beginning(rows: Array) -> Array:
    return rows[: len(rows) // 3 + 1]


def _change(rows: Array) -> Array:
    return rows - np.median(_beginning(rows), axis=0)


def _gap(ends: Array, others: Array) -> float:
    return float(np.median(ends) - others.max())


def telling_features(
    units: Array, classes: NDArray[np.int64], groups: NDArray[np.int64], stages: Sequence[Sequence[int]]
) -> dict[int, list[int]]:
    """Few features that together tell classes apart, by the margins of nearest neighbours; class -> what it needs.

    A unit i that is hit_i from the nearest unit of its class and of another group (0 where there is none), and miss_i from
    the nearest one of another class, has the margin m_i = (miss_i - hit_i) / (miss_i + hit_i + RESOLUTION) in [-1, 1]: high
    where the class does not vary and the others are far. Forward selection maximises the mean over classes of the mean of
    max(m_i over the features chosen so far): as in a decision tree, features that another class needs do not count
    against it. A class needs the features up to where its mean margin stops to grow.

    Args:
        units: (U, n) features in [0, 1], one row per observed decision.
        classes: (U,).
        groups: (U,) the demonstration of each unit: units of one group are no evidence for each other.
        stages: features to choose from; those of a later stage only where an earlier one has nothing to add.
    """
    squared = (units[:, None] - units[None]) ** 2
    other = classes[:, None] != classes[None]
    same = ~other & (groups[:, None] != groups[None])
    names = np.unique(classes)

    def margins(features: Sequence[int]) -> Array:
        return _margins(squared[:, :, list(features)].sum(axis=2), other, same)

    def per_class(values: Array) -> Array:
        return np.array([values[classes == c].mean() for c in names])

    chosen: list[int] = []
    needed: dict[int, list[int]] = {int(c): [] for c in names}
    best = np.zeros(len(units))
    for stage in stages:
        while True:
            possible = {j: np.maximum(best, margins([*chosen, j])) for j in stage if j not in chosen}
            winner = max(possible, key=lambda j: per_class(possible[j]).mean(), default=-1)
            gains = per_class(possible[winner] - best) if winner >= 0 else np.zeros(1)
            if gains.max() < LEAST_GAIN:
                break
            chosen.append(winner)
            best = possible[winner]
            needed |= {int(c): chosen.copy() for c, gain in zip(names, gains, strict=True) if gain >= LEAST_GAIN}
    return needed


def _margins(squared: Array, other: Mask, same: Mask) -> Array:
    distance = np.sqrt(squared)
    miss = np.min(distance, axis=1, where=other, initial=np.inf)
    hit = np.min(distance, axis=1, where=same, initial=np.inf)
    hit = np.where(np.isfinite(hit), hit, 0.0)
    return (miss - hit) / (miss + hit + RESOLUTION)
