"""J: how good an assignment of segments to primitives is, all terms together.

J = sum_k [E_k + log alpha + lnGamma(n_k)] over the complete segments + log eps_C for each of them + the scores of the
incomplete ones + log rho wherever a primitive moves to its goal twice in a row + the order of the primitives. It chooses the
number of primitives, the kinds of segments, the task spaces and the scales.

The order is that of a Markov chain with a flat prior over which of K follows a primitive (another one, or the end): with n_ab
times b after a, sum_a [lnGamma(K) - lnGamma(K + n_a) + sum_b lnGamma(1 + n_ab)]. Demonstrations of one task resemble each
other: what only one of them does is more likely the noise of what the others do there.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from policies.decomposition.evidence import Evidence, Statistics
from policies.decomposition.incomplete import incomplete_scores
from policies.decomposition.observed import Observed
from policies.decomposition.result import COMPLETE, PAUSE, STOPPED

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

LOG_AGAIN = float(np.log(0.05))
"""log rho: a movement that arrived is seldom followed by another to the same goal."""


class Assignment(NamedTuple):
    """A candidate."""

    primitive: Integers
    """(L,) numbers 0 to K - 1, each with at least one complete segment."""
    kind: Integers
    """(L,)."""


class Objective:
    """J under given scales."""

    def __init__(self, observed: Observed, evidence: Evidence) -> None:
        self.observed, self.evidence = observed, evidence
        self.following, self.moves = observed.following, observed.moves
        self.next_moving = self._next_moving()
        last = self.following < 0
        self.last, self.first = np.flatnonzero(last), np.flatnonzero(np.r_[True, last[:-1]])
        self.before = np.flatnonzero(~last)
        self.log_factorial = gammaln(1.0 + np.arange(2 * len(last) + 2))

    def __call__(self, candidate: Assignment) -> float:
        """J of a candidate; -inf where it is not allowed."""
        z, kind = candidate
        sets = self.sets(candidate)
        complete, incomplete = kind == COMPLETE, np.flatnonzero(kind != COMPLETE)
        if sets.n[z[incomplete]].min(initial=1.0) < 0.5 or not self._allowed(z, kind):
            return -np.inf
        value = float(self.evidence.total(sets).sum()) + float(self.observed.log_shares[complete, COMPLETE].sum())
        value += LOG_AGAIN * int(self._again(z, kind).sum()) + self.order(z)
        if len(incomplete):
            scores = self.scores(sets, incomplete)
            value += float(scores[np.arange(len(incomplete)), z[incomplete], kind[incomplete]].sum())
        return value

    def order(self, z: Integers) -> float:
        """log-probability of the order of the primitives in all demonstrations."""
        n = int(z.max()) + 1
        after, next_ = z[self.before], z[self.following[self.before]]
        changes = after != next_
        pairs = np.concatenate(
            [(n + 1) * after[changes] + next_[changes], (n + 1) * n + z[self.first], (n + 1) * z[self.last] + n]
        )
        counts = np.bincount(pairs, minlength=(n + 1) ** 2).reshape(n + 1, n + 1)
        factorial = self.log_factorial
        return float((factorial[n - 1] - factorial[n - 1 + counts.sum(axis=1)]).sum() + factorial[counts].sum())

    def sets(self, candidate: Assignment) -> Statistics:
        """Statistics of the complete segments of every primitive (K,)."""
        z, kind = candidate
        member = np.zeros((int(z.max()) + 1, len(z)))
        member[z, np.arange(len(z))] = kind == COMPLETE
        return Statistics(*(np.tensordot(member, array, axes=1) for array in self.evidence.single))

    def scores(self, sets: Statistics, rows: Integers) -> Array:
        """(rows, K, 5) of segments as incomplete ones."""
        return incomplete_scores(self.observed, self.evidence.predictive(sets), rows)

    def _again(self, z: Integers, kind: Integers) -> NDArray[np.bool_]:
        next_ = self.following
        same = (next_ >= 0) & self.moves & self.moves[next_] & (z == z[next_])
        return np.asarray(same & (kind == COMPLETE))

    def _allowed(self, z: Integers, kind: Integers) -> bool:
        later = self.next_moving
        resumed = (later >= 0) & (z == z[later])
        continued = (self.following >= 0) & (z == z[self.following])
        return not ((kind == STOPPED) & resumed).any() and not ((kind == PAUSE) & ~continued).any()

    def _next_moving(self) -> Integers:
        result = np.full(len(self.following), -1)
        for i in range(len(result) - 1, -1, -1):
            after = self.following[i]
            result[i] = after if after < 0 or self.moves[after] else result[after]
        return result
