"""What every learner in the registry and its skill keep, on demonstrations of the simulated robot."""

import copy
import dataclasses
import hashlib

import numpy as np
import pytest

from lfd_gym.demonstration import NO_LABEL, Demonstration
from lfd_gym.errors import DemonstrationError
from lfd_gym.evaluation import evaluate
from lfd_gym.recording import record
from lfd_gym.registry import look_up, make
from lfd_gym.wrappers import SeededEpisodes
from policies import LEARNERS, load_skill
from scripted_teachers.move_object import MoveObjectTeacher

ENV_ID, FIRST_SEED = "lfd_gym/MoveObject-v0", 200000
SLOW = {"bc": {"updates": 100, "width": 64}, "bc-chunks": {"updates": 100, "width": 64}}
"""Settings of learners whose defaults take long."""


@pytest.fixture(scope="module")
def taught() -> list[Demonstration]:
    return record(ENV_ID, MoveObjectTeacher(noise=1.0), n=3, seed=7).demonstrations


@pytest.fixture(scope="module", params=LEARNERS)
def method(request: pytest.FixtureRequest) -> str:
    return request.param


def new(method: str):
    """The learner, with its defaults unless they take long."""
    if method in SLOW:
        pytest.importorskip("torch", reason="the rl extra is not installed")
    return look_up(LEARNERS, "method", method)(**SLOW.get(method, {}))


@pytest.fixture(scope="module")
def skill(method: str, taught: list[Demonstration]):
    return new(method).fit(taught).skill_


def actions_of(skill, observations: list[dict[str, np.ndarray]]) -> np.ndarray:
    state, actions = None, []
    for i, observation in enumerate(observations):
        action, state = skill.predict(observation, state=state, episode_start=np.array([i == 0]))
        actions.append(action)
    return np.array(actions)


def seen(demonstration: Demonstration) -> list[dict[str, np.ndarray]]:
    return [{k: v[t] for k, v in demonstration.observations.items()} for t in range(len(demonstration))]


def digest(demonstrations: list[Demonstration]) -> str:
    total = hashlib.sha256()
    for demonstration in demonstrations:
        for name in sorted(demonstration.observations):
            total.update(demonstration.observations[name].tobytes())
        total.update(demonstration.actions.tobytes() + demonstration.labels.tobytes())
    return total.hexdigest()


def test_fit_reads_only_what_was_measured(method: str, skill, taught: list[Demonstration]) -> None:
    """Actions, references, states and setup are where the answer could be read off: NaN there changes nothing."""
    blind = [
        dataclasses.replace(
            demonstration,
            actions=np.full_like(demonstration.actions, np.nan),
            states=np.full_like(demonstration.states, np.nan),
            setup={},
            observations={
                k: np.full_like(v, np.nan) if k.startswith("reference_") else v
                for k, v in demonstration.observations.items()
            },
        )
        for demonstration in taught
    ]
    if new(method).reads_actions:
        with pytest.raises(DemonstrationError, match="reference_position"):
            new(method).fit(blind)
        return
    other = new(method).fit(blind).skill_
    assert np.array_equal(actions_of(other, seen(taught[0])), actions_of(skill, seen(taught[0])))


def test_fit_leaves_its_input_untouched_and_twice_is_once(method: str, skill, taught: list[Demonstration]) -> None:
    before = digest(taught)
    learner = new(method)
    assert learner.fit(taught) is learner
    learner.fit(taught)
    assert digest(taught) == before
    assert np.array_equal(actions_of(learner.skill_, seen(taught[1])), actions_of(skill, seen(taught[1])))


def test_what_a_skill_learned_is_read_only(skill, tmp_path) -> None:
    skill.save(tmp_path / "skill.npz")
    for learned in (skill, load_skill(tmp_path / "skill.npz")):
        arrays = learned.to_arrays()[1]
        assert arrays
        for array in arrays.values():
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0
    for array in copy.deepcopy(skill).to_arrays()[1].values():
        array[...] = 0


def test_a_skill_survives_its_file(skill, taught: list[Demonstration], tmp_path) -> None:
    skill.save(tmp_path / "skill.npz")
    loaded = load_skill(tmp_path / "skill.npz")
    assert loaded.env_id == ENV_ID
    assert tuple(loaded.taught_seeds) == tuple(demonstration.seed["reset"] for demonstration in taught)
    assert np.array_equal(actions_of(loaded, seen(taught[2])), actions_of(skill, seen(taught[2])))


