"""What can go wrong, in one sentence each: every message says what was given and what is possible.

All errors share the base `LfdGymError`, which the command line prints as one line, and derive beside it from the
builtin that a caller would expect.
"""

import difflib
import math
from collections.abc import Iterable
from numbers import Real
from typing import Any


class LfdGymError(Exception):
    """Base of every error that this project raises on purpose."""


class InvalidArgumentError(LfdGymError, ValueError):
    """An argument lies outside what is possible."""


class InvalidActionError(LfdGymError, ValueError):
    """An action has the wrong shape or is not finite."""


class InvalidSetupError(LfdGymError, ValueError):
    """Objects were asked to stand where they cannot: out of reach, overlapping, or unknown."""


class DemonstrationError(LfdGymError, ValueError):
    """Demonstrations are missing, truncated, foreign, of another environment, or too few to learn from."""


class SkillFileError(LfdGymError, ValueError):
    """A skill on disk is missing, truncated, foreign, or of a schema that this version does not read."""


class SeedOverlapError(LfdGymError, ValueError):
    """A skill would be evaluated on a setup that it was taught on."""


class RenderingUnavailableError(LfdGymError, RuntimeError):
    """This machine has no OpenGL to render with."""


class UnknownNameError(LfdGymError, LookupError):
    """A name is not among the known ones: "no environment 'bulp'; possible: light-bulb, ..."."""

    def __init__(self, kind: str, name: Any, known: Iterable[str]) -> None:
        """State what kind of thing was asked for, the name that was given and the names that exist."""
        self.kind, self.name, self.known = kind, str(name), tuple(known)
        close = difflib.get_close_matches(self.name, self.known, n=1)
        hint = f" (did you mean '{close[0]}'?)" if close else ""
        super().__init__(f"no {kind} '{name}'{hint}; possible: {', '.join(self.known) or 'none'}")

    def __reduce__(self) -> tuple[type, tuple[str, str, tuple[str, ...]]]:
        """Pickle the three arguments, so that the error survives its way back from a worker process."""
        return type(self), (self.kind, self.name, self.known)


class MissingExtraError(LfdGymError, ImportError):
    """A method needs packages that are installed only with an extra."""

    def __init__(self, feature: str, extra: str, missing: str) -> None:
        """State the feature that was asked for, the extra it belongs to and the module that was not found."""
        self.arguments = (feature, extra, missing)
        super().__init__(f"{feature} needs '{missing}', which is not installed: pip install 'lfd-gym[{extra}]'")

    def __reduce__(self) -> tuple[type, tuple[str, str, str]]:
        """Pickle the three arguments."""
        return type(self), self.arguments


def is_finite(value: Any) -> bool:
    """Whether a user gave a number that a float can hold."""
    try:
        return is_number(value) and math.isfinite(value)
    except OverflowError:
        return False


def is_number(value: Any) -> bool:
    """Whether a user gave a real number, Python's or numpy's; a bool is none."""
    return isinstance(value, Real) and not isinstance(value, bool)
