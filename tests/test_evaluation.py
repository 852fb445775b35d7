"""The one loop, recording and evaluation, on the smallest environment there is."""

import itertools
import json
from typing import Any

import gymnasium
import numpy as np
import pytest
import toy
from scipy import stats

from lfd_gym.demonstration import save_demonstrations
from lfd_gym.errors import DemonstrationError, InvalidArgumentError, SeedOverlapError, UnknownNameError
from lfd_gym.evaluation import check_fits, describe, evaluate, wilson_interval
from lfd_gym.perturbation import Perturbation
from lfd_gym.recording import record
from lfd_gym.registry import make
from lfd_gym.rollout import RandomPolicy, TeacherPolicy, rollout
from lfd_gym.seeds import TEACHING_SEED
from policies.sequence_graph_learner import SequenceGraphLearner
from scripted_teachers.move_object import MoveObjectTeacher


@pytest.mark.parametrize(("successes", "n"), [(0, 1), (0, 20), (3, 7), (50, 100), (95, 100), (100, 100)])
def test_wilson_interval_is_that_of_scipy(successes: int, n: int) -> None:
    expected = stats.binomtest(successes, n).proportion_ci(confidence_level=0.95, method="wilson")
    assert wilson_interval(successes, n) == pytest.approx((expected.low, expected.high), abs=1e-12)


def test_jobs_change_nothing_but_time() -> None:
    for policy in (toy.PointPolicy(), TeacherPolicy(toy.PointTeacher()), RandomPolicy()):
        one = evaluate(toy.ENV_ID, policy, episodes=9, seed=100000, jobs=1)
        two = evaluate(toy.ENV_ID, policy, episodes=9, seed=100000, jobs=2)
        assert one.to_json() == two.to_json()


def test_episode_i_is_reset_with_seed_plus_i() -> None:
    block = evaluate(toy.ENV_ID, toy.PointPolicy(), episodes=4, seed=100000)
    alone = evaluate(toy.ENV_ID, toy.PointPolicy(), episodes=1, seed=100003)
    assert block.episodes[3] == alone.episodes[0]
    assert [episode.seed for episode in block.episodes] == [100000, 100001, 100002, 100003]
    assert len({episode.return_ / episode.steps for episode in block.episodes}) > 1


def test_an_exception_is_a_failed_episode_that_says_why() -> None:
    report = evaluate(toy.ENV_ID, toy.PointPolicy(fails_beyond=1.0), episodes=12, seed=100000)
    failed = [episode for episode in report.episodes if episode.error]
    assert 0 < len(failed) < 12
    assert all(not e.success and e.error == "RuntimeError: too far away" for e in failed)
    assert report.successes == 12 - len(failed)
    assert "ended in an error" in report.table()


class ReturningPolicy(toy.PointPolicy):
    """Passes halfway, and walks back to the start before the episode ends."""

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        _, (count,) = super().predict(observation, state, episode_start)
        steps_there = round(6 * observation["frame_target"][0])
        action = (count < steps_there).astype(float) - (steps_there <= count < 2 * steps_there)
        return action.astype(np.float32), (count,)


def test_subtasks_count_if_they_were_ever_reached() -> None:
    last = list(rollout(make(toy.ENV_ID), ReturningPolicy(), seed=100000))[-1]
    assert not last.info["subtask/halfway"]
    returned = evaluate(toy.ENV_ID, ReturningPolicy(), episodes=5, seed=100000)
    assert returned.successes == 0
    assert all(episode.subtasks == {"halfway": True} for episode in returned.episodes)


def test_random_reaches_less_than_a_policy_that_walks_to_the_target() -> None:
    assert evaluate(toy.ENV_ID, toy.PointPolicy(), episodes=5, seed=100000).success_rate == 1.0
    lost = evaluate(toy.ENV_ID, RandomPolicy(), episodes=5, seed=100000)
    assert lost.successes < 5
    assert {episode.steps for episode in lost.episodes if not episode.success} == {40}


