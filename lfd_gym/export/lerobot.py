"""Demonstrations as a data set of LeRobot: version 3.0 of its format, without pictures.

    meta/info.json  stats.json  tasks.parquet  subtasks.parquet  episodes/chunk-000/file-000.parquet
    data/chunk-000/file-000.parquet         one row per control step of all demonstrations

| column | what it is |
|---|---|
| `observation.state` | what was measured on the robot, every observation but the frames, before the action |
| `observation.environment_state` | position and quaternion of the tracked frames |
| `action` | as the environment takes it |
| `next.reward`, `next.done`, `next.success` | after the action |
| `subtask_index` | the primitive that was active, a row of `meta/subtasks.parquet`; the first is "none" |
"""

import json
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfd_gym.action import ActionLayout
from lfd_gym.demonstration import NO_LABEL, Demonstration
from lfd_gym.errors import DemonstrationError, InvalidArgumentError
from lfd_gym.export.data_set import check_exportable, imported, written_below
from lfd_gym.registry import kebab_case

Columns = dict[str, NDArray[Any]]

REPO_ID = re.compile(r"\w[\w.-]*/\w[\w.-]*")
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
FIRST = FILE.format(chunk_index=0, file_index=0) + ".parquet"
QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)


def to_lerobot(demonstrations: Sequence[Demonstration], root: str | os.PathLike[str], repo_id: str) -> Path:
    """Write a data set below the folder `root`, whole or not at all, and return its own folder.

    `LeRobotDataset(repo_id, root=folder)` reads it. Its task is the environment's name in words.

    Raises MissingExtraError without the extra `data`, DemonstrationError for demonstrations of several environments or with
    several tables of primitives, and InvalidArgumentError for an id that is malformed or taken, and for time steps that are
    no fraction of a second.
    """
    pandas, arrow, parquet = (imported(name) for name in ("pandas", "pyarrow", "pyarrow.parquet"))
    env_id, first = check_exportable(demonstrations), demonstrations[0]
    if not REPO_ID.fullmatch(repo_id):
        raise InvalidArgumentError(f"'{repo_id}' is no id of a data set; it must read owner/name")
    if any(demonstration.primitives != first.primitives for demonstration in demonstrations):
        raise DemonstrationError("the demonstrations have several tables of primitives; one is needed")
    rate = round(1.0 / first.dt)
    if abs(rate * first.dt - 1.0) > 1e-9:
        raise InvalidArgumentError(f"a time step of {first.dt} s is no fraction of a second, which LeRobot needs")
    task = kebab_case(env_id).replace("-", " ")
    episodes, names = _episodes(demonstrations), _names(first)
    with written_below(Path(root), repo_id) as temporary:
        folder = temporary / repo_id
        for place in ("meta/episodes/" + FIRST, "data/" + FIRST):
            (folder / place).parent.mkdir(parents=True)
        everything = {name: np.concatenate([episode[name] for episode in episodes]) for name in episodes[0]}
        parquet.write_table(_table(arrow, everything), folder / "data" / FIRST)
        parquet.write_table(_index(arrow, episodes, task), folder / "meta" / "episodes" / FIRST)
        subtasks = ["none", *(primitive.name for primitive in first.primitives)]
        for kind, rows in (("task", [task]), ("subtask", subtasks)):
            numbered = pandas.DataFrame({f"{kind}_index": range(len(rows))}, index=rows)
            numbered.to_parquet(folder / "meta" / f"{kind}s.parquet")
        for name, value in (
            ("info", _info(everything, names, rate, len(episodes))),
            ("stats", _statistics(everything)),
        ):
            (folder / "meta" / f"{name}.json").write_text(json.dumps(value, indent=2) + "\n")
    return Path(root) / repo_id


