"""One demonstration: what was measured while a teacher performed a task, and what the teacher says about it.

Demonstrations are kept in one HDF5 file in the layout that robomimic reads, with our own fields beside it:

    data                     total, env_args (robomimic); schema (ours)
      demo_0                 num_samples (robomimic); record: a JSON object of every field that is no array (ours)
        obs/<name>           (T, d)      next_obs/<name>   (T, d)
        actions, rewards, dones, states  T rows
        labels (T,), final_state (S,)    ours

There are no time stamps: equal demonstrations give equal bytes. Nothing in a file is ever executed.
"""

import io
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from numbers import Integral
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import h5py
import numpy as np

from lfd_gym.action import ActionLayout
from lfd_gym.errors import DemonstrationError, is_number
from lfd_gym.paths import written_whole

NO_LABEL = -1
"""Label of a step in which no primitive is active."""
SCHEMA = "lfd_gym.demonstrations/1"
FIELDS = ("dt", "success", "env_id", "env_kwargs", "seed", "setup", "teacher", "action_layout", "actions_derived")
"""Fields of a demonstration that are stored as JSON as they are."""


class EntityControl(NamedTuple):
    """How one primitive controls one entity (position, orientation or hand): the selection of thesis 2.1.2."""

    primitive: int
    """Which of the entity's own primitives this is."""
    frame: str
    """Frame in which its goal is constant: "world", or a tracked frame's name."""
    space: str
    """Task space: "cartesian" or "cylindrical" for the position, "rotation", "joints"."""
    axes: tuple[str, ...]
    """Per axis "position", "force" or "hold" (3 of position and orientation, 4 of the hand)."""


class Primitive(NamedTuple):
    """One row of the primitive table: which entities a label stands for."""

    name: str
    position: EntityControl
    orientation: EntityControl
    hand: EntityControl | None
    """None where the robot has no hand."""


@dataclass(frozen=True, eq=False)
class Demonstration:
    """T control steps of one teacher in one setup; frozen, and every array is a read-only copy.

    Raises DemonstrationError if the arrays do not fit each other, and for what cannot say where they come from.
    """

    observations: Mapping[str, np.ndarray]
    """Per observation name (T + 1, d): before each action, and the final one; units as in the environment."""
    actions: np.ndarray
    """(T, A) float32 in [-1, 1]; `action_layout` has their meaning."""
    rewards: np.ndarray
    """(T,)."""
    labels: np.ndarray
    """(T,) int: row of `primitives` that was active while each action was applied, or -1."""
    primitives: tuple[Primitive, ...]
    """The primitive table."""
    dt: float
    """Control step [s]."""
    success: bool
    """Whether the task was solved at the end."""
    env_id: str
    env_kwargs: Mapping[str, Any]
    """Constructor arguments of the environment that were not its defaults."""
    seed: Mapping[str, int]
    """{"teach": seed of the data set, "index": of this demonstration, "reset": seed of its `env.reset`}, as far as known."""
    setup: Mapping[str, Any]
    """Where the objects stood."""
    teacher: Mapping[str, Any]
    """{"name", "noise", "mode"}."""
    action_layout: Mapping[str, Any]
    """`ActionLayout.to_dict()`."""
    states: np.ndarray
    """(T + 1, S) full simulation states."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of the packages that made it."""
    actions_derived: bool = False
    """True if the arm was guided and the actions were inferred afterwards."""

    def __post_init__(self) -> None:
        """Copy and freeze the arrays and check their lengths, and check the environment's id, seeds and action layout."""
        _check_origin(self.env_id, self.seed, self.action_layout)
        actions = _frozen(self.actions, np.float32)
        observations = {name: _frozen(rows, np.float64) for name, rows in self.observations.items()}
        arrays = {
            "actions": actions,
            "rewards": _frozen(self.rewards, np.float64),
            "labels": _frozen(self.labels, np.int64),
            "states": _frozen(self.states, np.float64),
        }
        if actions.ndim != 2 or len(actions) == 0:
            raise DemonstrationError(f"actions have shape {actions.shape}; a demonstration needs (T, A) with T >= 1")
        n_steps = len(actions)
        for name, rows in observations.items():
            _check_shape(f"observation '{name}'", rows, n_steps + 1, 2)
        for name, ndim, length in (("rewards", 1, n_steps), ("labels", 1, n_steps), ("states", 2, n_steps + 1)):
            _check_shape(name, arrays[name], length, ndim)
        labels = arrays["labels"]
        if labels.min() < NO_LABEL or labels.max() >= len(self.primitives):
            raise DemonstrationError(
                f"labels lie in [{labels.min()}, {labels.max()}]; "
                f"the primitive table allows {NO_LABEL} to {len(self.primitives) - 1}"
            )
        if not self.dt > 0.0:
            raise DemonstrationError(f"the time step is {self.dt} s; it must be positive")
        for name, value in arrays.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "observations", MappingProxyType(observations))
        object.__setattr__(self, "primitives", tuple(self.primitives))

    def __len__(self) -> int:
        """Number of actions T."""
        return len(self.actions)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by fields (a mapping proxy cannot be pickled itself)."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return _rebuild, (type(self), values | {"observations": dict(self.observations)})

    @property
    def n_steps(self) -> int:
        """Number of actions T."""
        return len(self.actions)

    @property
    def layout(self) -> ActionLayout:
        """What the actions mean; DemonstrationError where `action_layout` is none of this suite."""
        try:
            return ActionLayout.from_dict(self.action_layout)
        except (TypeError, ValueError) as error:
            needed = ", ".join(scale.name for scale in fields(ActionLayout))
            raise DemonstrationError(f"the action layout is {dict(self.action_layout)}; needed are {needed}") from error

    @property
    def duration(self) -> float:
        """How long it took [s]."""
        return self.n_steps * self.dt


