"""The Omniglot handwriting data set (Lake et al. 2015), as strokes: its own zip and text layout, any alphabet.

The files are `strokes_background.zip` and `strokes_evaluation.zip` of https://github.com/brendenlake/omniglot, or the folders
that they unpack to: `<Alphabet>/character<nn>/<image>_<drawer>.txt`, in any parent folder. A file lists the strokes of one
drawing, each between START and BREAK, one point "x,y,milliseconds" per line; y grows upward and is negative.
"""

import os
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.errors import DemonstrationError, UnknownNameError

Array = NDArray[np.float64]

HOW_TO_GET = "download strokes_background.zip from https://github.com/brendenlake/omniglot (folder python)"


class Drawing(NamedTuple):
    """One character drawn by one person."""

    alphabet: str
    character: str
    """"character01", "character02", ..."""
    drawer: int
    """1 to 20."""
    strokes: tuple[Array, ...]
    """Each (N, 3): x, y in pixels of a 105 x 105 image, y negative, and time [s]."""


def read_drawings(path: str | os.PathLike[str], alphabet: str) -> list[Drawing]:
    """All drawings of an alphabet ("Latin", "Greek", ...) in a zip file or a folder, in the order of their names.

    Raises:
        DemonstrationError: the file is missing, is no zip or holds no drawings, or a drawing in it is damaged.
        UnknownNameError: another alphabet.
    """
    files = dict(_files(Path(path)))
    alphabets = sorted({name.parts[-3] for name in files})
    if not alphabets:
        raise DemonstrationError(f"'{path}' holds no drawings <alphabet>/<character>/<drawing>.txt; {HOW_TO_GET}")
    if alphabet not in alphabets:
        raise UnknownNameError("alphabet", alphabet, alphabets)
    own = sorted(name for name in files if name.parts[-3] == alphabet)
    return [Drawing(alphabet, name.parts[-2], _drawer(name), _strokes(name, files[name])) for name in own]


def single_strokes(drawings: list[Drawing], n_points: int) -> dict[str, list[Array]]:
    """Drawings made without lifting the pen, per character, as (n_points, 2) at equal times, preprocessed as in 4.4.1.

    Each is shifted to a mean of zero; then each is scaled to the standard deviation that the drawings of its character have on
    average, in pixels. Characters with no such drawing are left out; a drawing of a single point, or a single time, is none.
    """
    found: dict[str, list[Array]] = {}
    for drawing in drawings:
        x, y, time = np.ptp(drawing.strokes[0], axis=0)
        if len(drawing.strokes) == 1 and max(x, y) > 0.0 and time > 0.0:
            points = _resampled(drawing.strokes[0], n_points)
            found.setdefault(drawing.character, []).append(points - points.mean(axis=0))
    return {character: _alike(drawn) for character, drawn in found.items()}


def _alike(drawn: list[Array]) -> list[Array]:
    spreads = [np.sqrt((points**2).sum(axis=1).mean()) for points in drawn]
    return [points * (np.mean(spreads) / spread) for points, spread in zip(drawn, spreads, strict=True)]


def _resampled(stroke: Array, n_points: int) -> Array:
    """x, y at equal times; of points with one time the last counts, and a clock that goes backwards stands."""
    time = np.maximum.accumulate(stroke[:, 2])
    last = np.append(np.diff(time) > 0.0, True)
    at = np.linspace(time[last][0], time[last][-1], n_points)
    return np.stack([np.interp(at, time[last], stroke[last, i]) for i in range(2)], axis=1)


def _files(path: Path) -> Iterator[tuple[PurePosixPath, str]]:
    try:
        for name, content in _contents(path):
            if name.suffix == ".txt" and len(name.parts) >= 3:
                yield name, content().decode()
    except FileNotFoundError as error:
        raise DemonstrationError(f"there is no file '{path}'; {HOW_TO_GET}") from error
    except (zipfile.BadZipFile, zlib.error, UnicodeDecodeError) as error:
        raise DemonstrationError(f"'{path}' holds what cannot be read; {HOW_TO_GET}") from error


def _contents(path: Path) -> Iterator[tuple[PurePosixPath, Callable[[], bytes]]]:
    """Names in a folder or a zip file, and what reads their bytes."""
    if path.is_dir():
        for file in filter(Path.is_file, path.rglob("*")):
            yield PurePosixPath(path.absolute().name, file.relative_to(path).as_posix()), file.read_bytes
        return
    with zipfile.ZipFile(path) as archive:
        for name in archive.namelist():
            yield PurePosixPath(name), partial(archive.read, name)


def _drawer(name: PurePosixPath) -> int:
    try:
        return int(name.stem.split("_")[1])
    except (IndexError, ValueError) as error:
        raise DemonstrationError(f"'{name}' is not named <image>_<drawer>.txt") from error


def _strokes(name: PurePosixPath, text: str) -> tuple[Array, ...]:
    """The strokes of one file; time in seconds."""
    strokes: list[Array] = []
    points: list[list[float]] = []
    for line in text.split():
        if line == "START":
            points = []
        elif line == "BREAK":
            if points:
                strokes.append(np.array(points) * [1.0, 1.0, 1e-3])
            points = []
        else:
            try:
                point = [float(value) for value in line.split(",")]
            except ValueError:
                point = []
            if len(point) != 3 or not np.isfinite(point).all():
                raise DemonstrationError(f"'{name}' has a line '{line}'; expected x,y,milliseconds")
            points.append(point)
    if not strokes:
        raise DemonstrationError(f"'{name}' has no stroke")
    return tuple(strokes)
