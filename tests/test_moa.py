"""MixtureOfAttractors: what it learns from demonstrations (thesis 4.3, 4.4)."""

import itertools

import numpy as np
import pytest
from moa_scenes import ALPHA, DT, draw, planted, random_frames, turn
from sklearn.base import clone
from sklearn.exceptions import NotFittedError

from lfd_gym.errors import DemonstrationError, InvalidArgumentError, UnknownNameError
from policies.moa.frames import Frames, resample
from policies.moa.mixture_of_attractors import MixtureOfAttractors, sparsity
from policies.moa.start_and_end import least_error, start_and_end
from policies.moa.tie_break import SLACK, excess

SETTINGS = {"n_support": 12, "alpha": ALPHA, "dt": DT, "aligned": True}


def learned(points, frames, **kwargs):
    return MixtureOfAttractors(**{**SETTINGS, **kwargs}).fit(points, frames)


def rms(moa):
    return np.sqrt(np.mean([(r**2).sum(axis=1).mean() for r in moa.residuals_]))


@pytest.mark.parametrize("moving", [False, True])
def test_a_planted_model_is_drawn_in_a_new_scene(moving):
    rng = np.random.default_rng(0)
    attractors, z, points, frames = planted(rng, moving=moving)
    moa = learned(points, frames, margin=0.5, accuracy=1e-4)
    new = random_frames(rng, 3, 2, 120 if moving else None)
    wanted = draw(z, attractors, new, 120)
    assert np.abs(moa.predict(new, wanted[0]) - wanted).max() < 0.01
    assert moa.sparsity_ > 0.9


@pytest.mark.parametrize("moving", [False, True])
def test_turning_and_shifting_the_scene_turns_and_shifts_the_answer(moving):
    rng = np.random.default_rng(1)
    _, _, points, frames = planted(rng, 4, d=3, moving=moving, noise=0.01)
    rotation, shift = turn(rng, 3), 50.0 * rng.normal(size=3)
    here = learned(points, frames, tolerance=1e-9)
    there = learned(
        [x @ rotation.T + shift for x in points], [f.moved(rotation, shift) for f in frames], tolerance=1e-9
    )
    assert there.objective_ == pytest.approx(here.objective_, rel=1e-6)
    new = random_frames(rng, 3, 3, 120 if moving else None)
    x = here.predict(new, np.zeros(3))
    np.testing.assert_allclose(there.predict(new.moved(rotation, shift), shift), x @ rotation.T + shift, atol=2e-4)


def test_activations_are_non_negative_and_sum_to_one():
    _, _, points, frames = planted(np.random.default_rng(2), noise=0.02)
    moa = learned(points, frames)
    a = moa.attractors_.corner_activations(moa.z_)
    assert a.shape == (12, 3, 4)
    assert a.min() >= 0.0
    assert np.abs(a.sum(axis=(1, 2)) - 1.0).max() < 1e-12
    assert moa.frame_activations_.min() >= 0.0
    assert np.abs(moa.frame_activations_.sum(axis=1) - 1.0).max() < 1e-12
    np.testing.assert_allclose(a.sum(axis=2), moa.z_[:, :3], atol=1e-12)


def test_result_carries_objective_gap_residuals_and_sparsity():
    _, _, points, frames = planted(np.random.default_rng(3), 2, noise=0.02)
    moa = learned(points, frames)
    assert moa.objective_ == pytest.approx(sum((r**2).sum() for r in moa.residuals_), rel=1e-9)
    assert moa.minimum_.relative_gap <= 1e-6
    assert 0.0 <= moa.objective_ - moa.minimum_.error <= moa.gap_
    assert moa.sparsity_ == sparsity(moa.frame_activations_)
    assert learned(points, frames, second_stage=False).gap_ <= 1e-6 * moa.objective_


def test_sparsity_is_one_for_single_frames_and_1_over_k_for_alike_ones():
    assert sparsity(np.eye(3)[[0, 0, 1, 2]]) == pytest.approx(1.0)
    assert sparsity(np.full((7, 4), 0.25)) == pytest.approx(0.25)


@pytest.mark.parametrize("solver", ["proxqp", "softmax"])
def test_every_solver_can_be_asked_for(solver):
    _, _, points, frames = planted(np.random.default_rng(4), 3, n_support=5, n_frames=2, n_steps=40, noise=0.02)
    ours = learned(points, frames, n_support=5, second_stage=False)
    other = learned(points, frames, n_support=5, second_stage=False, solver=solver)
    farther = 0.2 if solver == "softmax" else 1e-6  # gradients may stop where a softmax saturates
    assert (1.0 - 1e-6) * ours.objective_ <= other.objective_ <= (1.0 + farther) * ours.objective_


