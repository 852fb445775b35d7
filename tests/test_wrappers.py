"""The RL view: one design for every task, from observations alone, in which finishing pays."""

import json
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RescaleAction

from lfd_gym.errors import InvalidActionError, InvalidArgumentError
from lfd_gym.evaluation import check_fits, describe
from lfd_gym.registry import ENVIRONMENTS, dense_id, look_up, make
from lfd_gym.rollout import TeacherPolicy, rollout
from lfd_gym.view import View, environment_class
from lfd_gym.view_policy import ViewPolicy
from lfd_gym.wrappers import RLView, SeededEpisodes
from scripted_teachers import TEACHERS


def view(env_id: str, **kwargs: object) -> RLView:
    return RLView(make(env_id, terminate_on_success=False, **kwargs))


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_view_passes_the_peers_checkers(env_id: str) -> None:
    env = view(env_id)
    check_env(env, skip_render_check=True)
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker", reason="the rl extra is not installed")
    sb3.check_env(env)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_no_motion_is_asked_for_by_a_zero_decision(env_id: str) -> None:
    env = view(env_id)
    env.reset(seed=100000)
    start = env.unwrapped.data.site(f"{env.unwrapped.tool}/tool").xpos.copy()
    action = np.zeros(env.action_space.shape)
    if "grip" in env.view.controls:
        action[env.view.controls.index("grip")] = -1.0
    for _ in range(10):
        env.step(action)
    assert np.linalg.norm(env.unwrapped.data.site(f"{env.unwrapped.tool}/tool").xpos - start) < 2e-3


def test_a_decision_lasts_a_tenth_of_a_second_whatever_the_control_rate() -> None:
    for control_hz in (50, 100, 10):
        env = view("move-object", control_hz=control_hz)
        env.reset(seed=100000)
        before = env.unwrapped.data.time
        env.step(np.zeros(env.action_space.shape))
        assert env.unwrapped.data.time - before == pytest.approx(0.1)
    with pytest.raises(InvalidArgumentError, match="ten decisions"):
        view("move-object", control_hz=25)


@pytest.mark.parametrize("name", ["move-object", "whiteboard"])
def test_an_agent_of_the_view_acts_below_it_as_in_it(name: str) -> None:
    class Agent:
        def predict(self, seen: np.ndarray, deterministic: bool) -> tuple[np.ndarray, None]:
            assert deterministic
            return np.cos(1e3 * seen[: env.action_space.shape[0]]), None

    env, native, agent = view(name), make(name, terminate_on_success=False), Agent()
    seen, _ = env.reset(seed=100000)
    policy = ViewPolicy(agent, env.view)
    check_fits(policy, native)
    with pytest.raises(InvalidArgumentError, match="was taught for"):
        check_fits(policy, make("light-bulb" if name != "light-bulb" else "move-object"))
    assert describe(policy) == "ViewPolicy (Agent)"
    for i, step in zip(range(100), rollout(native, policy, 100000), strict=False):
        if i % env.view.repeats == 0:
            np.testing.assert_array_equal(env.view.flatten(step.observation), seen)
            seen, *_ = env.step(agent.predict(seen, deterministic=True)[0])


def test_views_without_a_seed_differ_and_wait_for_a_reset() -> None:
    env = view("move-object")
    with pytest.raises(gymnasium.error.ResetNeeded, match="RL view"):
        env.step(np.zeros(env.action_space.shape))
    assert not np.array_equal(env.reset()[0], view("move-object").reset()[0])
    with pytest.raises(InvalidArgumentError, match=r"gymnasium\.make"):
        RLView(environment_class("lfd_gym/MoveObject-v0")(terminate_on_success=False))


