"""Setups: what a reset places where, what is refused, and what an observation does not show."""

import json
import math
import sys
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from placed_arm import inverse_kinematics
from registered import IDS, Observation, assert_equal, make

from lfd_gym import quaternion, wam
from lfd_gym.errors import InvalidArgumentError, InvalidSetupError


@pytest.fixture(scope="module", params=IDS)
def env(request: pytest.FixtureRequest) -> Any:
    return make(request.param)


def tracked(env: Any, observation: Observation) -> np.ndarray:
    return np.concatenate([observation[f"frame_{name}"] for name in env.frames])


def test_a_reset_places_what_the_options_ask(env: Any) -> None:
    wanted, _ = env.reset(seed=21)
    setup = env.setup()
    json.dumps(setup)
    for seed in (22, 23):
        got, _ = env.reset(seed=seed, options={"setup": setup})
        assert env.setup() == setup
        np.testing.assert_array_equal(tracked(env, got), tracked(env, wanted))


def test_a_frame_is_where_the_object_of_its_name_stands(env: Any) -> None:
    """Or, as `obstacle_edge`, at the same place of the object whose part it is, wherever that stands."""
    named = {name: name for name in set(env.frames) & set(env.setup())} or {"obstacle_edge": "obstacle"}
    places: dict[str, list[np.ndarray]] = {name: [] for name in named}
    for seed in (21, 22, 23):
        observation, _ = env.reset(seed=seed)
        for name, owner in named.items():
            pose = observation[f"frame_{name}"]
            axes = quaternion.to_matrix(pose[3:])[:2, :2]
            places[name].append(axes.T @ (pose[:2] - env.setup()[owner]["position"]))
    for name, owner in named.items():
        assert np.ptp(places[name], axis=0).max() < 1e-9
        assert name != owner or np.abs(places[name]).max() < 1e-9


def test_objects_that_are_not_named_stand_around_those_that_are(env: Any) -> None:
    env.reset(seed=24)
    name, pose = next(iter(env.setup().items()))
    others = set()
    for seed in range(25, 30):
        env.reset(seed=seed, options={"setup": {name: pose}})
        setup = env.setup()
        assert setup[name] == pose
        others.add(json.dumps({key: value for key, value in setup.items() if key != name}))
    assert len(others) == (5 if len(setup) > 1 else 1)


def test_what_is_hidden_is_not_in_the_first_observation(env: Any) -> None:
    env.reset(seed=31)
    setup = env.setup()
    observations, hidden = [], []
    for seed in (32, 33):
        observations.append(env.reset(seed=seed, options={"setup": setup})[0])
        hidden.append(np.concatenate([*(view.ravel() for view in env._randomised), env._hidden]))
    assert not np.array_equal(*hidden), "nothing varies"
    assert_equal(*observations)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": [2.0, 0.0]}, "out of reach|possible"),
        ({"position": [0.6, 0.9]}, "out of reach|possible"),
        ({"position": [np.nan, 0.0]}, "expected|possible"),
        ({"position": [0.6]}, "expected|possible"),
        ({"position": "here"}, "expected|possible"),
        ({"position": ["0.6", "0.1"]}, "expected|possible"),
        ({"position": [[0.6], 0.1]}, "expected|possible"),
        ({"yaw": np.nan}, "yaw nan"),
        ({"yaw": "north"}, "yaw 'north'"),
        ({"yaw": True}, "yaw True"),
        ({"yaw": 10**400}, "yaw 1000"),
        ({"position": [Fraction(1, 2), 0.0]}, "expected|possible"),
        ({"height": 1.0}, "'height' of"),
        ({"height": 1.0, 3: 1.0}, "'3' of"),
    ],
)
def test_setups_that_cannot_be_are_refused(env: Any, change: dict[str, Any], message: str) -> None:
    env.reset(seed=34)
    setup, state = env.setup(), env.get_state()
    name = next(iter(setup))
    for seed in (35, None):
        with pytest.raises(InvalidSetupError, match=message):
            env.reset(seed=seed, options={"setup": {**setup, name: {**setup[name], **change}}})
    assert env.setup() == setup
    np.testing.assert_array_equal(env.get_state(), state)
    assert env.np_random_seed == 34
    assert np.isfinite(env.step(np.zeros(env.action_space.shape))[1])


