"""Gaussian mixtures as a classifier: one mixture per class and Bayes' rule (thesis 2.4; Bishop 2006, 9.2)."""

from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp, softmax
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

from policies.classifiers.gaussian_mixture import (
    Mixture,
    expectation_maximisation,
    log_densities,
    single_gaussian,
    split,
)

Array = NDArray[np.float64]

ROUNDING = 1e-9
"""A feature whose values differ by less than this share of themselves is constant."""


class GaussianMixtureClassifier(ClassifierMixin, BaseEstimator):
    """p(c|x) from class-conditional mixtures p(x|c) = sum_m pi_m N(x; mu_m, Sigma_m) and the classes' shares p(c).

    Each class takes the number of Gaussians with the least BIC. A sample stands for a small cloud of samples about it,
    of variance `regularisation` times that of all data per feature; so no Gaussian is narrower, however few samples
    there are. A sample of weight 2 is the same as two samples of weight 1.

    Parameters:
        max_components: most Gaussians per class.
        regularisation: variance of the cloud, as a fraction of the variance of each feature; must be positive.
        tol, max_iter: of expectation maximisation; relative to the number of samples.

    Attributes:
        classes_: (C,); class_prior_: (C,).
        weights_: (M,) share of every Gaussian within its class; means_: (M, n); covariances_: (M, n, n).
        component_class_: (M,) index of the class of every Gaussian, ascending.
        n_iter_: (C,) steps of expectation maximisation.
    """

    def __init__(
        self, max_components: int = 3, regularisation: float = 0.1, tol: float = 1e-4, max_iter: int = 500
    ) -> None:
        self.max_components, self.regularisation = max_components, regularisation
        self.tol, self.max_iter = tol, max_iter

    def fit(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> Self:
        """Learn from samples X (N, n) of classes y (N,); ValueError if no sample has a positive weight."""
        samples, labels = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(labels)
        weights = _check_sample_weight(sample_weight, samples, ensure_non_negative=True)
        used = weights > 0.0
        samples, weights = samples[used], weights[used]
        self.classes_, classes = np.unique(labels[used], return_inverse=True)
        if len(self.classes_) == 0:
            raise ValueError("no sample of any class has a positive weight; at least one is needed")
        mean = np.average(samples, axis=0, weights=weights)
        variance = np.average((samples - mean) ** 2, axis=0, weights=weights)
        varies = np.ptp(samples, axis=0) > ROUNDING * np.abs(samples).max(axis=0)
        cloud = self.regularisation * np.where(varies, variance, 1.0)
        mixtures = [self._best(samples[classes == c], weights[classes == c], cloud) for c in range(len(self.classes_))]
        self.n_iter_ = np.array([len(mixture.history) for mixture in mixtures])
        self.class_prior_ = np.bincount(classes, weights) / weights.sum()
        self.component_class_ = np.repeat(np.arange(len(mixtures)), [len(mixture.weights) for mixture in mixtures])
        self.weights_ = np.concatenate([mixture.weights for mixture in mixtures])
        self.means_ = np.concatenate([mixture.means for mixture in mixtures])
        self.covariances_ = np.concatenate([mixture.covariances for mixture in mixtures])
        return self

    def _best(self, X: Array, weights: Array, cloud: Array) -> Mixture:
        """The mixture with the least BIC = n_parameters log(sum of weights) - 2 log L."""
        mixture = single_gaussian(X, weights, cloud)
        candidates = [mixture]
        while len(mixture.weights) < min(self.max_components, len(X)):
            mixture = expectation_maximisation(X, weights, cloud, split(mixture), self.tol, self.max_iter)
            candidates.append(mixture)
        n_samples = max(weights.sum(), 1.0)
        return min(candidates, key=lambda m: m.n_parameters * np.log(n_samples) - 2.0 * m.history[-1])

    def predict_joint_log_proba(self, X: ArrayLike) -> Array:
        """log p(x, c) (N, C)."""
        check_is_fitted(self)
        samples = validate_data(self, X, dtype=np.float64, reset=False)
        of_component = log_densities(samples, self.means_, self.covariances_) + np.log(self.weights_)
        members = [of_component[:, self.component_class_ == c] for c in range(len(self.classes_))]
        return np.stack([logsumexp(part, axis=1) for part in members], axis=1) + np.log(self.class_prior_)

    def predict_proba(self, X: ArrayLike) -> Array:
        """Probability (N, C) of every class."""
        probabilities: Array = softmax(self.predict_joint_log_proba(X), axis=1)
        return probabilities

    def predict(self, X: ArrayLike) -> NDArray:
        """The most probable class (N,)."""
        most_probable = self.predict_joint_log_proba(X).argmax(axis=1)
        return self.classes_[most_probable]