def test_a_boxed_goal_must_lead():
    points = [np.stack([np.sin(np.linspace(0, 6, 150)), np.linspace(0, 0.2, 150)], axis=1)]
    tight, wide = (learned(points, None, n_support=30, alpha=20.0, margin=margin) for margin in (0.0, 0.1))
    assert rms(wide) < 0.5 * rms(tight)


def test_free_activations_track_best():
    _, _, points, frames = planted(np.random.default_rng(5), 2, n_steps=60, noise=0.02)
    free = learned(points, frames, n_support=None, second_stage=False)
    assert free.frame_activations_.shape == (60, 3)
    assert free.objective_ < learned(points, frames, second_stage=False).objective_


def approach_two_objects(rng, n):
    """Demonstrations that visit object 1, then object 2, closely; the world is far away."""
    t = np.linspace(0.0, 1.0, 120)[:, None]
    points, frames = [], []
    for _ in range(n):
        objects = random_frames(rng, 2, 2)
        circle = 0.05 * np.hstack([np.cos(9 * t), np.sin(9 * t)])
        there = objects.origins[:, None] + circle @ objects.axes.swapaxes(1, 2)
        points.append(np.where(t < 0.5, there[0], there[1]))
        frames.append(Frames.joined([Frames.at([[2.0, 2.0]]), objects]))
    return points, frames


def test_the_second_stage_ends_where_nothing_is_left_to_prefer():
    """A frame that moves with the tool explains everything at no distance."""
    time = np.linspace(0.0, 1.0, 100)
    path = np.stack([time, np.sin(3.0 * time), 0.3 * time], axis=1)
    frames = Frames.joined([Frames.world(3), Frames.at(path[:, None])])
    moa = MixtureOfAttractors(n_support=20, alpha=1000.0, beta=250.0, dt=0.02).fit([path], [frames])
    assert moa.sparsity_ > 0.98


def test_one_demonstration_generalises_by_the_second_stage_only():
    rng = np.random.default_rng(6)
    points, frames = approach_two_objects(rng, 8)
    with_it, without = (learned(points[:1], frames[:1], second_stage=stage) for stage in (True, False))
    unseen = list(zip(points[1:], frames[1:], strict=True))
    errors = [
        [np.median(np.linalg.norm(moa.predict(f, x[0]) - x, axis=1)) for x, f in unseen] for moa in (with_it, without)
    ]
    assert np.mean(errors[0]) < 0.02 < 0.1 < np.mean(errors[1])
    assert with_it.sparsity_ > 0.85 > 0.5 > without.sparsity_
    spread = np.sqrt(points[0].var(axis=0).sum())
    assert rms(with_it) <= np.sqrt(1.05 * rms(without) ** 2 + (3e-3 * spread) ** 2) * 1.001


def letter(rng, start, end):
    """A bow between two points, with a little error."""
    t = np.linspace(0.0, 1.0, 100)[:, None]
    bow = np.stack([0.3 * np.sin(2 * np.pi * t), 0.4 * np.sin(np.pi * t)], axis=2)[:, 0]
    return start + (end - start) * (3 * t**2 - 2 * t**3) + bow * (1.0 + 0.02 * rng.normal())


def letters(rng, n):
    return [letter(rng, rng.normal(0.0, 0.2, 2), np.array([1.0, 0.0]) + rng.normal(0.0, 0.2, 2)) for _ in range(n)]


def test_start_and_end_frames_reach_what_their_class_can():
    points = letters(np.random.default_rng(7), 8)
    moa = learned(points, [start_and_end(x) for x in points], n_support=20, alpha=100.0, dt=0.01, second_stage=False)
    assert rms(moa) ** 2 < 1.1 * least_error(points).mean()


def test_least_error_is_the_minimum_of_its_class():
    rng = np.random.default_rng(8)
    points = np.array(letters(rng, 6)) + 0.2 * rng.normal(size=(6, 100, 2))
    errors = []
    for w in np.linspace(0.0, 1.0, 501):
        rest = points - w * points[:, :1] - (1.0 - w) * points[:, -1:]
        errors.append(((rest - rest.mean(axis=0)) ** 2).sum(axis=2).mean(axis=0))
    np.testing.assert_allclose(least_error(points), np.min(errors, axis=0), atol=1e-6)


