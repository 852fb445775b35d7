"""Kernel logistic regression with the true penalty of its function space (thesis 2.4)."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpstrf
from sklearn.kernel_approximation import Nystroem
from sklearn.linear_model import LogisticRegression
from sklearn.metrics.pairwise import rbf_kernel

from policies.classifiers.kernel_classifier import Gamma, KernelClassifier

Array = NDArray[np.float64]

INDEPENDENT = 1e-10
"""Squared distance of a kernel from the span of others below which it adds nothing."""


class KernelLogisticRegression(KernelClassifier):
    """Multinomial logistic regression on functions f_c of the Gaussian kernel's Hilbert space.

    Minimises C sum_i w_i (-log p(y_i|x_i)) + 1/2 sum_c |f_c|^2. By the representer theorem f_c is a sum of kernels at the
    samples: `Nystroem` with all of them as components is the coordinates in which |f_c| is the Euclidean norm, and
    `LogisticRegression` does the rest. A pivoted Cholesky factorisation leaves out samples whose kernel is a sum of the
    others', which changes nothing and leaves few kernels to compute.

    Parameters:
        C: inverse strength of the regularisation.
        gamma: of the kernel; "scale" is 1 / (n times the variance of the samples).
        tol, max_iter: of the logistic regression.
    """

    def __init__(self, C: float = 1.0, gamma: Gamma = "scale", tol: float = 1e-8, max_iter: int = 200) -> None:
        self.C, self.gamma, self.tol, self.max_iter = C, gamma, tol, max_iter

    def _fit(self, points: Array, class_weights: Array) -> None:
        basis = points[independent_kernels(rbf_kernel(points, gamma=self.gamma_))]
        embedding = Nystroem(kernel="rbf", gamma=self.gamma_, n_components=len(basis), random_state=0).fit(basis)
        at, classes = np.nonzero(class_weights)
        regression = LogisticRegression(C=self.C, solver="newton-cholesky", tol=self.tol, max_iter=self.max_iter)
        regression.fit(embedding.transform(points)[at], classes, sample_weight=class_weights[at, classes])
        self.n_iter_ = int(regression.n_iter_.max())
        self.support_vectors_ = embedding.components_
        self.dual_coef_ = regression.coef_ @ embedding.normalization_
        self.intercept_ = regression.intercept_


def independent_kernels(gram: Array) -> NDArray[np.int64]:
    """Indices (r,) of kernels that span all of gram (M, M), the kernel's values at all pairs of points."""
    _, pivots, rank, _ = dpstrf(gram, tol=INDEPENDENT)
    return np.sort(pivots[:rank]) - 1
