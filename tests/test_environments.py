"""What every environment of the registry keeps: a new row inherits these tests."""

import copy
import json
import pickle
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from registered import IDS, actions, assert_equal, make, trajectory

from lfd_gym import wam
from lfd_gym.errors import InvalidActionError, InvalidArgumentError, UnknownNameError
from lfd_gym.registry import ENVIRONMENTS, load

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module", params=IDS)
def env(request: pytest.FixtureRequest) -> Any:
    return make(request.param)


# the programming interface


def test_gymnasiums_checker_is_content(env: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*not within the observation space.*", category=DeprecationWarning)
        check_env(gymnasium.make(env.spec.id).unwrapped, skip_render_check=True)


def test_stable_baselines_checker_is_content(env: Any) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="the rl extra is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(make(env.spec.id), warn=True, skip_render_check=True)


def test_gymnasiums_checker_of_mujoco_resets_is_content(env: Any) -> None:
    utils = pytest.importorskip("gymnasium.envs.mujoco.utils", reason="needs imageio", exc_type=ImportError)
    utils.check_mujoco_reset_state(make(env.spec.id), seed=3)


def test_observations_lie_in_their_space_under_any_action(env: Any) -> None:
    observation, _ = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    for action in actions(env, 300):
        observation, reward, _, _, info = env.step(action)
        assert env.observation_space.contains(observation)
        assert all(np.isfinite(value).all() for value in observation.values())
        assert 0.0 <= reward <= 1.0
        assert not info["broken"]


def test_the_info_has_the_same_keys_and_types_always(env: Any) -> None:
    _, first = env.reset(seed=1)
    assert {"is_success", "success"} <= set(first)
    assert [f"subtask/{name}" for name in env.subtasks] == [key for key in first if key.startswith("subtask/")]
    for action in actions(env, 30):
        info = env.step(action)[-1]
        assert {key: type(value) for key, value in info.items()} == {key: type(value) for key, value in first.items()}
        assert info["success"] == info["is_success"]


def test_quaternions_have_a_sign_and_unit_length_along_the_way(env: Any) -> None:
    observation, _ = env.reset(seed=2)
    for action in actions(env, 100):
        for name in env.frames:
            pose = observation[f"frame_{name}"]
            assert pose[3] >= 0.0
            assert np.linalg.norm(pose[3:]) == pytest.approx(1.0, abs=1e-9)
        for key in ("tool_quaternion", "reference_quaternion"):
            assert observation[key] @ env.action_layout.reference_quaternion >= 0.0
            assert np.linalg.norm(observation[key]) == pytest.approx(1.0, abs=1e-9)
        observation = env.step(action)[0]


def test_an_orientation_has_one_quaternion_however_the_simulation_writes_it(env: Any) -> None:
    """The bodies' quaternions are negated, and the wrist turns beyond where a matrix gives a quaternion of the other sign."""
    env.reset(seed=2)
    model, data, seen = env.model, env.data, env._observe()
    data.mocap_quat[:] *= -1.0
    for first in model.jnt_qposadr[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]:
        data.qpos[first + 3 : first + 7] *= -1.0
    for turn in (-2.5, 2.5):
        data.qpos[6] = turn
        mujoco.mj_forward(model, data)
        again = env._observe()
        for name in env.frames:
            np.testing.assert_array_equal(again[f"frame_{name}"], seen[f"frame_{name}"])
        assert again["tool_quaternion"] @ env.action_layout.reference_quaternion > 0.0


def test_the_dense_reward_stays_below_that_of_success(env: Any) -> None:
    dense = make(env.spec.id, reward_type="dense")
    dense.reset(seed=1)
    rewards = [dense.step(action)[1] for action in actions(dense, 100)]
    assert 0.0 <= min(rewards) <= max(rewards) < 1.0
    assert max(rewards) > 0.0
    env.reset(seed=1)
    assert {env.step(action)[1] for action in actions(env, 100)} == {0.0}


def test_unusable_actions_are_refused(env: Any) -> None:
    env.reset(seed=0)
    bad = env.action_space.sample()
    bad[2] = np.nan
    with pytest.raises(InvalidActionError, match="component 2"):
        env.step(bad)
    with pytest.raises(InvalidActionError, match="expected"):
        env.step(np.zeros(3))


def test_an_action_may_lie_anywhere_in_memory(env: Any) -> None:
    wide = np.linspace(-1.0, 1.0, 2 * env.action_space.shape[0]).reshape(-1, 2)
    for action in (wide[:, 0], wide[::-1, 1]):
        env.reset(seed=0)
        expected = env.step(action.copy())[0]
        env.reset(seed=0)
        assert_equal(env.step(action)[0], expected)


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("control_hz", 30.0),
        ("control_hz", 0.0),
        ("control_hz", -50.0),
        ("control_hz", 1000.0),
        ("reward_type", "shaped"),
        ("fingertip_friction", 1.3),
        ("fingertip_friction", 0.0),
        ("render_mode", "ascii"),
        ("terminate_on_success", "yes"),
        ("width", 0),
        ("height", "tall"),
    ],
)
def test_impossible_arguments_are_refused(argument: str, value: object) -> None:
    for env_id in IDS:
        with pytest.raises(InvalidArgumentError, match=argument):
            load(ENVIRONMENTS[env_id].entry_point)(**{argument: value})


