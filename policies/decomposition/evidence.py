"""Evidence that segments share one goal in one task space, goal and variances integrated out.

A primitive's goal has a flat prior 1/V, the variance v_g of a group g of d_g coordinates the prior InvGamma(a0, a0 s_g^2).
With SS_g the scatter of the n ends about their mean in space f and A_g = a0 + (n - 1) d_g / 2,

    E_f = -log V + sum_g [ -(d_g / 2) log n - ((n - 1) d_g / 2) log 2 pi + a0 log(a0 s_g^2) - lnGamma(a0) + lnGamma(A_g)
          - A_g log(a0 s_g^2 + SS_g / 2) ] + the members' constants in f

and E = log sum_f pi_f exp(E_f + H_f), where the members' log-hints h add up, unless the primitive is about something else
altogether: H_f = log(exp sum_l h_lf + exp LOG_APART). One segment alone has 1/V in every space: but for hints it says nothing
about its space, as it should. The partition has the prior of a Chinese restaurant process, alpha^K prod_k Gamma(n_k).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from policies.decomposition.observed import Group, Observed

Array = NDArray[np.float64]

LOG_APART = -20.0
"""log-probability that a primitive is about something else than what hints say of all of its members."""
CONCENTRATION = 1.0
"""alpha of the Chinese restaurant process."""


class Statistics(NamedTuple):
    """Sufficient statistics of sets of segments, added by adding; leading dimensions (...) are sets."""

    n: Array
    """(...,)."""
    total: Array
    """(..., F, D)."""
    squares: Array
    """(..., F, G)."""
    constants: Array
    """(..., F)."""
    hints: Array
    """(..., F)."""

    def at(self, index: Any) -> "Statistics":
        """Of some of the sets."""
        return Statistics(*(array[index] for array in self))

    def plus(self, other: "Statistics", sign: float = 1.0) -> "Statistics":
        """Of the unions of disjoint sets, or with sign -1 of differences."""
        return Statistics(*(a + sign * b for a, b in zip(self, other, strict=True)))


class Predictive(NamedTuple):
    """Where a primitive's next segment ends, in its most probable space."""

    space: NDArray[np.int64]
    """(K,)."""
    mean: Array
    """(K, D)."""
    variance: Array
    """(K, G)."""


class Evidence:
    """Evidence under given scales of the prior variances."""

    def __init__(self, observed: Observed, scales: ArrayLike) -> None:
        """scales (G,): s_g of every group, in units."""
        self.observed, self.groups = observed, observed.groups
        self.scales = np.asarray(scales, dtype=np.float64)
        self.single = statistics(observed)
        self.log_prior = np.log(observed.prior)

    def spaces(self, sets: Statistics) -> Array:
        """log pi_f + E_f (..., F)."""
        n = np.maximum(sets.n, 1.0)[..., None]
        result = sets.constants - self.observed.log_volume
        for g, group in enumerate(self.groups):
            d, prior = group.dimensions, group.shape * self.scales[g] ** 2
            shape = group.shape + 0.5 * (n - 1.0) * d
            result = result + (
                -0.5 * d * np.log(n)
                - 0.5 * (n - 1.0) * d * np.log(2.0 * np.pi)
                + group.shape * np.log(prior)
                - gammaln(group.shape)
                + gammaln(shape)
                - shape * np.log(prior + 0.5 * scatter(sets, g, group))
            )
        return np.asarray(result + np.logaddexp(sets.hints, LOG_APART) + self.log_prior)

    def total(self, sets: Statistics) -> Array:
        """E + log alpha + lnGamma(n) (...,) of every set as a primitive; 0 of an empty one."""
        value = (
            np.logaddexp.reduce(self.spaces(sets), axis=-1) + np.log(CONCENTRATION) + gammaln(np.maximum(sets.n, 1.0))
        )
        return np.asarray(np.where(sets.n > 0.5, value, 0.0))

    def predictive(self, sets: Statistics) -> Predictive:
        """Of every set (K,)."""
        space = np.argmax(self.spaces(sets), axis=-1)
        rows = np.arange(len(space))
        n = np.maximum(sets.n, 1.0)
        variance = np.empty((len(space), len(self.groups)))
        for g, group in enumerate(self.groups):
            d, prior = group.dimensions[space], group.shape * self.scales[g] ** 2
            shape = group.shape + 0.5 * (n - 1.0) * d
            variance[:, g] = (prior + 0.5 * scatter(sets, g, group)[rows, space]) / shape * (1.0 + 1.0 / n)
        return Predictive(space, sets.total[rows, space] / n[:, None], variance)


def statistics(observed: Observed) -> Statistics:
    """Of every segment by itself (L,)."""
    ends = observed.ends
    squares = np.stack([(ends[..., group.part] ** 2).sum(axis=-1) for group in observed.groups], axis=-1)
    return Statistics(np.ones(len(ends)), ends, squares, observed.constants, observed.hints)


def scatter(sets: Statistics, g: int, group: Group) -> Array:
    """SS_g (..., F) about the mean, and what a human scatters by at least: closer agreement is habit, not another goal."""
    n = np.maximum(sets.n, 1.0)[..., None]
    mean_part = (sets.total[..., group.part] ** 2).sum(axis=-1) / n
    least = (n - 1.0) * group.dimensions * group.least**2
    return np.maximum(sets.squares[..., g] - mean_part, 0.0) + least
