"""Transition classifiers (thesis 2.4): exported arrays decide as scikit-learn does."""

import numpy as np
import pytest

from policies.transition_data import separation
from policies.transitions import CLASSIFIERS, DECISIONS, constant_decision


def problem(n_classes: int, n_features: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    classes = np.repeat(np.arange(n_classes), 40)
    features = rng.uniform(size=(len(classes), n_features)) + 0.3 * classes[:, None] * rng.uniform(size=n_features)
    return features, classes, rng.uniform(0.2, 2.0, size=len(classes)), rng.uniform(-0.5, 2.5, size=(300, n_features))


@pytest.mark.parametrize("n_classes", [2, 3, 4])
@pytest.mark.parametrize(
    ("classifier", "settings"), [("lr", {}), ("svm", {"kernel": "rbf"}), ("svm", {"kernel": "linear"})]
)
def test_exported_decision_equals_scikit_learn(classifier, settings, n_classes):
    features, classes, weights, unseen = problem(n_classes, 3, seed=n_classes)
    estimator, decision = CLASSIFIERS[classifier](features, classes, weights, C=10.0, **settings)
    theirs = estimator.decision_function(unseen)
    if n_classes == 2 and classifier == "svm":
        ours = -np.array([decision.margins(f)[0] for f in unseen])
    else:
        ours = np.array([decision.scores(f) for f in unseen])
        ours = ours[:, 1] if n_classes == 2 else ours
    assert ours == pytest.approx(theirs, abs=1e-9)
    chosen = [int(np.argmax(decision.scores(f))) for f in unseen]
    assert chosen == estimator.predict(unseen).tolist()


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


def test_decisions_are_rebuilt_from_their_arrays():
    features, classes, weights, unseen = problem(3, 2, seed=0)
    for classifier in CLASSIFIERS:
        _, decision = CLASSIFIERS[classifier](features, classes, weights, C=1.0)
        kind = {cls: name for name, cls in DECISIONS.items()}[type(decision)]
        again = DECISIONS[kind](**{name: np.asarray(a) for name, a in decision._asdict().items()})
        assert all((again.scores(f) == decision.scores(f)).all() for f in unseen)


def test_constant_decision_stays():
    assert np.argmax(constant_decision(3, 2).scores(np.array([5.0, -1.0]))) == 0


def test_separation_is_one_for_disjoint_and_zero_for_equal_values():
    rng = np.random.default_rng(0)
    assert separation(rng.uniform(0, 1, 50), rng.uniform(2, 3, 70)) == 1
    assert separation(np.full(5, 0.3), np.full(9, 0.3)) == 0
    assert separation(rng.uniform(0, 1, 2000), rng.uniform(0, 1, 2000)) < 0.06