def check_same_environment(demonstrations: Sequence[Demonstration]) -> str:
    """The one environment id of all demonstrations; DemonstrationError if there are none or several."""
    ids = sorted({demonstration.env_id for demonstration in demonstrations})
    if len(ids) != 1:
        given = f"of {len(ids)} environments ({', '.join(ids)})" if ids else "missing"
        raise DemonstrationError(f"the demonstrations are {given}; one or more of a single environment are needed")
    return ids[0]


def check_alike(demonstrations: Sequence[Demonstration], labelled: bool = False) -> None:
    """Raise DemonstrationError unless time step, action layout, quantities and, where labelled, primitives are the same."""
    first, shared = demonstrations[0], {"dt": "time step", "action_layout": "action layout"}
    shared |= {"primitives": "primitive table"} if labelled else {}
    for i, other in enumerate(demonstrations[1:], start=1):
        for name, what in shared.items():
            if getattr(other, name) != getattr(first, name):
                raise DemonstrationError(f"the {what} of demonstration {i} differs from that of demonstration 0")
        if _sizes(other.observations) != _sizes(first.observations):
            raise DemonstrationError(f"demonstration {i} observes other quantities than demonstration 0")
        if other.actions.shape[1] != first.actions.shape[1]:
            raise DemonstrationError(
                f"the actions of demonstration {i} have another size than those of demonstration 0"
            )


def check_measured(name: str, demonstration: Demonstration, needs: Sequence[str], reads: tuple[str, ...] = ()) -> None:
    """Raise DemonstrationError for a needed observation that is missing, and for one of these, or read, that is not finite or
    whose quaternions are no orientations.

    Args:
        name: of the demonstration.
        demonstration: to be checked.
        needs: names of observations.
        reads: beginnings of the names of further ones, which need not be there.
    """
    missing = [need for need in needs if need not in demonstration.observations]
    if missing:
        raise DemonstrationError(f"{name} has no observation '{missing[0]}', which this method needs")
    for key, values in demonstration.observations.items():
        if not (key in needs or key.startswith(reads)):
            continue
        if not np.isfinite(values).all():
            raise DemonstrationError(f"the observation '{key}' of {name} is not finite; repeat the demonstration")
        if (key == "tool_quaternion" or key.startswith("frame_")) and values.shape[1] >= 4:
            check_quaternions(f"'{key}' of {name}", values[:, -4:])


def check_quaternions(what: str, quaternions: np.ndarray) -> None:
    """Raise DemonstrationError for a quaternion (N, 4) that is no orientation."""
    if not (np.abs(np.linalg.norm(quaternions, axis=1) - 1.0) < 1e-3).all():
        raise DemonstrationError(f"a quaternion in {what} is not of length 1; repeat the demonstration")


def taught_seeds(demonstrations: Sequence[Demonstration]) -> tuple[int, ...]:
    """Reset seeds of the demonstrations whose seed is known."""
    return tuple(int(d.seed["reset"]) for d in demonstrations if "reset" in d.seed)


def save_demonstrations(path: str | os.PathLike[str], demonstrations: Sequence[Demonstration]) -> None:
    """Write all demonstrations into one file, whole or not at all; DemonstrationError if there are none.

    The file is made in memory, for HDF5 does not recover from a disk that is full.
    """
    if not demonstrations:
        raise DemonstrationError("no demonstrations to save; at least one is needed")
    memory = io.BytesIO()
    with h5py.File(memory, "w", libver=("v110", "v110")) as file:
        data = file.create_group("data")
        first = demonstrations[0]
        env_args = {"env_name": first.env_id, "type": "gymnasium", "env_kwargs": dict(first.env_kwargs)}
        data.attrs["schema"] = SCHEMA
        data.attrs["total"] = sum(len(demonstration) for demonstration in demonstrations)
        data.attrs["env_args"] = _to_json(env_args)
        for i, demonstration in enumerate(demonstrations):
            _write(data.create_group(f"demo_{i}"), demonstration)
    with written_whole(path) as temporary:
        temporary.write_bytes(memory.getbuffer())


