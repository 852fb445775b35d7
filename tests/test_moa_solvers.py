"""The tracking problem and its solvers against the thesis's own form, against each other, and against planted solutions."""

import tracemalloc

import numpy as np
import pytest
from moa_scenes import planted, random_feasible, random_frames, setting
from scipy.optimize import check_grad

from lfd_gym.errors import UnknownNameError
from lfd_gym.experiments.letters import own_drawings
from policies.moa import normal_matrix
from policies.moa.attractors import BoxAttractors, join, projected, split
from policies.moa.generic_solver import quadratic_program, solve_generic
from policies.moa.interior_point import solve
from policies.moa.mixture_of_attractors import MixtureOfAttractors
from policies.moa.softmax import cost_and_gradient, solve_softmax
from policies.moa.start_and_end import start_and_end
from policies.moa.tie_break import break_tie, nearness
from policies.moa.tracking import TrackingProblem


def problem_of(rng, n_support=12, **kwargs):
    attractors, z, points, frames = planted(rng, n_support=n_support, **kwargs)
    return setting(attractors, points, frames, n_support).problem(), attractors, z


def thesis_goals(attractors, frames, a):
    """G a with the corners of every box mapped to the world one by one (4.31)."""
    corners = np.concatenate(
        [o + c @ axes.T for o, axes, c in zip(frames.origins, frames.axes, attractors.corners(), strict=True)]
    )
    return corners.T @ a.reshape(-1)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_short_form_and_corners_make_the_same_goals(d):
    rng = np.random.default_rng(d)
    frames, attractors = random_frames(rng, 3, d), BoxAttractors(-rng.uniform(0, 1, (3, d)), rng.uniform(0, 1, (3, d)))
    for z in random_feasible(rng, 20, 3, d):
        a = attractors.corner_activations(z)
        assert a.min() >= 0.0
        assert abs(a.sum() - 1.0) < 1e-12
        np.testing.assert_allclose(attractors.corner_matrix() @ a.reshape(-1), z, atol=1e-14)
        np.testing.assert_allclose(attractors.goal_matrix(frames) @ z, thesis_goals(attractors, frames, a), atol=1e-13)


def test_every_mixture_of_corners_has_a_short_form():
    rng = np.random.default_rng(0)
    attractors = BoxAttractors(np.array([[-1.0, 0.0], [0.0, 2.0]]), np.array([[1.0, 0.5], [0.0, 3.0]]))
    for a in rng.dirichlet(np.full(8, 0.2), 50):
        z = attractors.corner_matrix() @ a
        np.testing.assert_allclose(projected(z, 2), z, atol=1e-15)


def test_projection_makes_activations_feasible():
    rng = np.random.default_rng(0)
    z = projected(random_feasible(rng, 40, 3, 2) + rng.normal(0.0, 1e-2, (40, 9)), 3)
    alpha, rho = split(z, 3)
    assert alpha.min() >= 0.0
    assert np.abs(alpha.sum(axis=1) - 1.0).max() < 1e-12
    assert (np.abs(rho) <= alpha[..., None]).all()
    np.testing.assert_array_equal(join(alpha, rho), z)


@pytest.mark.parametrize("moving", [False, True])
def test_quadratic_form_of_the_thesis_is_the_simulated_error(moving):
    rng = np.random.default_rng(3)
    attractors, _, points, frames = planted(rng, 3, n_support=8, n_steps=60, moving=moving, noise=0.01)
    given = setting(attractors, points, frames, 8)
    problem = given.problem()
    program = quadratic_program(problem, attractors)
    for z in random_feasible(rng, 4 * 8, 3, 2).reshape(4, 8, -1):
        s = attractors.corner_activations(z).reshape(8, -1).T.reshape(-1)  # row by row of S
        np.testing.assert_allclose(program.A @ s, 1.0)
        simulated = 0.0
        for x, frame in zip(points, frames, strict=True):
            mixed = given.weights.interpolated(z)
            goals = (attractors.goal_matrix(frame) @ mixed[..., None])[..., 0]
            simulated += ((given.response.simulate(goals, x[0], x[1]) - x) ** 2).sum()
        # (4.15), (4.25) with the factor 2 in H or in f alone would differ by the size of the constant
        assert 0.5 * s @ program.H @ s + program.f @ s + program.constant == pytest.approx(simulated, rel=1e-9)
        assert problem.error(z) == pytest.approx(simulated, rel=1e-9)


