"""Baseline: sticky autoregressive HMM in the world frame, then the frame of each state from where its stretches end.

After Niekum et al. (2015) as in thesis 3.5.2, with a plain HMM in place of the beta process:

    x_{t+1} = A_k x_t + b_k + e,   e ~ N(0, Q_k),   with a prior for long stays in one state

The number of states is chosen by BIC. The ends of a state's stretches are compared in all frames; the one in which they scatter
least is its frame. Cartesian frames only.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.demonstration import Demonstration
from policies.decomposition.extraction import extract
from policies.decomposition.hidden_markov import forward_backward, of_least_bic, viterbi
from policies.decomposition.result import COMPLETE, Decomposition, EntityDecomposition
from policies.decomposition.runs import from_runs, steps_of
from policies.decomposition.segment_hmm import padded
from policies.decomposition.segmentation import entities
from policies.decomposition.task_spaces import EntitySegments, TaskSpace, coordinates

Array = NDArray[np.float64]

PERIOD = 0.2
"""Between points [s]."""
STICKINESS = 20.0
"""Prior count of stays in every state."""
MOST, PATIENCE, STEPS, TOLERANCE = 14, 2, 25, 1e-2
"""States at most; BIC has not improved so many times in a row; of Baum-Welch."""
FLOOR = {"position": 0.02, "orientation": 0.1, "hand": 0.02}
"""Least standard deviation of one step's noise [m], entries of a rotation matrix, [rad] (`results/decomposition-trials`)."""
RIDGE = 1e-3


class Model(NamedTuple):
    """K linear systems and how they follow each other."""

    weights: Array
    """(K, D + 1, D): A and b."""
    variances: Array
    """(K, D)."""
    log_start: Array
    log_transition: Array
    log_likelihood: float


def decompose_by_ar_hmm(demonstrations: Sequence[Demonstration], seed: int = 0) -> Decomposition:
    """Every entity."""
    found = {entity: _entity(demonstrations, entity, seed) for entity in entities(demonstrations)}
    return Decomposition(found, "sticky-ar-hmm")


def _entity(demonstrations: Sequence[Demonstration], entity: str, seed: int) -> EntityDecomposition:
    kind = {"position": "cartesian", "orientation": "rotation", "hand": "joints"}[entity]
    rows = [
        coordinates(demonstration, entity, TaskSpace("world", kind))[0][steps_of(demonstration, PERIOD)]
        for demonstration in demonstrations
    ]
    before, after = np.concatenate([x[:-1] for x in rows]), np.concatenate([x[1:] for x in rows])
    lengths = np.array([len(x) - 1 for x in rows])

    def fit(k: int) -> tuple[Model, float]:
        model = _fit(before, after, lengths, k, FLOOR[entity] ** 2, np.random.default_rng([seed, k]))
        d = before.shape[1]
        return model, -2.0 * model.log_likelihood + (k * (d * (d + 2)) + k**2 - 1) * float(np.log(len(before)))

    best = of_least_bic(fit, MOST, PATIENCE)
    emission = _log_emission(best, before, after)
    stops = np.cumsum(lengths)
    labels = [
        viterbi(emission[a:b], best.log_start, best.log_transition)
        for a, b in zip([0, *stops[:-1]], stops, strict=True)
    ]
    data, found = from_runs(demonstrations, entity, [np.r_[own, own[-1]] for own in labels], PERIOD)
    used, assignment = np.unique(found, return_inverse=True)
    posteriors = [_frames(data, np.flatnonzero(assignment == k)) for k in range(len(used))]
    kinds = np.full(len(assignment), COMPLETE)
    return EntityDecomposition(data, extract(data, assignment, kinds, posteriors), assignment, kinds)


def _fit(
    before: Array, after: Array, lengths: NDArray[np.int64], k: int, floor: float, rng: np.random.Generator
) -> Model:
    """Baum-Welch from equal parts of every demonstration, put together at random."""
    chunk = max(int(lengths.min()) // (2 * k), 5)
    starts = np.concatenate([np.arange(n) // chunk for n in lengths])
    share = np.eye(k)[rng.permutation(np.arange(starts.max() + 1) % k)[starts]]
    model = _maximised(before, after, share, np.full(k, 1.0 / k), np.eye(k), floor)
    for _ in range(STEPS):
        smoothed = forward_backward(
            padded(_log_emission(model, before, after), lengths), lengths, model.log_start, model.log_transition
        )
        gain = smoothed.log_likelihood - model.log_likelihood
        share = smoothed.states[np.arange(lengths.max()) < lengths[:, None]]
        if gain < TOLERANCE:
            break
        model = _maximised(before, after, share, smoothed.states[:, 0].sum(axis=0), smoothed.pairs, floor)
        model = model._replace(log_likelihood=smoothed.log_likelihood)
    return model


def _maximised(before: Array, after: Array, share: Array, starts: Array, pairs: Array, floor: float) -> Model:
    inputs = np.hstack([before, np.ones((len(before), 1))])
    weights, variances = [], []
    for own in share.T:
        gram = (inputs * own[:, None]).T @ inputs + RIDGE * np.eye(inputs.shape[1])
        stay = np.vstack([np.eye(before.shape[1]), np.zeros(before.shape[1])])
        w = np.linalg.solve(gram, (inputs * own[:, None]).T @ after + RIDGE * stay)
        weights.append(w)
        variances.append(np.maximum(own @ (after - inputs @ w) ** 2 / max(float(own.sum()), 1e-6), floor))
    counts = pairs + 0.1 + STICKINESS * np.eye(len(pairs))
    begin = np.log((starts + 0.1) / (starts + 0.1).sum())
    return Model(
        np.array(weights), np.array(variances), begin, np.log(counts / counts.sum(axis=1, keepdims=True)), -np.inf
    )


def _log_emission(model: Model, before: Array, after: Array) -> Array:
    """(N, K)."""
    inputs = np.hstack([before, np.ones((len(before), 1))])
    errors = after[None] - inputs @ model.weights
    variances = model.variances[:, None]
    return np.asarray(-0.5 * (errors**2 / variances + np.log(2.0 * np.pi * variances)).sum(axis=2).T)


def _frames(data: EntitySegments, members: NDArray[np.int64]) -> Array:
    """(F,) one where the ends scatter least, else zero; the world if there is only one end."""
    scatter = np.full(len(data.spaces), np.inf)
    for f, space in enumerate(data.spaces):
        if space.space != "cylindrical":
            scatter[f] = np.array([data.views[i][f].end for i in members]).var(axis=0).sum()
    return np.eye(len(scatter))[int(np.argmin(scatter))]
