"""What a learner is: a scikit-learn estimator that turns demonstrations into a skill."""

import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Self

import numpy as np
from sklearn.base import BaseEstimator

from lfd_gym.demonstration import NO_LABEL, Demonstration, check_alike, check_measured, check_same_environment
from lfd_gym.errors import DemonstrationError
from policies.sequence_graph import segments
from policies.skill import Skill


class Learner(BaseEstimator, ABC):
    """Base of all learners: `fit` checks the demonstrations, a subclass's `learn` does the rest.

    A learner may read measured signals, frames and, where it needs them, labels and the primitive table. It never reads
    actions, reference_* observations, states or the setup: from those the answer could be read off. Only behaviour cloning
    does, and says so: `reads_actions`.
    """

    needs: tuple[str, ...] = ("tool_position", "tool_quaternion")
    """Observations that must be there, with "hand_position" where the action has a hand."""
    reads: tuple[str, ...] = ("wrench", "hand_", "frame_")
    """Beginnings of the names of those that it reads besides, where they are there."""
    needs_labels = True
    """Whether every step must be labelled and every demonstration show a transition."""

    reads_actions = False
    """Whether it imitates actions and sees the controller's reference."""
    is_baseline = False
    """Whether it is there to be compared with, and need not solve a simple task from three demonstrations."""

    skill_: Skill

    @abstractmethod
    def learn(self, demonstrations: Sequence[Demonstration]) -> Skill:
        """The skill, from checked demonstrations."""

    def fit(self, demonstrations: Sequence[Demonstration], y: None = None) -> Self:
        """Learn `skill_` from one or more demonstrations of one environment; they are not changed.

        Raises DemonstrationError where they are missing, do not belong together, or cannot be learned from, and
        InvalidArgumentError for an argument of the constructor that is not possible.
        """
        demonstrations = list(demonstrations) if isinstance(demonstrations, Iterable) else [None]
        if not all(isinstance(demonstration, Demonstration) for demonstration in demonstrations):
            raise DemonstrationError("no demonstrations were given; `load_demonstrations` reads them from a file")
        check_same_environment(demonstrations)
        check_alike(demonstrations, self.needs_labels)
        for i, demonstration in enumerate(demonstrations):
            self._check_one(f"demonstration {i}", demonstration)
        failed = [str(i) for i, demonstration in enumerate(demonstrations) if not demonstration.success]
        if failed:
            warnings.warn(
                f"the task was not solved in demonstration {', '.join(failed)}: what is learned may fail as well",
                stacklevel=2,
            )
        self.skill_ = self.learn(demonstrations)
        return self

    def _check_one(self, name: str, demonstration: Demonstration) -> None:
        hand = ("hand_position",) if demonstration.layout.hand_low.size else ()
        check_measured(name, demonstration, (*self.needs, *hand), self.reads)
        if self.needs_labels:
            _check_labels(name, demonstration)


def _check_labels(name: str, demonstration: Demonstration) -> None:
    unlabelled = np.flatnonzero(demonstration.labels == NO_LABEL)
    if len(unlabelled):
        raise DemonstrationError(
            f"{name} has {len(unlabelled)} steps without a label, the first is step {unlabelled[0]}; "
            "this method needs a label at every step"
        )
    parts = segments(demonstration.labels)
    if len(parts) < 2:
        only = demonstration.primitives[parts[0].label].name
        raise DemonstrationError(f"{name} shows no transition: '{only}' is its only primitive; two in a row are needed")
