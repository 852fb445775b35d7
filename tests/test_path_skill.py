"""Skills that play a path over time: what they learn from paths and wrenches, and what they do on boards they never saw."""

import dataclasses
import itertools
import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from writing_world import CORNERS, DT, HOME, PRESS, board_pose, demonstrate, demonstration, draw

from lfd_gym.errors import DemonstrationError, SkillFileError
from policies import load_skill
from policies.moa.frames import Frames
from policies.moa_learner import MoALearner
from policies.orientation_schedule import cheapest_sequence, learn_orientations
from policies.path_skill import PATIENCE, Memory, PathSkill
from policies.press_schedule import learn_presses
from policies.trajectory_baselines.dynamic_movement_primitives import DMPLearner, VarDMPLearner
from policies.trajectory_baselines.gaussian_mixture import GMRLearner, TPGMMLearner
from policies.trajectory_baselines.promp import ProMPLearner
from policies.trajectory_baselines.replay import ReplayLearner


@pytest.fixture(scope="module")
def taught():
    return [demonstrate(seed) for seed in range(5)]


@pytest.fixture(scope="module")
def learner(taught):
    return MoALearner().fit(taught)


@pytest.fixture(scope="module")
def skill(learner):
    return learner.skill_


def distance_to_square(points):
    """Of points (N, 2) [m]."""
    a, b = CORNERS[:-1], CORNERS[1:]
    along = np.clip(((points[:, None] - a) * (b - a)).sum(2) / ((b - a) ** 2).sum(1), 0.0, 1.0)
    return np.linalg.norm(points[:, None] - a - along[..., None] * (b - a), axis=2).min(axis=1)


def test_the_square_is_drawn_on_boards_never_seen(skill):
    for seed in range(100, 104):
        ink, world = draw(skill, board_pose(np.random.default_rng(seed)))
        assert distance_to_square(ink).max() < 0.003
        sides = np.concatenate([np.linspace(a, b, 30) for a, b in itertools.pairwise(CORNERS)])
        assert np.linalg.norm(sides[:, None] - ink, axis=2).min(axis=1).max() < 0.004
        assert np.linalg.norm(world.position - HOME) < 0.01


def test_the_end_of_a_path_is_held_however_fast_it_was_come_to(skill):
    path = np.array([[0.5 + 0.08 * DT * i, 0.0, 0.2] for i in range(10)])
    assert np.array_equal(skill._goal(path, 9), path[-1])
    assert np.linalg.norm(skill._goal(path, 8) - path[8]) > 0.005


def test_the_path_is_in_the_board_while_writing_and_in_the_world_otherwise(learner, skill):
    activations = learner.model_.frame_activations_
    writes = skill.press.force.any(axis=1)
    assert activations[writes, 1].mean() > 0.95
    assert activations[-10:, 0].mean() > 0.95


def test_the_press_is_learned_without_friction(skill):
    forces = skill.press.force[skill.press.force.any(axis=1)]
    assert len(np.unique(forces, axis=0)) == 1
    assert np.linalg.norm(forces[0] - [0, 0, -PRESS]) < 0.15 * PRESS
    assert set(skill.press.frame[skill.press.force.any(axis=1)]) == {1}


def test_a_hand_that_withdraws_in_a_hurry_pressed_all_the_same():
    """It accelerates what is below the sensor, which therefore feels a contact for a moment longer."""
    height = np.zeros(100)
    height[57:] = np.minimum(0.005 * np.arange(1, 44), 0.1)
    points = np.stack([0 * height, 0 * height, height], axis=1)
    wrench = np.zeros((100, 6))
    wrench[20:57, 2], wrench[57:60, 2] = 4.0, -1.0
    force = learn_presses([points[:, None]] * 2, [np.eye(3)[None]] * 2, [wrench] * 2, 0.02).force
    assert force[20:57] == pytest.approx(np.tile([0.0, 0.0, -4.0], (37, 1)))
    slow = points * (1.0, 1.0, 3.0)
    slow[:, 2] = np.clip(0.001 * (np.arange(100) - 40), 0.0, 0.1)
    assert not learn_presses([slow[:, None]] * 2, [np.eye(3)[None]] * 2, [wrench] * 2, 0.02).force.any()


def test_a_contact_of_a_single_long_step_may_be_a_press():
    wrench = np.zeros((5, 6))
    wrench[2, 2] = 4.0
    force = learn_presses([np.zeros((5, 1, 3))], [np.eye(3)[None]], [wrench], 0.5).force
    assert np.array_equal(np.flatnonzero(force.any(axis=1)), [2])


