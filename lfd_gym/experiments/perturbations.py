"""What breaks: teachers and skills under imperfect tracking and sensing, pushes, slips, and unusual objects."""

from pathlib import Path

from lfd_gym.experiments.learning import TEACHING, learned, teacher
from lfd_gym.experiments.rows import Rows, markdown, missed, success
from lfd_gym.registry import kebab_case
from lfd_gym.rollout import TeacherPolicy

PERTURBATIONS: dict[str, dict[str, float]] = {
    "none": {},
    "tracking 1 cm, 1 degree": {"tracking_position": 0.01, "tracking_rotation": 0.01745},
    "push on the arm, 20 N": {"push_arm": 20.0},
    "push on the object, 3 N": {"push_object": 3.0},
    "wrench noise 0.3 N, bias 1 N": {"wrench_noise": 0.3, "wrench_bias": 1.0},
    "ranges of mass and friction doubled": {"variation": 2.0},
    "slippery fingertips for 0.5 s": {"slip": 0.5},
}
SETUPS = 50


def run(out: Path, quick: bool, jobs: int) -> str:
    """Evaluate the noise-1 teacher and the skill of teaching seed 0 of each task under each perturbation."""
    rows, table = Rows(out, quick, jobs), []
    for env_id in TEACHING:
        policies = {
            "teacher": lambda env_id=env_id: TeacherPolicy(teacher(env_id, 1.0)),
            "skill": lambda env_id=env_id: learned(env_id, 0),
        }
        for name, strengths in list(PERTURBATIONS.items())[: 2 if quick else None]:
            reports = {
                who: rows.evaluated(
                    f"{kebab_case(env_id)}-{who}-{'-'.join(strengths) or 'none'}",
                    env_id,
                    policy,
                    SETUPS,
                    {"perturbation": strengths},
                )
                for who, policy in policies.items()
            }
            cells = [cell for report in reports.values() for cell in (success([report]), missed(report))]
            table.append([kebab_case(env_id), name, *cells])
    return markdown(["task", "perturbation", "teacher %", "failed before", "skill %", "failed before"], table)
