"""The judge of transitions: what it calls right, that it finds human teachers right, and that it sees planted faults."""

import copy
from typing import Any

import numpy as np
import pytest

from lfd_gym.evaluation import evaluate
from lfd_gym.experiments.shadow import Comparison, judge
from lfd_gym.recording import record
from lfd_gym.registry import look_up, make
from lfd_gym.rollout import TeacherPolicy, rollout
from policies.sequence_graph_learner import SequenceGraphLearner
from scripted_teachers import TEACHERS
from scripted_teachers.light_bulb import GRASP, UNSCREW, LightBulbTeacher
from scripted_teachers.shadow import Shadow

LIGHT_BULB = "lfd_gym/LightBulb-v0"
DT = 0.1


def verdict(due: str, performed: str, leeway: float = 0.0) -> bool | None:
    """Of the comparison of two strings of labels, from 'a' on."""
    comparison = Comparison(ord("a"), DT)
    for x, y in zip(due, performed, strict=True):
        if (right := comparison.step(ord(x), leeway, ord(y))) is not None:
            return right
    return None


@pytest.mark.parametrize(
    ("due", "performed", "leeway", "right"),
    [
        ("aaab", "aaab", 0.0, True),
        ("aaabbbbbb", "aaaaaaaab", 0.0, True),  # 0.5 s late
        ("aaabbbbbbb", "aaaaaaaaab", 0.0, False),  # 0.6 s late
        ("aaabbbbbbbbb", "aaaaaaaaaaab", 0.3, True),  # the teacher pauses
        ("aaaaaab", "abbbbbb", 0.0, True),  # 0.5 s premature
        ("aaaaaaab", "abbbbbbb", 0.0, False),  # 0.6 s premature
        ("aaaaaaab", "abbbbbbb", 1.0, False),  # waiting excuses no hurry
        ("aaab", "aaac", 0.0, False),  # another successor
        ("aabb", "aacb", 0.0, False),
        ("aaaaab", "aabaab", 0.0, False),  # back again
        ("abbbb", "aacbb", 0.0, False),
        ("aaaaaaaaaaaa", "aaaaaaaaaaaa", 0.0, None),
    ],
)
def test_what_counts_as_right(due: str, performed: str, leeway: float, right: bool | None) -> None:
    assert verdict(due, performed, leeway) is right


def transitions_of_a_teacher(env_id: str, noise: float, seed: int) -> list[bool]:
    """Verdicts on a teacher that performs itself."""
    env, teacher = make(env_id), look_up(TEACHERS, "teacher", env_id)
    shadow, verdicts = Shadow(teacher(noise=0.0)), []
    shadow.reset(np.random.default_rng(0), env.unwrapped.action_layout, env.unwrapped.dt)  # type: ignore[attr-defined]
    comparison = Comparison(0, env.unwrapped.dt)  # type: ignore[attr-defined]
    for step in rollout(env, TeacherPolicy(teacher(noise=noise)), seed):
        assert step.state is not None
        performed = int(step.state[0][0])
        due = shadow.watch(step.observation, performed)
        right = comparison.step(due, shadow.leeway, performed)
        if right is not None:
            verdicts.append(right)
            comparison = Comparison(due, env.unwrapped.dt)  # type: ignore[attr-defined]
    return verdicts


@pytest.mark.slow  # some episodes
@pytest.mark.parametrize("task", ["LightBulb", "MoveObject", "BoxStacking", "CylinderGrasp"])
def test_the_judge_finds_a_human_teacher_right(task: str) -> None:
    verdicts = [v for seed in range(100000, 100003) for v in transitions_of_a_teacher(f"lfd_gym/{task}-v0", 1.0, seed)]
    assert len(verdicts) >= 9
    assert all(verdicts)


@pytest.fixture(scope="module")
def skill() -> Any:
    demonstrations = record(LIGHT_BULB, LightBulbTeacher(noise=1.0), 3, 0).demonstrations
    return SequenceGraphLearner().fit(demonstrations).skill_


@pytest.mark.slow  # learns a skill and performs it
def test_the_judge_changes_nothing_that_it_need_not(skill: Any) -> None:
    env = make(LIGHT_BULB)
    judged = [judge(env, skill, seed) for seed in (100000, 100001)]
    alone = evaluate(LIGHT_BULB, skill, 2, 100000).episodes
    assert [episode.success for episode in judged] == [episode.success for episode in alone]
    assert all(len(episode.transitions) >= 15 for episode in judged)
    assert all(episode.restarts == 0 and all(t.right for t in episode.transitions) for episode in judged)


@pytest.mark.slow  # learns a skill and performs it
def test_a_skill_that_never_unscrews_fails_there_and_is_helped_past_it(skill: Any) -> None:
    stuck = copy.copy(skill)
    stuck.nodes = tuple(
        node._replace(decision=None) if label == GRASP else node
        for node, label in zip(skill.nodes, skill.graph.labels, strict=True)
    )
    episode = judge(make(LIGHT_BULB), stuck, 100000)
    wrong = [(t.before, t.after) for t in episode.transitions if not t.right]
    assert set(wrong) == {(GRASP, UNSCREW)}
    assert len(wrong) == episode.restarts >= 2
    assert len(episode.transitions) >= 15
    assert not episode.success
