"""What a skill does when a cylinder slips out of its hand (thesis 2.5.3).

A slip leads back to the beginning because it was demonstrated, and only then. So episodes are told apart by what the skill was
shown: a slip at all, and a cylinder of this length in this posture.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lfd_gym.experiments.learning import TEACHING, demonstrations, learned
from lfd_gym.experiments.rows import Rows, markdown, solved
from lfd_gym.rollout import rollout
from scripted_teachers.cylinder_grasp import LIFT, SLIPPED

TASK = "lfd_gym/CylinderGrasp-v0"
SETUPS, TEACHING_SEEDS = 100, (0, 1, 2)
CAUSES: dict[str, dict[str, float]] = {"weight and friction": {}, "fingertips slippery for 0.5 s": {"slip": 0.5}}
"""What makes a cylinder slip, and the perturbation."""
SHOWN = {
    "all": lambda slip, cylinder: True,
    "a slip and such a cylinder were shown": lambda slip, cylinder: slip and cylinder,
    "a slip was shown, such a cylinder was not": lambda slip, cylinder: slip and not cylinder,
    "no slip was shown": lambda slip, cylinder: not slip,
}


def run(out: Path, quick: bool, jobs: int) -> str:
    """Watch the skills of every teaching seed on 100 unseen setups, without and with a perturbation."""
    rows, table = Rows(out, quick, jobs), []
    seeds = TEACHING_SEEDS[: 1 if quick else None]
    for cause, perturbation in CAUSES.items():
        episodes = []
        for seed in seeds:
            slip, cylinders = _shown(rows, seed)

            def skill(seed: int = seed) -> Any:
                return learned(TASK, seed)

            name = f"{'-'.join(perturbation) or 'natural'}-{seed}"
            found = rows.observed(name, TASK, skill, watch_for_slips, SETUPS, {"perturbation": perturbation})
            episodes += [(slip, episode["cylinder"] in cylinders, episode) for episode in found]
        for name, counts in SHOWN.items():
            chosen = [episode for slip, cylinder, episode in episodes if counts(slip, cylinder)]
            success = solved(chosen) if chosen else ""
            table.append([cause, name, str(len(chosen)), success, recovered(chosen)])
    return markdown(["cause", "episodes", "number", "success %", "of those with a slip %"], table)


def _shown(rows: Rows, seed: int) -> tuple[bool, list[str]]:
    """Whether the demonstrations of a teaching seed show a slip, and which cylinders they show."""

    def shown() -> dict[str, Any]:
        taught = demonstrations(TASK, TEACHING[TASK], seed)
        slip = any(np.any(np.diff(demonstration.labels) == -LIFT) for demonstration in taught)
        return {"slip": slip, "cylinders": sorted({_cylinder(demonstration.setup) for demonstration in taught})}

    row = rows.kept(f"shown-{seed}", shown)
    return row["slip"], row["cylinders"]


def _cylinder(setup: Mapping[str, Any]) -> str:
    return f"{setup['cylinder']['length']} m, {setup['cylinder']['posture']}"


class SlipEpisode(NamedTuple):
    """One episode."""

    seed: int
    slipped: bool
    """The cylinder moved in the hand while it was lifted, or fell."""
    success: bool
    cylinder: str
    """Length and posture at the beginning."""


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
    return SlipEpisode(seed, slipped, success, _cylinder(env.unwrapped.setup()))


def recovered(episodes: Sequence[Mapping[str, Any]]) -> str:
    """How many of the episodes with a slip ended well, in percent with the interval; and of how many."""
    slipped = [episode for episode in episodes if episode["slipped"]]
    return f"{solved(slipped)} of {len(slipped)}" if slipped else "none slipped"
