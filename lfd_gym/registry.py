"""What there is: one visible row per environment, imported only when it is made.

The registries of the other packages (`policies.LEARNERS`, `scripted_teachers.TEACHERS`) are `{"name":
"package.module:Class"}`, without a time limit, and are read with the same `load`.
"""

import importlib
import inspect
import os
import re
import sys
from collections.abc import Mapping
from typing import Any, NamedTuple

import gymnasium

from lfd_gym.errors import (
    InvalidArgumentError,
    LfdGymError,
    MissingExtraError,
    RenderingUnavailableError,
    UnknownNameError,
)

EXTRAS = {
    "torch": "rl", "stable_baselines3": "rl", "sb3_contrib": "rl", "cma": "rl",
    "minari": "data", "pandas": "data", "pyarrow": "data", "ray": "cluster",
}  # fmt: skip
"""Modules that only an extra installs, and that extra."""


class EnvironmentEntry(NamedTuple):
    """One row of the registry of environments."""

    entry_point: str
    """Where the class is: "package.module:Class"."""
    seconds: float
    """Time limit of an episode [s]."""


ENVIRONMENTS: dict[str, EnvironmentEntry] = {
    "lfd_gym/MoveObject-v0": EnvironmentEntry("lfd_gym.envs.move_object:MoveObjectEnv", seconds=30.0),
    "lfd_gym/LightBulb-v0": EnvironmentEntry("lfd_gym.envs.light_bulb:LightBulbEnv", seconds=90.0),
    "lfd_gym/BoxStacking-v0": EnvironmentEntry("lfd_gym.envs.box_stacking:BoxStackingEnv", seconds=90.0),
    "lfd_gym/BoxFlipping-v0": EnvironmentEntry("lfd_gym.envs.box_flipping:BoxFlippingEnv", seconds=30.0),
    "lfd_gym/Whiteboard-v0": EnvironmentEntry("lfd_gym.envs.whiteboard:WhiteboardEnv", seconds=60.0),
    "lfd_gym/CylinderGrasp-v0": EnvironmentEntry("lfd_gym.envs.cylinder_grasp:CylinderGraspEnv", seconds=60.0),
}


def register() -> None:
    """Tell Gymnasium about every environment and its dense variant; calling it twice changes nothing.

    The environments end an episode themselves, since their limits are in seconds and not in steps.
    """
    for env_id, entry in ENVIRONMENTS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(id=env_id, entry_point=entry.entry_point)
            gymnasium.register(id=dense_id(env_id), entry_point=entry.entry_point, kwargs={"reward_type": "dense"})


def dense_id(env_id: str) -> str:
    """The same task with the dense reward: "lfd_gym/LightBulb-v0" has "lfd_gym/LightBulbDense-v0"."""
    task, _, version = env_id.rpartition("-")
    return f"{task}Dense-{version}"


def task_id(env_id: str) -> str:
    """The row of `ENVIRONMENTS` that an id, its dense variant or "module:id" belongs to."""
    task, _, version = env_id.rpartition(":")[2].rpartition("-")
    return f"{task.removesuffix('Dense')}-{version}"


def kebab_case(env_id: str) -> str:
    """The task's short name: "lfd_gym/LightBulb-v0" is "light-bulb"."""
    task = env_id.rpartition("/")[2].rpartition("-v")[0]
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", task).lower()


def environment_id(name: str) -> str:
    """The full id of an environment given by its short name ("light-bulb"), its full id, or "module:id".

    Raises UnknownNameError, InvalidArgumentError for what is not a name.
    """
    if not isinstance(name, str):
        raise InvalidArgumentError(f"environment {name!r}; expected a name such as 'light-bulb'")
    if name in ENVIRONMENTS or name in gymnasium.registry or re.fullmatch("[^:]+:[^:]+", name):
        return name
    short = {kebab_case(env_id): env_id for env_id in ENVIRONMENTS}
    dense = {kebab_case(dense_id(env_id)): dense_id(env_id) for env_id in ENVIRONMENTS}
    if name not in short | dense:
        raise UnknownNameError("environment", name, short)
    return (short | dense)[name]


def make(name: str, /, **kwargs: Any) -> gymnasium.Env:
    """`gymnasium.make` by short name or id, with its own arguments and those of the environment.

    Raises UnknownNameError for an unknown environment, InvalidArgumentError for an argument it does not take, and for an
    environment of another module that cannot be made.
    """
    env_id = environment_id(name)
    if task_id(env_id) in ENVIRONMENTS:
        register()
        entry = ENVIRONMENTS[task_id(env_id)]
        general = inspect.signature(gymnasium.make).parameters
        own = {key: value for key, value in kwargs.items() if key not in general}
        check_arguments(load(entry.entry_point), own, f"environment '{kebab_case(env_id)}'")
    try:
        return gymnasium.make(env_id, **kwargs)
    except LfdGymError:
        raise
    except (TypeError, ValueError, ModuleNotFoundError, gymnasium.error.Error) as error:
        reason = str(error).partition(" was raised from")[0]
        raise InvalidArgumentError(f"environment '{name}' cannot be made with {kwargs}: {reason}") from error


def load(path: str) -> Any:
    """The object at "package.module:Name".

    Raises MissingExtraError where a module of an extra is not installed, RenderingUnavailableError where MuJoCo cannot be
    imported with the MUJOCO_GL that is set.
    """
    module, _, name = path.partition(":")
    try:
        return getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing in EXTRAS:
            raise MissingExtraError(name, EXTRAS[missing], missing) from error
        raise
    except (AttributeError, ImportError, RuntimeError) as error:
        backend = os.environ.get("MUJOCO_GL")
        if backend and "mujoco" not in sys.modules:
            raise RenderingUnavailableError(f"MuJoCo cannot be imported with MUJOCO_GL={backend}") from error
        raise


def look_up(registry: Mapping[str, str], kind: str, name: str) -> Any:
    """The class registered as `name`, imported now; UnknownNameError lists what there is."""
    if name not in registry:
        raise UnknownNameError(kind, name, registry)
    return load(registry[name])


def arguments(constructor: Any) -> dict[str, inspect.Parameter]:
    """The named arguments that a constructor takes; those of its base class too where it passes on all others."""
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    parameters = inspect.signature(constructor).parameters
    own = {n: p for n, p in parameters.items() if p.kind in kinds}
    if inspect.isclass(constructor) and any(p.kind == p.VAR_KEYWORD for p in parameters.values()):
        return own | arguments(constructor.__base__)
    return own


def check_arguments(constructor: Any, given: Mapping[str, Any], owner: str) -> None:
    """Raise InvalidArgumentError, naming what is possible, if `constructor` does not take what is given."""
    known = arguments(constructor)
    for name in given:
        if name not in known:
            raise InvalidArgumentError(f"{owner}: {UnknownNameError('argument', name, known)}")
