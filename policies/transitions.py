"""Classifiers that decide when a node is left, and to which successor (thesis 2.4), behind one call.

    CLASSIFIERS[name](features, classes, weights, C) -> (fitted scikit-learn estimator, its decision as plain arrays)

features (N, n), classes (N,) in 0..K-1 with every class present, weights (N,) with mean 1, C the inverse strength of
the regularisation. A new kind of classifier is one function and one row here and, if its decision has a new form, one
more class in `decisions.py`.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.decisions import Decision, KernelDecision, LinearDecision, MixtureDecision, VotingDecision

Array = NDArray[np.float64]
Classes = NDArray[np.int64]

KERNELS = ("linear", "rbf")


def fit_logistic_regression(features: Array, classes: Classes, weights: Array, C: float) -> tuple[Any, Decision]:
    """Multinomial logistic regression."""
    from sklearn.linear_model import LogisticRegression

    estimator = LogisticRegression(C=C, max_iter=2000, tol=1e-6).fit(features, classes, sample_weight=weights)
    return estimator, LinearDecision(*_every_class(estimator.coef_, estimator.intercept_))


def fit_kernel_logistic_regression(features: Array, classes: Classes, weights: Array, C: float) -> tuple[Any, Decision]:
    """Kernel logistic regression with a Gaussian kernel."""
    from policies.classifiers import KernelLogisticRegression

    return _kernel_decision(KernelLogisticRegression(C=C).fit(features, classes, sample_weight=weights))


def fit_import_vectors(features: Array, classes: Classes, weights: Array, C: float) -> tuple[Any, Decision]:
    """Import vector machine: kernel logistic regression on few kernels."""
    from policies.classifiers import ImportVectorMachine

    return _kernel_decision(ImportVectorMachine(C=C).fit(features, classes, sample_weight=weights))


def fit_gaussian_mixtures(features: Array, classes: Classes, weights: Array, C: float) -> tuple[Any, Decision]:
    """One Gaussian mixture per class; 1 / C of a feature's variance is the least variance of a Gaussian."""
    from policies.classifiers import GaussianMixtureClassifier

    estimator = GaussianMixtureClassifier(regularisation=1.0 / C).fit(features, classes, sample_weight=weights)
    whitening = np.linalg.inv(np.linalg.cholesky(estimator.covariances_))
    log_determinants = np.log(np.diagonal(whitening, axis1=1, axis2=2)).sum(axis=1)
    of_class = estimator.component_class_
    offsets = np.log(estimator.weights_ * estimator.class_prior_[of_class]) + log_determinants
    offsets -= 0.5 * features.shape[1] * np.log(2.0 * np.pi)
    starts = np.searchsorted(of_class, np.arange(len(estimator.classes_)))
    return estimator, MixtureDecision(estimator.means_, whitening, offsets, starts)


def fit_support_vectors(
    features: Array, classes: Classes, weights: Array, C: float, kernel: str = "rbf"
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
    support, gamma, offsets = estimator.support_vectors_, np.array(estimator._gamma), estimator.intercept_.copy()
    if n_classes == 2:  # scikit-learn flips the sign of a single pair
        coefficients, offsets = -coefficients, -offsets
    if kernel == "linear":  # the weighted sum of support vectors is one vector per pair
        support, gamma, coefficients = np.eye(features.shape[1]), np.array(0.0), coefficients @ support
    uncalibrated = VotingDecision(support, gamma, pairs, coefficients, offsets, np.ones(len(pairs)))
    margins = np.array([uncalibrated.margins(row) for row in features])
    slopes = []
    for (a, b), margin in zip(pairs, margins.T, strict=True):
        own = (classes == a) | (classes == b)
        slopes.append(logistic_slope(margin[own], classes[own] == a, weights[own]))
    return estimator, uncalibrated._replace(slopes=np.array(slopes))


def logistic_slope(margins: Array, first: NDArray[np.bool_], weights: Array) -> float:
    """Slope s > 0 that makes 1 / (1 + exp(-s margin)) the most likely probability of the first class (Platt 1999).

    margins, first, weights (N,). Platt's targets (n + 1) / (n + 2) in place of 1 keep s finite where the margins
    separate the classes. The margins are those of the training data, so probabilities are too sure of themselves.
    """
    from scipy.optimize import minimize_scalar

    n_first, n_second = weights[first].sum(), weights[~first].sum()
    target = np.where(first, (n_first + 1.0) / (n_first + 2.0), 1.0 / (n_second + 2.0))

    def loss(log_slope: float) -> float:
        z = np.exp(log_slope) * margins
        return float(weights @ (np.logaddexp(0.0, z) - target * z))

    return float(np.exp(minimize_scalar(loss, bounds=np.log([1e-3, 1e3]), method="bounded").x))


def _kernel_decision(estimator: Any) -> tuple[Any, Decision]:
    weights, offsets = _every_class(estimator.dual_coef_, estimator.intercept_)
    return estimator, KernelDecision(estimator.support_vectors_, np.array(estimator.gamma_), weights, offsets)


def _every_class(weights: Array, offsets: Array) -> tuple[Array, Array]:
    """One row per class; of two classes scikit-learn has the second one's only, against a first one of zero."""
    if len(weights) > 1:
        return weights, offsets
    return np.vstack([np.zeros_like(weights), weights]), np.concatenate([np.zeros(1), offsets])


CLASSIFIERS: Mapping[str, Callable[..., tuple[Any, Decision]]] = {
    "lr": fit_logistic_regression,
    "klr": fit_kernel_logistic_regression,
    "svm": fit_support_vectors,
    "ivm": fit_import_vectors,
    "gmm": fit_gaussian_mixtures,
}
