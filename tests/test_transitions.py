"""Transition classifiers (thesis 2.4): exported arrays decide as the scikit-learn estimators do, only faster."""

import numpy as np
import pytest

from policies.decisions import VotingDecision, constant_decision
from policies.feature_selection import separation
from policies.transitions import CLASSIFIERS, logistic_slope

KINDS = [
    ("svm", {"kernel": "rbf"}),
    ("svm", {"kernel": "linear"}),
    *((name, {}) for name in CLASSIFIERS if name != "svm"),
]


def problem(n_classes: int, n_features: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    classes = np.repeat(np.arange(n_classes), 40)
    features = rng.uniform(size=(len(classes), n_features)) + 0.3 * classes[:, None] * rng.uniform(size=n_features)
    return features, classes, rng.uniform(0.2, 2.0, size=len(classes)), rng.uniform(-0.5, 2.5, size=(300, n_features))


def scores_of(estimator, unseen: np.ndarray) -> np.ndarray:
    """The estimator's own scores (N, C): of two classes the second one's against zero."""
    if hasattr(estimator, "predict_joint_log_proba"):
        return estimator.predict_joint_log_proba(unseen)
    scores = estimator.decision_function(unseen)
    return np.stack([np.zeros_like(scores), scores], axis=1) if scores.ndim == 1 else scores


@pytest.mark.parametrize("n_classes", [2, 3, 4])
@pytest.mark.parametrize(("classifier", "settings"), KINDS)
def test_exported_decision_equals_scikit_learn(classifier, settings, n_classes):
    features, classes, weights, unseen = problem(n_classes, 3, seed=n_classes)
    estimator, decision = CLASSIFIERS[classifier](features, classes, weights, C=10.0, **settings)
    ours = np.array([decision.scores(f) for f in unseen])
    theirs = scores_of(estimator, unseen)
    if classifier == "svm" and n_classes == 2:
        ours = np.stack([np.zeros(len(ours)), ours[:, 1]], axis=1)
    assert ours == pytest.approx(theirs, abs=1e-9)
    chosen = [int(np.argmax(decision.scores(f))) for f in unseen]
    assert chosen == estimator.predict(unseen).tolist()
    assert len(set(chosen)) == n_classes


@pytest.mark.parametrize("n_classes", [2, 3, 4])
@pytest.mark.parametrize("classifier", [name for name in CLASSIFIERS if name != "svm"])
def test_probabilities_equal_those_of_the_estimator(classifier, n_classes):
    features, classes, weights, unseen = problem(n_classes, 3, seed=n_classes)
    estimator, decision = CLASSIFIERS[classifier](features, classes, weights, C=10.0)
    ours = np.array([decision.probabilities(f) for f in unseen])
    assert ours == pytest.approx(estimator.predict_proba(unseen), abs=1e-9)


@pytest.mark.parametrize("n_classes", [2, 3, 4])
@pytest.mark.parametrize(("classifier", "settings"), KINDS)
def test_probabilities_are_calibrated_on_unseen_samples(classifier, settings, n_classes):
    """Decisions that are made with probability p are right about that often."""
    rng = np.random.default_rng(n_classes)
    angles = 2.0 * np.pi * np.arange(n_classes) / n_classes
    centres = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    classes, truth = rng.integers(n_classes, size=200), rng.integers(n_classes, size=1000)
    features, unseen = (centres[c] + rng.normal(0.0, 0.8, (len(c), 2)) for c in (classes, truth))
    _, decision = CLASSIFIERS[classifier](features, classes, np.ones(len(classes)), C=10.0, **settings)
    p = np.array([decision.probabilities(f) for f in unseen])
    assert p.sum(axis=1) == pytest.approx(1.0)
    right, sure = p.argmax(axis=1) == truth, p.max(axis=1)
    for part in (sure < np.median(sure), sure >= np.median(sure)):
        assert sure[part].mean() == pytest.approx(right[part].mean(), abs=0.1)


def test_slope_of_the_logistic_map_is_recovered():
    rng = np.random.default_rng(0)
    margins = rng.normal(0, 2, 20000)
    first = rng.uniform(size=len(margins)) < 1 / (1 + np.exp(-1.7 * margins))
    assert logistic_slope(margins, first, np.ones(len(margins))) == pytest.approx(1.7, abs=0.06)
    two = logistic_slope(np.array([-1.0, 1.0]), np.array([False, True]), np.ones(2))
    assert two == pytest.approx(np.log(2.0), rel=1e-3)  # Platt's target is 2/3 where one sample is all there is


def test_coupling_recovers_probabilities_that_agree_pairwise():
    """Price et al.: if r_ab = p_a / (p_a + p_b) for all pairs, the coupled probabilities are p."""
    p = np.array([0.5, 0.15, 0.05, 0.3])
    pairs = np.array([(a, b) for a in range(4) for b in range(a + 1, 4)])
    offsets = np.log(p[pairs[:, 0]] / p[pairs[:, 1]])
    decision = VotingDecision(np.eye(2), np.array(0.0), pairs, np.zeros((6, 2)), offsets / 3.0, np.full(6, 3.0))
    assert decision.probabilities(np.zeros(2)) == pytest.approx(p)


@pytest.mark.parametrize("classifier", list(CLASSIFIERS))
def test_weights_shift_the_border(classifier):
    features = np.r_[np.linspace(0, 1, 50), np.linspace(0.8, 1.8, 50)][:, None]
    classes = np.repeat([0, 1], 50)
    borders = []
    for weight in (0.02, 50.0):
        _, decision = CLASSIFIERS[classifier](features, classes, np.where(classes == 1, weight, 1.0), C=10.0)
        grid = np.linspace(0, 2, 400)
        borders.append(grid[np.argmax([np.argmax(decision.scores(np.array([f]))) == 1 for f in grid])])
    assert borders[1] < borders[0]


def test_constant_decision_stays():
    assert np.argmax(constant_decision(3, 2).scores(np.array([5.0, -1.0]))) == 0


def test_separation_is_one_for_disjoint_and_zero_for_equal_values():
    rng = np.random.default_rng(0)
    assert separation(rng.uniform(0, 1, 50), rng.uniform(2, 3, 70)) == 1
    assert separation(np.full(5, 0.3), np.full(9, 0.3)) == 0
    assert separation(rng.uniform(0, 1, 2000), rng.uniform(0, 1, 2000)) < 0.06
