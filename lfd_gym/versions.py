"""The versions that a result depends on."""

import platform
from importlib import metadata

PACKAGES = ("lfd-gym", "mujoco", "gymnasium", "numpy", "scipy", "numba", "scikit-learn", "h5py")


def versions() -> dict[str, str]:
    """Version per package that shapes results, and Python's; a package that is not installed is left out."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found
