"""What the texts on the command line stand for: settings, teachers, learners, policies."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from lfd_gym.errors import InvalidArgumentError

NO_SETTINGS: Mapping[str, Any] = MappingProxyType({})


def parse_settings(settings: Sequence[str] | None) -> dict[str, Any]:
    """`name=value` texts as a dictionary; a value is JSON, True, False, None or else a string. Raises InvalidArgumentError."""
    parsed: dict[str, Any] = {}
    for text in settings or ():
        name, separator, value = text.partition("=")
        if not (separator and name.isidentifier()):
            raise InvalidArgumentError(f"--set {text}: it must read name=value, such as control_hz=25")
        try:
            parsed[name] = json.loads({"True": "true", "False": "false", "None": "null"}.get(value, value))
        except json.JSONDecodeError:
            parsed[name] = value
    return parsed


def teacher(env_id: str, noise: float, mode: str = "commanded", settings: Mapping[str, Any] = NO_SETTINGS) -> Any:
    """The teacher of an environment; settings of the environment that concern the teacher too, such as `words`, reach it."""
    from lfd_gym.registry import arguments, look_up, task_id
    from scripted_teachers import TEACHERS

    kind = look_up(TEACHERS, "teacher for", task_id(env_id))
    own = arguments(kind).keys() - {"noise", "mode"}
    shared = {name: value for name, value in settings.items() if name in own}
    return kind(noise=noise, mode=mode, **shared)


def learner(method: str, settings: dict[str, Any]) -> Any:
    """A learner with these parameters."""
    from lfd_gym.registry import check_arguments, look_up
    from policies import LEARNERS

    kind = look_up(LEARNERS, "method", method)
    check_arguments(kind, settings, f"method '{method}'")
    return kind(**settings)


def policy(
    skill: str,
    env_id: str,
    noise: float | None = None,
    mode: str | None = None,
    settings: Mapping[str, Any] = NO_SETTINGS,
) -> Any:
    """The policy that "teacher", "random" or the path of a skill stands for; noise and mode are the teacher's."""
    from lfd_gym.rollout import RandomPolicy, TeacherPolicy

    if skill == "teacher":
        return TeacherPolicy(teacher(env_id, 1.0 if noise is None else noise, mode or "commanded", settings))
    if (noise, mode) != (None, None):
        raise InvalidArgumentError(f"--noise and --mode are the teacher's; '{skill}' has neither")
    if skill == "random":
        return RandomPolicy()
    from policies import load_skill

    return load_skill(Path(skill))