def test_unknown_objects_and_options_are_refused(env: Any) -> None:
    with pytest.raises(InvalidSetupError, match="no object 'teapot'"):
        env.reset(options={"setup": {"teapot": {"position": [0.6, 0.0]}}})
    with pytest.raises(InvalidArgumentError, match="possible: {'setup'"):
        env.reset(options={"setups": {}})
    with pytest.raises(InvalidArgumentError, match="possible: {'setup'"):
        env.reset(options=["setup"])
    with pytest.raises(InvalidSetupError, match="mapping"):
        env.reset(options={"setup": [1, 2]})


def test_overlapping_objects_are_refused(env: Any) -> None:
    env.reset(seed=36)
    setup = env.setup()
    if len(setup) < 2:
        pytest.skip("one object cannot overlap")
    first, second = list(setup)[:2]
    with pytest.raises(InvalidSetupError):
        env.reset(options={"setup": {**setup, second: {**setup[second], "position": setup[first]["position"]}}})


@pytest.mark.parametrize(
    ("env_id", "wanted", "message"),
    [
        ("BoxFlipping", {"box": {"yaw": 3.0}}, r"^yaw of 'box' is 3.0; possible: -0.4363 to 0.4363$"),
        (
            "BoxStacking",
            {
                "box_yellow": {"position": [0.585, 0.0]},
                "box_green": {"position": [0.585, 0.2]},
                "box_red": {"position": [0.585, -0.2]},
            },
            "^no room for what the setup does not name",
        ),
    ],
)
def test_what_is_wrong_does_not_depend_on_what_was_drawn(env_id: str, wanted: dict[str, Any], message: str) -> None:
    env = make(f"lfd_gym/{env_id}-v0")
    for seed in (41, 42, 43):
        with pytest.raises(InvalidSetupError, match=message):
            env.reset(seed=seed, options={"setup": wanted})


def test_random_setups_pass_their_own_check_and_start_unsolved(env: Any) -> None:
    for seed in range(40, 70):
        env.reset(seed=seed)
        env.check_setup(env.setup())
        assert not env.succeeded()
        assert env.data.ncon < 40


GRASPS = {
    "lfd_gym/MoveObject-v0": ((0.057, 0.059, 0.18), (0.0,)),
    "lfd_gym/LightBulb-v0": ((0.064, 0.11), (-math.radians(60.0), math.radians(60.0))),
}
"""Heights of the tool point [m] and yaws [rad] that a task needs all over its area."""


@pytest.mark.parametrize("env_id", GRASPS)
def test_the_arm_reaches_every_corner_of_the_area(env_id: str) -> None:
    env = make(env_id)
    module = sys.modules[type(env).__module__]
    heights, yaws = GRASPS[env_id]
    for x in (module.AREA_LOW[0], module.AREA_HIGH[0]):
        for y in (module.AREA_LOW[1], module.AREA_HIGH[1]):
            for height in heights:
                for yaw in yaws:
                    turn = quaternion.from_rotation_vector(np.array([0.0, 0.0, yaw]))
                    goal = quaternion.multiply(turn, wam.TOOL_DOWN)
                    found = inverse_kinematics(env.model, env.tool, np.array([x, y, height]), goal)
                    assert found is not None, (x, y, height, yaw)


@pytest.mark.parametrize(("env_id", "span"), [("lfd_gym/MoveObject-v0", 0.50), ("lfd_gym/LightBulb-v0", 0.60)])
def test_objects_are_placed_all_over_their_area(env_id: str, span: float) -> None:
    env = make(env_id)
    places = {name: [] for name in env.frames}
    yaws = []
    for seed in range(150):
        env.reset(seed=seed)
        for name, pose in env.setup().items():
            places[name].append(pose["position"])
            yaws.append(pose["yaw"])
    for name in places:
        np.testing.assert_allclose(np.ptp(places[name], axis=0), [0.25, span], rtol=0.06)
    assert np.ptp(yaws) > math.radians(350.0)