def _episodes(demonstrations: Sequence[Demonstration]) -> list[Columns]:
    """The columns of every demonstration, T rows each."""
    episodes, begin = [], 0
    for i, demonstration in enumerate(demonstrations):
        n = len(demonstration)
        rows, ends = np.arange(n), np.arange(n) == n - 1
        robot, frames = _observed(demonstration)
        columns: Columns = {"observation.state": robot[:n].astype(np.float32)}
        if frames.shape[1]:
            columns["observation.environment_state"] = frames[:n].astype(np.float32)
        columns |= {
            "action": demonstration.actions,
            "next.reward": demonstration.rewards.astype(np.float32),
            "next.done": ends,
            "next.success": ends & demonstration.success,
            "subtask_index": demonstration.labels - NO_LABEL,
            "timestamp": (rows * demonstration.dt).astype(np.float32),
            "frame_index": rows,
            "episode_index": np.full(n, i),
            "index": begin + rows,
            "task_index": np.zeros(n, dtype=np.int64),
        }
        episodes.append(columns)
        begin += n
    return episodes


def _observed(demonstration: Demonstration) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What was measured on the robot and of the frames, (T + 1, D) each; columns in the order of `_names`."""
    none, seen = np.empty((len(demonstration) + 1, 0)), demonstration.observations
    robot, frames = (np.hstack([none, *(seen[name] for name in names)]) for names in _sides(demonstration))
    return robot, frames


def _sides(demonstration: Demonstration) -> tuple[list[str], list[str]]:
    """Names of the observations of the robot, and of the frames."""
    names = sorted(demonstration.observations)
    frames = [name for name in names if name.startswith("frame_")]
    return [name for name in names if name not in frames], frames


def _names(demonstration: Demonstration) -> dict[str, list[str]]:
    """Names of the components of the columns that have several."""
    seen, n_actions = demonstration.observations, demonstration.actions.shape[1]
    robot, frames = (
        [f"{name}.{i}" for name in own for i in range(seen[name].shape[1])] for own in _sides(demonstration)
    )
    parts = {part: getattr(ActionLayout, part) for part in ("position", "rotation", "force", "hand")}
    action = [f"{part}.{i}" for part, place in parts.items() for i in range(len(range(*place.indices(n_actions))))]
    return {"observation.state": robot, "observation.environment_state": frames, "action": action}


def _table(arrow: Any, columns: Columns) -> Any:
    """Columns (N,) and (N, D) as a table, the latter as lists of fixed length D where that is not 1."""
    arrays = {}
    for name, rows in columns.items():
        flat = arrow.array(rows.ravel())
        arrays[name] = arrow.FixedSizeListArray.from_arrays(flat, rows.shape[1]) if rows.size > len(rows) else flat
    return arrow.table(arrays)


def _index(arrow: Any, episodes: Sequence[Columns], task: str) -> Any:
    """One row per demonstration: where its rows are, and their statistics."""
    rows = []
    for i, episode in enumerate(episodes):
        begin, n = int(episode["index"][0]), len(episode["index"])
        row = {
            "episode_index": i,
            "tasks": [task],
            "length": n,
            "dataset_from_index": begin,
            "dataset_to_index": begin + n,
        }
        row |= {f"{place}/{number}_index": 0 for place in ("data", "meta/episodes") for number in ("chunk", "file")}
        for name, statistics in _statistics(episode).items():
            row |= {f"stats/{name}/{kind}": value for kind, value in statistics.items()}
        rows.append(row)
    return arrow.Table.from_pylist(rows)


def _statistics(columns: Columns) -> dict[str, dict[str, list[float]]]:
    """Per column minimum, maximum, mean, standard deviation, number and quantiles of every component."""
    found = {}
    for name, rows in columns.items():
        values = rows.reshape(len(rows), -1).astype(np.float64)
        kinds = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
        quantiles = zip(QUANTILES, np.quantile(values, QUANTILES, axis=0), strict=True)
        kinds |= {f"q{round(100 * share):02d}": value for share, value in quantiles}
        found[name] = {kind: value.tolist() for kind, value in kinds.items()} | {"count": [len(rows)]}
    return found


def _info(columns: Columns, names: Mapping[str, list[str]], rate: int, n_episodes: int) -> dict[str, Any]:
    """What LeRobot's info.json says."""
    features = {
        name: {"dtype": rows.dtype.name, "shape": [*rows.shape[1:]] or [1], "names": names.get(name)}
        for name, rows in columns.items()
    }
    return {
        "codebase_version": "v3.0",
        "robot_type": "barrett_wam",
        "total_episodes": n_episodes,
        "total_frames": len(columns["index"]),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {"train": f"0:{n_episodes}"},
        "data_path": f"data/{FILE}.parquet",
        "video_path": None,
        "features": features,
    }