def load_demonstrations(path: str | os.PathLike[str]) -> list[Demonstration]:
    """Read all demonstrations of a file.

    Raises DemonstrationError, in one line, if the file is missing, no HDF5, truncated, of another program or schema, or
    if its contents do not fit each other.
    """
    path = Path(path)
    if not path.is_file():
        reason = "it is a folder" if path.is_dir() else "there is no such file"
        raise DemonstrationError(f"no demonstrations at '{path}': {reason}; 'lfd-gym teach' writes a file")
    try:
        with h5py.File(path, "r") as file:
            data = file.get("data")
            schema = data.attrs.get("schema") if isinstance(data, h5py.Group) else None
            if schema != SCHEMA:
                found = f"schema '{schema}'" if schema else "no lfd_gym schema"
                raise DemonstrationError(f"it has {found}; '{SCHEMA}' is read")
            demonstrations = [_read(data[f"demo_{i}"]) for i in range(len(data))]
    except DemonstrationError as error:
        raise DemonstrationError(f"'{path}' is no file of demonstrations: {error}") from error
    except (OSError, KeyError, IndexError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        reason = str(error.args[0] if error.args else error).splitlines()[0]
        raise DemonstrationError(
            f"'{path}' is no readable HDF5 file of demonstrations, or it is truncated ({reason}); record it again"
        ) from error
    if not demonstrations:
        raise DemonstrationError(f"'{path}' holds no demonstrations; at least one is needed")
    return demonstrations


def _rebuild(cls: type[Demonstration], values: dict[str, Any]) -> Demonstration:
    return cls(**values)


def _check_origin(env_id: Any, seed: Any, action_layout: Any) -> None:
    if not isinstance(env_id, str):
        raise DemonstrationError(f"the environment's id is {env_id!r}; it must be a text")
    if not isinstance(seed, Mapping) or not all(is_number(s) and isinstance(s, Integral) for s in seed.values()):
        raise DemonstrationError(
            f"the seed is {seed!r}; it must be whole numbers by name, such as {{'reset': 7}}, or {{}}"
        )
    if not isinstance(action_layout, Mapping):
        raise DemonstrationError(f"the action layout is {action_layout!r}; it must be numbers by name")


def _sizes(observations: Mapping[str, np.ndarray]) -> dict[str, int]:
    return {name: rows.shape[1] for name, rows in observations.items()}


def _frozen(rows: Any, dtype: type) -> np.ndarray:
    copy: np.ndarray = np.array(rows, dtype=dtype, order="C")
    copy.setflags(write=False)
    return copy


def _check_shape(name: str, rows: np.ndarray, length: int, ndim: int) -> None:
    if rows.ndim != ndim or len(rows) != length:
        raise DemonstrationError(
            f"{name} has shape {rows.shape}; with {length} rows and {ndim} dimensions it would fit the actions"
        )


def _write(group: h5py.Group, demonstration: Demonstration) -> None:
    n_steps = len(demonstration)
    group.attrs["num_samples"] = n_steps
    record = {name: _plain(getattr(demonstration, name)) for name in FIELDS}
    record["versions"] = _plain(demonstration.versions)
    record["primitives"] = demonstration.primitives
    group.attrs["record"] = _to_json(record)
    dones = np.zeros(n_steps, dtype=np.int64)
    dones[-1] = 1
    arrays = {
        "actions": demonstration.actions,
        "rewards": demonstration.rewards,
        "dones": dones,
        "labels": demonstration.labels,
        "states": demonstration.states[:-1],
        "final_state": demonstration.states[-1],
    }
    for name, rows in demonstration.observations.items():
        arrays[f"obs/{name}"], arrays[f"next_obs/{name}"] = rows[:-1], rows[1:]
    for name, rows in arrays.items():
        group.create_dataset(name, data=rows, compression="gzip", shuffle=True, track_times=False)


def _read(group: h5py.Group) -> Demonstration:
    record = json.loads(group.attrs["record"])
    record["primitives"] = tuple(_primitive(row) for row in record["primitives"])
    after = group["next_obs"]
    return Demonstration(
        observations={name: np.concatenate([rows[:], after[name][-1:]]) for name, rows in group["obs"].items()},
        actions=group["actions"][:],
        rewards=group["rewards"][:],
        labels=group["labels"][:],
        states=np.concatenate([group["states"][:], group["final_state"][:][None]]),
        **record,
    )


def _primitive(row: list[Any]) -> Primitive:
    name, *entities = row
    controls = [e and EntityControl(int(e[0]), e[1], e[2], tuple(e[3])) for e in entities]
    return Primitive(name, *controls)


def _plain(value: Any) -> Any:
    return dict(value) if isinstance(value, Mapping) else value


def _to_json(value: Any) -> str:
    return json.dumps(value, sort_keys=True, default=_to_builtin)


def _to_builtin(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise DemonstrationError(
        f"a demonstration cannot store a {type(value).__name__}; JSON values and arrays are possible"
    )
