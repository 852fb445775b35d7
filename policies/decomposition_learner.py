"""The learner of chapter 3: primitives, graph and transitions from demonstrations without labels."""

import dataclasses
import warnings
from collections.abc import Sequence

from lfd_gym.demonstration import Demonstration, taught_seeds
from lfd_gym.errors import DemonstrationError
from policies.decomposition.checks import DecompositionWarning, check_demonstrations
from policies.decomposition.labelling import agreeing, labelled
from policies.decomposition.methods import method_named
from policies.decomposition.result import Decomposition
from policies.learner import Learner
from policies.sequence_graph_learner import SequenceGraphLearner
from policies.skill import Skill


class DecompositionLearner(Learner):
    """Finds the primitives of every entity, then learns one sequence graph whose nodes activate one primitive of each (3.4).

    Neither labels nor the primitive table of the demonstrations are read. Demonstrations in which movements follow each other
    as in no other are left out of the graph where most agree, and named: what is found once is more often wrong than rare.

    Parameters:
        method: of the decomposition, a key of `METHODS` (`decomposition/methods.py`): ours, the thesis's, or a baseline.
        graph, classifier, kernel, C, dwell, patience: of the sequence graph, see `SequenceGraphLearner`.

    Attributes:
        decomposition_: what was found.
    """

    needs_labels = False
    decomposition_: Decomposition

    def __init__(
        self,
        method: str = "bayesian",
        graph: str = "global",
        classifier: str = "svm",
        kernel: str = "rbf",
        C: float = 10.0,
        dwell: float = 1.0,
        patience: float | None = 1.0,
    ) -> None:
        self.method = method
        self.graph, self.classifier, self.kernel, self.C = graph, classifier, kernel, C
        self.dwell, self.patience = dwell, patience

    def learn(self, demonstrations: Sequence[Demonstration]) -> Skill:
        """The decomposition, then labels from it, then the skill.

        Raises InvalidArgumentError or UnknownNameError for an argument that is not possible, and DemonstrationError where
        nothing moves, nothing pauses, or the force sensor has an offset; warns with `DecompositionWarning` of what will not
        be decomposed well.
        """
        of_the_graph = {name: value for name, value in self.get_params().items() if name != "method"}
        learner = SequenceGraphLearner(**of_the_graph, outliers="keep")
        learner.check_arguments()
        decompose = method_named(self.method)
        check_demonstrations(demonstrations)
        self.decomposition_ = decompose(demonstrations)
        if ambiguous := self.decomposition_.ambiguous:
            warnings.warn(
                f"the demonstrations do not tell the frame of {', '.join(ambiguous)}; show the task with the objects elsewhere",
                DecompositionWarning,
                stacklevel=3,
            )
        labels, primitives = labelled(demonstrations, self.decomposition_)
        for i, own in enumerate(labels):
            if (own == own[0]).all():
                raise DemonstrationError(
                    f"demonstration {i} is a single movement as far as can be seen; "
                    "pause where a movement ends, at least 0.2 s, so that movements can be told apart"
                )
        kept = agreeing(labels)
        if left_out := [m for m in range(len(labels)) if m not in kept]:
            warnings.warn(
                f"the skill is learned without demonstrations {left_out}, in which movements follow each other as in no other",
                DecompositionWarning,
                stacklevel=3,
            )
        taught = [dataclasses.replace(demonstrations[m], labels=labels[m], primitives=primitives) for m in kept]
        skill = learner.learn(taught)
        learned = f"decomposition, {self.method}, {skill.metadata['learner']}"
        metadata = {**skill.metadata, "learner": learned, "parameters": self.get_params()}
        return skill.with_facts(taught_seeds=taught_seeds(demonstrations), metadata=metadata)