@pytest.mark.parametrize("moving", [False, True])
def test_gradient_and_band_are_those_of_the_cost(moving):
    rng = np.random.default_rng(4)
    problem, _, _ = problem_of(rng, n_demonstrations=2, n_steps=150, moving=moving, noise=0.01)
    problem = TrackingProblem(problem.groups, 3, rng.uniform(size=(12, 3)), 0.7)
    shape = (12, problem.n_parameters)
    z = rng.normal(size=shape)
    error = check_grad(
        lambda v: problem.cost_and_gradient(v.reshape(shape))[0],
        lambda v: problem.cost_and_gradient(v.reshape(shape))[1].reshape(-1),
        z.reshape(-1),
    )
    assert error < 1e-4 * np.abs(problem.cost_and_gradient(z)[1]).max()
    band = normal_matrix.band(problem, np.eye(problem.n_parameters))
    n = len(band)
    lower = sum(np.diag(band[: n - k, k], -k) for k in range(min(n, band.shape[1])))
    hessian = lower + np.tril(lower, -1).T
    step = rng.normal(size=shape)
    change = problem.cost_and_gradient(z + step)[1] - problem.cost_and_gradient(z)[1]
    np.testing.assert_allclose(hessian @ step.reshape(-1), change.reshape(-1), atol=1e-9 * np.abs(change).max())


def test_band_is_narrow_where_the_movement_is_long():
    problem, _, _ = problem_of(np.random.default_rng(0), n_support=60, n_steps=1800)
    assert normal_matrix.band(problem, np.eye(9)).shape[1] < 15 * 9


@pytest.mark.parametrize(
    ("n", "d", "moving"), [(1, 2, False), (4, 2, False), (4, 2, True), (4, 3, False), (2, 3, True)]
)
def test_structured_solver_finds_the_minimum_of_the_reference(n, d, moving):
    rng = np.random.default_rng(5 + d)
    problem, attractors, _ = problem_of(rng, n_demonstrations=n, n_support=10, d=d, moving=moving, noise=0.03)
    ours, reference = solve(problem, 1e-8), solve_generic(problem, attractors, "proxqp")
    assert ours.converged
    assert ours.relative_gap <= 1e-8
    assert ours.error == pytest.approx(reference.error, rel=1e-6)
    assert ours.error <= reference.error * (1.0 + 1e-8)


def test_gap_bounds_what_is_missing_anywhere():
    rng = np.random.default_rng(6)
    problem, _, _ = problem_of(rng, noise=0.01)
    minimum = solve(problem, 1e-9).cost
    for z in random_feasible(rng, 50 * 12, 3, 2).reshape(50, 12, -1):
        cost, gradient = problem.cost_and_gradient(z)
        assert problem.gap(z, cost, gradient).absolute >= cost - minimum


@pytest.mark.parametrize("moving", [False, True])
def test_planted_activations_are_found(moving):
    rng = np.random.default_rng(7)
    problem, _, z = problem_of(rng, n_demonstrations=8, n_support=12, moving=moving)
    found = solve(problem, 1e-3)
    assert problem.error(z) < 1e-20
    assert found.error < 1e-8 * problem.scale
    np.testing.assert_allclose(found.z[:, :3], z[:, :3], atol=0.02)


def test_still_frames_are_a_case_of_moving_ones():
    rng = np.random.default_rng(8)
    problem, _, _ = problem_of(rng, noise=0.01)
    group = problem.groups[0]
    copied = group._replace(matrices=np.tile(group.matrices, (len(group.targets), 1, 1)))
    assert solve(TrackingProblem((copied,), 3)).error == pytest.approx(solve(problem).error, rel=1e-6)


def test_a_warm_start_saves_iterations():
    rng = np.random.default_rng(9)
    problem, _, _ = problem_of(rng, n_support=20, noise=0.01)
    cold = solve(problem)
    warm = solve(problem, start=cold.z)
    assert warm.n_iterations <= cold.n_iterations - 2
    assert warm.error == pytest.approx(cold.error, rel=1e-5)


def test_one_frame_has_offsets_only():
    problem, attractors, _ = problem_of(np.random.default_rng(10), n_demonstrations=1, n_frames=1, noise=0.02)
    assert solve(problem).error == pytest.approx(solve_generic(problem, attractors).error, rel=1e-5)


