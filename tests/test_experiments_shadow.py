"""The judge of transitions: what it calls right, that it finds human teachers right, and that it sees planted faults."""

import copy
from typing import Any

import numpy as np
import pytest

from lfd_gym.evaluation import evaluate
from lfd_gym.experiments.judged import Judged, summary
from lfd_gym.experiments.shadow import TOLERANCE, judge, judge_performance
from lfd_gym.recording import record
from lfd_gym.registry import look_up, make
from lfd_gym.rollout import TeacherPolicy, rollout
from policies.sequence_graph_learner import SequenceGraphLearner
from scripted_teachers import TEACHERS
from scripted_teachers.light_bulb import GRASP, UNSCREW, LightBulbTeacher
from scripted_teachers.shadow import Shadow

LIGHT_BULB = "lfd_gym/LightBulb-v0"
DT = 0.1


class Strings:
    """What a skill performs and what is due, one letter per control step of the world; the shadow never turns back."""

    def __init__(self, due: str, performed: str, leeway: float = 0.0) -> None:
        self.due, self.performed, self.leeway = due, performed, leeway
        self.dt, self.t, self.ended, self.success, self.turned = DT, 0, False, False, due[0]

    def decide(self) -> int:
        return ord(self.performed[self.t])

    def watch(self, label: int) -> int:
        self.turned = max(self.turned, self.due[self.t])
        return ord(self.turned)

    def act(self) -> None:
        self.t += 1
        self.ended = self.t == len(self.due) - 1

    def stay(self) -> None:
        self.act()

    def turn(self, label: int) -> bool:
        return False

    def snapshot(self) -> Any:
        return self.t, self.ended

    def restore(self, snapshot: Any) -> None:
        self.t, self.ended = snapshot


@pytest.mark.parametrize(
    ("due", "performed", "leeway", "right"),
    [
        ("aaabbbb", "aaabbbb", 0.0, True),
        ("aaabbbbbbbb", "aaaaaaaabbb", 0.0, True),  # 0.5 s late
        ("aaabbbbbbbbb", "aaaaaaaaabbb", 0.0, False),  # 0.6 s late
        ("aaabbbbbbbbbbbb", "aaaaaaaaaaabbbb", 0.3, True),  # the teacher pauses
        ("aaaaaabbb", "abbbbbbbb", 0.0, True),  # 0.5 s premature
        ("aaaaaaabbb", "abbbbbbbbb", 0.0, False),  # 0.6 s premature
        ("aaaaaaabbb", "abbbbbbbbb", 1.0, False),  # waiting excuses no hurry
        ("aaaabbbb", "aaaacccc", 0.0, False),  # another successor
        ("aaaabbbb", "aacccccc", 0.0, False),
        ("aaaabbbb", "aacbbbbb", 0.0, False),  # the first decision counts
    ],
)
def test_what_counts_as_right(due: str, performed: str, leeway: float, right: bool) -> None:
    _, helped, transitions = judge_performance(Strings(due, performed, leeway))
    assert [(chr(t.before), chr(t.after), t.right) for t in transitions] == [("a", "b", right)]
    assert helped == (not right)


def test_nothing_is_judged_after_the_last_primitive() -> None:
    assert judge_performance(Strings("aaaaaaaaaaaa", "aaaaaaaaaaaa")) == (False, 0, ())
    assert judge_performance(Strings("aaaaaaaaaaaa", "aaabbbbbbbbb")) == (False, 1, ())


@pytest.mark.slow  # some episodes
@pytest.mark.parametrize("task", ["LightBulb", "MoveObject", "BoxStacking", "CylinderGrasp"])
def test_a_human_teacher_is_right_at_every_transition(task: str) -> None:
    """It never turns before its shadow, and to the same primitive within the leeway."""
    env_id = f"lfd_gym/{task}-v0"
    env, teacher = make(env_id), look_up(TEACHERS, "teacher", env_id)
    world: Any = env.unwrapped
    n_transitions = 0
    for seed in range(100000, 100003):
        shadow, label, waited = Shadow(teacher(noise=0.0)), 0, 0.0
        shadow.reset(np.random.default_rng(0), world.action_layout, world.dt)
        for step in rollout(env, TeacherPolicy(teacher(noise=1.0)), seed):
            assert step.state is not None
            performed = int(step.state[0][0])
            due = shadow.watch(step.observation, label)
            waited += world.dt * (due != label)
            if performed != label:
                assert performed == due
                n_transitions, label, waited = n_transitions + 1, performed, 0.0
            assert waited <= shadow.leeway + TOLERANCE
    assert n_transitions >= 9


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
    assert all(episode.helped == 0 and all(t.right for t in episode.transitions) for episode in judged)


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
    assert len(wrong) == episode.helped >= 2
    assert len(episode.transitions) >= 15
    assert not episode.success


def test_skills_on_the_same_setups_are_no_more_setups():
    """Nine that do alike tell as much as one."""
    rng = np.random.default_rng(0)
    success = (rng.uniform(size=(1, 20)) < 0.7).astype(float)
    due = np.ones((1, 20, 3))
    right = due * success[:, :, None]
    one = Judged(np.array([3]), right, due, success)
    nine = Judged(np.full(9, 3), *(np.repeat(array, 9, axis=0) for array in (right, due, success)))
    assert summary(nine).whole == summary(one).whole
    assert summary(nine).mean.low == pytest.approx(summary(one).mean.low, abs=0.05)
