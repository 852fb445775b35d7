"""A recorded demonstration can be replayed: by its states, and bitwise by its actions."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lfd_gym.demonstration import Demonstration, load_demonstrations, save_demonstrations
from lfd_gym.recording import record
from lfd_gym.registry import look_up, make
from scripted_teachers import TEACHERS


@pytest.fixture(scope="module")
def env() -> Any:
    return make("move-object").unwrapped


@pytest.fixture(scope="module")
def demonstration(tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    """As it comes back from a file."""
    teacher = look_up(TEACHERS, "teacher", "lfd_gym/MoveObject-v0")(noise=1.0)
    path: Path = tmp_path_factory.mktemp("demonstrations") / "one.h5"
    save_demonstrations(path, record("move-object", teacher, 1, seed=3).demonstrations)
    return load_demonstrations(path)[0]


def test_its_actions_replay_it_bitwise(env: Any, demonstration: Demonstration) -> None:
    observation, _ = env.reset(seed=demonstration.seed["reset"])
    assert env.setup() == demonstration.setup
    for t, action in enumerate(demonstration.actions):
        for key, rows in demonstration.observations.items():
            np.testing.assert_array_equal(observation[key], rows[t], err_msg=f"{key} at step {t}")
        np.testing.assert_array_equal(env.get_state(), demonstration.states[t])
        observation, reward, _, _, info = env.step(action)
        assert reward == demonstration.rewards[t]
    for key, rows in demonstration.observations.items():
        np.testing.assert_array_equal(observation[key], rows[-1])
    assert info["is_success"] == demonstration.success


def test_each_state_is_the_moment_that_was_observed(env: Any, demonstration: Demonstration) -> None:
    """The wrench is a mean over the step before; all else is seen again when a state is restored."""
    env.reset(seed=0)
    for t in range(0, len(demonstration) + 1, 23):
        env.set_state(demonstration.states[t])
        observation = env._observe()
        for key, rows in demonstration.observations.items():
            if key not in ("wrench", "hand_torque"):
                np.testing.assert_array_equal(observation[key], rows[t], err_msg=f"{key} at step {t}")


def test_each_step_follows_from_its_state_and_action(env: Any, demonstration: Demonstration) -> None:
    env.reset(seed=0)
    for t in range(0, len(demonstration), 23):
        env.set_state(demonstration.states[t])
        observation, *_ = env.step(demonstration.actions[t])
        for key, rows in demonstration.observations.items():
            np.testing.assert_array_equal(observation[key], rows[t + 1], err_msg=f"{key} after step {t}")
        np.testing.assert_array_equal(env.get_state(), demonstration.states[t + 1])


def test_labels_and_actions_belong_to_the_observation_before_them(env: Any, demonstration: Demonstration) -> None:
    """The reference that the last observation shows has moved towards the goals that were commanded before it."""
    layout = env.action_layout
    reference = demonstration.observations["reference_position"]
    towards = 0
    for t, action in enumerate(demonstration.actions):
        goal = layout.decode(action).position
        gap = goal - reference[t]
        if np.linalg.norm(gap) > 0.02:
            towards += 1
            assert (reference[t + 1] - reference[t]) @ gap > 0.0
    assert towards > 20
