"""How often the scripted teachers succeed: clean, human, twice as noisy, guiding by hand, with slippery fingertips."""

from pathlib import Path
from typing import Any

from lfd_gym.experiments.rows import Rows, markdown, success
from lfd_gym.registry import ENVIRONMENTS, kebab_case, look_up
from lfd_gym.rollout import TeacherPolicy
from scripted_teachers import TEACHERS

CONDITIONS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "noise 0": ({"noise": 0.0}, {}),
    "noise 1": ({"noise": 1.0}, {}),
    "noise 2": ({"noise": 2.0}, {}),
    "kinesthetic": ({"noise": 1.0, "mode": "kinesthetic"}, {}),
    "fingertip friction 0.8": ({"noise": 1.0}, {"fingertip_friction": 0.8}),
}
"""Arguments of the teacher and of the environment."""


def run(out: Path, quick: bool, jobs: int) -> str:
    """Evaluate every teacher under every condition on 100 setups."""
    rows, table = Rows(out, quick, jobs), []
    for env_id in ENVIRONMENTS:
        row = [kebab_case(env_id)]
        for name, (teaching, env_kwargs) in CONDITIONS.items():

            def policy(env_id: str = env_id, teaching: dict[str, Any] = teaching) -> TeacherPolicy:
                return TeacherPolicy(look_up(TEACHERS, "teacher for", env_id)(**teaching))

            report = rows.evaluated(
                f"{kebab_case(env_id)}-{name.replace(' ', '-')}", env_id, policy, env_kwargs=env_kwargs
            )
            row.append(success([report]))
        table.append(row)
    return markdown(["teacher", *CONDITIONS], table)