def test_stable_baselines_judges_a_skill_as_evaluate_does(method: str, skill) -> None:
    pytest.importorskip("stable_baselines3", reason="the rl extra is not installed")
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import DummyVecEnv

    worlds = [lambda i=i: SeededEpisodes(make(ENV_ID), FIRST_SEED + i) for i in range(4)]
    rewards, lengths = evaluate_policy(
        skill, DummyVecEnv(worlds), n_eval_episodes=4, return_episode_rewards=True, warn=False
    )
    report = evaluate(ENV_ID, skill, episodes=4, seed=FIRST_SEED)
    ours = sorted((episode.return_, episode.steps) for episode in report.episodes)
    assert sorted(zip(rewards, lengths, strict=True)) == ours
    assert new(method).is_baseline or report.success_rate >= 0.75


def test_the_same_skill_is_learned_from_the_file(method: str, skill, taught: list[Demonstration], tmp_path) -> None:
    from lfd_gym.demonstration import load_demonstrations, save_demonstrations

    save_demonstrations(tmp_path / "demos.h5", taught)
    other = new(method).fit(load_demonstrations(tmp_path / "demos.h5")).skill_
    assert np.array_equal(actions_of(other, seen(taught[0])), actions_of(skill, seen(taught[0])))


def test_measurements_that_are_no_numbers_are_refused(method: str, taught: list[Demonstration]) -> None:
    first = taught[0]
    for name in ("hand_position", "frame_object"):
        rows = first.observations[name].copy()
        rows[0] = np.nan
        broken = dataclasses.replace(first, observations={**first.observations, name: rows})
        with pytest.raises(DemonstrationError, match="not finite"):
            new(method).fit([*taught[1:], broken])


def test_quaternions_that_are_not_of_length_one_are_refused(method: str, taught: list[Demonstration]) -> None:
    first = taught[0]
    for name in ("tool_quaternion", "frame_object"):
        for factor in (0.0, 1.01):
            rows = first.observations[name].copy()
            rows[0, -4:] *= factor
            broken = dataclasses.replace(first, observations={**first.observations, name: rows})
            with pytest.raises(
                DemonstrationError, match=f"a quaternion in '{name}' of demonstration 2 is not of length 1"
            ):
                new(method).fit([*taught[1:], broken])


def test_what_is_no_demonstration_is_refused(method: str) -> None:
    with pytest.raises(DemonstrationError, match="load_demonstrations"):
        new(method).fit("demos.h5")
    with pytest.raises(DemonstrationError, match="load_demonstrations"):
        new(method).fit(None)


def test_demonstrations_that_failed_are_named(method: str, taught: list[Demonstration]) -> None:
    failed = dataclasses.replace(taught[1], success=False)
    with pytest.warns(UserWarning, match="not solved in demonstration 1:"):
        new(method).fit([taught[0], failed, taught[2]])


def test_a_hand_that_was_not_measured_is_refused(method: str, taught: list[Demonstration]) -> None:
    blind = [
        dataclasses.replace(d, observations={k: v for k, v in d.observations.items() if k != "hand_position"})
        for d in taught
    ]
    with pytest.raises(DemonstrationError, match="demonstration 0 has no observation 'hand_position'"):
        new(method).fit(blind)


def test_demonstrations_of_another_origin_teach_as_far_as_they_say_what_they_are(
    method: str, skill, taught: list[Demonstration]
) -> None:
    other = new(method).fit([dataclasses.replace(taught[0], seed={}), *taught[1:]]).skill_
    assert tuple(other.taught_seeds) == tuple(demonstration.seed["reset"] for demonstration in taught[1:])
    assert np.array_equal(actions_of(other, seen(taught[0])), actions_of(skill, seen(taught[0])))
    with pytest.raises(DemonstrationError, match="action layout"):
        new(method).fit([dataclasses.replace(demonstration, action_layout={}) for demonstration in taught])


def test_unlabelled_learners_do_not_look_at_the_primitives(method: str, skill, taught: list[Demonstration]) -> None:
    learner = new(method)
    others = [dataclasses.replace(taught[0], primitives=taught[0].primitives[::-1]), *taught[1:]]
    if learner.needs_labels:
        with pytest.raises(DemonstrationError, match="primitive table"):
            learner.fit(others)
    else:
        others[1] = dataclasses.replace(taught[1], labels=np.full_like(taught[1].labels, NO_LABEL))
        other = learner.fit(others).skill_
        assert np.array_equal(actions_of(other, seen(taught[0])), actions_of(skill, seen(taught[0])))
