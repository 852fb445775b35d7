"""Other models of paths over time: each recovers what it can represent, and shows the limit that it is known for."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture
from writing_world import DT, HOME, board_pose, demonstrate, demonstration, draw

from lfd_gym.errors import DemonstrationError, InvalidArgumentError
from lfd_gym.experiments import writing
from lfd_gym.registry import load
from policies import LEARNERS, load_skill
from policies.moa.frames import Frames
from policies.trajectory_baselines.dynamic_movement_primitives import fit_segments, segment_by_variance
from policies.trajectory_baselines.gaussian_mixture import fit_mixture
from policies.trajectory_baselines.promp import fit_promp
from policies.trajectory_baselines.task_mixture import TaskMixture, fit_task_mixture

N = 200
TIME = np.linspace(0.0, 1.0, N)
FROM_REST = TIME**3 * (10.0 - 15.0 * TIME + 6.0 * TIME**2)


@pytest.fixture(scope="module")
def scenes():
    """Paths (M, N, 3) that follow a loop in frame 1 in their middle and go from and to a point of frame 0."""
    rng = np.random.default_rng(0)
    frames = [Frames.of_poses(np.array([[0, 0, 0, 1, 0, 0, 0], board_pose(rng)])) for _ in range(6)]
    return frames, np.array([path_in(frame, rng) for frame in frames])


def path_in(frames, rng):
    loop = 0.05 * np.stack([np.sin(4 * np.pi * TIME), np.cos(2 * np.pi * TIME), TIME], axis=1)
    blend = np.clip(5.0 * np.minimum(TIME, 1.0 - TIME), 0.0, 1.0)[:, None]
    smooth = blend**2 * (3.0 - 2.0 * blend)
    return (1 - smooth) * HOME + smooth * (frames.origins[1] + loop @ frames.axes[1].T) + 1e-4 * rng.normal(size=(N, 3))


def local_of(scenes):
    return np.array([frame.local(path) for frame, path in zip(*scenes, strict=True)])


def new_scene():
    rng = np.random.default_rng(50)
    frames = Frames.of_poses(np.array([[0, 0, 0, 1, 0, 0, 0], board_pose(rng)]))
    return frames, path_in(frames, rng)


def test_tp_gmm_draws_in_a_new_scene_and_gmr_cannot(scenes):
    local, (frames, wanted) = local_of(scenes), new_scene()
    middle = slice(60, 140)
    task = fit_mixture(local, 25, 1e-6, slice(None)).path(frames, HOME)
    blind = fit_mixture(local, 10, 1e-6, slice(0, 1))
    world = blind.path(frames, HOME)
    assert np.linalg.norm(task - wanted, axis=1)[middle].max() < 0.005
    assert np.linalg.norm(world - wanted, axis=1)[middle].mean() > 0.05
    assert np.array_equal(world, blind.path(scenes[0][0], HOME))


def test_tp_gmm_turns_with_the_scene(scenes):
    model, (frames, _) = fit_mixture(local_of(scenes), 15, 1e-6, slice(None)), new_scene()
    rng = np.random.default_rng(1)
    turn, shift = Rotation.random(rng=rng).as_matrix(), rng.uniform(size=3)
    moved = model.path(frames.moved(turn, shift), HOME)
    np.testing.assert_allclose(moved, model.path(frames, HOME) @ turn.T + shift, atol=1e-7)


def test_a_mixture_that_is_taught_in_a_turned_scene_draws_the_turned_path(scenes):
    """The world's axes stay."""
    turn = Rotation.from_rotvec([0.0, 0.0, 1.0]).as_matrix()

    def turned(frames):
        return Frames(frames.origins @ turn.T, np.stack([frames.axes[0], turn @ frames.axes[1]]))

    (frames, paths), (new, _) = scenes, new_scene()
    taught = scenes, ([turned(frame) for frame in frames], paths @ turn.T)
    one, other = (fit_mixture(local_of(shown), 15, 1e-6, slice(None)) for shown in taught)
    np.testing.assert_allclose(other.path(turned(new), turn @ HOME), one.path(new, HOME) @ turn.T, atol=1e-9)