def test_what_gives_way_is_carried_and_not_pressed():
    rng = np.random.default_rng(0)
    height = np.clip(np.linspace(-0.1, 0.3, 200), 0.0, 0.2)
    points = [np.stack([np.full(200, x), np.zeros(200), height], axis=1) for x in rng.uniform(size=3)]
    local = [Frames.world(3).local(x) for x in points]
    wrench = np.zeros((200, 6))
    wrench[40:160, 2] = -5.0
    axes = [np.eye(3)[None]] * 3
    assert not learn_presses(local, axes, [wrench] * 3, DT).force.any()
    still = [np.repeat(x[:1], 200, axis=0) for x in local]
    assert learn_presses(still, axes, [wrench] * 3, DT).force[100] @ [0, 0, 1] == 5.0


def test_friction_along_one_long_stroke_is_no_part_of_the_press():
    """A force tilted by friction would point along the stroke by more than a wall allows."""
    along = np.linspace(0.0, 0.1, 200)
    points = np.stack([0 * along, along, 0 * along], axis=1)
    wrench = np.zeros((200, 6))
    wrench[:, :3] = [0.0, -0.6, 2.0]
    force = learn_presses([points[:, None]] * 3, [np.eye(3)[None]] * 3, [wrench] * 3, DT).force
    assert force == pytest.approx(np.tile([0.0, 0.0, -2.0], (200, 1)))


def _on_an_arc(last: float) -> tuple[list[np.ndarray], np.ndarray]:
    """A tool that comes from 0.4 m to 0.2 m within 60 steps and turns by an angle [rad] within 100 more; outward (160, 3)."""
    radius = np.concatenate([np.linspace(0.4, 0.2, 60), np.full(100, 0.2)])
    angle = np.concatenate([np.zeros(60), np.linspace(0.0, last, 100)])
    outward = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    return [(radius[:, None] * outward)[:, None]] * 3, outward


def test_a_press_turns_with_what_is_flipped():
    local, outward = _on_an_arc(1.4)
    wrench = np.zeros((160, 6))
    wrench[:, :3] = np.where(np.arange(160)[:, None] < 60, 0.8, 9.0) * outward
    force = learn_presses(local, [np.eye(3)[None]] * 3, [wrench] * 3, DT).force
    assert np.array_equal(np.flatnonzero(force.any(axis=1)), np.arange(60, 160))
    assert force[60:] == pytest.approx(-9.0 * outward[60:], abs=0.2)


def test_what_is_pushed_towards_an_axis_is_not_pressed():
    local, outward = _on_an_arc(1.4)
    wrench = np.zeros((160, 6))
    wrench[:, :3] = 5.0 * outward
    assert not learn_presses([x[:70] for x in local], [np.eye(3)[None]] * 3, [wrench[:70]] * 3, DT).force.any()


def test_on_the_axis_nothing_turns():
    """As where a bulb is pulled out of its holder, whatever the tool feels from the side."""
    outward = _on_an_arc(2.0 * np.pi)[1][60:]
    points = 0.003 * outward + np.linspace(0.0, 0.1, 100)[:, None] * [0.0, 0.0, 1.0]
    wrench = np.zeros((100, 6))
    wrench[:, :3] = 4.0 * outward - [0.0, 0.0, 8.0]
    assert not learn_presses([points[:, None]] * 3, [np.eye(3)[None]] * 3, [wrench] * 3, DT).force.any()


def test_chatter_is_no_gap_in_a_contact():
    wrench = np.zeros((100, 6))
    wrench[20:80, 2], wrench[50, 2], wrench[90, 2] = 4.0, 0.0, 4.0
    local, axes = [np.zeros((100, 1, 3))], [np.eye(3)[None]]
    force = learn_presses(local, axes, [wrench], DT).force
    assert np.array_equal(np.flatnonzero(force.any(axis=1)), np.arange(20, 80))


def test_a_push_by_closing_fingers_is_no_press():
    wrench = np.zeros((100, 6))
    wrench[20:29, 2], wrench[40:60, 2] = 4.0, 4.0
    force = learn_presses([np.zeros((100, 1, 3))], [np.eye(3)[None]], [wrench], 0.02).force
    assert np.array_equal(np.flatnonzero(force.any(axis=1)), np.arange(40, 60))


