"""Every transition of a sequence-graph skill, judged by the noise-free teacher in its shadow (thesis 2.5.2).

"A transition is considered successful, if the system activates the correct successor at the correct state. Incorrect,
premature or too late transitions are considered failures. For unsuccessful transitions, we restart the movement, trigger the
transition manually and continue with the reproduction from there." Here the teacher's shadow (`scripted_teachers.shadow`) says
what is correct, and the exact state of the simulation makes the restart exact.
"""

import copy
from collections.abc import Mapping
from typing import Any, NamedTuple

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
    """The skill solved the task alone, without any help."""
    restarts: int
    """How often it was helped."""
    transitions: tuple[Transition, ...]
    """In their order."""


class Comparison:
    """Whether a skill and its shadow turn from one primitive to the same next one, within `TOLERANCE` of each other.

    The skill may go on from `TOLERANCE` before the movement is over for the shadow, until `TOLERANCE` after the acting teacher
    would have gone on at the latest. It fails if it does not, if it turns to another primitive than the teacher, or back.
    """

    def __init__(self, label: int, dt: float) -> None:
        """Both perform `label`; dt is the time between two steps [s]."""
        self.label, self._dt = label, dt
        self._ahead, self._waited = label, 0.0

    def step(self, due: int, leeway: float, performed: int) -> bool | None:
        """True: both have turned to the same primitive. False: the skill has failed to. None: not yet.

        Args:
            due, leeway: what the shadow says, see `Shadow`.
            performed: label of the skill's active primitive.
        """
        if due != self.label and performed == due:
            return True
        if due == performed == self._ahead:
            return None
        self._waited += self._dt
        if due != self.label:
            in_time = performed == self.label == self._ahead and self._waited <= leeway + TOLERANCE + 1e-9
        else:
            self._ahead = performed if self._ahead == self.label else self._ahead
            in_time = performed == self._ahead and self._waited <= TOLERANCE + 1e-9
        return None if in_time else False


def judge(env: Any, skill: SequenceGraphSkill, seed: int) -> JudgedEpisode:
    """Judge every transition of one episode. Where the skill fails at one, it first goes on alone until the end of the
    episode, then the world is put back to where the movement began, and the movement is performed until the shadow goes on.

    What follows the teacher's last primitive is not judged; whether the skill stops there shows in its success.
    """
    run = _Performance(env, skill, seed)
    alone: bool | None = None
    restarts, transitions = 0, []
    run.step(skill)
    while not run.ended:
        movement, label = run.checkpoint(), run.due
        comparison, right = Comparison(label, run.dt), None
        while right is None and not run.ended:
            run.step(skill)
            right = comparison.step(run.due, run.shadow.leeway, run.performed)
        if right is False:
            if alone is None:
                alone = run.finish()
            restarts += 1
            run.restart(movement)
            if not run.help(label):
                break
        if right is not None:
            transitions.append(Transition(label, run.due, right))
    return JudgedEpisode(seed, run.success if alone is None else alone, restarts, tuple(transitions))


class _Checkpoint(NamedTuple):
    """Where a movement began."""

    world: np.ndarray
    """State of the simulation."""
    observation: Mapping[str, np.ndarray]
    memory: Any
    """State of the skill."""
    n_watched: int
    """Steps that the shadow had watched."""


class _Performance:
    """A skill performs, and its shadow watches."""

    def __init__(self, env: Any, skill: SequenceGraphSkill, seed: int) -> None:
        self.env, self.skill, self.seed, self.dt = env, skill, seed, float(env.unwrapped.dt)
        self.locked = copy.copy(skill)
        self.locked.nodes = tuple(node._replace(decision=None) for node in skill.nodes)
        """The same skill, which never goes on by itself."""
        self.observation, _ = env.reset(seed=seed)
        self.memory: Any = None
        self.watched: list[tuple[Mapping[str, np.ndarray], int]] = []
        self.ended = self.success = False
        self.shadow = self._shadow()

    def step(self, skill: SequenceGraphSkill) -> None:
        """One control step: the skill decides, the shadow watches, the world goes on."""
        action, self.memory = skill.predict(self.observation, self.memory)
        self.performed = int(skill.active(self.memory)[0])
        self.watched.append((self.observation, self.performed))
        self.due = self.shadow.watch(*self.watched[-1])
        self.observation, _, terminated, truncated, info = self.env.step(action)
        self.ended, self.success = terminated or truncated, bool(info["is_success"])

    def finish(self) -> bool:
        """Whether the skill solves the task alone from here."""
        while not self.ended:
            self.step(self.skill)
        return self.success

    def checkpoint(self) -> _Checkpoint:
        """What `restart` needs."""
        return _Checkpoint(self.env.unwrapped.get_state(), self.observation, self.memory, len(self.watched))

    def restart(self, start: _Checkpoint) -> None:
        """Put world, skill and shadow back."""
        self.env.unwrapped.set_state(start.world)
        self.observation, self.memory, self.ended = start.observation, start.memory, False
        del self.watched[start.n_watched :]
        self.shadow = self._shadow()
        for step in self.watched:
            self.due = self.shadow.watch(*step)

    def help(self, label: int) -> bool:
        """Perform a primitive until its successor is due, pause as the teacher does, and trigger the transition.

        False where that was not reached before the episode ended, or where the skill has no such primitive.
        """
        while not self.ended and self.due == label:
            self.step(self.locked)
        for _ in range(round(PAUSE / self.dt) if self.shadow.leeway else 0):
            if not self.ended:
                self.step(self.locked)
        if self.ended or self.due not in self.skill.graph.labels:
            return False
        graph, memory = self.skill.graph, Memory(*self.memory)
        following = [node for node in graph.successors(int(memory.node[0])) if graph.labels[node] == self.due]
        node = (following or [graph.labels.index(self.due)])[0]
        none = np.zeros(1)
        self.memory = memory._replace(node=np.array([node]), still=none, chosen=none.astype(np.int64), lasted=none)
        return True

    def _shadow(self) -> Shadow:
        shadow = Shadow(look_up(TEACHERS, "teacher for", self.skill.env_id)(noise=0.0))
        world = self.env.unwrapped
        shadow.reset(np.random.default_rng(self.seed), world.action_layout, world.dt)
        return shadow