def test_view_refuses_environments_that_end_on_success_or_are_not_as_made_and_bad_actions() -> None:
    with pytest.raises(InvalidArgumentError, match="terminate_on_success=False"):
        RLView(make("move-object"))
    with pytest.raises(InvalidArgumentError, match="own actions"):
        RLView(RescaleAction(make("move-object", terminate_on_success=False), 0.0, 1.0))
    env = view("move-object")
    env.reset(seed=100000)
    for action in (np.zeros(3), np.full(5, np.nan)):
        with pytest.raises(InvalidActionError, match="5 finite numbers: x, y, z, yaw, grip"):
            env.step(action)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_finishing_pays_more_than_stopping_shortly_before(env_id: str) -> None:
    """The clean teacher's dense return over the whole time beats that of stopping at 95 % of its way."""
    env = make(dense_id(env_id), terminate_on_success=False)
    teacher = look_up(TEACHERS, "teacher for", env_id)(noise=0.0)
    steps = list(rollout(env, TeacherPolicy(teacher), 100000))
    finished = next(k for k, step in enumerate(steps) if step.info["is_success"])
    stop = int(0.95 * finished)
    whole = sum(step.reward for step in steps)
    stopped = sum(step.reward for step in steps[:stop]) + (len(steps) - stop) * steps[stop].reward
    assert whole > stopped + 0.01 * len(steps)


def test_episodes_have_the_seeds_that_evaluate_uses() -> None:
    env = SeededEpisodes(make("move-object"), 100000)
    first, second = env.reset()[0], env.reset()[0]
    plain = gymnasium.make("lfd_gym/MoveObject-v0")
    assert np.array_equal(first["frame_object"], plain.reset(seed=100000)[0]["frame_object"])
    assert np.array_equal(second["frame_object"], plain.reset(seed=100001)[0]["frame_object"])


def towards_the_edge(frame: Any, tool: np.ndarray) -> np.ndarray:
    along = frame.xmat.reshape(3, 3)[:, 2]
    return frame.xpos + ((tool - frame.xpos) @ along) * along - tool


def into_the_board(frame: Any, tool: np.ndarray) -> np.ndarray:
    return -frame.xmat.reshape(3, 3)[:, 2]


def upwards(frame: Any, tool: np.ndarray) -> np.ndarray:
    return np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("env_id", "right"),
    [("box-flipping", towards_the_edge), ("whiteboard", into_the_board), ("light-bulb", upwards)],
)
def test_a_press_points_from_the_tool_to_what_is_pressed(env_id: str, right: Callable[..., np.ndarray]) -> None:
    """Near every frame; a bulb is pulled."""
    env = view(env_id)
    world = env.unwrapped
    observation, _ = world.reset(seed=100000)
    action = np.zeros(env.action_space.shape)
    action[env.view.controls.index("press")] = 0.5
    for frame in map(world.data.body, world.frames):
        tool = observation["tool_position"] = frame.xpos + np.array([0.05, 0.03, 0.1])
        force = world.action_layout.decode(env.view.native_action(action, observation)).force
        assert np.linalg.norm(force) == pytest.approx(0.5 * world.action_layout.force_limit, rel=1e-3)
        direction = right(frame, tool)
        assert force @ direction > 0.9999 * np.linalg.norm(force) * np.linalg.norm(direction)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_a_decision_is_read_off_the_action_that_it_became(env_id: str) -> None:
    """Also beyond the speed limit, where the action that the decision becomes again pulls alike."""
    seen, rng = view(env_id).view, np.random.default_rng(0)
    observation, _ = make(env_id).reset(seed=100000)
    layout = seen.layout
    observation["reference_position"] = 0.5 * (layout.workspace_low + layout.workspace_high)
    for _ in range(20):
        decision = rng.uniform(-0.55, 0.55, len(seen.controls))
        read = seen.decision(seen.native_action(decision, observation), observation)
        if "press" in seen.controls and decision[-1] <= 0.0:
            decision[-1] = -1.0
        assert read == pytest.approx(decision, abs=1e-5)
    away = np.zeros(len(seen.controls))
    away[0] = 1.0
    far = layout.encode(layout.workspace_high * [1, 0, 0] + observation["reference_position"] * [0, 1, 1],
                        observation["reference_quaternion"], hand=np.full(layout.hand_low.size, 0.5))  # fmt: skip
    assert seen.decision(far, observation)[:3] == pytest.approx(away[:3], abs=1e-4)


def test_a_view_survives_json() -> None:
    seen = view("light-bulb").view
    assert View.from_dict(json.loads(json.dumps(seen.to_dict()))) == seen