def test_a_skill_is_not_judged_on_what_it_was_taught_on() -> None:
    policy = toy.PointPolicy(taught_seeds=(7, 100004))
    with pytest.raises(SeedOverlapError, match="--seed 100005"):
        evaluate(toy.ENV_ID, policy, episodes=5, seed=100000)
    assert evaluate(toy.ENV_ID, policy, episodes=4, seed=100000).success_rate == 1.0


def test_a_skill_is_not_judged_in_another_environment() -> None:
    policy = toy.PointPolicy()
    policy.env_id = "lfd_gym/LightBulb-v0"
    with pytest.raises(InvalidArgumentError, match="taught for lfd_gym/LightBulb-v0"):
        evaluate(toy.ENV_ID, policy, episodes=1, seed=100000)


def test_a_skill_is_judged_under_either_reward_but_at_its_own_rate() -> None:
    policy = TeacherPolicy(MoveObjectTeacher(noise=0.0))
    policy.env_id, policy.dt = "lfd_gym/MoveObject-v0", 0.02
    check_fits(policy, make("move-object-dense"))
    with pytest.raises(InvalidArgumentError, match="control_hz=50"):
        check_fits(policy, make("move-object", control_hz=25))
    with pytest.raises(InvalidArgumentError, match="no environment of this suite"):
        evaluate("CartPole-v1", RandomPolicy(), episodes=1, seed=100000)
    for foreign in ("lfd_gym:lfd_gym/Nothing-v0", "no_such_module:Nothing-v0", "toy: "):
        with pytest.raises(InvalidArgumentError, match="cannot be made"):
            evaluate(foreign, RandomPolicy(), episodes=1, seed=100000)


def test_gymnasiums_own_arguments_pass_through_make() -> None:
    env = make("move-object", max_episode_steps=3, control_hz=25)
    env.reset(seed=100000)
    ends = [env.step(np.zeros(env.action_space.shape))[3] for _ in range(3)]
    assert ends == [False, False, True]
    with pytest.raises(InvalidArgumentError, match="did you mean 'control_hz'"):
        make("move-object", max_episode_steps=3, control_hertz=25)
    with pytest.raises(InvalidArgumentError, match="max_episode_steps"):
        make("move-object", max_episode_steps=0)
    with pytest.raises(InvalidArgumentError, match="expected a name"):
        evaluate(env, RandomPolicy(), episodes=1, seed=100000)  # type: ignore[arg-type]


def test_a_teacher_that_has_taught_can_be_sent_to_processes() -> None:
    teacher = MoveObjectTeacher(noise=1.0)
    record("move-object", teacher, 1, seed=0)
    fresh = TeacherPolicy(MoveObjectTeacher(noise=1.0))
    used = evaluate("move-object", TeacherPolicy(teacher), episodes=2, seed=100000, jobs=2)
    assert used.to_json() == evaluate("move-object", fresh, episodes=2, seed=100000).to_json()


def test_a_teacher_is_judged_as_it_is() -> None:
    wrapped = evaluate(toy.ENV_ID, TeacherPolicy(toy.PointTeacher()), episodes=3, seed=100000)
    assert evaluate(toy.ENV_ID, toy.PointTeacher(), episodes=3, seed=100000).to_json() == wrapped.to_json()


class Agent(toy.PointPolicy):
    """Of Stable-Baselines3: it says what it sees."""

    observation_space = gymnasium.spaces.Box(-1.0, 1.0, (3,))


@pytest.mark.parametrize(
    ("policy", "says"),
    [
        (toy.PointTeacher, r"class PointTeacher .* PointTeacher\(\)"),
        (SequenceGraphLearner(), "`skill_`, after `fit`"),
        (None, "NoneType is no policy"),
        ("random", "str is no policy"),
        (Agent(), "ViewPolicy"),
    ],
)
def test_what_is_no_policy_is_refused_before_the_first_episode(policy: Any, says: str) -> None:
    with pytest.raises(InvalidArgumentError, match=says):
        evaluate(toy.ENV_ID, policy, episodes=1, seed=100000)


