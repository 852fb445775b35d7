"""What all exported data sets have in common: one environment, and a folder that is written whole."""

import importlib
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.demonstration import Demonstration, check_alike, check_measured, check_same_environment
from lfd_gym.errors import DemonstrationError, InvalidArgumentError, MissingExtraError
from lfd_gym.paths import check_writable, writing


def check_exportable(demonstrations: Sequence[Demonstration]) -> str:
    """The id of the environment of all demonstrations.

    Raises DemonstrationError if there are several, or several arguments, if quantities or sizes differ, and for observations
    and actions that are not finite.
    """
    env_id = check_same_environment(demonstrations)
    if any(demonstration.env_kwargs != demonstrations[0].env_kwargs for demonstration in demonstrations):
        raise DemonstrationError(
            "the demonstrations were given with several arguments of the environment; one is needed"
        )
    check_alike(demonstrations)
    for i, demonstration in enumerate(demonstrations):
        check_measured(f"demonstration {i}", demonstration, tuple(demonstration.observations))
        if not np.isfinite(demonstration.actions).all():
            raise DemonstrationError(f"the actions of demonstration {i} are not finite; repeat the demonstration")
    return env_id


def imported(name: str) -> Any:
    """A module that the extra `data` installs; MissingExtraError without it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingExtraError("export", "data", name) from error


@contextmanager
def written_below(root: Path, name: str) -> Iterator[Path]:
    """Yield a temporary folder; what the block writes into its subfolder `name` becomes root / name if it succeeds.

    Raises InvalidArgumentError where that is taken or cannot be written.
    """
    folder = root / name
    if folder.exists():
        raise InvalidArgumentError(f"there is a data set '{folder}' already; choose another name")
    check_writable(folder)
    with writing(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".export-") as temporary:
            yield Path(temporary)
            (Path(temporary) / name).rename(folder)