def test_a_letter_is_drawn_where_start_equals_end():
    points = letters(np.random.default_rng(9), 8)
    moa = learned(points, [start_and_end(x) for x in points], n_support=20, alpha=100.0, dt=0.01, goal_frame=1)
    here = np.array([3.0, 1.0])
    x = moa.predict(Frames.at([here, here]), here)
    assert np.ptp(x, axis=0).min() > 0.3
    assert np.linalg.norm(moa.predict(Frames.at([here, here]), here, n=600)[-1] - here) < 1e-6


def test_a_movement_ends_at_its_goal_frame():
    rng = np.random.default_rng(10)
    points = letters(rng, 5)
    frames = [start_and_end(x) for x in points]
    moa = learned(points, frames, alpha=100.0, dt=0.01, goal_frame=1)
    scene = Frames.at([[0.2, 0.3], [1.4, -0.5]])
    assert np.linalg.norm(moa.predict(scene, scene.origins[0], n=800)[-1] - scene.origins[1]) < 1e-6
    loose = learned(points, frames, alpha=100.0, dt=0.01, second_stage=False)
    assert moa.minimum_.error >= loose.minimum_.error * (1.0 - 1e-6)


def test_joint_limits_are_kept_from_rest():
    rng = np.random.default_rng(11)
    low, high = -np.ones(7), np.ones(7)
    t = np.linspace(0.0, 1.0, 200)[:, None]
    points = [0.999 * np.sin(t * rng.uniform(5, 20, 7) + rng.uniform(0, 6, 7)) for _ in range(2)]
    moa = learned(points, None, n_support=40, bounds=(low[None], high[None]))
    for start in (low, high, np.zeros(7)):
        x = moa.predict(Frames.world(7), start, n=400)
        assert x.min() >= -1.0 - 1e-12
        assert x.max() <= 1.0 + 1e-12
    assert moa.attractors_.corner_activations(moa.z_).shape == (40, 1, 128)
    assert moa.predict(Frames.world(7), 0.5 * high, high).max() > 1.01  # not kept by a start in motion


def test_one_step_likelihood_never_falls_and_finds_where_demonstrations_scatter():
    rng = np.random.default_rng(12)
    points = letters(rng, 12)
    response_noise = np.where(np.arange(100)[:, None] < 50, 1e-4, 5e-3)
    points = [np.asarray(x + response_noise * rng.normal(size=x.shape)) for x in points]
    moa = learned(points, [start_and_end(x) for x in points], n_support=10, alpha=100.0, dt=0.01, objective="one-step")
    likelihood = moa.one_step_.log_likelihood
    assert len(likelihood) > 2
    assert np.diff(likelihood).min() > -1e-6 * abs(likelihood[-1])
    spread = np.sqrt(np.trace(moa.one_step_.covariances, axis1=1, axis2=2))
    assert spread[7:].mean() > 5.0 * spread[1:4].mean()


def test_one_step_weights_all_directions_by_their_variance():
    """So the unit of a direction changes nothing but the unit of the answer."""
    rng, unit = np.random.default_rng(15), np.array([1.0, 10.0])
    points = [x + [1e-4, 2e-3] * rng.normal(size=x.shape) for x in letters(rng, 6)]
    settings = {"n_support": 10, "alpha": 100.0, "dt": 0.01, "second_stage": False, "tolerance": 1e-9}
    one, other = (
        learned(xs, [start_and_end(x) for x in xs], objective="one-step", **settings)
        for xs in (points, [unit * x for x in points])
    )
    x = one.predict(start_and_end(points[0]), points[0][0])
    np.testing.assert_allclose(other.predict(start_and_end(unit * points[0]), unit * points[0][0]) / unit, x, atol=1e-4)
    covariances = one.one_step_.covariances * np.outer(unit, unit)
    np.testing.assert_allclose(other.one_step_.covariances, covariances, rtol=0.02)


def test_one_step_ends_where_nothing_is_left_to_explain():
    s = np.linspace(0.0, 1.0, 60)[:, None]
    s = 3.0 * s**2 - 2.0 * s**3
    points = [np.hstack([s, np.sin(3.0 * s)])]
    moa = MixtureOfAttractors(None, objective="one-step").fit(points)
    assert moa.one_step_.converged
    assert np.isfinite(moa.one_step_.covariances).all()


