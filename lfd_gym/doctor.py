"""What this machine has, what is missing, and how to get it."""

import importlib.util
import os
import platform
from typing import NamedTuple

from lfd_gym import rendering
from lfd_gym.errors import RenderingUnavailableError
from lfd_gym.paths import assets
from lfd_gym.registry import EXTRAS
from lfd_gym.versions import versions


class Finding(NamedTuple):
    """One line of the doctor's report."""

    ok: bool
    what: str
    remark: str


def examine() -> list[Finding]:
    """All findings, in the order in which they matter."""
    findings = [Finding(True, name, version) for name, version in versions().items()]
    findings.append(Finding(True, "machine", f"{platform.machine()}, {platform.system()}, {os.cpu_count()} cores"))
    folder = assets()
    if folder.is_dir():
        findings.append(Finding(True, "assets", str(folder)))
    else:
        findings.append(Finding(False, "assets", f"missing at {folder}: install the package again"))
    findings.append(_rendering())
    for module, extra in EXTRAS.items():
        found = importlib.util.find_spec(module) is not None
        findings.append(Finding(found, module, "installed" if found else f"optional: pip install 'lfd-gym[{extra}]'"))
    return findings


def table(findings: list[Finding]) -> str:
    """The findings as aligned text."""
    return "\n".join(f"{'ok' if f.ok else '--':<4}{f.what:<20}{f.remark}" for f in findings)


def _rendering() -> Finding:
    try:
        backend = rendering.prepare()
    except RenderingUnavailableError as error:
        return Finding(False, "rendering", str(error))
    works = rendering.works(backend)
    return Finding(works, "rendering", backend if works else f"MUJOCO_GL={backend} does not work: {rendering.HOW_TO}")
