"""The thesis's decomposition and the baselines: hidden Markov models, what they find, and what every method returns."""

import itertools

import joblib
import numpy as np
import pytest
from kinematic_world import teach
from scipy.special import logsumexp

from lfd_gym.demonstration import Demonstration
from lfd_gym.errors import InvalidArgumentError, UnknownNameError
from policies.decomposition.convergence import converging
from policies.decomposition.hidden_markov import forward_backward, viterbi
from policies.decomposition.methods import METHODS, method_named
from policies.decomposition.result import Decomposition
from policies.decomposition.segment_hmm import bic, decompose_entity, fit, padded, sequence_lengths
from policies.decomposition.task_spaces import EntitySegments, entity_segments
from policies.decomposition_learner import DecompositionLearner

BASELINES = [name for name in METHODS if name != "bayesian"]


@pytest.fixture(scope="module")
def shown() -> list[Demonstration]:
    return [teach(seed) for seed in (1, 2)]


@pytest.fixture(scope="module")
def position(shown: list[Demonstration]) -> EntitySegments:
    return entity_segments(shown, "position")


@pytest.fixture(scope="module", params=BASELINES)
def found(request: pytest.FixtureRequest, shown: list[Demonstration]) -> Decomposition:
    return METHODS[request.param](shown)


def hidden(rng: np.random.Generator, n_states: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    start, transition = rng.dirichlet(np.ones(n_states)), rng.dirichlet(np.ones(n_states), size=n_states)
    return rng.normal(scale=3.0, size=(4, n_states)), np.log(start), np.log(transition)


def paths(emission: np.ndarray, start: np.ndarray, transition: np.ndarray) -> dict[tuple[int, ...], float]:
    steps, n_states = emission.shape
    return {
        path: start[path[0]]
        + emission[np.arange(steps), path].sum()
        + sum(transition[a, b] for a, b in itertools.pairwise(path))
        for path in itertools.product(range(n_states), repeat=steps)
    }


def test_forward_backward_sums_over_all_paths() -> None:
    rng = np.random.default_rng(0)
    long, start, transition = hidden(rng)
    short = rng.normal(size=(2, 3))
    emission, lengths = padded(np.concatenate([long, short]), np.array([4, 2])), np.array([4, 2])
    smoothed = forward_backward(emission, lengths, start, transition)
    every = [paths(part, start, transition) for part in (long, short)]
    assert smoothed.log_likelihood == pytest.approx(sum(logsumexp(list(own.values())) for own in every))
    states, pairs = np.zeros((2, 4, 3)), np.zeros((3, 3))
    for m, own in enumerate(every):
        total = logsumexp(list(own.values()))
        for path, value in own.items():
            states[m, np.arange(len(path)), path] += np.exp(value - total)
            for pair in itertools.pairwise(path):
                pairs[pair] += np.exp(value - total)
    np.testing.assert_allclose(smoothed.states, states, atol=1e-12)
    np.testing.assert_allclose(smoothed.pairs, pairs, atol=1e-12)


def test_viterbi_finds_the_best_path() -> None:
    for seed in range(10):
        model = hidden(np.random.default_rng(seed))
        every = paths(*model)
        assert tuple(viterbi(*model)) == max(every, key=lambda path: every[path])


def test_forward_backward_does_not_underflow() -> None:
    emission = np.full((1, 500, 2), -1000.0)
    smoothed = forward_backward(emission, np.array([500]), np.log([0.5, 0.5]), np.log(np.full((2, 2), 0.5)))
    assert smoothed.log_likelihood == pytest.approx(-1000.0 * 500)


@pytest.mark.parametrize("n_states", [1, 3])
def test_baum_welch_never_falls(position: EntitySegments, n_states: int) -> None:
    for seed in range(3):
        model = fit(converging(position), sequence_lengths(position), "position", n_states, seed=seed)
        assert np.diff(model.history).min() > -1e-6


def test_more_states_are_likelier_and_bic_charges_for_them(position: EntitySegments) -> None:
    points, lengths = converging(position), sequence_lengths(position)
    few, many = (fit(points, lengths, "position", k) for k in (1, 4))
    assert many.log_likelihood > few.log_likelihood
    assert bic(many, 1e9) - bic(many, 1e3) > 4 * (bic(few, 1e9) - bic(few, 1e3))


def test_processes_change_nothing(position: EntitySegments) -> None:
    points, lengths = converging(position), sequence_lengths(position)
    with joblib.parallel_config(backend="threading"):
        alone, together = (fit(points, lengths, "position", 2, jobs=jobs) for jobs in (1, 2))
    np.testing.assert_array_equal(alone.means, together.means)


def test_the_thesis_finds_the_planted_goals_of_one_primitive(shown: list[Demonstration]) -> None:
    """The hand has two goals, in one space: nothing can be confused."""
    found = decompose_entity(entity_segments(shown, "hand"))
    assert len(found.primitives) == 2
    ends = sorted(primitive.goal[1] for primitive in found.primitives)
    np.testing.assert_allclose(ends, [0.0, 1.2], atol=0.15)


def test_every_step_has_a_primitive_and_every_primitive_a_space(
    found: Decomposition, shown: list[Demonstration]
) -> None:
    assert set(found.entities) == {"position", "orientation", "hand"}
    for part in found.entities.values():
        assert set(part.assignment) == set(range(len(part.primitives)))
        for m, demonstration in enumerate(shown):
            assert set(part.active(m, len(demonstration))) <= set(range(len(part.primitives)))
        for primitive in part.primitives:
            assert primitive.posterior.shape == (len(part.data.spaces),)
            assert primitive.posterior.sum() == pytest.approx(1.0)
            assert primitive.space == part.data.spaces[int(np.argmax(primitive.posterior))]
            assert np.isfinite(primitive.goal).all()


@pytest.mark.parametrize("name", ["tp-gmm", "sticky-ar-hmm"])
def test_equal_demonstrations_give_equal_decompositions(name: str, shown: list[Demonstration]) -> None:
    first, second = (METHODS[name](shown[:1]) for _ in range(2))
    for entity, part in first.entities.items():
        np.testing.assert_array_equal(part.assignment, second.entities[entity].assignment)


def test_the_end_of_a_segment_counts_most(position: EntitySegments) -> None:
    """Points of a movement lie in its late part, and its rest is an anchor."""
    points = converging(position)
    moving = [i for i, part in enumerate(position.segments) if part.moves]
    x = points.spaces[0].about(np.zeros(6))[0].reshape(-1, points.n_points, 6)
    for i in moving:
        view = position.views[i][0]
        left = np.linalg.norm(x[i, :, :3] - view.end, axis=1)
        assert np.median(left) < 0.5 * view.length + 1e-3


def test_a_method_that_is_none_is_named() -> None:
    with pytest.raises(
        InvalidArgumentError, match="no method of decomposition 'dnd'; methods: bayesian, directional-hmm"
    ):
        method_named("dnd")


@pytest.mark.parametrize("wrong", [{"classifier": "svn"}, {"C": np.inf}, {"method": "dnd"}])
def test_arguments_are_checked_before_anything_is_decomposed(shown: list[Demonstration], wrong: dict) -> None:
    learner = DecompositionLearner(**wrong)
    with pytest.raises((UnknownNameError, InvalidArgumentError)):
        learner.fit(shown)
    assert not hasattr(learner, "decomposition_")


def test_more_states_than_segments_do_no_harm(position: EntitySegments) -> None:
    few = position._replace(segments=position.segments[:2], views=position.views[:2])
    model = fit(converging(few), np.array([2]), "position", 3)
    assert np.isfinite(model.log_likelihood)


def test_a_skill_can_be_learned_from_the_decomposition_of_a_baseline(shown: list[Demonstration]) -> None:
    learner = DecompositionLearner(method="tp-gmm").fit(shown[:1])
    assert learner.decomposition_.method == "tp-gmm"
    action, _ = learner.skill_.predict({name: rows[0] for name, rows in shown[0].observations.items()})
    assert np.isfinite(action).all()