def test_moving_goals_follow_their_frames():
    rng = np.random.default_rng(14)
    _, _, points, frames = planted(rng, noise=0.01)
    moa = learned(points, frames)
    scene = random_frames(rng, 3, 2, 120)
    alpha, places = moa.activations()
    goals = moa.goals(scene)
    for i in range(0, 120, 17):
        parts = [alpha[i, f] * scene.origins[i, f] + scene.axes[i, f] @ places[i, f] for f in range(3)]
        np.testing.assert_allclose(goals[i], np.sum(parts, axis=0), atol=1e-12)


def test_trajectories_are_aligned_first():
    """The same letter begun fast and begun slowly: without an alignment the means of different places are drawn."""
    n, powers, points = 160, (0.7, 1.0, 1.5, 2.0), letters(np.random.default_rng(15), 4)
    warped = [resample(x, 99.0 * np.linspace(0.0, 1.0, n) ** p) for x, p in zip(points, powers, strict=True)]
    frames = [start_and_end(x) for x in warped]
    moa, as_they_are = learned(warped, frames, aligned=False), learned(warped, frames)
    assert rms(moa) < 0.3 * rms(as_they_are)
    assert {len(r) for r in moa.residuals_} == {moa.n_steps_} == {n}
    given = MixtureOfAttractors(**SETTINGS).fit(warped, frames, warps=moa.warps_)
    assert given.objective_ == pytest.approx(moa.objective_)


def test_warm_start_uses_the_previous_fit():
    _, _, points, frames = planted(np.random.default_rng(16), noise=0.02)
    moa = MixtureOfAttractors(**SETTINGS, second_stage=False, warm_start=True).fit(points, frames)
    cold = moa.minimum_
    assert moa.fit(points, frames).minimum_.n_iterations < cold.n_iterations
    assert moa.minimum_.error == pytest.approx(cold.error, rel=1e-5)


def test_arguments_are_not_changed_and_estimator_is_cloned():
    _, _, points, frames = planted(np.random.default_rng(17), 2, noise=0.01)
    before = [x.copy() for x in points]
    moa = clone(MixtureOfAttractors(**SETTINGS)).fit(points, frames)
    assert moa.get_params()["n_support"] == 12
    for x, y in zip(points, before, strict=True):
        np.testing.assert_array_equal(x, y)
    np.testing.assert_array_equal(moa.z_, clone(moa).fit(points, frames).z_)


LINE = np.linspace([0.0, 0.0], [1.0, 1.0], 50)
WORLD = Frames.world(2)


@pytest.mark.parametrize(
    ("points", "frames", "message"),
    [
        ([], None, "no demonstration was given"),
        ([LINE[:1]], None, r"shape \(1, 2\); needed: at least 3 points"),
        ([LINE[:0]], None, r"shape \(0, 2\)"),
        ([LINE[:, 0]], None, r"shape \(50,\)"),
        ([LINE, np.where(LINE[7] == LINE, np.nan, LINE)], None, "demonstration 1 is not finite at step 7"),
        ([np.ones((50, 2))], None, "demonstration 0 has length 0"),
        ([LINE, LINE[:, :1]], None, "demonstration 1 has 1 dimensions, demonstration 0 2"),
        ([LINE, LINE], [WORLD], "2 demonstrations came with the frames of 1"),
        ([LINE, LINE], [WORLD, Frames.at(np.zeros((2, 2)))], "demonstration 1 has 2 frames, demonstration 0 1"),
        ([LINE], [Frames.world(3)], "demonstration 0 has 2 dimensions, its frames 3"),
        ([LINE], [Frames.at(LINE[:40, None])], "demonstration 0 has 50 points, its frames 40 time steps"),
        ([LINE, LINE[:40]], None, "aligned demonstrations have one length, not 40, 50"),
    ],
)
def test_demonstrations_that_cannot_be_learned_from(points, frames, message):
    with pytest.raises(DemonstrationError, match=message):
        learned(points, frames)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"n_support": 51}, "51 support points; possible: 2 to the number of time steps, 50"),
        ({"n_support": 1}, "n_support is 1; possible: a whole number from 2 on"),
        ({"n_support": 12.5}, "n_support is 12.5; possible: a whole number"),
        ({"alpha": -1.0}, "alpha is -1.0; it must be positive"),
        ({"alpha": np.inf}, "alpha is inf; it must be positive, and below"),
        ({"beta": np.nan}, "beta is nan; it must be positive"),
        ({"dt": "0.02"}, "dt is '0.02'; it must be positive"),
        ({"margin": np.nan}, "margin is nan; possible: a number from 0 to 100"),
        ({"margin": -1.0}, "margin is -1.0; possible: a number from 0 to 100"),
        ({"overlap": 1.0}, "overlap is 1.0; possible: a number from 1e-06 to 0.999"),
        ({"tolerance": 0.0}, "tolerance is 0.0; possible: a number from 1e-12 to 1"),
        ({"slack": -0.1}, "slack is -0.1; possible: a number from 0"),
        ({"accuracy": np.nan}, "accuracy is nan; possible: a number from 0"),
        ({"switching": np.inf}, "switching is inf; possible: a number from 0"),
        ({"second_stage": "no"}, "second_stage is 'no'; possible: True, False"),
        ({"aligned": 1}, "aligned is 1; possible: True, False"),
        ({"goal_frame": 1}, "no frame 1; possible: 0 to 0"),
        ({"goal_frame": 0.0}, "no frame 0.0; possible: 0 to 0"),
        ({"objective": "mse"}, "no objective 'mse'"),
        ({"bounds": (np.zeros((1, 3)), np.ones((1, 3)))}, r"bounds are two arrays \(1, 2\)"),
        ({"bounds": (np.zeros((1, 2)), np.full((1, 2), np.inf))}, "bounds must be finite"),
    ],
)
def test_arguments_that_are_not_possible(settings, message):
    with pytest.raises(InvalidArgumentError, match=message):
        learned([LINE], None, **settings)