def points_in_frames(rng, n_frames, n=300, d=3):
    """Points (F, R, D) of three clusters in every frame, and first responsibilities (R, 3) by one coordinate."""
    centre = 3.0 * rng.normal(size=(n_frames, 3, d))
    rows = centre[:, rng.integers(0, 3, n)] + rng.normal(size=(n_frames, n, d)) @ rng.normal(size=(d, d))
    return rows, np.eye(3)[np.argsort(np.argsort(rows[0, :, 0])) * 3 // n]


def test_a_point_belongs_to_a_component_by_the_product_over_the_frames():
    rows, first = points_in_frames(np.random.default_rng(0), 3)
    mixture = TaskMixture.of_responsibilities(rows, first, 1e-6)
    density = np.array(
        [
            p
            * np.prod(
                [multivariate_normal(m, c).pdf(x) for x, m, c in zip(rows, mean, covariance, strict=True)], axis=0
            )
            for p, mean, covariance in zip(
                mixture.prior, mixture.mean.swapaxes(0, 1), mixture.covariance.swapaxes(0, 1), strict=True
            )
        ]
    ).T
    responsibility, log_likelihood = mixture.expectation(rows)
    np.testing.assert_allclose(responsibility, density / density.sum(axis=1, keepdims=True), atol=1e-12)
    assert log_likelihood == pytest.approx(np.log(density.sum(axis=1)).mean())


@pytest.mark.parametrize("n_frames", [1, 3])
def test_the_likelihood_of_a_mixture_never_falls(n_frames):
    for seed in range(5):
        rows, first = points_in_frames(np.random.default_rng(seed), n_frames)
        history = fit_task_mixture(rows, first, 1e-12, 200).log_likelihood
        assert len(history) > 2
        assert np.diff(history).min() > -1e-9


def test_in_one_frame_it_is_an_ordinary_gaussian_mixture():
    rows, first = points_in_frames(np.random.default_rng(1), 1)
    start = TaskMixture.of_responsibilities(rows, first, 1e-6)
    ordinary = GaussianMixture(
        3, reg_covar=1e-6, weights_init=start.prior, means_init=start.mean[0],
        precisions_init=np.linalg.inv(start.covariance[0]),
    ).fit(rows[0])  # fmt: skip
    fitted = fit_task_mixture(rows, first, 1e-6, 100)
    assert len(fitted.log_likelihood) == ordinary.n_iter_
    np.testing.assert_allclose(fitted.mixture.prior, ordinary.weights_, rtol=1e-6)
    np.testing.assert_allclose(fitted.mixture.mean[0], ordinary.means_, rtol=1e-6)
    np.testing.assert_allclose(fitted.mixture.covariance[0], ordinary.covariances_, rtol=1e-6)


def test_a_mixture_says_that_it_has_not_converged():
    rows, first = points_in_frames(np.random.default_rng(2), 2)
    with pytest.warns(ConvergenceWarning, match="not converged after 1 steps of EM"):
        assert not fit_task_mixture(rows, first, 1e-6, 1).converged
    assert fit_task_mixture(rows, first, 1e-6, 200).converged


def test_many_gaussians_write_as_well_as_few(scenes):
    """With one covariance over all frames together components leave the axis of time, and the loop is missed by 30 cm."""
    model = fit_mixture(local_of(scenes), 60, 1e-6, slice(None))
    frames, wanted = new_scene()
    assert np.linalg.norm(model.path(frames, HOME) - wanted, axis=1)[60:140].max() < 0.002


def test_var_dmp_finds_the_frames_and_draws_in_a_new_scene(scenes):
    local, (frames, wanted) = local_of(scenes), new_scene()
    start, frame = segment_by_variance(local, 10, 20)
    assert list(frame) == [0, 1, 0]
    path = fit_segments(local, start, frame, 5, goal_scaling=False, dt=DT).path(frames, HOME)
    assert np.linalg.norm(path - wanted, axis=1)[120:160].max() < 0.005


def test_a_segment_that_begins_elsewhere_is_back_on_its_path_however_long_it_is():
    """Gains belong to the time, not to the segment: the way back takes half a second in all of them."""
    for n in (100, 400):
        path = np.stack([np.sin(np.linspace(0, 3, n)), np.cos(np.linspace(0, 5, n))], axis=1)
        dmp = fit_segments(path[None, :, None], np.array([0, n]), np.array([0]), 5, goal_scaling=False, dt=DT)
        away = dmp.path(Frames.world(2), path[0] + [0.1, 0.0]) - dmp.path(Frames.world(2), path[0])
        assert np.linalg.norm(away[round(0.5 / DT)]) < 0.02
        assert np.linalg.norm(away[round(1.0 / DT)]) < 1e-3


@pytest.mark.parametrize("dt", [0.02, 0.04, 0.1])
def test_a_dmp_draws_the_same_path_in_steps_of_any_length(dt):
    s = np.linspace(0.0, 1.0, round(4.0 / dt) + 1)
    path = np.stack([s**3 * (10.0 - 15.0 * s + 6.0 * s**2), np.sin(np.pi * s) ** 2], axis=1)
    whole = np.array([0, len(path)]), np.array([0])
    dmp = fit_segments(path[None, :, None], *whole, max(round(0.15 / dt), 1), goal_scaling=False, dt=dt)
    assert np.linalg.norm(dmp.path(Frames.world(2), path[0]) - path, axis=1).max() < 0.05


def test_a_dmp_reproduces_one_demonstration_and_collapses_where_it_starts_at_its_goal():
    path = np.stack([FROM_REST, np.sin(3 * FROM_REST), 0.5 * FROM_REST**2], axis=1)
    whole, world = (np.array([0, N]), np.array([0])), Frames.world(3)
    scaled, free = (
        fit_segments(path[None, :, None], *whole, 5, goal_scaling=scaling, dt=DT) for scaling in (True, False)
    )
    for dmp in (scaled, free):
        assert np.linalg.norm(dmp.path(world, path[0]) - path, axis=1).max() < 0.01
    goal = scaled.goal[0]
    assert np.ptp(scaled.path(world, goal), axis=0).max() < 1e-12
    assert np.ptp(free.path(world, goal), axis=0).max() > 0.1


def test_a_promp_follows_its_start_as_the_demonstrations_did():
    rng = np.random.default_rng(0)
    starts, fades = rng.uniform(size=(10, 1, 2)), (1.0 - FROM_REST)[:, None]
    paths = fades * starts + (1 - fades) * np.array([1.0, 2.0])
    model = fit_promp(paths, 20, 0.1, 1e-9, 1e-4)
    first = np.array([0.3, -0.4])
    wanted = fades * first + (1 - fades) * np.array([1.0, 2.0])
    assert np.abs(model.path(Frames.world(2), first) - wanted).max() < 0.02


@pytest.mark.parametrize("method", ["tp-gmm", "var-dmp", "gmr", "promp", "dmp", "replay"])
def test_every_baseline_is_a_skill_with_a_file(method, tmp_path):
    parameters = {"n_components": 10} if method in ("tp-gmm", "gmr") else {}
    skill = load(LEARNERS[method])(**parameters).fit([demonstrate(seed) for seed in range(3)]).skill_
    skill.save(tmp_path / "skill.npz")
    pose = board_pose(np.random.default_rng(9))
    ends = [draw(one, pose, 2.0)[1].position for one in (skill, load_skill(tmp_path / "skill.npz"))]
    assert np.array_equal(*ends)
    assert np.linalg.norm(ends[0] - HOME) > 0.05


def test_too_few_steps_for_the_gaussians_are_named():
    with pytest.raises(DemonstrationError, match=r"too few for 9000 Gaussians; set n_components to at most \d+$"):
        load(LEARNERS["tp-gmm"])(n_components=9000).fit([demonstrate(seed) for seed in range(2)])


@pytest.mark.parametrize("n_components", [40, 46])
def test_hardly_more_steps_than_gaussians_are_enough(n_components):
    path = np.stack([TIME, np.sin(3 * TIME), TIME**2], axis=1)[:: N // 46][:46]
    model = fit_mixture(path[None, :, None], n_components, 1e-6, slice(None))
    assert np.linalg.norm(model.path(Frames.world(3), HOME) - path, axis=1).max() < 0.01


@pytest.mark.parametrize("method", ["tp-gmm", "gmr"])
def test_a_tool_that_never_moves_is_named(method):
    still = demonstration(0, np.tile(HOME, (100, 1)), np.zeros((100, 6)), board_pose(np.random.default_rng(0)))
    for shown, index in (([still], 0), ([demonstrate(1), still], 1)):
        with pytest.raises(DemonstrationError, match=f"demonstration {index} has length 0: it never moves"):
            load(LEARNERS[method])(n_components=5).fit(shown)


def test_a_mixture_of_points_that_are_all_the_same_is_refused():
    with pytest.raises(DemonstrationError, match="all points .* are the same; a Gaussian mixture needs a movement"):
        fit_mixture(np.ones((2, 50, 1, 3)), 5, 1e-6, slice(None))


@pytest.mark.parametrize(
    ("method", "arguments", "message"),
    [
        ("moa", {"spacing": 0}, "spacing is 0; possible: a number from 0.02 to 1000"),
        ("moa", {"spacing": -1}, "spacing is -1; possible"),
        ("moa", {"margin": np.nan}, "margin is nan; possible: a number from 0 to 100"),
        ("moa", {"margin": -1}, "margin is -1; possible"),
        ("moa", {"second_stage": "no"}, "second_stage is 'no'; possible: True, False"),
        ("tp-gmm", {"n_components": 0}, "n_components is 0; possible: a whole number from 1 on"),
        ("tp-gmm", {"n_components": 7.5}, "n_components is 7.5; possible: a whole number from 1 on"),
        ("tp-gmm", {"regularisation": 0}, "regularisation is 0; possible: a number from 1e-10 to 1"),
        ("gmr", {"max_iter": 0}, "max_iter is 0; possible: a whole number from 1 on"),
        ("promp", {"spacing": 1e-320}, "spacing is 1e-320; possible: a number from 0.02 to 1000"),
        ("promp", {"overlap": 0}, "overlap is 0; possible: a number from 1e-06 to 0.999"),
        ("promp", {"ridge": -1}, "ridge is -1; possible: a number from 1e-12 to 1"),
        ("promp", {"noise": 1e200}, "noise is 1e.200; possible: a number from 1e-06 to 1000"),
        ("dmp", {"spacing": np.nan}, "spacing is nan; possible: a number from 0.02 to 1000"),
        ("dmp", {"goal_scaling": "no"}, "goal_scaling is 'no'; possible: True, False"),
        ("var-dmp", {"window": 0}, "window is 0; possible: a number from 0.02 to 1000"),
        ("var-dmp", {"spacing": True}, "spacing is True; possible"),
        *(
            (method, {"events": value}, "events is .*; possible: a number from 0 to 1000")
            for method in ("moa", "tp-gmm", "gmr", "promp", "dmp", "var-dmp", "replay")
            for value in (1e200, np.nan, -1.0, "far")
        ),
    ],
)
def test_arguments_that_are_not_possible(method, arguments, message):
    with pytest.raises(InvalidArgumentError, match=message):
        load(LEARNERS[method])(**arguments).fit([demonstrate(seed) for seed in range(2)])


def test_replay_is_one_of_the_demonstrations():
    shown = [demonstrate(seed) for seed in range(3)]
    points = load(LEARNERS["replay"])().fit(shown).skill_.generator.points
    assert any(np.array_equal(points, d.observations["tool_position"]) for d in shown)


def test_a_distance_to_a_word_is_that_to_its_nearest_stroke():
    strokes = writing.strokes("I")
    corner = strokes[0][0]
    assert writing.distances(corner[None], "I")[0] < 1e-9
    away = np.array([[1.0, 0.0]])
    assert writing.distances(away, "I")[0] == pytest.approx(
        min(np.linalg.norm(away - writing.sample(s, 1e-3), axis=1).min() for s in strokes), abs=1e-3
    )
