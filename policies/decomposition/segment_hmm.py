"""The thesis's decomposition: a hidden Markov model over segments, each state a mixture over task spaces (thesis 3.2.2).

The emission of a segment with points x_i and weights w_i (their sum is the number of effective points) in state k is

    sum_f pi_kf exp( sum_i w_i log DND(x_i, v_i | mu_kf, S_kf) )

Baum-Welch from the ends of random segments, several restarts, the number of states by BIC with n = effective points x segments.
With ends only (one anchor per segment) the same model is the end-point GMM-HMM, the baseline of 3.5.2.

The likelihood prefers wrong assignments to planted ones: a state owns one goal per task space and absorbs unrelated movements.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import joblib
import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from lfd_gym.demonstration import Demonstration
from policies.decomposition.convergence import Converging, converging
from policies.decomposition.directional_normal import Expected, e_step, m_step
from policies.decomposition.extraction import extract
from policies.decomposition.hidden_markov import Smoothed, forward_backward, of_least_bic, viterbi
from policies.decomposition.result import COMPLETE, Decomposition, EntityDecomposition, EntityPrimitive
from policies.decomposition.segmentation import entities
from policies.decomposition.task_spaces import EntitySegments, entity_segments

Array = NDArray[np.float64]

START = {"position": 0.05, "orientation": 0.2, "hand": 0.2}
"""Standard deviation to begin with."""
STEPS, TOLERANCE = 25, 1e-2
"""Of Baum-Welch; it ends when the log-likelihood gains less."""
GROUP = 3
"""Position and force have one variance each, an orientation one, a hand one: with full covariances in every space BIC finds one
state."""
SELF_TRANSITION = 0.2
"""Bias of the random transition matrix (thesis 3.2.2)."""


class Settings(NamedTuple):
    """Of one of the two methods, each with the best of its trials (`results/decomposition-trials`)."""

    effective: float
    """Effective points of a segment: its points are not independent."""
    restarts: int
    """Of Baum-Welch."""
    patience: int
    """The number of states is raised until BIC has not improved so many times in a row."""
    floor: Mapping[str, float]
    """Least standard deviation [m], [rad], [rad]."""
    charges_spaces: bool
    """Whether BIC counts the weights of the spaces."""


DIRECTIONAL = Settings(2.0, 3, 2, {"position": 0.004, "orientation": 0.02, "hand": 0.05}, False)
END_POINT = Settings(1.0, 8, 4, {"position": 0.004, "orientation": 0.05, "hand": 0.05}, True)


class Model(NamedTuple):
    """Parameters of K states in F spaces, and what they say."""

    means: Array
    """(F, K, D)."""
    covariances: Array
    """(F, K, d, d)."""
    log_mixture: Array
    """(K, F)."""
    log_start: Array
    log_transition: Array
    log_likelihood: float
    history: tuple[float, ...]
    """Log-likelihood before every step."""


def decompose_by_segment_hmm(
    demonstrations: Sequence[Demonstration], seed: int = 0, jobs: int = 1, ends_only: bool = False
) -> Decomposition:
    """Every entity with the Directional Normal Distribution, or of its ends only."""
    found = {
        entity: decompose_entity(entity_segments(demonstrations, entity), seed, jobs, ends_only)
        for entity in entities(demonstrations)
    }
    return Decomposition(found, "end-point-hmm" if ends_only else "directional-hmm")


def decompose_entity(
    data: EntitySegments, seed: int = 0, jobs: int = 1, ends_only: bool = False
) -> EntityDecomposition:
    """The model of least BIC, and its most likely primitives."""
    points, lengths = converging(data, ends_only), sequence_lengths(data)
    settings = END_POINT if ends_only else DIRECTIONAL

    def fitted(k: int) -> tuple[Model, float]:
        model = fit(points, lengths, data.entity, k, settings, seed, jobs)
        return model, bic(model, settings.effective * len(data.segments), settings)

    best = of_least_bic(fitted, len(data.segments), settings.patience)
    return _result(data, points, lengths, best, settings.effective)


def fit(
    points: Converging,
    lengths: NDArray[np.int64],
    entity: str,
    n_states: int,
    settings: Settings = DIRECTIONAL,
    seed: int = 0,
    jobs: int = 1,
) -> Model:
    """The most likely of several restarts; each has its own seed, so `jobs` changes nothing but time."""
    seeds = np.random.SeedSequence([seed, n_states]).spawn(settings.restarts if n_states > 1 else 1)
    run = joblib.delayed(_baum_welch)
    models = joblib.Parallel(n_jobs=jobs)(
        run(points, lengths, entity, n_states, settings, np.random.default_rng(own)) for own in seeds
    )
    return max(models, key=lambda model: model.log_likelihood)


def bic(model: Model, n: float, settings: Settings = DIRECTIONAL) -> float:
    """-2 log L + (number of free parameters) log n, where every state counts as one goal.

    Only one space describes a primitive in the end. Were the goals in all spaces counted, BIC would find one state in a task
    with four objects.
    """
    n_spaces, n_states, _ = model.means.shape
    d = model.covariances.shape[-1]
    per_state = d + len(_groups(d)) + (n_spaces - 1 if settings.charges_spaces else 0)
    return -2.0 * model.log_likelihood + (n_states * per_state + n_states**2 - 1) * float(np.log(n))


def sequence_lengths(data: EntitySegments) -> NDArray[np.int64]:
    """(M,) number of segments of every demonstration."""
    return np.bincount([part.demonstration for part in data.segments])


def padded(rows: Array, lengths: NDArray[np.int64]) -> Array:
    """Rows (L, K) of consecutive sequences as (M, S, K), zeros behind."""
    result = np.zeros((len(lengths), lengths.max(), rows.shape[1]))
    result[np.arange(lengths.max()) < lengths[:, None]] = rows
    return result


def _baum_welch(
    points: Converging,
    lengths: NDArray[np.int64],
    entity: str,
    n_states: int,
    settings: Settings,
    rng: np.random.Generator,
) -> Model:
    n_spaces, n_segments, _ = points.ends.shape
    means = points.ends[:, rng.choice(n_segments, n_states, replace=n_states > n_segments)]
    d = points.spaces[0].about(means[0])[0].shape[-1]
    covariances = np.tile(START[entity] ** 2 * np.eye(d), (n_spaces, n_states, 1, 1))
    transition = rng.dirichlet(np.ones(n_states), size=n_states) + SELF_TRANSITION * np.eye(n_states)
    log_transition = np.log(transition / transition.sum(axis=1, keepdims=True) + 1e-12)
    model = Model(
        means,
        covariances,
        np.full((n_states, n_spaces), -np.log(n_spaces)),
        np.full(n_states, -np.log(n_states)),
        log_transition,
        -np.inf,
        (),
    )
    for _ in range(STEPS):
        x, v, expected, per_segment = expectations(points, model, settings.effective)
        joint = per_segment + model.log_mixture
        emission = logsumexp(joint, axis=2)
        smoothed = forward_backward(padded(emission, lengths), lengths, model.log_start, model.log_transition)
        gain = smoothed.log_likelihood - model.log_likelihood
        model = model._replace(
            log_likelihood=smoothed.log_likelihood, history=(*model.history, smoothed.log_likelihood)
        )
        if gain < TOLERANCE:
            break
        inside = np.arange(lengths.max()) < lengths[:, None]
        share = smoothed.states[inside][:, :, None] * np.exp(joint - emission[:, :, None])
        floor = settings.floor[entity] ** 2
        model = _maximised(points, model, share, smoothed, x, v, expected, settings.effective, floor)
    return model


def expectations(
    points: Converging, model: Model, effective: float
) -> tuple[list[Array], list[Array], list[Expected], Array]:
    """Per space the points about the means, velocities and E-steps, and the log-density (L, K, F) of every segment."""
    xs, vs, steps, columns = [], [], [], []
    for f, geometry in enumerate(points.spaces):
        x, v = geometry.about(model.means[f])
        expected = e_step(x, v, model.covariances[f])
        density = (expected.log_density + points.log_jacobian[f]).reshape(len(x), -1, points.n_points)
        columns.append(effective * density.mean(axis=2).T)
        xs.append(x)
        vs.append(v)
        steps.append(expected)
    return xs, vs, steps, np.stack(columns, axis=2)


def _maximised(
    points: Converging,
    model: Model,
    share: Array,
    smoothed: Smoothed,
    x: Sequence[Array],
    v: Sequence[Array],
    expected: Sequence[Expected],
    effective: float,
    floor: float,
) -> Model:
    """The M-step; share (L, K, F) of every segment. What no segment belongs to stays as it is."""
    means, covariances = model.means.copy(), model.covariances.copy()
    for f, geometry in enumerate(points.spaces):
        weights = np.repeat(share[:, :, f].T * effective / points.n_points, points.n_points, axis=1)
        used = weights.sum(axis=1) > 1e-6
        shift, own = m_step(x[f], v[f], expected[f], weights + 1e-300, 0.0)
        means[f, used] = geometry.moved(model.means[f], shift)[used]
        covariances[f, used] = _isotropic(own, floor)[used]
    mixture = share.sum(axis=0) + 1e-12
    starts = smoothed.states[:, 0].sum(axis=0) + 1e-12
    pairs = smoothed.pairs + 1e-12
    return model._replace(
        means=means,
        covariances=covariances,
        log_mixture=np.log(mixture / mixture.sum(axis=1, keepdims=True)),
        log_start=np.log(starts / starts.sum()),
        log_transition=np.log(pairs / pairs.sum(axis=1, keepdims=True)),
    )


def _groups(d: int) -> list[slice]:
    """Coordinates that share a variance: (position, force), or all."""
    return [slice(0, GROUP), slice(GROUP, d)] if d == 2 * GROUP else [slice(0, d)]


def _isotropic(covariances: Array, floor: float) -> Array:
    """The likeliest covariances (..., d, d) with one variance per group, none below the floor."""
    result = np.zeros_like(covariances)
    for group in _groups(covariances.shape[-1]):
        at = np.arange(group.start, group.stop)
        result[..., at, at] = np.maximum(covariances[..., at, at].mean(axis=-1, keepdims=True), floor)
    return result


def _result(
    data: EntitySegments, points: Converging, lengths: NDArray[np.int64], model: Model, effective: float
) -> EntityDecomposition:
    emission = logsumexp(expectations(points, model, effective)[3] + model.log_mixture, axis=2)
    stops = np.cumsum(lengths)
    parts = [
        viterbi(emission[a:b], model.log_start, model.log_transition)
        for a, b in zip([0, *stops[:-1]], stops, strict=True)
    ]
    used, assignment = np.unique(np.concatenate(parts), return_inverse=True)
    kinds = np.full(len(assignment), COMPLETE)
    extracted = extract(data, assignment, kinds, list(np.exp(model.log_mixture[used])))
    primitives = [_goal(primitive, model, int(k)) for primitive, k in zip(extracted, used, strict=True)]
    return EntityDecomposition(data, tuple(primitives), assignment, kinds)


def _goal(primitive: EntityPrimitive, model: Model, k: int) -> EntityPrimitive:
    """With the goal and covariance of its most likely space, without those of forces."""
    f = int(np.argmax(model.log_mixture[k]))
    n = len(primitive.goal)
    d = len(primitive.covariance)
    return primitive._replace(goal=model.means[f, k, :n].copy(), covariance=model.covariances[f, k, :d, :d].copy())