def test_a_margin_may_be_a_whole_number():
    exact, whole = (learned([LINE], None, margin=margin) for margin in (0.0, 0))
    assert np.array_equal(exact.z_, whole.z_)


def test_a_solver_that_is_not_there_and_frames_that_do_not_fit():
    with pytest.raises(UnknownNameError, match="no solver 'quick'"):
        learned([LINE], None, solver="quick")
    with pytest.raises(InvalidArgumentError, match="2 frames over any number of steps were given; 1 frames over 50"):
        learned([LINE], None).predict(Frames.at(np.zeros((2, 2))), np.zeros(2))
    with pytest.raises(DemonstrationError, match="1 demonstrations came with 2 warps"):
        MixtureOfAttractors(**SETTINGS).fit([LINE], warps=[np.arange(50.0)] * 2)
    with pytest.raises(NotFittedError):
        MixtureOfAttractors().predict(WORLD, np.zeros(2))


def test_noise_of_few_demonstrations_does_not_mix_frames():
    """Three demonstrations whose places are 1 cm off: the least error fits that, at the price of the next scene."""
    accounted, unaccounted = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scenes = [_three_places(rng) for _ in range(3)]
        shown = [_visit(places + 0.01 * rng.standard_normal((3, 2))) for places in scenes]
        for errors, slack in ((accounted, excess(3, 2)), (unaccounted, SLACK)):
            moa = learned(shown, [Frames.at(places) for places in scenes], n_support=30, slack=slack)
            for new in (_three_places(np.random.default_rng(i)) for i in range(20)):
                drawn = moa.predict(Frames.at(new), new[0])
                errors += [np.linalg.norm(drawn[65] - new[1]), np.linalg.norm(drawn[-1] - new[2])]
    assert np.max(accounted) < 0.02
    assert np.max(unaccounted) > 0.05


def test_excess_is_that_of_a_regression():
    """Mean squared errors of a place and a share that are fitted to M points, and of those that are true."""
    rng = np.random.default_rng(0)
    true, least = 0.0, 0.0
    for _ in range(2000):
        noise = rng.standard_normal(3 * 3)
        design = np.column_stack([np.tile(np.eye(3), (3, 1)), rng.standard_normal(9)])
        true += noise @ noise
        least += np.linalg.lstsq(design, noise)[1][0]
    assert true / least - 1.0 == pytest.approx(excess(3, 3), rel=0.1)
    assert excess(1, 3) == 0.0


def _three_places(rng):
    """The world's origin, and two places that vary by 10 cm."""
    return np.array([[0.0, 0.0], [0.4, 0.0], [0.8, 0.4]]) + np.vstack([np.zeros(2), 0.1 * rng.standard_normal((2, 2))])


def _visit(places):
    """A movement (130, 2) from place to place, with rests."""
    t = np.linspace(0.0, 1.0, 40)[:, None]
    s = 10.0 * t**3 - 15.0 * t**4 + 6.0 * t**5
    parts = [np.repeat(places[:1], 10, axis=0)]
    for a, b in itertools.pairwise(places):
        parts += [a + s * (b - a), np.repeat(b[None], 20, axis=0)]
    return np.vstack(parts)
