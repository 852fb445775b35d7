"""Classifiers that decide when a node is left, and to which successor (thesis 2.4).

scikit-learn fits them; what decides at run time are plain arrays that give the same decision without scikit-learn.
A new kind of classifier is one function in `CLASSIFIERS` and, if its decision has a new form, one more class.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Decision(Protocol):
    """A fitted classifier as plain arrays."""

    def scores(self, features: Array) -> Array:
        """Activation (C,) of every class for features (n,); the largest one is chosen (2.4)."""
        ...


class LinearDecision(NamedTuple):
    """Scores W f + b."""

    weights: Array
    """(C, n)."""
    offsets: Array
    """(C,)."""

    def scores(self, features: Array) -> Array:
        """Activation of every class."""
        return self.weights @ features + self.offsets


class KernelDecision(NamedTuple):
    """One-against-one votes of a kernel machine, ties broken by the sum of the pairs' margins.

    With v and s the votes and the sums of the margins of each class, the scores are v + s / (3 (|s| + 1)), which is
    what scikit-learn calls the decision function "ovr" of its SVC.
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

    def margins(self, features: Array) -> Array:
        """Margin (P,) of every pair."""
        if self.gamma == 0.0:
            kernel = self.support @ features
        else:
            kernel = np.exp(-self.gamma * ((self.support - features) ** 2).sum(axis=1))
        return self.weights @ kernel + self.offsets

    def scores(self, features: Array) -> Array:
        """Activation of every class."""
        margins = self.margins(features)
        if len(margins) == 1:
            return np.array([margins[0], -margins[0]])
        n_classes = int(self.pairs.max()) + 1
        votes, total = np.zeros(n_classes), np.zeros(n_classes)
        for (a, b), margin in zip(self.pairs, margins, strict=True):
            votes[a if margin > 0 else b] += 1
            total[a] += margin
            total[b] -= margin
        return votes + total / (3.0 * (np.abs(total) + 1.0))


DECISIONS: dict[str, Callable[..., Any]] = {"linear": LinearDecision, "kernel": KernelDecision}


def constant_decision(n_classes: int, n_features: int) -> LinearDecision:
    """The first class, whatever the features."""
    return LinearDecision(np.zeros((n_classes, n_features)), np.eye(n_classes)[0])


def fit_logistic_regression(features: Array, classes: Array, weights: Array, C: float) -> tuple[Any, Decision]:
    """Multinomial logistic regression; features (N, n), classes (N,) in 0..C-1, weights (N,) with mean 1."""
    from sklearn.linear_model import LogisticRegression

    estimator = LogisticRegression(C=C, max_iter=2000, tol=1e-6).fit(features, classes, sample_weight=weights)
    return estimator, _linear(estimator.coef_, estimator.intercept_)


def fit_support_vectors(
    features: Array, classes: Array, weights: Array, C: float, kernel: str = "rbf"
) -> tuple[Any, Decision]:
    """Support vector machine, one against one; kernel "rbf" (of scikit-learn's width "scale") or "linear"."""
    from sklearn.svm import SVC

    estimator = SVC(C=C, kernel=kernel, break_ties=True).fit(features, classes, sample_weight=weights)
    n_classes = len(estimator.classes_)
    pairs = np.array([(a, b) for a in range(n_classes) for b in range(a + 1, n_classes)])
    # libsvm keeps, for each support vector of class a, its coefficients against the other classes in their order
    starts = np.concatenate([[0], np.cumsum(estimator.n_support_)])
    coefficients = np.zeros((len(pairs), len(estimator.support_vectors_)))
    for p, (a, b) in enumerate(pairs):
        of_a, of_b = slice(starts[a], starts[a + 1]), slice(starts[b], starts[b + 1])
        coefficients[p, of_a] = estimator.dual_coef_[b - 1, of_a]
        coefficients[p, of_b] = estimator.dual_coef_[a, of_b]
    offsets = estimator.intercept_.copy()
    if n_classes == 2:  # scikit-learn flips the sign of a single pair
        coefficients, offsets = -coefficients, -offsets
    if kernel == "linear":  # the weighted sum of support vectors is one vector per pair
        n_features = features.shape[1]
        identity, weights = np.eye(n_features), coefficients @ estimator.support_vectors_
        return estimator, KernelDecision(identity, np.array(0.0), pairs, weights, offsets)
    return estimator, KernelDecision(
        estimator.support_vectors_, np.array(estimator._gamma), pairs, coefficients, offsets
    )


def _linear(weights: Array, offsets: Array) -> LinearDecision:
    """Two classes have one row, whose sign decides."""
    if len(weights) == 1:
        weights, offsets = np.vstack([-weights, weights]), np.concatenate([-offsets, offsets])
    return LinearDecision(weights, offsets)


KERNELS = ("linear", "rbf")
CLASSIFIERS: Mapping[str, Callable[..., tuple[Any, Decision]]] = {
    "lr": fit_logistic_regression,
    "svm": fit_support_vectors,
}
