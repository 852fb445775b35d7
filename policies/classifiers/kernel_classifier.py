"""Base of the classifiers whose scores are a sum of Gaussian kernels and whose probabilities are their softmax."""

from abc import ABC, abstractmethod
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import softmax
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.metrics.pairwise import rbf_kernel
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, validate_data

Array = NDArray[np.float64]
Gamma = float | Literal["scale"]


class KernelClassifier(ClassifierMixin, BaseEstimator, ABC):
    """Scores f_c(x) = sum_s dual_coef[c, s] exp(-gamma |x - x_s|^2) + intercept[c], p(c|x) = softmax_c f(x).

    With two classes there is one row, the score of the second class against a first one of zero.

    Attributes:
        classes_: (C,).
        support_vectors_: (S, n) points x_s of the kernels that are used.
        dual_coef_: (C, S), or (1, S) for two classes.
        intercept_: (C,) or (1,).
        gamma_: width of the kernel that was used.
    """

    gamma: Gamma
    classes_: NDArray
    support_vectors_: Array
    dual_coef_: Array
    intercept_: Array

    @abstractmethod
    def _fit(self, points: Array, class_weights: Array) -> None:
        """Find kernels and coefficients.

        Args:
            points: (M, n) the distinct samples, sorted.
            class_weights: (M, C) summed weights of the samples of each class at each point.
        """

    def fit(self, X: ArrayLike, y: ArrayLike, sample_weight: ArrayLike | None = None) -> Self:
        """Learn from samples X (N, n) of classes y (N,); ValueError unless two classes have samples of positive weight.

        A sample of weight 2 is the same as two samples of weight 1.
        """
        samples, labels = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(labels)
        weights = _check_sample_weight(sample_weight, samples, ensure_non_negative=True)
        used = weights > 0.0
        self.classes_, classes = np.unique(labels[used], return_inverse=True)
        if len(self.classes_) < 2:
            raise ValueError(
                f"{type(self).__name__} needs samples of two classes; given: {len(self.classes_)} class(es)"
            )
        points, at = np.unique(samples[used], axis=0, return_inverse=True)
        class_weights = np.zeros((len(points), len(self.classes_)))
        np.add.at(class_weights, (at.ravel(), classes), weights[used])
        self.gamma_ = self.gamma if self.gamma != "scale" else scale_width(points, class_weights.sum(axis=1))
        self._fit(points, class_weights)
        return self

    def decision_function(self, X: ArrayLike) -> Array:
        """Scores (N, C); for two classes (N,), positive for the second."""
        check_is_fitted(self)
        kernels = rbf_kernel(validate_data(self, X, dtype=np.float64, reset=False), self.support_vectors_, self.gamma_)
        scores: Array = kernels @ self.dual_coef_.T + self.intercept_
        return scores[:, 0] if len(self.classes_) == 2 else scores

    def predict_proba(self, X: ArrayLike) -> Array:
        """Probability (N, C) of every class."""
        scores = self.decision_function(X)
        probabilities: Array = softmax(np.stack([np.zeros_like(scores), scores], 1) if scores.ndim == 1 else scores, 1)
        return probabilities

    def predict(self, X: ArrayLike) -> NDArray:
        """The most probable class (N,)."""
        most_probable = self.predict_proba(X).argmax(axis=1)
        return self.classes_[most_probable]


def scale_width(points: Array, weights: Array) -> float:
    """gamma = 1 / (n v) with v the weighted variance of all entries of points (M, n): scikit-learn's "scale"."""
    mean = np.average(points, axis=0, weights=weights).mean()
    variance = np.average((points - mean) ** 2, axis=0, weights=weights).mean()
    return 1.0 / (points.shape[1] * variance) if variance > 0.0 else 1.0
