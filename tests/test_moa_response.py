"""The discretised attractor and the interpolation of activations (thesis 4.2.1, 4.2.2)."""

import numpy as np
import pytest

from lfd_gym.errors import InvalidArgumentError
from policies.moa.response import Response
from policies.moa.support_points import Interpolation, bandwidth, interpolation

GAINS = [(20.0, None, 0.02), (100.0, None, 0.01), (30.0, 2.0, 0.02), (10.0, 9.0, 0.005)]


def coefficients_of_413(response, n):
    """lambda, mu (n,) and gamma (n, n), by the recursion printed under (4.13)."""
    mixing, lam, mu = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    lam[1], mu[0] = 1.0, 1.0
    for i in range(2, n):
        lam[i] = response.c1 * lam[i - 1] + response.c2 * lam[i - 2]
        mu[i] = response.c1 * mu[i - 1] + response.c2 * mu[i - 2]
        mixing[i] = response.c1 * mixing[i - 1] + response.c2 * mixing[i - 2]
        mixing[i, i] += response.c3
    return lam, mu, mixing


@pytest.mark.parametrize("gains", GAINS)
def test_simulated_trajectory_is_413(gains):
    rng, response = np.random.default_rng(0), Response.of_attractor(*gains)
    goals, first, second = rng.normal(size=(200, 3)), rng.normal(size=3), rng.normal(size=3)
    lam, mu, gamma = coefficients_of_413(response, 200)
    expected = lam[:, None] * second + mu[:, None] * first + gamma @ goals
    np.testing.assert_allclose(response.simulate(goals, first, second), expected, atol=1e-10)
    np.testing.assert_allclose(response.free(first, second, 200) + response.forced(goals), expected, atol=1e-10)


@pytest.mark.parametrize("gains", GAINS)
def test_a_goal_that_stands_still_is_reached(gains):
    response = Response.of_attractor(*gains)
    assert response.c1 + response.c2 + response.c3 == pytest.approx(1.0)  # (4.11) printed with c2 > 0 explodes
    assert response.simulate(np.full((20000, 1), 0.7), np.zeros(1), np.zeros(1))[-1] == pytest.approx(0.7)


def test_critical_damping_has_the_closed_form():
    alpha, h, n = 40.0, 0.02, 60
    response = Response.of_attractor(alpha, None, h)
    p = 1.0 / (1.0 + 0.5 * alpha * h)
    i, j = np.mgrid[2:n, 2:n]
    lag = np.maximum(i - j, 0)
    toeplitz = np.where(i >= j, response.c3 * (lag + 1.0) * p**lag, 0.0)
    gamma = response.forced(np.eye(n))
    np.testing.assert_allclose(gamma[2:, 2:], toeplitz, atol=1e-14)
    assert not gamma[:, :2].any()  # goals at the first two steps never matter


def test_transposed_response_is_the_adjoint():
    rng, response = np.random.default_rng(1), Response.of_attractor(20.0, None, 0.02)
    goals, forces = rng.normal(size=(2, 90, 4))
    assert (response.forced(goals) * forces).sum() == pytest.approx((goals * response.forced_transposed(forces)).sum())


def test_wanted_goals_reproduce_a_movement():
    rng, response = np.random.default_rng(2), Response.of_attractor(20.0, 3.0, 0.02)
    x = np.cumsum(rng.normal(size=(50, 2)), axis=0)
    goals = np.vstack([np.zeros((2, 2)), response.wanted_goals(x)])
    np.testing.assert_allclose(response.simulate(goals, x[0], x[1]), x, atol=1e-10)


@pytest.mark.parametrize("gains", GAINS)
def test_memory_is_how_long_an_impulse_is_felt(gains):
    response = Response.of_attractor(*gains)
    impulse = np.zeros((response.memory + 50, 1))
    impulse[2] = 1.0
    felt = np.abs(response.forced(impulse)[2:, 0])
    assert felt[response.memory :].max() < 1e-12 < felt[response.memory // 2]


@pytest.mark.parametrize(
    "gains", [(0.0, None, 0.02), (20.0, -1.0, 0.02), (20.0, None, 0.0), (np.nan, 5.0, 0.02), (1e200, None, 0.02)]
)
def test_gains_that_are_not_possible(gains):
    with pytest.raises(InvalidArgumentError, match="must be positive"):
        Response.of_attractor(*gains)


def test_a_support_point_has_the_overlap_at_its_neighbour():
    gamma = bandwidth(0.4, 0.1)
    assert np.exp(-((gamma * 0.4) ** 2)) == pytest.approx(0.1)
    assert gamma == pytest.approx(np.sqrt(np.log(10.0)) / 0.4)


def test_weights_are_the_normalised_rbf():
    n, n_support = 50, 7
    times, centres = np.arange(n)[:, None], np.linspace(0, n - 1, n_support)
    values = np.exp(-(bandwidth(centres[1], 0.1) ** 2) * (times - centres) ** 2)
    weights = interpolation(n, n_support, 0.1)
    np.testing.assert_allclose(weights.matrix, values / values.sum(axis=1, keepdims=True), atol=1e-15)
    rng = np.random.default_rng(0)
    z, v = rng.normal(size=(n_support, 3)), rng.normal(size=(n, 3))
    np.testing.assert_allclose(weights.interpolated(z), weights.matrix @ z, atol=1e-14)
    np.testing.assert_allclose(weights.transposed(v), weights.matrix.T @ v, atol=1e-13)
    np.testing.assert_allclose(weights.without_last().matrix, weights.matrix[:, :-1])


def test_free_activations_have_a_support_point_at_every_step():
    np.testing.assert_array_equal(interpolation(9, None, 0.1).matrix, np.eye(9))


def test_beyond_the_end_the_last_support_point_takes_over():
    extended = interpolation(50, 7, 0.1, 500).matrix
    np.testing.assert_allclose(extended[:50], interpolation(50, 7, 0.1).matrix)
    assert extended[-1, -1] == pytest.approx(1.0)
    assert interpolation(9, None, 0.1, 12).matrix[-1].tolist() == [0.0] * 8 + [1.0]


def test_any_matrix_of_weights_is_kept():
    rng = np.random.default_rng(0)
    matrix = rng.uniform(size=(30, 8)) * (rng.uniform(size=(30, 8)) < 0.2)
    np.testing.assert_array_equal(Interpolation.of_matrix(matrix).matrix, matrix)


@pytest.mark.parametrize(("n_support", "overlap"), [(1, 0.1), (51, 0.1), (10, 0.0), (10, 1.0)])
def test_support_points_that_are_not_possible(n_support, overlap):
    with pytest.raises(InvalidArgumentError, match="support points; possible: 2 to|overlap"):
        interpolation(50, n_support, overlap)
