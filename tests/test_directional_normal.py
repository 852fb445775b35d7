"""The Directional Normal Distribution: planted goals, a likelihood that never falls, and the errata of chapter 3.3."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from scipy.special import log_ndtr
from scipy.stats import multivariate_normal

from lfd_gym.errors import InvalidArgumentError
from policies.decomposition.directional_normal import DirectionalNormal, e_step, m_step, truncated_normal
from policies.decomposition.geometry import Matrices, Rotations, parts
from policies.decomposition.task_spaces import nearest_rotation

SPREAD, N_SEGMENTS = 0.02, 25


def approaches(
    rng: np.random.Generator, d: int, rate: int = 20
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Goal, then points, unit velocities and weights of straight movements that end near it, each with an anchor."""
    goal = rng.normal(size=d)
    x, v = [], []
    for target in goal + SPREAD * rng.normal(size=(N_SEGMENTS, d)):
        start = target + rng.normal(size=d)
        share = np.linspace(0.0, 1.0, rate + 1)[:, None]
        x.append(start + share * (target - start))
        v.append(np.tile((target - start) / np.linalg.norm(target - start), (rate + 1, 1)))
        v[-1][-1] = 0.0
    weights = np.tile((np.arange(1, rate + 2) / (rate + 1)) ** 4, N_SEGMENTS)
    return goal, np.concatenate(x), np.concatenate(v), weights / weights.sum() * N_SEGMENTS


@pytest.mark.parametrize("d", [2, 3])
def test_planted_goals_are_recovered_within_twice_their_standard_error(d: int) -> None:
    """Of the mean of the targets, over all coordinates: sqrt(d / n) times the spread of one."""
    errors = []
    for seed in range(20):
        goal, x, v, weights = approaches(np.random.default_rng(seed), d)
        errors.append(DirectionalNormal().fit(x, v, weights).goal_ - goal)
    assert np.linalg.norm(errors, axis=1).max() < 2.0 * SPREAD * np.sqrt(d / N_SEGMENTS)


@pytest.mark.parametrize("geometry", ["rotation", "matrix"])
def test_planted_orientations_are_recovered_within_twice_their_standard_error(geometry: str) -> None:
    errors = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        goal = Rotation.random(rng=rng)
        x, v = [], []
        for target in Rotation.from_rotvec(SPREAD * rng.normal(size=(N_SEGMENTS, 3))) * goal:
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            for angle in (1.2, 0.8, 0.4, 0.1, 0.0):
                x.append((Rotation.from_rotvec(-angle * axis) * target).as_matrix().ravel())
                v.append(axis if angle else 0.0 * axis)
        found = DirectionalNormal(geometry, floor=1e-6).fit(x, v, np.tile([0.1, 0.1, 0.2, 0.2, 0.4], N_SEGMENTS))
        errors.append((Rotation.from_matrix(found.goal_.reshape(3, 3)) * goal.inv()).magnitude())
    assert max(errors) < 2.0 * SPREAD * np.sqrt(3 / N_SEGMENTS)


@pytest.mark.parametrize("d", [2, 3])
def test_the_likelihood_never_falls_in_random_fits(d: int) -> None:
    rng = np.random.default_rng(d)
    x, v = rng.normal(size=(2, 500, 12, d))
    v[rng.random(v.shape[:2]) < 0.2] = 0.0
    weights = rng.uniform(0.1, 2.0, size=(500, 12))
    mean, covariance = rng.normal(size=(500, d)), np.tile(np.eye(d), (500, 1, 1)) * rng.uniform(0.05, 2.0, (500, 1, 1))
    before = np.full(500, -np.inf)
    for _ in range(30):
        about = x - mean[:, None]
        expected = e_step(about, v, covariance)
        now = (weights * expected.log_density).sum(axis=1)
        assert (now > before - 1e-8 * (1.0 + np.abs(now))).all()
        before = now
        shift, covariance = m_step(about, v, expected, weights, 1e-6)
        mean = mean + shift


def test_erratum_3_9_the_logarithm_belongs_outside_of_the_integral() -> None:
    x, v = np.array([0.3, -0.2]), np.array([0.8, 0.6])
    covariance = np.array([[0.5, 0.1], [0.1, 0.3]])
    density = e_step(x[None], v[None], covariance).log_density[0]
    marginal = quad(lambda t: multivariate_normal.pdf(x + t * v, np.zeros(2), covariance), 0.0, 50.0)[0]
    assert density == pytest.approx(np.log(marginal), abs=1e-8)
    inside = quad(lambda t: multivariate_normal.logpdf(x + t * v, np.zeros(2), covariance), 0.0, 50.0)[0]
    assert abs(inside - np.log(marginal)) > 1.0