def test_a_press_ends_where_there_is_no_wall(skill):
    i = int(np.flatnonzero(skill.press.force.any(axis=1))[0])
    pose = board_pose(np.random.default_rng(7))
    down = -Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()[:, 2]
    seen = {
        "tool_position": HOME,
        "tool_quaternion": np.array([0.0, 0, 1, 0]),
        "frame_board": pose,
        "wrench": np.zeros(6),
    }
    _, state = skill.predict(seen)
    state = Memory(*state)._replace(step=np.array([i]))
    for depth, presses in ((0.0, True), (0.009, True), (0.011, False), (-0.02, True)):
        action, _ = skill.predict(seen | {"tool_position": state.path[0, i] + depth * down}, state)
        assert skill.layout.decode(action).force.any() == presses


def test_turning_and_shifting_the_scene_turns_and_shifts_the_path(skill):
    rng = np.random.default_rng(3)
    poses = np.array([[0, 0, 0, 1, 0, 0, 0], board_pose(rng)])
    turn, shift = Rotation.random(rng=rng).as_matrix(), rng.uniform(size=3)
    frames = Frames.of_poses(poses)
    path = skill.generator.path(frames, HOME)
    moved = skill.generator.path(frames.moved(turn, shift), turn @ HOME + shift)
    np.testing.assert_allclose(moved, path @ turn.T + shift, atol=1e-12)


def test_the_clock_stops_for_a_contact_that_is_missing_but_not_for_ever(skill):
    i = int(np.flatnonzero(skill.press.force.any(axis=1))[0])
    pose = board_pose(np.random.default_rng(7))
    seen = {"tool_position": HOME, "tool_quaternion": np.array([0.0, 0, 1, 0]), "frame_board": pose}
    _, state = skill.predict(seen | {"wrench": np.zeros(6)})
    state = Memory(*state)._replace(step=np.array([i]))
    on_path = seen | {"tool_position": state.path[0, i], "wrench": np.zeros(6)}
    steps = []
    for _ in range(round(PATIENCE / DT) + 2):
        _, state = skill.predict(on_path, state)
        steps.append(int(Memory(*state).step[0]))
    assert steps[: round(PATIENCE / DT)] == [i] * round(PATIENCE / DT)
    assert steps[-1] > i
    later = []
    for _ in range(5):
        memory = Memory(*state)
        _, state = skill.predict(
            seen | {"tool_position": memory.path[0, int(memory.step[0])], "wrench": np.zeros(6)}, state
        )
        later.append(int(Memory(*state).step[0]))
    assert later == [steps[-1] + n for n in range(1, 6)]
    normal = Rotation.from_quat(pose[3:], scalar_first=True).as_matrix()[:, 2]
    felt = on_path | {"wrench": np.r_[PRESS * normal, np.zeros(3)]}
    _, state = skill.predict(felt, Memory(*state)._replace(step=np.array([i]), waited=np.zeros(1)))
    assert Memory(*state).step[0] == i + 1


def test_a_turned_tool_is_turned_with_the_frame_it_belongs_to():
    rng = np.random.default_rng(0)
    planted = Rotation.random(rng=rng)
    axes = [np.array([np.eye(3), Rotation.random(rng=rng).as_matrix()]) for _ in range(4)]
    noise = [Rotation.from_rotvec(0.02 * rng.standard_normal((100, 3))) for _ in range(4)]
    first = [Rotation.from_matrix(np.tile(a[1], (50, 1, 1))) * planted for a in axes]
    then = Rotation.from_matrix(np.tile(np.eye(3), (50, 1, 1)))
    turns = [Rotation.concatenate([one, then]) * n for one, n in zip(first, noise, strict=True)]
    learned = learn_orientations([turn.as_quat(scalar_first=True) for turn in turns], axes, DT)
    assert np.abs(np.flatnonzero(np.diff(learned.frame)) - 49).max() < 15
    assert learned.frame[0] == 1
    assert learned.frame[-1] == 0
    found = Rotation.from_quat(learned.quaternion, scalar_first=True)
    assert (planted.inv() * found[:30]).magnitude().max() < 0.1
    assert found[-30:].magnitude().max() < 0.1


def test_the_orientation_of_a_single_demonstration_belongs_to_the_first_frame():
    rng = np.random.default_rng(1)
    for _ in range(20):
        axes = np.array([np.eye(3), *Rotation.random(2, rng=rng).as_matrix()])
        turns = Rotation.from_rotvec(np.cumsum(0.02 * rng.standard_normal((100, 3)), axis=0)) * Rotation.random(rng=rng)
        assert not learn_orientations([turns.as_quat(scalar_first=True)], [axes], DT).frame.any()


