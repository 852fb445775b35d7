"""What every scripted teacher keeps: a new row of the registry inherits these tests."""

import functools
import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lfd_gym.action import ActionLayout
from lfd_gym.errors import InvalidArgumentError
from lfd_gym.registry import ENVIRONMENTS, load, look_up
from scripted_teachers import TEACHERS, noise

ROOT = Path(__file__).parent.parent
SEEDS = (200000, 200001, 200002)
IDS = tuple(TEACHERS)
FIRST_GOALS = ("lfd_gym/MoveObject-v0", "lfd_gym/LightBulb-v0")
"""Teachers that begin with a movement to a fixed place that is not critical."""


class Performance(NamedTuple):
    """One episode of a teacher."""

    observations: list[dict[str, np.ndarray]]
    actions: np.ndarray
    labels: np.ndarray
    progress: np.ndarray
    success: bool
    layout: ActionLayout


@functools.cache
def environment(env_id: str) -> Any:
    return gymnasium.make(env_id).unwrapped


def teacher(env_id: str, **kwargs: Any) -> Any:
    return look_up(TEACHERS, "teacher", env_id)(**kwargs)


@functools.cache
def perform(env_id: str, noise: float, seed: int, draws: int = 0, steps: int | None = None) -> Performance:
    """A teacher's episode on the setup of `seed` with random numbers of its own, or its first steps."""
    env, actor = environment(env_id), teacher(env_id, noise=noise)
    observation, info = env.reset(seed=seed)
    actor.reset(np.random.default_rng([seed, draws]), env.action_layout, env.dt)
    observations, actions, labels, progress = [observation], [], [], []
    ended = False
    while not ended and (steps is None or len(actions) < steps):
        action, label = actor.act(observation)
        observation, _, terminated, truncated, info = env.step(action)
        assert type(terminated) is type(info["is_success"]) is bool
        ended = terminated or truncated
        observations.append(observation)
        actions.append(action)
        labels.append(label)
        progress.append(env.progress())
    done = (np.array(actions), np.array(labels), np.array(progress), info["is_success"])
    return Performance(observations, *done, env.action_layout)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("scale", [0.0, 1.0])
@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.slow  # an episode of a minute takes some seconds
def test_teachers_succeed(env_id: str, scale: float, seed: int) -> None:
    assert perform(env_id, scale, seed).success


@pytest.mark.parametrize("env_id", IDS)
def test_the_dense_reward_does_not_punish_the_way_to_success(env_id: str) -> None:
    progress = perform(env_id, 0.0, SEEDS[0]).progress
    assert progress[-1] > 0.8
    assert (np.maximum.accumulate(progress) - progress).max() < 0.12


@pytest.mark.slow  # shares the episodes of the test before
@pytest.mark.parametrize("env_id", IDS)
def test_labels_are_rows_of_the_primitive_table_and_all_are_used(env_id: str) -> None:
    wanted = set(range(len(look_up(TEACHERS, "teacher", env_id).primitives)))
    used: set[int] = set()
    for seed in range(SEEDS[0], SEEDS[0] + 15):
        labels = perform(env_id, 0.0, seed).labels
        assert labels.dtype.kind == "i"
        used |= set(labels.tolist())
        assert used <= wanted
        if used == wanted and seed >= SEEDS[-1]:
            break
    assert used == wanted


@pytest.mark.parametrize("env_id", IDS)
def test_the_primitive_table_names_frames_spaces_and_axes_that_exist(env_id: str) -> None:
    env, table = environment(env_id), look_up(TEACHERS, "teacher", env_id).primitives
    assert len({row.name for row in table}) == len(table)
    for row in table:
        hand = () if row.hand is None else (row.hand,)
        assert bool(hand) == (env.tool == "hand")
        for control in (row.position, row.orientation, *hand):
            assert control.frame in ("world", *env.frames)
            assert set(control.axes) <= {"position", "force", "hold"}
            assert control.primitive >= 0
        assert row.position.space in ("cartesian", "cylindrical")
        assert row.orientation.space == "rotation"
        assert len(row.position.axes) == len(row.orientation.axes) == 3
        assert all(control.space == "joints" and len(control.axes) == 4 for control in hand)


@pytest.mark.parametrize("env_id", IDS)
def test_actions_are_actions_of_the_environment(env_id: str) -> None:
    env = environment(env_id)
    for action in perform(env_id, 1.0, SEEDS[0], steps=150).actions:
        assert env.action_space.contains(action)