@pytest.mark.parametrize("numbers", [{"n": 0}, {"n": 2.0}, {"seed": 0.5}, {"seed": -1}, {"repeat": 0}])
def test_demonstrations_are_counted_in_whole_numbers(numbers: dict[str, Any]) -> None:
    with pytest.raises(InvalidArgumentError, match=next(iter(numbers))):
        record(toy.ENV_ID, toy.PointTeacher(), **({"n": 1, "seed": 0} | numbers))


@pytest.mark.parametrize("teacher", [toy.PointTeacher, toy.PointPolicy()])
def test_who_does_not_teach_is_not_recorded(teacher: Any) -> None:
    with pytest.raises(InvalidArgumentError, match="class PointTeacher|does not teach"):
        record(toy.ENV_ID, teacher, n=1, seed=0)


def test_a_teacher_of_another_task_is_refused() -> None:
    teacher = MoveObjectTeacher()
    with pytest.raises(InvalidArgumentError, match="cannot teach lfd_gym/LightBulb-v0: no frame object, target"):
        record("light-bulb", teacher, 1, seed=0)
    with pytest.raises(InvalidArgumentError, match="MoveObjectTeacher cannot teach"):
        evaluate("light-bulb", TeacherPolicy(teacher), episodes=1, seed=100000)


def test_a_report_says_how_a_teacher_taught() -> None:
    assert describe(TeacherPolicy(MoveObjectTeacher(noise=0.5))) == "MoveObjectTeacher (noise 0.5)"
    guiding = MoveObjectTeacher(mode="kinesthetic")
    assert describe(TeacherPolicy(guiding)) == "MoveObjectTeacher (noise 1, kinesthetic)"


@pytest.mark.parametrize("numbers", [{"episodes": 0}, {"episodes": 1.5}, {"seed": -1}, {"jobs": 0}])
def test_numbers_out_of_range_are_refused(numbers: dict[str, int]) -> None:
    with pytest.raises(InvalidArgumentError, match=next(iter(numbers))):
        evaluate(toy.ENV_ID, toy.PointPolicy(), **({"episodes": 1, "seed": 0} | numbers))


def test_the_report_is_json_with_the_promised_keys() -> None:
    report = json.loads(
        evaluate(toy.ENV_ID, toy.PointPolicy(), episodes=2, seed=100000, env_kwargs={"speed": 2.0}).to_json()
    )
    assert set(report) == {
        *("schema", "env_id", "env_kwargs", "policy", "episodes", "success_rate", "wilson", "versions"),
    }
    assert set(report["episodes"][0]) == {"seed", "success", "subtasks", "steps", "seconds", "return", "error"}
    assert report["env_kwargs"] == {"speed": 2.0}


def test_arguments_of_any_kind_are_written_down_as_json() -> None:
    given = {"control_hz": np.int64(50), "perturbation": Perturbation(push_arm=20.0)}
    report = evaluate("move-object", toy.PointPolicy(), episodes=1, seed=100000, env_kwargs=given)
    written = json.loads(report.to_json())["env_kwargs"]
    assert written["control_hz"] == 50
    assert make("move-object", **written).unwrapped.perturbation == given["perturbation"]
    with pytest.raises(InvalidArgumentError, match="cannot be written down"):
        evaluate(toy.ENV_ID, toy.PointPolicy(), episodes=1, seed=100000, env_kwargs={"speed": 1j})


def test_the_policy_sees_a_start_once_and_its_own_state_afterwards() -> None:
    env = make(toy.ENV_ID)
    steps = list(rollout(env, toy.PointPolicy(), seed=3))
    assert [int(step.state[0][0]) for step in steps] == list(range(len(steps)))
    assert all(a.next_observation is b.observation for a, b in itertools.pairwise(steps))
    assert steps[-1].terminated
    assert not any(step.terminated or step.truncated for step in steps[:-1])