def printed_objective(x: np.ndarray, v: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(3.9) with (3.8) as printed: E[log p(x | t) + log p(t | x)], for the posterior of t is its prior there."""
    expected = e_step(x, v, covariance)
    precision = np.linalg.inv(covariance)[:, None]
    rate = np.sqrt((v[..., None, :] @ precision @ v[..., None])[..., 0, 0])
    z = -(v[..., None, :] @ precision @ x[..., None])[..., 0, 0] / rate
    off = x + expected.first[..., None] * v
    square = (off[..., None, :] @ precision @ off[..., None])[..., 0, 0] + expected.variance * rate**2
    around = expected.variance * rate**2 + (expected.first * rate - z) ** 2
    log_normal = -0.5 * (square + np.linalg.slogdet(2.0 * np.pi * covariance)[1][:, None])
    log_posterior = np.log(rate) - 0.5 * np.log(2.0 * np.pi) - log_ndtr(z) - 0.5 * around
    return (log_normal + log_posterior).sum(axis=1)


def test_erratum_3_8_the_posterior_of_t_is_not_its_prior() -> None:
    """The printed M-step never lowers the likelihood with a flat prior, but often the printed one."""
    x, v = np.random.default_rng(7).normal(size=(2, 200, 12, 2))
    mean, covariance = np.zeros((200, 2)), np.tile(np.eye(2), (200, 1, 1))
    fell, before, ours = np.zeros(200, dtype=bool), np.full(200, -np.inf), np.full(200, -np.inf)
    for _ in range(30):
        about = x - mean[:, None]
        expected = e_step(about, v, covariance)
        now, likelihood = printed_objective(about, v, covariance), expected.log_density.sum(axis=1)
        assert (likelihood > ours - 1e-8).all()
        fell |= now < before - 1e-6
        before, ours = now, likelihood
        shift, covariance = m_step(about, v, expected, np.ones((200, 12)), 1e-6)
        mean = mean + shift
    assert fell.mean() > 0.2


def test_erratum_3_5_the_density_of_t_integrates_to_one() -> None:
    """c1 d4 = 1 only with the root over 2 pi alone; printed it covers sigma_t as well."""
    mean, sigma = 0.4, 0.1
    mass = quad(lambda t: np.exp(-0.5 * ((t - mean) / sigma) ** 2), 0.0, 5.0)[0]
    below = multivariate_normal.cdf(-mean / sigma)
    corrected = 1.0 / (np.sqrt(2.0 * np.pi) * sigma * (1.0 - below))
    printed = 1.0 / (np.sqrt(2.0 * np.pi * sigma) * (1.0 - below))
    assert corrected * mass == pytest.approx(1.0, abs=1e-6)
    assert abs(printed * mass - 1.0) > 0.5
    first = quad(lambda t: t * np.exp(-0.5 * ((t - mean) / sigma) ** 2), 0.0, 5.0)[0] * corrected
    assert e_step(np.array([[-mean]]), np.array([[1.0]]), np.array([[sigma**2]])).first[0] == pytest.approx(first)


def test_moments_are_accurate_where_the_printed_form_is_not_a_number() -> None:
    z = np.array([-1e6, -50.0, -30.001, -29.999, -3.0, 0.0, 5.0, 1e6])
    log_mass, first, second = truncated_normal(z)
    np.testing.assert_allclose(log_mass, log_ndtr(z), rtol=1e-10, atol=1e-12)
    assert np.isfinite(first).all()
    assert np.isfinite(second).all()
    assert (np.diff(first) > 0.0).all()
    assert (np.diff(second) > 0.0).all()
    assert first[0] == pytest.approx(1e-6)
    assert second[2] == pytest.approx(second[3], rel=1e-3)
    for at in (-3.0, 0.0, 5.0):
        weight = quad(lambda t, at=at: np.exp(-0.5 * (t - at) ** 2), 0.0, 20.0)[0]
        mean = quad(lambda t, at=at: t * np.exp(-0.5 * (t - at) ** 2), 0.0, 20.0)[0] / weight
        square = quad(lambda t, at=at: t**2 * np.exp(-0.5 * (t - at) ** 2), 0.0, 20.0)[0] / weight
        np.testing.assert_allclose([part.item() for part in truncated_normal(at)[1:]], [mean, square], rtol=1e-6)
    assert truncated_normal(-50.0).first == first[1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        printed = np.exp(-0.5 * 50.0**2) / (1.0 - multivariate_normal.cdf(50.0))
    assert np.isnan(printed)
    far = e_step(np.array([[1e6, 0.0]]), np.array([[1.0, 0.0]]), np.eye(2))
    assert all(np.isfinite(part).all() for part in far)


def test_a_slow_start_is_no_goal_but_a_slow_end_is() -> None:
    """Printed: every slow point counts as t = 0. A pause at the start then pulls the goal to itself."""
    path = np.linspace(0.0, 1.0, 21)[:, None] * [1.0, 0.0]
    rng = np.random.default_rng(0)
    x = np.concatenate([path[:1].repeat(10, axis=0), path, path[-1:].repeat(10, axis=0)]) + 0.01 * rng.normal(
        size=(41, 2)
    )
    v = np.concatenate([np.zeros((10, 2)), np.tile([1.0, 0.0], (21, 1)), np.zeros((10, 2))])
    printed = DirectionalNormal().fit(x, v).goal_
    learned = DirectionalNormal().fit(x[10:], v[10:]).goal_
    assert np.linalg.norm(learned - [1.0, 0.0]) < 0.02
    assert np.linalg.norm(printed - [1.0, 0.0]) > 0.15


def test_weights_toward_the_end_take_the_bias_of_a_bow() -> None:
    s = np.linspace(0.0, 1.0, 60)
    paths, ways, weights = [], [], []
    for angle in np.linspace(-0.8, 0.8, 5):
        bowed = np.stack([s - 1.0, 0.1 * np.sin(np.pi * s)], axis=1)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        paths.append(bowed @ turn.T)
        ways.append(np.gradient(paths[-1], axis=0))
        weights.append((np.arange(1, 61) / 60) ** 4)
    x, v = np.concatenate(paths), np.concatenate(ways)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    equal = np.linalg.norm(DirectionalNormal(tol=1e-4).fit(x, v).goal_)
    late = np.linalg.norm(DirectionalNormal(tol=1e-4).fit(x, v, np.concatenate(weights)).goal_)
    assert late < 0.5 * equal


def test_erratum_3_14_the_way_of_an_orientation_is_its_tangent() -> None:
    rng = np.random.default_rng(1)
    start, axis, t = Rotation.random(rng=rng), np.array([0.6, 0.0, 0.8]), 0.7
    goal = (Rotation.from_rotvec(t * axis) * start).as_matrix().ravel()
    points = Matrices(start.as_matrix().reshape(1, 9), axis[None])
    x, v = points.about(goal)
    np.testing.assert_allclose(x + t * v, 0.0, atol=1e-9)
    ahead = (Rotation.from_rotvec((t + 1e-6) * axis) * start).as_matrix().ravel()
    np.testing.assert_allclose(v[0], (ahead - goal) / 1e-6, atol=1e-5)
    assert np.linalg.norm(v) == pytest.approx(np.sqrt(2.0))
    d, e, _ = ((part[0] @ start.as_matrix()).ravel() for part in parts(axis[None]))
    printed = np.cos(t) * (d + e) + np.sin(t) * (e - d)
    assert np.linalg.norm(printed - v[0]) > 0.5


def test_erratum_b_2_rotations_are_active() -> None:
    """B.2 prints the passive R_VS: with axes in the inertia frame it turns the wrong way."""
    axis, t = np.array([0.0, 0.6, 0.8]), 0.4
    d, e, f = (part[0] for part in parts(axis[None]))
    turned = Rotation.from_rotvec(t * axis).as_matrix()
    np.testing.assert_allclose(d * np.cos(t) + e * np.sin(t) + f, turned, atol=1e-12)
    assert np.abs(d * np.cos(t) - e * np.sin(t) + f - turned).max() > 0.3


def test_erratum_b_2_1_the_nearest_angle_is_where_the_angle_to_the_goal_is_least() -> None:
    rng = np.random.default_rng(2)
    for start, goal in zip(Rotation.random(20, rng=rng), Rotation.random(20, rng=rng), strict=True):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        apart = goal.as_matrix() @ start.as_matrix().T
        d, e, _ = (part[0] for part in parts(axis[None]))
        t = np.arctan2((apart * e).sum(), (apart * d).sum())

        def angle(at: float, axis: np.ndarray = axis, start: Rotation = start, goal: Rotation = goal) -> float:
            return float((goal * (Rotation.from_rotvec(at * axis) * start).inv()).magnitude())

        grid = np.linspace(-np.pi, np.pi, 200)
        assert angle(t) <= min(angle(at) for at in grid) + 1e-3
        printed = np.arctan2(-(apart * e).sum(), (apart * d).sum())
        assert angle(printed) > angle(t)


def test_the_nearest_rotation_is_no_reflection() -> None:
    matrix = np.diag([1.0, 1.0, -0.2])
    assert np.linalg.det(nearest_rotation(matrix)) == pytest.approx(1.0)
    u, _, vt = np.linalg.svd(matrix)
    assert np.linalg.det(u @ vt) == pytest.approx(-1.0)


def test_rotation_vectors_and_matrices_agree() -> None:
    rng = np.random.default_rng(3)
    goal = Rotation.random(rng=rng)
    axes = rng.normal(size=(30, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    off = Rotation.from_rotvec(0.03 * rng.normal(size=(30, 3))) * goal
    x = (Rotation.from_rotvec(-rng.uniform(0.2, 1.0, (30, 1)) * axes) * off).as_matrix().reshape(-1, 9)
    goals = [DirectionalNormal(geometry, floor=1e-6).fit(x, axes).goal_ for geometry in ("rotation", "matrix")]
    apart = Rotation.from_matrix(goals[0].reshape(3, 3)) * Rotation.from_matrix(goals[1].reshape(3, 3)).inv()
    assert apart.magnitude() < 0.02


def test_the_goal_moves_with_the_scene() -> None:
    rng = np.random.default_rng(4)
    _, x, v, weights = approaches(rng, 3)
    turn, shift = Rotation.random(rng=rng), rng.normal(size=3)
    here = DirectionalNormal().fit(x, v, weights)
    there = DirectionalNormal().fit(turn.apply(x) + shift, turn.apply(v), weights)
    np.testing.assert_allclose(there.goal_, turn.apply(here.goal_) + shift, atol=1e-6)
    assert there.history_[-1] == pytest.approx(here.history_[-1], abs=1e-6)


def test_orientations_turn_with_the_scene() -> None:
    rng = np.random.default_rng(5)
    axes = rng.normal(size=(12, 3))
    rotations, turn = Rotation.from_rotvec(0.3 * rng.normal(size=(12, 3))), Rotation.random(rng=rng)
    mean = Rotation.from_rotvec([0.1, 0.0, 0.2])
    x, v = Rotations(rotations.as_matrix().reshape(-1, 9), axes).about(mean.as_matrix().ravel())
    turned = Rotations((turn * rotations).as_matrix().reshape(-1, 9), turn.apply(axes))
    y, w = turned.about((turn * mean).as_matrix().ravel())
    np.testing.assert_allclose(y, turn.apply(x), atol=1e-9)
    np.testing.assert_allclose(w, turn.apply(v), atol=1e-9)


def test_the_recording_rate_does_not_matter() -> None:
    goals = [DirectionalNormal().fit(*approaches(np.random.default_rng(6), 3, rate)[1:]).goal_ for rate in (20, 100)]
    assert np.linalg.norm(goals[0] - goals[1]) < 0.1 * SPREAD


def test_points_that_do_not_fit_are_refused() -> None:
    with pytest.raises(InvalidArgumentError, match="no geometry 'sphere'; possible: euclidean"):
        DirectionalNormal("sphere").fit(np.zeros((2, 2)), np.zeros((2, 2)))
    with pytest.raises(InvalidArgumentError, match=r"\(2, 2\) and velocities \(3, 2\) do not fit"):
        DirectionalNormal().fit(np.zeros((2, 2)), np.zeros((3, 2)))
    with pytest.raises(InvalidArgumentError, match="finite"):
        DirectionalNormal().fit([[np.nan, 0.0]], [[1.0, 0.0]])
    with pytest.raises(InvalidArgumentError, match="not all of them 0"):
        DirectionalNormal().fit([[1.0, 0.0]], [[1.0, 0.0]], [0.0])
