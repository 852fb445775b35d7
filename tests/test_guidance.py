"""Kinesthetic teaching: an outside hand leads the arm, the wrist sensor feels the world and not the hand (thesis 3.1.2)."""

import mujoco
import numpy as np
import pytest

from lfd_gym.demonstration import Demonstration
from lfd_gym.errors import InvalidArgumentError
from lfd_gym.guidance import MOST_DAMPING, Impedance
from lfd_gym.recording import record
from lfd_gym.registry import ENVIRONMENTS, look_up, make
from policies.reinforcement.demonstrated_decisions import check_observed, view_of
from scripted_teachers import TEACHERS

SEED = 300000


def led(env_id: str, shift: tuple[float, float, float], force: tuple[float, float, float], seconds: float):
    """An environment whose tool a hand leads to `shift` from the start within the first second, pressing with `force`."""
    env = make(env_id, terminate_on_success=False)
    observation, _ = env.reset(seed=SEED)
    start, quaternion = observation["tool_position"].copy(), observation["tool_quaternion"].copy()
    action = env.unwrapped.action_layout.encode(
        start + 0.2, quaternion, hand=observation.get("hand_position", np.empty(0))
    )
    seen = []
    for t in np.arange(0.0, seconds, env.unwrapped.dt):
        way = min(t, 1.0) * np.array(shift)
        twist = np.concatenate([np.array(shift) * (t < 1.0), np.zeros(3)])
        env.unwrapped.set_guidance(np.concatenate([start + way, quaternion, twist, force]))
        observation, *_ = env.step(action)
        seen.append(observation)
    return env, seen, start + np.array(shift)


@pytest.mark.parametrize("env_id", ["move-object", "whiteboard"])
def test_the_tool_goes_where_the_hand_leads_it_and_rests_there(env_id: str) -> None:
    _, seen, goal = led(env_id, (0.05, -0.05, -0.05), (0.0, 0.0, 0.0), 3.0)
    last = np.array([observation["tool_position"] for observation in seen[-25:]])
    assert np.linalg.norm(last - goal, axis=1).max() < 0.012
    assert np.ptp(last, axis=0).max() < 1e-3
    assert np.abs(seen[-1]["tool_velocity"]).max() < 0.01


def test_in_the_air_the_wrist_sensor_does_not_feel_the_hand() -> None:
    env, seen, _ = led("move-object", (0.05, -0.05, -0.05), (0.0, 0.0, 0.0), 3.0)
    hand = env.unwrapped.data.xfrc_applied[env.unwrapped.model.body("wam_link_7").id, :3]
    assert np.linalg.norm(hand) > 0.5
    assert np.abs(seen[-1]["wrench"][:3]).max() < 0.05


def test_pressing_on_something_the_wrist_sensor_reads_the_contacts_and_nothing_else() -> None:
    env, seen, _ = led("move-object", (0.0, 0.0, 0.0), (0.0, 0.0, -12.0), 8.0)
    model, data = env.unwrapped.model, env.unwrapped.data
    total, one = np.zeros(3), np.zeros(6)
    for i, contact in enumerate(data.contact[: data.ncon]):
        of_hand = [model.geom(geom).name.startswith("hand/") for geom in contact.geom]
        if any(of_hand):
            mujoco.mj_contactForce(model, data, i, one)
            total += (1 if of_hand[1] else -1) * contact.frame.reshape(3, 3).T @ one[:3]
    assert total[2] > 5.0
    assert np.mean([o["wrench"][:3] for o in seen[-25:]], axis=0) == pytest.approx(total, abs=0.4)


def test_guided_the_pose_goals_are_ignored_and_the_fingers_obey() -> None:
    env = make("move-object", terminate_on_success=False)
    observation, _ = env.reset(seed=SEED)
    start = observation["tool_position"].copy()
    closed = np.array([0.0, 1.5, 1.5, 1.5])
    action = env.unwrapped.action_layout.encode(start + 0.1, observation["tool_quaternion"], hand=closed)
    env.unwrapped.set_guidance(np.concatenate([start, observation["tool_quaternion"], np.zeros(9)]))
    for _ in range(100):
        observation, *_ = env.step(action)
    assert np.linalg.norm(observation["tool_position"] - start) < 0.01
    assert observation["hand_position"] == pytest.approx(closed, abs=0.1)
    env.unwrapped.set_guidance(None)
    for _ in range(100):
        observation, *_ = env.step(action)
    assert np.linalg.norm(observation["tool_position"] - start) > 0.05


def test_a_light_tool_is_held_softly_and_a_heavy_one_as_it_is() -> None:
    heavy, light = np.full(6, 0.1), np.array([0.1, 0.1, 50.0, 0.1, 0.1, 2000.0])
    assert Impedance().holding(heavy, 0.002) == Impedance()
    soft = Impedance().holding(light, 0.002)
    assert 0.002 * soft.damping * 50.0 == pytest.approx(MOST_DAMPING)
    assert soft.turn_damping[:2] == Impedance().turn_damping[:2]
    assert soft.turn_stiffness[2] / soft.turn_damping[2] == pytest.approx(20.0 / 1.5)


@pytest.mark.parametrize("guidance", [np.zeros(5), np.full(6, np.nan), np.zeros((2, 8))])
def test_guidance_that_is_none_is_refused(guidance: np.ndarray) -> None:
    env = make("move-object")
    env.reset(seed=SEED)
    with pytest.raises(InvalidArgumentError, match="6 or 16 finite numbers"):
        env.unwrapped.set_guidance(guidance)
    other = make("move-object")
    other.reset(seed=SEED)
    goal = np.ones(env.action_space.shape)
    np.testing.assert_array_equal(env.step(goal)[0]["tool_position"], other.step(goal)[0]["tool_position"])


def shown(env_id: str, noise: float) -> Demonstration:
    teacher = look_up(TEACHERS, "teacher for", env_id)(noise=noise, mode="kinesthetic")
    return record(env_id, teacher, 1, seed=SEED).demonstrations[0]


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_every_task_can_be_shown_by_hand(env_id: str) -> None:
    demonstration = shown(env_id, 1.0)
    assert demonstration.success
    assert demonstration.actions_derived
    assert len(set(demonstration.labels)) >= min(4, len(demonstration.primitives))


def test_agents_are_warned_of_what_no_decision_can_do() -> None:
    demonstration = shown("lfd_gym/MoveObject-v0", 1.0)
    with pytest.warns(UserWarning, match="a hand guided the arm in demonstration 0"):
        check_observed([demonstration], view_of(demonstration))


def test_a_hand_moves_like_a_human() -> None:
    demonstration = shown("lfd_gym/MoveObject-v0", 1.0)
    first = demonstration.observations["tool_velocity"][: int(np.argmax(demonstration.labels != 0))]
    speed = np.linalg.norm(first[:, :3], axis=1)
    moving = speed[speed > 0.02]
    assert 1.4 < moving.max() / moving.mean() < 2.6, "bell-shaped: a minimum jerk has a ratio of 1.9"
    assert speed[0] < 0.02
    clean = shown("lfd_gym/MoveObject-v0", 0.0)
    assert len(clean) != len(demonstration)
