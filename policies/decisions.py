"""What decides at run time: fitted classifiers as plain arrays, without scikit-learn (thesis 2.4)."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Decision(Protocol):
    """A fitted classifier as a named tuple of arrays."""

    def scores(self, features: Array) -> Array:
        """Activation (C,) of every class for features (n,); the largest one is chosen (2.4)."""
        ...

    def probabilities(self, features: Array) -> Array:
        """Probability (C,) of every class for features (n,)."""
        ...


class LinearDecision(NamedTuple):
    """Scores W f + b, whose softmax are the probabilities."""

    weights: Array
    """(C, n)."""
    offsets: Array
    """(C,)."""

    def scores(self, features: Array) -> Array:
        """Activation of every class."""
        return self.weights @ features + self.offsets

    def probabilities(self, features: Array) -> Array:
        """Softmax of the scores."""
        return softmax(self.scores(features))


class KernelDecision(NamedTuple):
    """Scores W k(f) + b with Gaussian kernels k, whose softmax are the probabilities."""

    support: Array
    """(S, n) centres of the kernels."""
    gamma: Array
    """() width of the kernels exp(-gamma |f - s|^2)."""
    weights: Array
    """(C, S)."""
    offsets: Array
    """(C,)."""

    def scores(self, features: Array) -> Array:
        """Activation of every class."""
        return self.weights @ gaussian_kernels(self.support, float(self.gamma), features) + self.offsets

    def probabilities(self, features: Array) -> Array:
        """Softmax of the scores."""
        return softmax(self.scores(features))


class VotingDecision(NamedTuple):
    """One-against-one votes of a support vector machine, ties broken by the sum of the pairs' margins.

    With v and s the votes and the sums of the margins of each class, the scores are v + s / (3 (|s| + 1)), which is
    what scikit-learn calls the decision function "ovr" of its SVC. Two classes score plus and minus their margin.
    """

    support: Array
    """(S, n) support vectors."""
    gamma: Array
    """() width of the kernel exp(-gamma |f - s|^2); 0 stands for the linear kernel s f."""
    pairs: NDArray[np.int64]
    """(P, 2) the classes of each pair, in order."""
    weights: Array
    """(P, S): the margin of a pair is weights k(f) + offset, positive for its first class."""
    offsets: Array
    """(P,)."""
    slopes: Array
    """(P,) of the logistic maps from margins to probabilities."""

    def margins(self, features: Array) -> Array:
        """Margin (P,) of every pair."""
        gamma = float(self.gamma)
        kernel = gaussian_kernels(self.support, gamma, features) if gamma else self.support @ features
        return self.weights @ kernel + self.offsets

    def scores(self, features: Array) -> Array:
        """Activation of every class."""
        margins = self.margins(features)
        if len(margins) == 1:
            return np.array([margins[0], -margins[0]])
        return votes(margins, self.pairs)

    def probabilities(self, features: Array) -> Array:
        """Pairwise probabilities r_ab = 1 / (1 + exp(-slope margin)), coupled by p_a ~ 1 / (sum_b 1 / r_ab - (C - 2)).

        (Price et al. 1994.) The logistic maps have no offset: a pair is undecided where its margin is zero. A support
        vector machine is not a probabilistic model; these are a calibration on the training data, and with three or
        more classes the most probable one need not be the one with most votes.
        """
        z = np.clip(self.slopes * self.margins(features), -500.0, 500.0)
        n_classes = int(self.pairs[-1, 1]) + 1
        inverse = np.zeros(n_classes)
        np.add.at(inverse, self.pairs, np.stack([1.0 + np.exp(-z), 1.0 + np.exp(z)], axis=1))
        p: Array = 1.0 / (inverse - (n_classes - 2))
        return p / p.sum()


class MixtureDecision(NamedTuple):
    """Scores log p(f, c) of class-conditional Gaussian mixtures; Bayes' rule gives the probabilities."""

    means: Array
    """(M, n)."""
    whitening: Array
    """(M, n, n) A_m with A_m' A_m the inverse covariance."""
    offsets: Array
    """(M,) log of weight, class prior and normalising constant of every Gaussian."""
    starts: NDArray[np.int64]
    """(C,) first Gaussian of every class; they are in the order of the classes."""

    def scores(self, features: Array) -> Array:
        """Activation of every class."""
        scores: Array = np.logaddexp.reduceat(
            log_densities(self.means, self.whitening, self.offsets, features), self.starts
        )
        return scores

    def probabilities(self, features: Array) -> Array:
        """Posterior of every class."""
        return softmax(self.scores(features))


DECISIONS: dict[str, Callable[..., Any]] = {
    "linear": LinearDecision,
    "kernel": KernelDecision,
    "votes": VotingDecision,
    "mixture": MixtureDecision,
}
"""Name in a skill's file -> decision."""


def constant_decision(n_classes: int, n_features: int) -> LinearDecision:
    """The first class, whatever the features."""
    return LinearDecision(np.zeros((n_classes, n_features)), np.eye(n_classes)[0])


@njit(cache=True)
def gaussian_kernels(support: Array, gamma: float, features: Array) -> Array:
    """exp(-gamma |f - s|^2) (S,) for features f (n,) and every row s of support (S, n)."""
    result = np.empty(len(support))
    for s in range(len(support)):
        squared = 0.0
        for i in range(len(features)):
            squared += (support[s, i] - features[i]) ** 2
        result[s] = np.exp(-gamma * squared)
    return result


@njit(cache=True)
def votes(margins: Array, pairs: NDArray[np.int64]) -> Array:
    """Scores (C,) of one-against-one margins (P,) of pairs (P, 2), see `VotingDecision`."""
    won, total = np.zeros(pairs[-1, 1] + 1), np.zeros(pairs[-1, 1] + 1)
    for p in range(len(margins)):
        a, b = pairs[p]
        won[a if margins[p] > 0.0 else b] += 1.0
        total[a] += margins[p]
        total[b] -= margins[p]
    return won + total / (3.0 * (np.abs(total) + 1.0))


@njit(cache=True)
def log_densities(means: Array, whitening: Array, offsets: Array, features: Array) -> Array:
    """offset_m - 1/2 |A_m (f - mu_m)|^2 (M,) for features f (n,), means (M, n) and whitening A (M, n, n)."""
    result = offsets.copy()
    for m in range(len(means)):
        for i in range(len(features)):
            z = 0.0
            for j in range(len(features)):
                z += whitening[m, i, j] * (features[j] - means[m, j])
            result[m] -= 0.5 * z * z
    return result


def softmax(scores: Array) -> Array:
    """exp(s_c) / sum exp(s) (C,); scipy's takes ten times as long for a single row."""
    exponentials = np.exp(scores - scores.max())
    result: Array = exponentials / exponentials.sum()
    return result