def test_iterations_that_do_not_suffice_are_reported():
    problem, _, _ = problem_of(np.random.default_rng(11), noise=0.01)
    with pytest.warns(UserWarning, match="relative gap"):
        assert not solve(problem, max_iterations=3).converged


def test_more_accuracy_than_there_is_ends_at_the_best_that_was_found():
    for seed in range(5):
        problem, _, _ = problem_of(np.random.default_rng(seed), noise=0.01)
        with pytest.warns(UserWarning, match="relative gap"):
            found = solve(problem, tolerance=0.0)
        assert 0.0 <= found.relative_gap < 1e-8
        assert found.cost == pytest.approx(solve(problem).cost, rel=1e-5)


def test_thesis_size_needs_little_memory():
    problem, attractors, _ = problem_of(np.random.default_rng(12), n_support=75, d=3, n_steps=1200, noise=0.005)
    assert problem.n_support * attractors.corner_matrix().shape[1] == 1800
    solve(problem)
    tracemalloc.start()
    found = solve(problem)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found.relative_gap <= 1e-6
    assert found.n_iterations <= 25
    assert peak < 20e6


def test_every_single_letter_is_solved():
    for drawn in own_drawings().values():
        for x in drawn[:3]:
            for frames in (None, [start_and_end(x)]):
                assert solve(MixtureOfAttractors(20, aligned=True).setting([x], frames).problem()).converged


def test_a_solver_that_is_not_installed():
    problem, attractors, _ = problem_of(np.random.default_rng(0))
    with pytest.raises(UnknownNameError, match="no solver 'proxq' .did you mean 'proxqp'"):
        solve_generic(problem, attractors, "proxq")


def test_softmax_gradient_is_that_of_its_cost():
    rng = np.random.default_rng(13)
    problem, attractors, _ = problem_of(rng, n_demonstrations=2, n_support=5, n_steps=40, noise=0.01)
    corners = attractors.corner_matrix()
    shape = 5, corners.shape[1]
    theta = rng.normal(size=shape).reshape(-1)
    error = check_grad(
        lambda v: cost_and_gradient(v.reshape(shape), problem, corners)[0],
        lambda v: cost_and_gradient(v.reshape(shape), problem, corners)[1].reshape(-1),
        theta,
    )
    assert error < 1e-5 * np.abs(cost_and_gradient(theta.reshape(shape), problem, corners)[1]).max()


def test_softmax_comes_near_the_convex_minimum_and_knows_what_is_missing():
    problem, attractors, _ = problem_of(np.random.default_rng(14), n_support=6, n_steps=40, noise=0.01)
    least, found = solve(problem, 1e-9), solve_softmax(problem, attractors, max_iterations=1000)
    assert least.error <= found.error <= 1.05 * least.error
    assert found.gap >= found.error - least.error


def test_second_stage_takes_the_preferred_frame_where_all_explain_the_same():
    rng = np.random.default_rng(15)
    attractors, _, points, frames = planted(rng, 1, n_support=10, noise=0.01)
    problem = setting(BoxAttractors(attractors.low * 3.0, attractors.high * 3.0), points, frames, 10).problem()
    first = solve(problem)
    preference = np.ones((10, 3))
    preference[:5, 0], preference[5:, 2] = 0.1, 0.1
    allowed = first.error + 1e-4 * problem.scale
    second = break_tie(problem, first, preference, 0.01, allowed, 1e-6)
    assert second.error <= allowed * (1.0 + 1e-4)
    assert second.z[:5, 0].min() > 0.9 > 0.6 > first.z[:, :3].max()
    assert second.z[5:, 2].min() > 0.9


def test_second_stage_uses_up_what_it_may_spend():
    rng = np.random.default_rng(16)
    attractors, _, points, frames = planted(rng, 3, n_support=15, noise=0.02)
    given = setting(attractors, points, frames, 15)
    problem, preference = given.problem(), nearness(given.local, given.weights)
    first = solve(problem)
    errors, costs = [], []
    for slack in (0.0, 0.1, 0.5):
        second = break_tie(problem, first, preference, 0.0, (1.0 + slack) * first.error, 1e-6)
        errors.append(second.error)
        costs.append((preference * second.z[:, :3]).sum())
    assert errors[0] == first.error
    assert errors[1] == pytest.approx(1.1 * first.error, rel=0.08)
    assert errors[2] == pytest.approx(1.5 * first.error, rel=0.3)
    assert costs[0] > costs[1] > costs[2]