def test_the_cheapest_sequence_is_the_cheapest_of_all():
    rng = np.random.default_rng(0)
    for _ in range(20):
        costs = rng.uniform(size=(6, 3))
        every = np.array(list(itertools.product(range(3), repeat=6)))
        total = costs[np.arange(6), every].sum(axis=1) + 0.3 * (np.diff(every, axis=1) != 0).sum(axis=1)
        assert np.array_equal(cheapest_sequence(costs, 0.3), every[np.argmin(total)])


def test_a_file_keeps_the_skill(skill, tmp_path):
    skill.save(tmp_path / "skill.npz")
    pose = board_pose(np.random.default_rng(8))
    assert np.array_equal(
        draw(load_skill(tmp_path / "skill.npz"), pose, 4.0)[1].position, draw(skill, pose, 4.0)[1].position
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("press_force", lambda a: a[:, :1]), ("press_force", lambda a: a * np.nan), ("press_frame", lambda a: a + 2),
        ("press_frame", lambda a: a - 1), ("press_frame", lambda a: a[:-1]), ("press_frame", lambda a: 0.5 * a),
        ("orientation_quaternion", lambda a: a[:, :2]), ("orientation_quaternion", lambda a: a[:0]),
        ("orientation_frame", lambda a: a + 10**8), ("hand", lambda a: np.zeros((len(a), 4))), ("hand", lambda a: a[1:]),
        ("path_activations", lambda a: a[:, :1]), ("path_places", lambda a: a[..., :2]), ("path_places", lambda a: a[:1]),
        ("path_response", lambda a: a[:2]),
        ("frames", lambda a: []), ("frames", lambda a: [*a, "lid"]), ("frames", lambda a: "b"), ("frames", lambda a: [0]),
        ("dt", lambda a: -a), ("dt", lambda a: np.inf), ("dt", str), ("generator", lambda a: "fixed"),
        ("layout", lambda a: a | {"hand_low": [0.0] * 4, "hand_high": [1.0] * 4}),
        ("layout", lambda a: a | {"hand_low": 3.0}), ("layout", lambda a: a | {"workspace_low": [-1.0, -1.0]}),
        ("layout", lambda a: a | {"workspace_low": a["workspace_high"]}), ("layout", lambda a: a | {"alpha": 0.0}),
        ("layout", lambda a: a | {"beta": np.nan}), ("layout", lambda a: a | {"force_limit": "much"}),
    ],
)  # fmt: skip
def test_files_whose_parts_do_not_fit_are_refused(skill, tmp_path, name, value):
    skill.save(tmp_path / "skill.npz")
    with np.load(tmp_path / "skill.npz") as file:
        arrays = {key: file[key] for key in file.files}
    header = json.loads(str(arrays["header"]))
    changed = arrays if name in arrays else header["values"]
    changed[name] = value(changed[name])
    np.savez(tmp_path / "changed.npz", **arrays | {"header": np.array(json.dumps(header))})
    with pytest.raises(SkillFileError, match="damaged"):
        load_skill(tmp_path / "changed.npz")


@pytest.mark.parametrize(
    "learner", [ReplayLearner(), ProMPLearner(), DMPLearner(), VarDMPLearner(), TPGMMLearner(3, 1e-3, 2), GMRLearner(3)]
)
def test_every_array_of_a_path_has_the_size_of_the_others(learner, taught):
    skill = learner.fit(taught[:2]).skill_
    values, arrays = skill.to_arrays()
    facts = {"env_id": skill.env_id, "taught_seeds": (), "metadata": {}}
    PathSkill.from_arrays(values, arrays, **facts)
    for name in (key for key in arrays if key.startswith("path_")):
        wrong = [arrays[name][..., None], *(np.repeat(arrays[name], 3, axis) for axis in range(arrays[name].ndim))]
        wrong += [arrays[name] + 99, -1 - arrays[name]] if name in ("path_start", "path_frame") else []
        for array in wrong:
            with pytest.raises(ValueError, match="does not fit the rest"):
                PathSkill.from_arrays(values, arrays | {name: array}, **facts)


def test_bad_demonstrations_are_refused(taught):
    one = taught[0]
    broken = dict(one.observations) | {"frame_board": np.full_like(one.observations["frame_board"], np.nan)}
    with pytest.raises(DemonstrationError, match="frame of demonstration 1"):
        MoALearner().fit([one, dataclasses.replace(one, observations=broken)])
    still = np.tile(HOME, (50, 1))
    with pytest.raises(DemonstrationError, match="never moves"):
        MoALearner().fit([demonstration(0, still, np.zeros((50, 6)), board_pose(np.random.default_rng(0)))])