@pytest.mark.parametrize("camera", ["overveiw", None])
def test_an_unknown_camera_is_refused_before_the_first_picture(camera: Any) -> None:
    with pytest.raises(UnknownNameError, match=f"no camera .{camera}.*overview"):
        make(IDS[0], camera=camera)


def test_the_time_limit_is_in_seconds_at_any_rate(env: Any) -> None:
    assert env.time_limit == ENVIRONMENTS[env.spec.id].seconds
    slow = make(env.spec.id, control_hz=25.0)
    observation, _ = slow.reset(seed=0)
    assert slow.dt == 0.04
    action = slow.action_layout.encode(
        observation["tool_position"], observation["tool_quaternion"], hand=observation.get("hand_position", ())
    )
    slow.step(action)
    assert slow.data.time == pytest.approx(0.04)
    slow.data.time = slow.time_limit - 1.0
    ends = [slow.step(action)[3] for _ in range(25)]
    assert ends == [False] * 24 + [True]


def test_the_step_follows_the_control_rate(env: Any) -> None:
    """Ten decisions per second that keep their goal move the robot as fifty do."""
    ends = []
    for hz in (10.0, 50.0):
        other = make(env.spec.id, control_hz=hz)
        other.reset(seed=4)
        for action in actions(other, 20)[::10]:
            for _ in range(round(hz)):
                observation = other.step(action)[0]
        ends.append(observation["joint_position"])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-9)


@pytest.mark.parametrize("hz", [10.0, 50.0])
def test_success_must_hold_for_a_second_without_interruption(env: Any, hz: float) -> None:
    world, second = make(env.spec.id, control_hz=hz), round(hz)
    shown = [True] * second + [False] + [True] * (second + 1)
    world.succeeded = lambda: True
    assert not world.reset(seed=1)[1]["is_success"]
    found = []
    for action, done in zip(actions(world, len(shown)), shown, strict=True):
        world.succeeded = lambda done=done: done
        _, reward, terminated, _, info = world.step(action)
        found.append((info["is_success"], terminated, reward))
    assert found == [(False, False, 0.0)] * (2 * second + 1) + [(True, True, 1.0)]
    world.reset(seed=1)
    assert not world.step(action)[-1]["is_success"]


def test_a_moment_is_no_second_and_a_broken_simulation_no_success(env: Any) -> None:
    world = make(env.spec.id, control_hz=1.0)
    world.reset(seed=1)
    world.succeeded = lambda: True
    action = np.zeros(world.action_space.shape, np.float32)
    assert not world.step(action)[-1]["is_success"]
    world.data.qvel[0] = np.nan
    _, reward, terminated, _, info = world.step(action)
    assert (info["broken"], info["is_success"], terminated, reward) == (True, False, True, 0.0)


# copies and vectors


def test_an_environment_can_be_pickled_and_copied(env: Any) -> None:
    original = make(env.spec.id, control_hz=25.0, reward_type="dense")
    for twin in (pickle.loads(pickle.dumps(original)), copy.deepcopy(original)):
        assert (twin.dt, twin.reward_type) == (0.04, "dense")
        assert twin.spec == original.spec
        assert_equal(original.reset(seed=5)[0], twin.reset(seed=5)[0])
        commands = actions(env, 20)
        np.testing.assert_array_equal(trajectory(original, commands), trajectory(twin, commands))
    with pytest.raises(gymnasium.error.ResetNeeded, match="copy"):
        copy.deepcopy(original).step(commands[0])


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_gymnasium_vectors_are_two_single_environments(env: Any, mode: str) -> None:
    vector = gymnasium.make_vec(env.spec.id, num_envs=2, vectorization_mode=mode)
    try:
        observations, _ = vector.reset(seed=[7, 8])
        commands = actions(env, 20)
        for action in commands:
            observations, *_ = vector.step(np.stack([action, -action]))
    finally:
        vector.close()
    for i, sign in enumerate((1, -1)):
        env.reset(seed=7 + i)
        for action in commands:
            last = env.step(sign * action)[0]
        assert_equal(last, {key: rows[i] for key, rows in observations.items()})


