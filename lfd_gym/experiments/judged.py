"""Statistics of judged transitions: shares with intervals, and paired differences."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.evaluation import wilson_interval
from lfd_gym.experiments.figures import Estimate

Array = NDArray[np.float64]

RESAMPLES = 1000
"""Of the bootstrap."""


class Judged(NamedTuple):
    """What the judge saw of one kind of skill."""

    sizes: NDArray[np.int64]
    """(S,) number of demonstrations of each skill."""
    right: Array
    """(S, E, T) how often each skill made each transition right in each setup."""
    due: Array
    """(S, E, T) how often it was due."""
    success: Array
    """(S, E) whether it solved the task alone."""

    def of_size(self, n: int) -> "Judged":
        """The skills from n demonstrations."""
        return Judged(*(array[self.sizes == n] for array in self))

    def shares(self) -> Array:
        """(T,) share of right ones of each transition; NaN where it was never due."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.right.sum(axis=(0, 1)) / self.due.sum(axis=(0, 1)))


class Summary(NamedTuple):
    """The bars of Figure 2.12."""

    worst: float
    """Share of right ones of the worst transition."""
    mean: Estimate
    """Mean share over the transitions, with the interval of the bootstrap."""
    best: float
    whole: Estimate
    """Share of solved tasks, with Wilson's interval over setups: all skills meet the same."""


def judged(skills: Sequence[Mapping[str, Any]], pairs: Sequence[tuple[int, int]]) -> Judged:
    """Arrays of skills, each with its "size" and its judged "episodes"; pairs are the T transitions."""
    n_setups = len(skills[0]["episodes"])
    right, due = np.zeros((2, len(skills), n_setups, len(pairs)))
    success = np.zeros((len(skills), n_setups))
    for s, skill in enumerate(skills):
        for e, episode in enumerate(skill["episodes"]):
            success[s, e] = episode["success"]
            for before, after, well in episode["transitions"]:
                due[s, e, pairs.index((before, after))] += 1
                right[s, e, pairs.index((before, after))] += well
    return Judged(np.array([skill["size"] for skill in skills]), right, due, success)


def summary(of: Judged) -> Summary:
    """Worst, mean and best transition, and the whole task."""
    shares, (n_skills, n_setups) = of.shares(), of.success.shape
    solved = float(of.success.sum()) / n_skills
    mean = Estimate(float(np.nanmean(shares)), *_interval(resampled(of)[0]))
    whole = Estimate(solved / n_setups, *wilson_interval(solved, n_setups))
    return Summary(float(np.nanmin(shares)), mean, float(np.nanmax(shares)), whole)


def differences(one: Judged, other: Judged) -> tuple[Estimate, Estimate]:
    """Of the mean over the transitions, and of the whole task; paired by skill and setup."""
    values = np.nanmean(one.shares()) - np.nanmean(other.shares()), (one.success - other.success).mean()
    draws = [a - b for a, b in zip(resampled(one), resampled(other), strict=True)]
    transitions, whole = (Estimate(float(v), *_interval(d)) for v, d in zip(values, draws, strict=True))
    return transitions, whole


def resampled(of: Judged) -> tuple[Array, Array]:
    """Mean over the transitions, and success of the whole task, of `RESAMPLES` draws of skills and of setups.

    All skills meet the same setups, so that a setup that is drawn is drawn for all of them. Equal shapes are drawn alike, so
    that differences between kinds of skill are paired.
    """
    rng = np.random.default_rng(0)
    n_skills, n_setups, _ = of.right.shape
    transitions, whole = np.empty((2, RESAMPLES))
    for i in range(RESAMPLES):
        drawn = rng.integers(n_skills, size=(n_skills, 1)), rng.integers(n_setups, size=n_setups)
        sample = Judged(of.sizes, of.right[drawn], of.due[drawn], of.success[drawn])
        transitions[i], whole[i] = np.nanmean(sample.shares()), sample.success.mean()
    return transitions, whole


def _interval(draws: Array) -> tuple[float, float]:
    low, high = np.quantile(draws, [0.025, 0.975])
    return float(low), float(high)
