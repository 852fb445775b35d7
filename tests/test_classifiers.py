"""Our own scikit-learn classifiers: kernel logistic regression, import vector machine, Gaussian mixtures."""

import warnings

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import cho_solve
from scipy.optimize import minimize
from scipy.stats import norm
from sklearn.datasets import make_moons
from sklearn.exceptions import ConvergenceWarning
from sklearn.metrics.pairwise import rbf_kernel
from sklearn.utils.estimator_checks import parametrize_with_checks

from policies.classifiers import GaussianMixtureClassifier, ImportVectorMachine, KernelLogisticRegression
from policies.classifiers import import_vector_machine as ivm
from policies.classifiers.gaussian_mixture import expectation_maximisation, single_gaussian, split


@parametrize_with_checks([KernelLogisticRegression(), ImportVectorMachine(), GaussianMixtureClassifier()])
def test_scikit_learns_checks_pass(estimator, check):
    check(estimator)


def overlapping(n_classes: int, n: int = 40, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    classes = np.repeat(np.arange(n_classes), n)
    centres = rng.uniform(-1, 1, size=(n_classes, 2))
    return centres[classes] + rng.normal(0, 0.5, (len(classes), 2)), classes, rng.uniform(0.2, 2, len(classes))


@pytest.mark.parametrize("n_classes", [2, 3])
def test_kernel_logistic_regression_is_the_minimum_in_its_function_space(n_classes):
    """There the derivative is zero: f_c(x) = C sum_i w_i ([y_i = c] - p_c(x_i)) k(x_i, x) + b_c, and residuals add to 0."""
    X, y, weights = overlapping(n_classes)
    estimator = KernelLogisticRegression(C=3.0).fit(X, y, sample_weight=weights)
    residuals = weights[:, None] * (np.eye(n_classes)[y] - estimator.predict_proba(X))
    assert residuals.sum(axis=0) == pytest.approx(0.0, abs=1e-5)
    rows = residuals if n_classes > 2 else residuals[:, 1:]
    scores = 3.0 * rbf_kernel(X, gamma=estimator.gamma_) @ rows + estimator.intercept_
    assert np.squeeze(scores) == pytest.approx(estimator.decision_function(X), abs=1e-4)


@pytest.mark.parametrize("n_classes", [2, 3])
def test_import_vector_machine_with_every_kernel_is_kernel_logistic_regression(n_classes):
    X, y, weights = overlapping(n_classes)
    machine = ImportVectorMachine(C=3.0, tol=0.0).fit(X, y, sample_weight=weights)
    regression = KernelLogisticRegression(C=3.0).fit(X, y, sample_weight=weights)
    assert machine.decision_function(X) == pytest.approx(regression.decision_function(X), abs=1e-3)


def test_import_vector_machine_needs_few_kernels_and_loses_nothing():
    X, y = make_moons(400, noise=0.2, random_state=0)
    unseen, truth = make_moons(2000, noise=0.2, random_state=1)
    machine, regression = ImportVectorMachine(C=10.0).fit(X, y), KernelLogisticRegression(C=10.0).fit(X, y)
    assert len(machine.support_vectors_) < 25
    assert machine.score(unseen, truth) > regression.score(unseen, truth) - 0.005
    assert {tuple(row) for row in machine.support_vectors_} <= {tuple(row) for row in X}


def test_objective_of_the_import_vector_machine_falls_and_its_stop_is_the_relative_decrease():
    X, y = make_moons(200, noise=0.3, random_state=0)
    loose, tight = ImportVectorMachine(tol=1e-2).fit(X, y), ImportVectorMachine(tol=1e-5).fit(X, y)
    assert (np.diff(tight.objective_) <= 0).all()
    n = len(loose.objective_)
    assert loose.objective_ == pytest.approx(tight.objective_[:n])
    relative = -np.diff(tight.objective_) / tight.objective_[1:]
    assert relative[n - 2] <= 1e-2 < relative[: n - 2].min()
    assert len(ImportVectorMachine(max_imports=3).fit(X, y).support_vectors_) == 3


@pytest.mark.parametrize(("n_classes", "n_features"), [(2, 2), (3, 1), (4, 1), (4, 2)])
@pytest.mark.parametrize("C", [1e5, 1e6])
def test_import_vector_machine_ends_where_rounding_hides_the_gain(n_classes, n_features, C):
    """At such C some kernels leave the Hessian indefinite; what was imported before them is no worse than with more bias."""
    for seed in range(2):
        X, y, weights = overlapping(n_classes, n=20, seed=seed)
        X = X[:, :n_features]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            machine = ImportVectorMachine(C=C).fit(X, y, sample_weight=weights)
        assert np.isfinite(machine.decision_function(X)).all()
        assert len(machine.objective_) == len(machine.support_vectors_) + 1
        assert (np.diff(machine.objective_) <= 0).all()
        assert machine.score(X, y) > ImportVectorMachine(C=10.0).fit(X, y, sample_weight=weights).score(X, y) - 0.05


def test_first_and_second_import_are_among_the_best_of_all_kernels():
    X, y, weights = overlapping(2, seed=3)
    machine = ImportVectorMachine(C=3.0, max_imports=2, tol=0.0).fit(X, y, sample_weight=weights)
    gram = rbf_kernel(X, gamma=machine.gamma_)

    def objective(parameters: np.ndarray, chosen: list[int]) -> float:
        z = (2 * y - 1) * (parameters[0] + gram[:, chosen] @ parameters[1:])
        return (
            3.0 * weights @ np.logaddexp(0, -z) + 0.5 * parameters[1:] @ gram[np.ix_(chosen, chosen)] @ parameters[1:]
        )

    imported = [int(np.flatnonzero((row == X).all(axis=1))[0]) for row in machine.support_vectors_]
    for n, before in ((1, []), (2, imported[:1])):
        candidates = [[*before, i] for i in range(len(X)) if i not in before]
        found = sorted(minimize(objective, np.zeros(n + 1), args=(chosen,)).fun for chosen in candidates)
        assert machine.objective_[n] == pytest.approx(minimize(objective, np.zeros(n + 1), args=(imported[:n],)).fun)
        assert machine.objective_[n] < found[3]


@pytest.mark.parametrize("n_classes", [2, 3])
def test_candidates_are_ranked_by_one_newton_step_over_all_coefficients(n_classes):
    X, y, weights = overlapping(n_classes, n=10)
    gram, class_weights = rbf_kernel(X, gamma=1.0), weights[:, None] * np.eye(n_classes)[y]
    imported, columns = [3, 7], 1 if n_classes == 2 else n_classes
    state = ivm._converge(ivm._problem(gram, imported, class_weights), np.zeros((3, columns)))
    gain = ivm._gain(gram, imported, class_weights, state)
    for candidate in (i for i in range(len(X)) if i not in imported):
        start = np.vstack([state.coefficients, np.zeros(columns)])
        larger, gradient = ivm._problem(gram, [*imported, candidate], class_weights).expand(start)
        assert gain[candidate] == pytest.approx(
            0.5 * gradient.ravel() @ cho_solve(larger.factor, gradient.ravel()), rel=1e-4
        )


def test_single_gaussians_are_bayes_rule():
    rng = np.random.default_rng(0)
    X, y = np.r_[rng.normal(0, 1, 4000), rng.normal(2, 0.5, 1000)][:, None], np.repeat([0, 1], [4000, 1000])
    estimator = GaussianMixtureClassifier(max_components=1, regularisation=1e-9).fit(X, y)
    grid = np.linspace(-2, 4, 50)[:, None]
    joint = np.hstack([0.8 * norm.pdf(grid, 0, 1), 0.2 * norm.pdf(grid, 2, 0.5)])
    assert estimator.predict_proba(grid) == pytest.approx(joint / joint.sum(axis=1, keepdims=True), abs=0.04)
    assert quad(lambda x: np.exp(estimator.predict_joint_log_proba([[x]])).sum(), -8, 8)[0] == pytest.approx(1.0)


def test_number_of_gaussians_is_the_planted_one():
    rng = np.random.default_rng(1)
    one, three = rng.normal(0, 0.3, (300, 2)), [rng.normal(m, 0.3, (100, 2)) for m in ([3, 0], [0, 3], [3, 3])]
    estimator = GaussianMixtureClassifier(max_components=5, regularisation=1e-3)
    estimator.fit(np.concatenate([one, *three]), np.repeat([0, 1], 300))
    assert np.bincount(estimator.component_class_).tolist() == [1, 3]
    means = estimator.means_[estimator.component_class_ == 1]
    assert sorted(means.round().tolist()) == [[0, 3], [3, 0], [3, 3]]
    assert estimator.score(np.concatenate([one, *three]), np.repeat([0, 1], 300)) > 0.99


def test_likelihood_of_a_mixture_never_falls_and_no_gaussian_is_narrower_than_the_cloud():
    rng = np.random.default_rng(2)
    for _ in range(5):
        X, weights = rng.normal(size=(30, 3)) * rng.uniform(0.01, 2, 3), rng.uniform(0.1, 3, 30)
        cloud = rng.uniform(0.001, 0.3, 3)
        mixture = single_gaussian(X, weights, cloud)
        for _ in range(3):
            mixture = expectation_maximisation(X, weights, cloud, split(mixture), tol=1e-5, max_iter=2000)
            assert (np.diff(mixture.history) >= -1e-9).all()
            narrowest = np.linalg.eigvalsh(mixture.covariances - np.diag(cloud)).min()
            assert narrowest > -1e-9


def test_classes_of_one_sample_each_are_told_apart():
    estimator = GaussianMixtureClassifier().fit([[0.0, 1.0], [1.0, 1.0]], [5, 7])
    assert estimator.predict([[0.1, 1.0], [0.8, 1.0]]).tolist() == [5, 7]