def test_stable_baselines_runs_two_in_processes(env: Any) -> None:
    vectors = pytest.importorskip("stable_baselines3.common.vec_env", reason="the rl extra is not installed")
    vector = vectors.SubprocVecEnv([lambda: gymnasium.make(env.spec.id)] * 2, start_method="fork")
    try:
        vector.seed(7)
        observations = vector.reset()
    finally:
        vector.close()
    for i in range(2):
        assert_equal(env.reset(seed=7 + i)[0], {key: rows[i] for key, rows in observations.items()})


# seeds and states


def test_a_seeded_reset_is_the_same_after_a_dirty_episode(env: Any) -> None:
    commands = actions(env, 50)
    first, info = env.reset(seed=11)
    state, path = env.get_state(), trajectory(env, commands)
    env.reset(seed=99)
    trajectory(env, actions(env, 100, seed=1))
    again, info_again = env.reset(seed=11)
    assert_equal(first, again)
    assert info == info_again
    np.testing.assert_array_equal(env.get_state(), state)
    np.testing.assert_array_equal(trajectory(env, commands), path)


def test_different_seeds_give_different_setups(env: Any) -> None:
    setups = [json.dumps(env.reset(seed=seed) and env.setup()) for seed in range(8)]
    assert len(set(setups)) == 8


def test_unseeded_resets_continue_the_seeded_stream(env: Any) -> None:
    env.reset(seed=12)
    second = env.reset()[0]
    env.reset(seed=12)
    trajectory(env, actions(env, 5))
    assert_equal(env.reset()[0], second)


def test_a_state_is_restored_exactly(env: Any) -> None:
    env.reset(seed=13)
    trajectory(env, actions(env, 60))
    state = env.get_state()
    commands = actions(env, 100, seed=2)
    path, following = trajectory(env, commands), env.reset()[0]
    env.reset(seed=14)
    env.set_state(state)
    np.testing.assert_array_equal(env.get_state(), state)
    np.testing.assert_array_equal(trajectory(env, commands), path)
    assert_equal(env.reset()[0], following)


def test_what_is_no_state_is_refused_and_changes_nothing(env: Any) -> None:
    state = env.get_state()
    for bad, reason in ((np.zeros(3), r"expected \("), (np.append(state[:-1], np.nan), "random generator")):
        with pytest.raises(InvalidArgumentError, match=reason):
            env.set_state(bad)
        np.testing.assert_array_equal(env.get_state(), state)


ELSEWHERE = """
import json, sys
import gymnasium, numpy as np
import lfd_gym
sys.path.insert(0, sys.argv[1])
from registered import actions, make, trajectory
given, found = np.load(sys.argv[2]), {}
for env_id in json.loads(sys.argv[3]):
    env = make(env_id)
    env.set_state(given[env_id])
    found[env_id + ":path"] = trajectory(env, actions(env, 100, seed=2))
    found[env_id + ":next"] = np.concatenate(list(env.reset()[0].values()))
    first, _ = env.reset(seed=11)
    found[env_id + ":first"] = np.concatenate(list(first.values()))
    found[env_id + ":state"] = env.get_state()
np.savez(sys.argv[4], **found)
"""


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """States of all environments, and what a fresh process makes of them."""
    folder = tmp_path_factory.mktemp("states")
    states = {}
    for env_id in IDS:
        env = make(env_id)
        env.reset(seed=13)
        trajectory(env, actions(env, 60))
        states[env_id] = env.get_state()
    np.savez(folder / "states.npz", **states)
    arguments = [str(ROOT / "tests"), str(folder / "states.npz"), json.dumps(IDS), str(folder / "found.npz")]
    subprocess.run([sys.executable, "-c", ELSEWHERE, *arguments], check=True, cwd=ROOT, timeout=120)
    return {**np.load(folder / "found.npz"), **{f"{key}:given": state for key, state in states.items()}}


def test_a_fresh_process_resets_bitwise_equally(env: Any, elsewhere: dict[str, np.ndarray]) -> None:
    first, _ = env.reset(seed=11)
    np.testing.assert_array_equal(np.concatenate(list(first.values())), elsewhere[f"{env.spec.id}:first"])
    np.testing.assert_array_equal(env.get_state(), elsewhere[f"{env.spec.id}:state"])