@pytest.mark.parametrize("env_id", IDS)
def test_the_same_random_numbers_give_the_same_actions_and_others_do_not(env_id: str) -> None:
    first = perform(env_id, 1.0, SEEDS[0], steps=150)
    again = perform.__wrapped__(env_id, 1.0, SEEDS[0], steps=150)
    np.testing.assert_array_equal(first.actions, again.actions)
    np.testing.assert_array_equal(first.labels, again.labels)
    other = perform(env_id, 1.0, SEEDS[0], draws=1, steps=150)
    assert not np.array_equal(first.actions, other.actions)


@pytest.mark.parametrize("env_id", IDS)
def test_without_noise_the_random_numbers_do_not_matter(env_id: str) -> None:
    paths = [perform(env_id, 0.0, SEEDS[1], draws=draws, steps=250).actions for draws in range(2)]
    np.testing.assert_array_equal(*paths)


@pytest.mark.parametrize("env_id", IDS)
@pytest.mark.parametrize("scale", [-0.1, np.nan, np.inf, 3000.0, "loud"])
def test_a_noise_that_cannot_be_is_refused(env_id: str, scale: float) -> None:
    with pytest.raises(InvalidArgumentError, match="noise"):
        teacher(env_id, noise=scale)


ALONE = """
import json, pickle, sys
import numpy as np
from lfd_gym.action import ActionLayout
from lfd_gym.registry import look_up
from scripted_teachers import TEACHERS
env_id, layout, dt, seed = json.loads(sys.argv[1])
actor = look_up(TEACHERS, "teacher", env_id)(noise=1.0)
actor.reset(np.random.default_rng([seed, 0]), ActionLayout.from_dict(layout), dt)
while True:
    try:
        observation = pickle.load(sys.stdin.buffer)
    except EOFError:
        break
    seen = sorted(name for name in sys.modules if name.split(".")[0] in ("mujoco", "dm_control") or ".envs." in name)
    pickle.dump((*actor.act(observation), [name for name in seen if "gymnasium" not in name]), sys.stdout.buffer)
    sys.stdout.buffer.flush()
"""


