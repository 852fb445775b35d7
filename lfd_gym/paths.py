"""Where the project's own files lie, in a checkout as in an installed wheel, and how files are written whole."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path

from lfd_gym.errors import InvalidArgumentError


def assets() -> Path:
    """The folder of MJCF files: `lfd_gym/assets` in a wheel, `assets` beside the package in a checkout."""
    package = Path(str(resources.files("lfd_gym")))
    installed = package / "assets"
    return installed if installed.is_dir() else package.parent / "assets"


def check_writable(path: str | os.PathLike[str], *read: str | os.PathLike[str]) -> None:
    """Raise InvalidArgumentError where no file can be written, before long work for it; makes nothing.

    Args:
        path: of the file to write.
        read: files that are read for it, which must not be lost.
    """
    path = Path(path)
    if path.resolve() in [Path(other).resolve() for other in read]:
        raise InvalidArgumentError(f"cannot write '{path}': it is read here; choose another name")
    if path.is_dir():
        raise InvalidArgumentError(f"cannot write '{path}': it is a folder, a file name is needed")
    if path.exists() and not path.is_file():
        raise InvalidArgumentError(f"cannot write '{path}': it is no regular file")
    nearest = next(folder for folder in path.absolute().parents if folder.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        raise InvalidArgumentError(f"cannot write '{path}': '{nearest}' is no folder that can be written to")


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path in the same folder that takes the place of `path` only if the block succeeds.

    The folder is made if it is missing; of a symbolic link, the file that it names is written. Raises InvalidArgumentError
    where it cannot be written, be it only in the block because the disk is full.
    """
    path = Path(path).resolve()
    check_writable(path)
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        try:
            yield temporary
            temporary.chmod(0o666 & ~_umask())
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def writing(path: str | os.PathLike[str]) -> Iterator[None]:
    """Raise InvalidArgumentError for what the operating system refuses while the block writes `path`."""
    try:
        yield
    except OSError as error:
        raise InvalidArgumentError(f"cannot write '{path}': {error.strerror or error}") from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
