"""Checks of what a user gave a constructor, made where it is used: in `fit`."""

from numbers import Integral
from typing import Any

import numpy as np

from lfd_gym.errors import InvalidArgumentError, is_number


def check_number(name: str, value: Any, least: float, most: float) -> None:
    """Raise InvalidArgumentError, naming the argument and what is possible, for all but a number in [least, most]."""
    if not (is_number(value) and least <= value <= most):
        raise InvalidArgumentError(f"{name} is {value!r}; possible: a number from {least:g} to {most:g}")


def check_count(name: str, value: Any, least: int) -> None:
    """Raise InvalidArgumentError, naming the argument and what is possible, for all but a whole number >= least."""
    if not (is_whole(value) and value >= least):
        raise InvalidArgumentError(f"{name} is {value!r}; possible: a whole number from {least} on")


def is_whole(value: Any) -> bool:
    """Whether a user gave a whole number, Python's or numpy's; a bool is none."""
    return is_number(value) and isinstance(value, Integral)


def check_flag(name: str, value: Any) -> None:
    """Raise InvalidArgumentError, naming the argument and what is possible, for all but a truth value."""
    if not isinstance(value, bool | np.bool_):
        raise InvalidArgumentError(f"{name} is {value!r}; possible: True, False")
