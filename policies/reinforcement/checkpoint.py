"""Checkpoints of a training: a folder beside the skill that it will become, from which a killed training goes on.

    job.json                      what is trained; another job refuses the folder
    lock                          held by the process that trains
    log.jsonl                     one line per evaluation
    checkpoint-000025000/         after so many decisions: agent.zip, replay_buffer.pkl, state.json

This is not the format of skills: agents and buffers are pickles, which run code when they are loaded. Load only your own.
"""

import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from lfd_gym.errors import InvalidArgumentError
from lfd_gym.paths import writing, written_whole

SCHEMA = "lfd_gym.training-checkpoint/1 (holds pickles: load only your own)"
PREFIX = "checkpoint-"
STATE = ("decisions", "seconds", "simulated_seconds", "episodes", "updates")
"""What is kept of how far a training has come."""


@contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold the folder of a training. Raises InvalidArgumentError while another process does."""
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / "lock")
        try:
            lock.acquire(timeout=0)
        except Timeout:
            raise InvalidArgumentError(
                f"'{folder}' is being trained in by another process; wait for it to end"
            ) from None
    try:
        yield
    finally:
        lock.release()


class TrainingFolder:
    """The folder of one training. Raises InvalidArgumentError if it holds checkpoints of another one."""

    def __init__(self, path: Path, job: Mapping[str, Any]) -> None:
        self.path, self.log = path, path / "log.jsonl"
        described = json.dumps({"schema": SCHEMA, **job}, indent=2, sort_keys=True) + "\n"
        file = path / "job.json"
        if self.latest() and file.exists() and file.read_text() != described:
            raise InvalidArgumentError(
                f"'{path}' holds checkpoints of another training; remove it, or choose another --out"
            )
        with written_whole(file) as temporary:
            temporary.write_text(described)

    def latest(self) -> Path | None:
        """The last whole checkpoint."""
        found = sorted(self.path.glob(PREFIX + "*[0-9]"))
        return found[-1] if found else None

    def state(self) -> dict[str, Any]:
        """What `write` was told with the last checkpoint; empty if there is none. InvalidArgumentError if it is damaged."""
        latest = self.latest()
        if latest is None:
            return {}
        with undamaged(latest):
            kept = json.loads((latest / "state.json").read_text())
            return {name: kept[name] for name in STATE}

    def write(self, agent: Any, state: Mapping[str, Any]) -> None:
        """Add a checkpoint, which is there whole or not at all, and remove older ones."""
        name = f"{PREFIX}{state['decisions']:09d}"
        partial, whole = self.path / f"{name}.part", self.path / name
        if whole.exists():
            return
        shutil.rmtree(partial, ignore_errors=True)
        with writing(whole):
            partial.mkdir()
            agent.save(partial / "agent.zip")
            if hasattr(agent, "save_replay_buffer"):
                agent.save_replay_buffer(partial / "replay_buffer.pkl")
            (partial / "state.json").write_text(json.dumps(dict(state), indent=2))
            os.replace(partial, whole)
        for other in self.path.glob(PREFIX + "*"):
            if other != whole:
                shutil.rmtree(other)

    def rows(self) -> list[dict[str, Any]]:
        """The log."""
        return read_log(self.path)

    def go_on(self, decisions: int) -> None:
        """Drop the lines of the log that a kill has left of an agent with more decisions, which is lost."""
        self._write_log([row for row in self.rows() if row["decisions"] <= decisions])

    def append(self, row: Mapping[str, Any]) -> None:
        """Add a line to the log."""
        self._write_log([*self.rows(), row])

    def _write_log(self, rows: Iterable[Mapping[str, Any]]) -> None:
        with written_whole(self.log) as temporary:
            temporary.write_text("".join(json.dumps(dict(row)) + "\n" for row in rows))


@contextmanager
def undamaged(checkpoint: Path) -> Iterator[None]:
    """Raise InvalidArgumentError for a checkpoint that the block cannot read."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:  # a damaged pickle raises whatever it comes upon
        raise InvalidArgumentError(
            f"the checkpoint '{checkpoint}' cannot be read; if it is damaged, remove it to train anew "
            f"({type(error).__name__}: {error})"
        ) from error


def read_log(folder: Path) -> list[dict[str, Any]]:
    """The lines of a training's log; none if it has not been evaluated. InvalidArgumentError if it is damaged."""
    log = folder / "log.jsonl"
    if not log.exists():
        return []
    try:
        return [json.loads(line) for line in log.read_text().splitlines()]
    except ValueError as error:
        raise InvalidArgumentError(f"the log '{log}' is damaged; remove it to go on without its curve") from error
