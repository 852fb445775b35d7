"""Whether the cylinder slipped in an episode of CylinderGrasp (thesis 2.5.3)."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from lfd_gym.experiments.rows import rate
from lfd_gym.rollout import rollout
from scripted_teachers.cylinder_grasp import LIFT, SLIPPED


class SlipEpisode(NamedTuple):
    """One episode."""

    seed: int
    slipped: bool
    """The cylinder moved in the hand while it was lifted, or fell."""
    success: bool


def watch_for_slips(env: Any, skill: Any, seed: int) -> SlipEpisode:
    """Perform an episode and look for slips, by the teacher's own threshold.

    A slip begins with a hand that holds the cylinder when the lift begins; a lift with an empty hand is none.
    """
    held, lifting, touched, slipped, success = None, False, False, False, False
    for step in rollout(env, skill, seed):
        assert step.state is not None
        began, lifting = not lifting, int(skill.active(step.state)[0]) == LIFT
        in_hand = step.observation["frame_cylinder"][:3] - step.observation["tool_position"]
        if not lifting:
            held = None
        elif began:
            held = in_hand if touched else None
        slipped |= held is not None and bool(np.linalg.norm(in_hand - held) > SLIPPED)
        touched, success = bool(step.info["subtask/grasped"]), bool(step.info["is_success"])
    return SlipEpisode(seed, slipped, success)


def recovered(episodes: Sequence[Mapping[str, Any]]) -> str:
    """How many of the episodes with a slip ended well, in percent with the interval; and of how many."""
    slipped = [episode for episode in episodes if episode["slipped"]]
    well = sum(episode["success"] for episode in slipped)
    return f"{rate(well, len(slipped))} of {len(slipped)}" if slipped else "none slipped"