def test_a_fresh_process_continues_a_state_exactly(env: Any, elsewhere: dict[str, np.ndarray]) -> None:
    env.reset(seed=0)
    env.set_state(elsewhere[f"{env.spec.id}:given"])
    path = trajectory(env, actions(env, 100, seed=2))
    np.testing.assert_array_equal(path, elsewhere[f"{env.spec.id}:path"])
    np.testing.assert_array_equal(np.concatenate(list(env.reset()[0].values())), elsewhere[f"{env.spec.id}:next"])


# honest physics


def test_the_arm_begins_at_rest_with_the_tool_down(env: Any) -> None:
    observation, _ = env.reset(seed=51)
    np.testing.assert_array_equal(observation["joint_velocity"], 0.0)
    np.testing.assert_allclose(np.abs(observation["tool_quaternion"] @ wam.TOOL_DOWN), 1.0, atol=1e-9)
    np.testing.assert_allclose(observation["reference_position"], observation["tool_position"], atol=1e-12)
    assert np.linalg.norm(observation["wrench"][:3]) < 1.0


def test_nothing_helps_the_hand(env: Any) -> None:
    model = env.model
    robot = model.body_rootid == model.body("wam_base").id
    assert not (model.actuator_trntype == mujoco.mjtTrn.mjTRN_BODY).any(), "adhesion"
    actuated = model.jnt_bodyid[model.actuator_trnid[:, 0]]
    assert (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).all()
    assert robot[actuated].all(), "an object moves itself"
    for i in range(model.neq):
        first, second = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
        kind = mujoco.mjtEq(model.eq_type[i])
        if kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            assert model.eq_objtype[i] == mujoco.mjtObj.mjOBJ_BODY
            assert not robot[[first, second]].any(), "something is welded to the robot"
            assert "nut" in (model.body(first).name, model.body(second).name)
        elif kind == mujoco.mjtEq.mjEQ_JOINT:
            assert robot[model.jnt_bodyid[first]] == (second < 0 or robot[model.jnt_bodyid[second]])
        else:
            assert kind == mujoco.mjtEq.mjEQ_TENDON
            assert model.tendon(first).name == "thread"
    for i in range(model.nwrap):
        if model.wrap_type[i] == mujoco.mjtWrap.mjWRAP_JOINT:
            assert not robot[model.jnt_bodyid[model.wrap_objid[i]]], "a tendon pulls at the robot"
    mocap = model.body_mocapid >= 0
    assert not mocap[robot].any()


def test_gravity_and_friction_are_the_worlds(env: Any) -> None:
    model = env.model
    env.reset(seed=52)
    np.testing.assert_array_equal(model.opt.gravity, [0, 0, -9.81])
    np.testing.assert_array_equal(model.body_gravcomp, 0.0)
    assert model.opt.disableflags == int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    assert model.geom_friction[:, 0].max() <= wam.MAX_FINGERTIP_FRICTION
    solid = (model.geom_contype > 0) | (model.geom_conaffinity > 0)
    assert (model.geom_solref[solid, 0] >= 2 * model.opt.timestep).all()
    assert (model.geom_margin == 0.0).all()


def test_the_solver_is_one_that_is_right(env: Any) -> None:
    assert mujoco.__version__ != "4.0.0"
    assert env.model.opt.jacobian == mujoco.mjtJacobian.mjJAC_DENSE
    assert env.model.opt.timestep == env.physics_dt == 0.002


def test_every_resettable_body_and_joint_has_a_name(env: Any) -> None:
    model = env.model
    assert all(model.body(i).name for i in range(model.nbody))
    assert all(model.joint(i).name for i in range(model.njnt))
    assert all(model.actuator(i).name for i in range(model.nu))


def test_a_reset_does_not_compile_the_model_anew(env: Any) -> None:
    model, data = env.model, env.data
    env.reset(seed=1)
    env.reset(seed=2)
    assert env.model is model
    assert env.data is data


def test_a_broken_simulation_ends_the_episode() -> None:
    env = make(IDS[0], reward_type="dense")
    observation, _ = env.reset(seed=0)
    env.data.qvel[3] = np.nan
    last, reward, terminated, _, info = env.step(np.zeros(env.action_space.shape))
    assert info["broken"]
    assert terminated
    assert reward == 0.0
    assert env.observation_space.contains(last)
    again, info = env.reset(seed=0)
    assert not info["broken"]
    assert_equal(observation, again)
    state, paid = env.get_state(), env.reward()
    env.data.qvel[3] = np.nan
    env.step(np.zeros(env.action_space.shape))
    env.set_state(state)
    assert env.reward() == paid > 0.0
