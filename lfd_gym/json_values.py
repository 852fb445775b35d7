"""Arguments as JSON values, so that what was run can be written down and run again."""

import json
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from typing import Any

import numpy as np

from lfd_gym.errors import InvalidArgumentError


def json_values(given: Mapping[str, Any]) -> dict[str, Any]:
    """The same arguments, NumPy's numbers, arrays and dataclasses as what JSON has. Raises InvalidArgumentError."""
    values: dict[str, Any] = json.loads(json.dumps(dict(given), default=_plain))
    return values


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    raise InvalidArgumentError(f"an argument {value!r} cannot be written down; JSON values and arrays can")
