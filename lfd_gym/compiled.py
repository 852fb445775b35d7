"""Compiled functions with their arguments fixed: called past Numba's type dispatch, which costs as much as a small kernel."""

from collections.abc import Callable
from functools import partial
from typing import Any

from numba import typeof


def bound(function: Any, *arguments: Any, call: tuple[Any, ...] = ()) -> Callable[..., Any]:
    """A compiled function with its first arguments fixed; `call` stands for those that come with each call."""
    function(*arguments, *call)
    signature = tuple(typeof(argument) for argument in (*arguments, *call))
    return partial(function.overloads[signature].entry_point, *arguments)
