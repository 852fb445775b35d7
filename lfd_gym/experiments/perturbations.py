"""What breaks: teacher and skills under imperfect tracking and sensing, pushes, slips, and unusual objects."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from lfd_gym.experiments.rows import evaluated, markdown, rate
from lfd_gym.experiments.sequence_graphs import learned
from lfd_gym.registry import kebab_case, look_up
from lfd_gym.rollout import TeacherPolicy
from scripted_teachers import TEACHERS

PERTURBATIONS: dict[str, dict[str, float]] = {
    "none": {},
    "tracking 1 cm, 1 degree": {"tracking_position": 0.01, "tracking_rotation": 0.01745},
    "wrench noise 0.3 N, bias 1 N": {"wrench_noise": 0.3, "wrench_bias": 1.0},
    "ranges of mass and friction doubled": {"variation": 2.0},
    "push on the arm, 20 N": {"push_arm": 20.0},
    "push on the object, 3 N": {"push_object": 3.0},
    "slippery fingertips for 0.5 s": {"slip": 0.5},
}
TASKS = ("lfd_gym/LightBulb-v0", "lfd_gym/MoveObject-v0")


def run(out: Path, quick: bool, jobs: int) -> str:
    """Evaluate the noise-1 teacher and the skill of teaching seed 0 under each perturbation on 100 setups."""
    rows = []
    for name, strengths in PERTURBATIONS.items():
        row = [name]
        for env_id in TASKS:
            for who, policy in _policies(env_id).items():
                path = out / f"{kebab_case(env_id)}-{who}-{'-'.join(strengths) or 'none'}.json"
                row.append(rate(evaluated(path, env_id, policy, quick, jobs, {"perturbation": strengths})))
        rows.append(row)
    return markdown(["perturbation", *(f"{kebab_case(t)}, {who}" for t in TASKS for who in ("teacher", "skill"))], rows)


def _policies(env_id: str) -> dict[str, Callable[[], Any]]:
    return {
        "teacher": lambda: TeacherPolicy(look_up(TEACHERS, "teacher for", env_id)(noise=1.0)),
        "skill": lambda: learned(env_id, "global", 0),
    }