@pytest.mark.parametrize("env_id", IDS)
def test_a_teacher_acts_from_observations_alone(env_id: str) -> None:
    """In a process of its own, which has never heard of the simulation, it does what it does beside it."""
    steps = None if env_id == IDS[0] else 150
    env = environment(env_id)
    given = json.dumps([env_id, env.action_layout.to_dict(), env.dt, SEEDS[0]])
    expected = perform(env_id, 1.0, SEEDS[0], steps=steps)
    child = subprocess.Popen(
        [sys.executable, "-c", ALONE, given], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        observation, info = env.reset(seed=SEEDS[0])
        for wanted, wanted_label in zip(expected.actions, expected.labels, strict=True):
            pickle.dump(observation, child.stdin)
            child.stdin.flush()
            action, label, modules = pickle.load(child.stdout)
            assert modules == []
            assert label == wanted_label
            np.testing.assert_array_equal(action, wanted)
            observation, *_, info = env.step(action)
        assert info["is_success"] == expected.success
    finally:
        child.stdin.close()
        child.stdout.close()
        assert child.wait(timeout=10) == 0


@pytest.mark.parametrize("env_id", IDS)
def test_a_teacher_neither_changes_nor_keeps_the_observation(env_id: str) -> None:
    expected = perform(env_id, 1.0, SEEDS[0], steps=150)
    env, actor = environment(env_id), teacher(env_id, noise=1.0)
    observation, _ = env.reset(seed=SEEDS[0])
    actor.reset(np.random.default_rng([SEEDS[0], 0]), env.action_layout, env.dt)
    for wanted in expected.actions:
        frozen = {key: value.copy() for key, value in observation.items()}
        for value in frozen.values():
            value.setflags(write=False)
        action, _ = actor.act(frozen)
        for value in frozen.values():
            value.setflags(write=True)
            value[...] = 1e6
        np.testing.assert_array_equal(action, wanted)
        observation, *_ = env.step(action)


# how much a teacher varies


def first_goal(env_id: str, scale: float, draws: int) -> tuple[np.ndarray, Rotation, float]:
    """Where the first movement of a recorded episode ended, and how long it took [s]."""
    performance = perform(env_id, scale, SEEDS[0], draws=draws, steps=250)
    end = int(np.flatnonzero(performance.labels != performance.labels[0])[0])
    observation = performance.observations[end]
    turn = Rotation.from_quat(observation["tool_quaternion"], scalar_first=True)
    return observation["tool_position"], turn, end * 0.02


@pytest.mark.parametrize("env_id", FIRST_GOALS)
def test_recorded_movements_end_where_a_human_would_end_them(env_id: str) -> None:
    """24 episodes, 3 axes: a standard deviation is known to 8 %; noise 2 draws the same numbers and doubles them."""
    clean, upright, _ = first_goal(env_id, 0.0, 0)
    spreads = {}
    for scale in (1.0, 2.0):
        ends = [first_goal(env_id, scale, draws) for draws in range(24)]
        position = np.sqrt(np.mean([(p - clean) ** 2 for p, _, _ in ends]))
        rotation = np.sqrt(np.mean([(turn * upright.inv()).as_rotvec() ** 2 for _, turn, _ in ends]))
        spreads[scale] = position, np.degrees(rotation), np.std(np.log([time for *_, time in ends]))
    position, rotation, time = spreads[1.0]
    assert position == pytest.approx(0.010, rel=0.25)
    assert rotation == pytest.approx(3.0, rel=0.25)
    assert time > 0.1
    assert spreads[2.0][0] / position == pytest.approx(2.0, rel=0.15)
    assert spreads[2.0][1] / rotation == pytest.approx(2.0, rel=0.15)
    assert spreads[2.0][2] > 1.3 * time


@pytest.mark.slow  # shares episodes with the test of success
def test_recorded_pulls_lie_between_5_and_15_newtons_and_differ() -> None:
    pulls = set()
    for seed in SEEDS:
        performance = perform("lfd_gym/LightBulb-v0", 1.0, seed)
        for action in performance.actions:
            force = performance.layout.decode(action).force
            if force.any():
                assert force[2] == pytest.approx(np.linalg.norm(force))
                pulls.add(round(float(force[2]), 2))
    assert len(pulls) >= 6
    assert min(pulls) >= 4.99
    assert max(pulls) <= 15.01
    assert max(pulls) - min(pulls) > 3.0


def variations(scale: float, steady: bool) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(0)
    drawn = [noise.vary(rng, scale, steady) for _ in range(4000)]
    return {name: np.array([getattr(v, name) for v in drawn]) for name in noise.Variation._fields}


@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0, 6.0])
def test_the_model_of_a_human_has_the_spreads_of_its_table(scale: float) -> None:
    v, s = variations(scale, steady=False), variations(scale, steady=True)
    assert v["position"].std() == pytest.approx(0.010 * scale, rel=0.05)
    assert s["position"].std() == pytest.approx(0.0025 * scale, rel=0.05)
    assert v["rotation"].std() == pytest.approx(np.radians(3.0) * scale, rel=0.05)
    assert s["rotation"].std() == pytest.approx(np.radians(1.0) * scale, rel=0.05)
    np.testing.assert_allclose([v["speed"].min(), v["speed"].max()], [0.6**scale, 1.5**scale], rtol=0.01)
    shortest, longest = max(0.6 - 0.4 * scale, 0.1), 0.6 + 0.4 * scale
    np.testing.assert_allclose([v["pause"].min(), v["pause"].max()], [shortest, longest], atol=0.01)
    bows = np.linalg.norm(v["bow"], axis=1)
    assert bows.max() == pytest.approx(0.10 * scale, rel=0.01)
    lowest, highest = max(1.0 - 0.2 * scale, 0.2), 1.0 + 0.2 * scale
    np.testing.assert_allclose([v["threshold"].min(), v["threshold"].max()], [lowest, highest], atol=0.01)
    early = v["completeness"] < 1.0
    assert early.mean() == pytest.approx(0.1 * scale, abs=0.02)
    np.testing.assert_allclose(
        [v["completeness"][early].min(), v["completeness"][early].max()], [0.85, 0.95], atol=0.01
    )
    assert (s["completeness"] == 1.0).all()


def test_without_noise_nothing_varies() -> None:
    for steady in (False, True):
        v = variations(0.0, steady)
        for name, clean in (
            ("position", 0),
            ("rotation", 0),
            ("bow", 0),
            ("speed", 1),
            ("completeness", 1),
            ("threshold", 1),
        ):
            np.testing.assert_array_equal(v[name], clean)
        np.testing.assert_array_equal(v["pause"], noise.PAUSE)


def test_pulls_have_the_spread_of_the_table() -> None:
    rng = np.random.default_rng(1)
    drawn = {scale: [noise.pull(rng, scale, 20.0) for _ in range(2000)] for scale in (0.0, 1.0, 2.0)}
    assert set(drawn[0.0]) == {10.0}
    np.testing.assert_allclose([min(drawn[1.0]), max(drawn[1.0])], [5.0, 15.0], atol=0.05)
    np.testing.assert_allclose([min(drawn[2.0]), max(drawn[2.0])], [3.0, 20.0], atol=0.05)


def test_every_environment_has_a_teacher() -> None:
    assert set(TEACHERS) == set(ENVIRONMENTS)
    for path in TEACHERS.values():
        assert callable(load(path))
