"""What is learned from demonstrations: learners, and the skills they learn.

This package stands on `lfd_gym` alone. Its only contact with teachers is a file of demonstrations. To add a learner is
one file and one row here, and one in `policies.skill.SKILLS` for a skill class of its own; rows are imported on use.
"""

import os

from lfd_gym.errors import SkillFileError
from lfd_gym.registry import load
from policies.skill import SKILLS, Skill, read_skill_file

__all__ = ["LEARNERS", "SKILLS", "Skill", "load_skill"]

LEARNERS: dict[str, str] = {
    "sequence-graph": "policies.sequence_graph_learner:SequenceGraphLearner",
    "decomposition": "policies.decomposition_learner:DecompositionLearner",
    "moa": "policies.moa_learner:MoALearner",
    "bc": "policies.reinforcement.behaviour_cloning:BehaviourCloning",
    "bc-chunks": "policies.reinforcement.behaviour_cloning:ChunkedBehaviourCloning",
    "tp-gmm": "policies.trajectory_baselines.gaussian_mixture:TPGMMLearner",
    "var-dmp": "policies.trajectory_baselines.dynamic_movement_primitives:VarDMPLearner",
    "gmr": "policies.trajectory_baselines.gaussian_mixture:GMRLearner",
    "promp": "policies.trajectory_baselines.promp:ProMPLearner",
    "dmp": "policies.trajectory_baselines.dynamic_movement_primitives:DMPLearner",
    "replay": "policies.trajectory_baselines.replay:ReplayLearner",
}
"""Name of the method -> its learner."""


def load_skill(path: str | os.PathLike[str]) -> Skill:
    """The skill in a file that `Skill.save` wrote; no code in the file is run. Raises SkillFileError."""
    header, arrays = read_skill_file(path)
    kind = header.get("kind")
    if not isinstance(kind, str) or kind not in SKILLS:
        raise SkillFileError(f"'{path}' holds a skill of kind {kind!r}; possible: {', '.join(SKILLS)}")
    try:
        skill: Skill = load(SKILLS[kind]).from_arrays(header["values"], arrays, **header["facts"])
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise SkillFileError(f"'{path}' is incomplete or damaged; 'lfd-gym learn' writes skills") from error
    return skill
