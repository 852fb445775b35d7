"""Forward-backward and Viterbi in log space, for several sequences at once (thesis 3.2.2); how many states there are.

Sequences of S steps are padded at their end: `lengths` says how long each is.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Array = NDArray[np.float64]
Model = TypeVar("Model")


class Smoothed(NamedTuple):
    """What the E-step of Baum-Welch gives."""

    log_likelihood: float
    """Of all sequences."""
    states: Array
    """(M, S, K) posterior; 0 where padded."""
    pairs: Array
    """(K, K) expected number of transitions."""


def forward_backward(
    log_emission: Array, lengths: NDArray[np.int64], log_start: Array, log_transition: Array
) -> Smoothed:
    """log_emission (M, S, K), log_start (K,), log_transition (K, K) from row to column."""
    m, s, k = log_emission.shape
    rows = np.arange(m)
    forward = np.empty((m, s, k))
    forward[:, 0] = log_start + log_emission[:, 0]
    for t in range(1, s):
        forward[:, t] = _after(forward[:, t - 1], log_transition) + log_emission[:, t]
    log_likelihood = logsumexp(forward[rows, lengths - 1], axis=1)
    backward, pairs = np.zeros((m, s, k)), np.zeros((k, k))
    for t in range(s - 2, -1, -1):
        inside = (t < lengths - 1)[:, None]
        ahead = log_emission[:, t + 1] + backward[:, t + 1]
        backward[:, t] = np.where(inside, _after(ahead, log_transition.T), 0.0)
        pair = forward[:, t, :, None] + log_transition + ahead[:, None, :] - log_likelihood[:, None, None]
        pairs += np.exp(pair)[inside[:, 0]].sum(axis=0)
    states = np.exp(forward + backward - log_likelihood[:, None, None])
    states *= (np.arange(s) < lengths[:, None])[..., None]
    return Smoothed(float(log_likelihood.sum()), states, pairs)


def of_least_bic(fit: Callable[[int], tuple[Model, float]], most: int, patience: int) -> Model:
    """The model of least BIC with 1, 2, ... states, up to `most` of them.

    Args:
        fit: model and BIC with so many states.
        most: states at most.
        patience: ends when BIC has not improved so many times in a row.
    """
    best, least = fit(1)
    worse, k = 0, 1
    while worse < patience and k < most:
        k += 1
        model, criterion = fit(k)
        worse = 0 if criterion < least else worse + 1
        if criterion < least:
            best, least = model, criterion
    return best


def viterbi(log_emission: Array, log_start: Array, log_transition: Array) -> NDArray[np.int64]:
    """The most likely states (S,) of one sequence (S, K)."""
    s, k = log_emission.shape
    best, back = log_start + log_emission[0], np.zeros((s, k), dtype=np.int64)
    for t in range(1, s):
        ways = best[:, None] + log_transition
        back[t] = np.argmax(ways, axis=0)
        best = ways[back[t], np.arange(k)] + log_emission[t]
    path = [int(np.argmax(best))]
    for t in range(s - 1, 0, -1):
        path.append(int(back[t, path[-1]]))
    return np.array(path[::-1])


def _after(log_weights: Array, log_transition: Array) -> Array:
    """log sum_i w_i T_ij (M, K), scaled so that nothing underflows."""
    top = log_weights.max(axis=1, keepdims=True)
    highest = log_transition.max()
    mass = np.exp(log_weights - top) @ np.exp(log_transition - highest)
    return np.asarray(np.log(np.maximum(mass, 1e-300)) + top + highest)
