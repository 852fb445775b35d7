"""Classifiers of thesis 2.4 that scikit-learn does not have, as scikit-learn estimators."""

from policies.classifiers.gaussian_mixture_classifier import GaussianMixtureClassifier
from policies.classifiers.import_vector_machine import ImportVectorMachine
from policies.classifiers.kernel_logistic_regression import KernelLogisticRegression

__all__ = ["GaussianMixtureClassifier", "ImportVectorMachine", "KernelLogisticRegression"]
