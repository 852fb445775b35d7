"""Every transition of a sequence-graph skill, judged by the noise-free teacher in its shadow (thesis 2.5.2).

"A transition is considered successful, if the system activates the correct successor at the correct state. Incorrect,
premature or too late transitions are considered failures. For unsuccessful transitions, we restart the movement, trigger the
transition manually and continue with the reproduction from there." Here the teacher's shadow (`scripted_teachers.shadow`) says
what is correct, within half a second:

- not premature: had the skill performed its movement on, the shadow would have turned to the next one in `TOLERANCE` at most.
  The state of the simulation can be put back exactly, so this is tried;
- not too late: the skill turns not later than `TOLERANCE` after the acting teacher would at the latest (`Shadow.leeway`);
- the correct successor: both turn to the same primitive.

Where the skill fails, its movement is performed on from the moment of its decision until the shadow turns, the transition is
triggered after the teacher's pause, and the episode goes on. What follows the teacher's last primitive is not judged.
"""

import copy
from typing import Any, NamedTuple, Protocol

import numpy as np

from lfd_gym.registry import look_up
from policies.sequence_graph_skill import Memory, SequenceGraphSkill
from scripted_teachers import TEACHERS
from scripted_teachers.noise import PAUSE
from scripted_teachers.shadow import Shadow

TOLERANCE = 0.5
"""How far the skill's transition may lie from a moment at which the teacher goes on [s]."""


class Transition(NamedTuple):
    """One transition that was due in an episode."""

    before: int
    """Label of the primitive that was over."""
    after: int
    """Label of the primitive that the teacher turned to."""
    right: bool
    """The skill turned to the same one in time, by itself."""


class JudgedEpisode(NamedTuple):
    """One episode, with help where the skill needed it."""

    seed: int
    success: bool
    """The skill solves the task alone, without any help."""
    helped: int
    """How often it was helped."""
    transitions: tuple[Transition, ...]
    """In their order."""


class Performance(Protocol):
    """A skill that performs, and its shadow; what `judge` needs of them."""

    dt: float
    ended: bool
    success: bool

    @property
    def leeway(self) -> float:
        """See `Shadow.leeway`."""

    def decide(self) -> int:
        """The label of the primitive that the skill performs now."""

    def watch(self, label: int) -> int:
        """The label that is due according to the shadow, while `label` is performed."""

    def act(self) -> None:
        """Perform what the skill decided, for one control step."""

    def stay(self) -> None:
        """Perform the skill's last primitive on, for one control step."""

    def turn(self, label: int) -> bool:
        """Trigger a transition; False where the skill has no such primitive."""

    def snapshot(self) -> Any:
        """World and skill, not the shadow."""

    def restore(self, snapshot: Any) -> None:
        """Put them back."""


def judge(env: Any, skill: SequenceGraphSkill, seed: int) -> JudgedEpisode:
    """Judge every transition of the episode that begins with `seed`."""
    return JudgedEpisode(seed, *judge_performance(SkillPerformance(env, skill, seed)))


def judge_performance(run: Performance) -> tuple[bool, int, tuple[Transition, ...]]:
    """Whether the skill succeeds alone, how often it was helped, and its transitions."""
    alone: bool | None = None
    helped, transitions, label = 0, [], run.decide()
    while (turn := _until_one_turns(run, label)) is not None:
        performed, due = turn
        decision = run.snapshot()
        if due == label:
            due = _stay(run, label, TOLERANCE)
        if right := performed == due:
            run.restore(decision)
        else:
            here = run.snapshot()
            run.restore(decision)
            alone = _finish(run) if alone is None else alone
            run.restore(here)
            helped += 1
            due = _stay(run, label, np.inf) if due == label else due
            for _ in range(round(PAUSE / run.dt) if run.leeway and not run.ended else 0):
                run.stay()
        if due == label:
            break
        transitions.append(Transition(label, due, right))
        if not (right or run.turn(due)):
            break
        label = due
    return run.success if alone is None else alone, helped, tuple(transitions)


def _until_one_turns(run: Performance, label: int) -> tuple[int, int] | None:
    """Perform until the skill turns, or is too late; what it performs then, and what is due. None where the episode ends."""
    waited = 0.0
    while not run.ended:
        performed, due = run.decide(), run.watch(label)
        waited += run.dt * (due != label)
        if performed != label or waited > run.leeway + TOLERANCE:
            return performed, due
        run.act()
    return None


def _stay(run: Performance, label: int, seconds: float) -> int:
    """Perform the primitive on until the shadow turns to the next one; what is due then."""
    due, stayed = label, 0.0
    while due == label and stayed < seconds - 1e-9 and not run.ended:
        run.stay()
        stayed += run.dt
        due = run.watch(label)
    return due


def _finish(run: Performance) -> bool:
    """Whether the skill alone succeeds from here."""
    while not run.ended:
        run.decide()
        run.act()
    return run.success


class SkillPerformance:
    """A sequence-graph skill in its environment."""

    def __init__(self, env: Any, skill: SequenceGraphSkill, seed: int) -> None:
        self.env, self.skill, self.dt = env, skill, float(env.unwrapped.dt)
        self.locked = copy.copy(skill)
        self.locked.nodes = tuple(node._replace(decision=None) for node in skill.nodes)
        """The same skill, which never goes on by itself."""
        self.observation, _ = env.reset(seed=seed)
        self.memory: Any = None
        self.ended = self.success = False
        self.shadow = Shadow(look_up(TEACHERS, "teacher for", skill.env_id)(noise=0.0))
        self.shadow.reset(np.random.default_rng(seed), env.unwrapped.action_layout, self.dt)

    @property
    def leeway(self) -> float:
        """See `Shadow.leeway`."""
        return self.shadow.leeway

    def decide(self) -> int:
        """The label of the primitive that the skill performs now."""
        self.action, self.following = self.skill.predict(self.observation, self.memory)
        return int(self.skill.active(self.following)[0])

    def watch(self, label: int) -> int:
        """The label that is due according to the shadow, while `label` is performed."""
        return self.shadow.watch(self.observation, label)

    def act(self) -> None:
        """Perform what the skill decided, for one control step."""
        self.memory = self.following
        self.observation, _, terminated, truncated, info = self.env.step(self.action)
        self.ended, self.success = terminated or truncated, bool(info["is_success"])

    def stay(self) -> None:
        """Perform the skill's last primitive on, for one control step."""
        self.action, self.following = self.locked.predict(self.observation, self.memory)
        self.act()

    def turn(self, label: int) -> bool:
        """Activate the successor, or else the first node, with this label; False where there is none."""
        graph, memory = self.skill.graph, Memory(*self.memory)
        following = [node for node in graph.successors(int(memory.node[0])) if graph.labels[node] == label]
        nodes = following or [node for node in range(graph.n_nodes) if graph.labels[node] == label]
        none = np.zeros(1)
        if nodes:
            node, chosen = np.array(nodes[:1]), np.zeros(1, dtype=np.int64)
            self.memory = memory._replace(node=node, still=none, chosen=chosen, lasted=none)
        return bool(nodes)

    def snapshot(self) -> Any:
        """World and skill, not the shadow."""
        return self.env.unwrapped.get_state(), self.observation, self.memory, self.ended, self.success

    def restore(self, snapshot: Any) -> None:
        """Put them back."""
        state, self.observation, self.memory, self.ended, self.success = snapshot
        self.env.unwrapped.set_state(state)
