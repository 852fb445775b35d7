"""How well a transition classifier decides in a demonstration that it was not trained on."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.errors import DemonstrationError
from policies.decisions import Decision, constant_decision
from policies.transitions import CLASSIFIERS

Array = NDArray[np.float64]


class HeldOut(NamedTuple):
    """Weighted shares of right decisions."""

    accuracy: float
    """Over all samples."""
    per_demonstration: Mapping[int, float]
    """Over the samples of each demonstration, decided without it."""


def held_out_accuracy(
    classifier: str,
    features: Array,
    classes: NDArray[np.int64],
    weights: Array,
    demonstrations: NDArray[np.int64],
    C: float = 10.0,
    **settings: Any,
) -> HeldOut:
    """Accuracy on every demonstration of a classifier trained on the others.

    The samples of one demonstration resemble each other: to hold out rows would let a classifier recognise its own
    training data. A class that the other demonstrations do not show counts as missed.

    Args:
        classifier: name in `CLASSIFIERS`.
        features, classes, weights: (N, n), (N,), (N,).
        demonstrations: (N,) which demonstration each sample is from.
        C: inverse strength of the regularisation.
        settings: further arguments of the classifier.

    Raises:
        DemonstrationError: all samples are from one demonstration.
    """
    held = np.unique(demonstrations)
    if len(held) < 2:
        raise DemonstrationError("all samples are from one demonstration; to hold one out, two or more are needed")
    right = np.empty(len(classes))
    for demonstration in held:
        own = demonstrations == demonstration
        known, codes = np.unique(classes[~own], return_inverse=True)
        decision: Decision = constant_decision(1, features.shape[1])
        if len(known) > 1:
            balanced = weights[~own] / weights[~own].mean()
            _, decision = CLASSIFIERS[classifier](features[~own], codes, balanced, C, **settings)
        chosen = known[[int(np.argmax(decision.scores(row))) for row in features[own]]]
        right[own] = chosen == classes[own]
    shares = {int(d): _mean(right, weights, demonstrations == d) for d in held}
    return HeldOut(_mean(right, weights, np.ones(len(right), dtype=bool)), shares)


def _mean(right: Array, weights: Array, where: NDArray[np.bool_]) -> float:
    return float(np.average(right[where], weights=weights[where]))