def test_an_unknown_environment_lists_the_known_ones() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'light-bulb'.*move-object"):
        evaluate("light-bulp", toy.PointPolicy(), episodes=1, seed=0)


@pytest.mark.parametrize("name", [":", "toy:", ":Point-v0", "toy:toy:Point-v0"])
def test_an_environment_of_another_module_is_asked_for_as_module_and_id(name: str) -> None:
    with pytest.raises(UnknownNameError, match=f"no environment '{name}'.*move-object"):
        make(name)


def test_recording_twice_gives_equal_files_and_seeds_beyond_evaluation(tmp_path) -> None:
    for name in ("a.h5", "b.h5"):
        demonstrations, discarded = record(toy.ENV_ID, toy.PointTeacher(), n=3, seed=5)
        save_demonstrations(tmp_path / name, demonstrations)
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()
    assert discarded == []
    resets = [demonstration.seed["reset"] for demonstration in demonstrations]
    assert min(resets) >= TEACHING_SEED
    assert len(set(resets)) == 3
    assert len({demonstration.n_steps for demonstration in demonstrations}) > 1


def test_a_demonstration_is_what_happened() -> None:
    (demonstration,), _ = record(toy.ENV_ID, toy.PointTeacher(), n=1, seed=1)
    position = demonstration.observations["position"][:, 0]
    np.testing.assert_allclose(np.diff(position), 0.1 * demonstration.actions[:, 0], atol=1e-7)
    np.testing.assert_array_equal(demonstration.states[:, 0], position)
    np.testing.assert_array_equal(demonstration.rewards, np.r_[np.zeros(len(demonstration) - 1), 1.0])
    assert demonstration.success
    assert demonstration.setup["target"]["position"] == [demonstration.states[0, 1]]


def test_demonstration_i_does_not_depend_on_how_many_are_asked_for() -> None:
    few, many = (record(toy.ENV_ID, toy.PointTeacher(), n=n, seed=2).demonstrations for n in (1, 3))
    np.testing.assert_array_equal(few[0].actions, many[0].actions)


def test_a_failed_attempt_is_discarded_and_the_next_index_tried() -> None:
    demonstrations, discarded = record(toy.ENV_ID, toy.PointTeacher(gives_up=True), n=4, seed=0)
    assert discarded
    assert all(demonstration.success for demonstration in demonstrations)
    used = [demonstration.seed["index"] for demonstration in demonstrations]
    assert sorted(used + discarded) == list(range(max(used) + 1))


def test_a_teacher_that_never_succeeds_is_reported() -> None:
    with pytest.raises(DemonstrationError, match="0 of 10 attempts"):
        record(toy.ENV_ID, toy.PointTeacher(), n=1, seed=0, env_kwargs={"speed": 0.0})


@pytest.mark.parametrize(("n", "seed"), [(0, 0), (-1, 0), (1, -1)])
def test_recording_refuses_impossible_numbers(n: int, seed: int) -> None:
    with pytest.raises(InvalidArgumentError):
        record(toy.ENV_ID, toy.PointTeacher(), n=n, seed=seed)


def test_a_setup_is_demonstrated_again() -> None:
    shown = record(toy.ENV_ID, toy.PointTeacher(), n=4, seed=6, repeat=2).demonstrations
    targets = [demonstration.setup["target"]["position"][0] for demonstration in shown]
    assert targets[0] == targets[1] != targets[2] == targets[3]
    assert len({demonstration.seed["reset"] for demonstration in shown}) == 4
    alone = record(toy.ENV_ID, toy.PointTeacher(), n=1, seed=6).demonstrations
    assert np.array_equal(shown[0].actions, alone[0].actions)
    with pytest.raises(InvalidArgumentError, match="multiple"):
        record(toy.ENV_ID, toy.PointTeacher(), n=3, seed=6, repeat=2)
