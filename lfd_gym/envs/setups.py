"""Setups: where the objects stand at a reset, as `{object: {"position": [x, y], "yaw": angle, ...}}`."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lfd_gym import quaternion
from lfd_gym.errors import InvalidSetupError, is_finite

ATTEMPTS = 1000
"""How often the objects that are not named are drawn anew around those that are."""

Setup = dict[str, Any]


def complete(wanted: Any, sample: Callable[[], Setup], check: Callable[[Setup], None]) -> Setup:
    """A setup with what is wanted, the rest drawn at random around it.

    Args:
        wanted: None, or a mapping with some of the objects and some of their coordinates.
        sample: draws a whole setup.
        check: raises InvalidSetupError for a setup that cannot be.

    Raises:
        InvalidSetupError: an unknown object or coordinate, out of reach, overlapping, or no room for the rest.
    """
    fresh = sample()
    if wanted is None:
        return fresh
    if not isinstance(wanted, Mapping):
        raise InvalidSetupError(f"setup {wanted!r}; expected a mapping of object to {{position, yaw}}")
    for name, pose in wanted.items():
        if name not in fresh:
            raise InvalidSetupError(f"no object '{name}' in the setup; possible: {', '.join(fresh)}")
        unknown = set(pose) - set(fresh[name]) if isinstance(pose, Mapping) else {repr(pose)}
        if unknown:
            raise InvalidSetupError(f"'{min(map(str, unknown))}' of '{name}'; possible: {', '.join(fresh[name])}")
        for key, value in pose.items():
            if isinstance(fresh[name][key], float) and not is_finite(value):
                raise InvalidSetupError(f"{key} {value!r} of '{name}'; expected a finite number")
            if isinstance(fresh[name][key], str) and not isinstance(value, str):
                raise InvalidSetupError(f"{key} {value!r} of '{name}'; expected a text such as '{fresh[name][key]}'")
    wanted = {name: {key: _plain(value) for key, value in pose.items()} for name, pose in wanted.items()}
    nothing_to_draw = all(set(wanted.get(name, ())) == set(pose) for name, pose in fresh.items())
    faults: Counter[str] = Counter()
    for _ in range(ATTEMPTS):
        setup = {name: {**pose, **wanted.get(name, {})} for name, pose in fresh.items()}
        try:
            check(setup)
        except InvalidSetupError as error:
            if nothing_to_draw:
                raise
            faults[str(error)] += 1
            fresh = sample()
            continue
        return setup
    fault, times = faults.most_common(1)[0]
    # what is wrong with the named objects themselves is wrong nearly always
    own = times > 0.1 * ATTEMPTS
    raise InvalidSetupError(fault if own else f"no room for what the setup does not name: for example, {fault}")


def apart(
    rng: np.random.Generator,
    names: Sequence[str],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    distance: float,
) -> Setup:
    """Two objects uniform in an area (x, y) [m], any yaw, by rejection of pairs that are closer than a distance [m]."""
    while True:
        places = rng.uniform(low, high, (2, 2))
        if np.linalg.norm(places[0] - places[1]) >= distance:
            yaws = rng.uniform(-np.pi, np.pi, 2)
            return {
                name: {"position": place.tolist(), "yaw": float(yaw)}
                for name, place, yaw in zip(names, places, yaws, strict=True)
            }


def check_apart(setup: Mapping[str, Any], low: ArrayLike, high: ArrayLike, distance: float) -> None:
    """Raise InvalidSetupError unless both objects are in their area and apart."""
    for name, pose in setup.items():
        within(name, pose["position"], low, high)
    (one, a), (other, b) = setup.items()
    between = float(np.linalg.norm(np.subtract(a["position"], b["position"])))
    if between < distance - 1e-9:
        raise InvalidSetupError(f"{one} and {other} are {between:.3f} m apart; possible: at least {distance} m")


def within(name: str, position: ArrayLike, low: ArrayLike, high: ArrayLike) -> None:
    """Raise InvalidSetupError where an object does not stand in its area (x, y) [m]."""
    numbers = isinstance(position, list) and all(isinstance(x, float) for x in position)
    p = np.array(position if numbers else [])
    if p.shape != (2,) or not np.isfinite(p).all():
        raise InvalidSetupError(f"position {position!r} of '{name}'; expected [x, y] in metres")
    (x0, y0), (x1, y1) = np.asarray(low).tolist(), np.asarray(high).tolist()
    if not (x0 - 1e-9 <= p[0] <= x1 + 1e-9 and y0 - 1e-9 <= p[1] <= y1 + 1e-9):
        raise InvalidSetupError(
            f"'{name}' at {p.tolist()} is out of reach; possible: x from {x0} to {x1}, y from {y0} to {y1} m"
        )


def check_reach(name: str, position: Sequence[float], least: float) -> None:
    """Raise InvalidSetupError where an object stands too near to the axis of the robot's base [m]."""
    reach = math.hypot(*position)
    if reach < least - 1e-9:
        raise InvalidSetupError(f"'{name}' is {reach:.3f} m from the robot; possible: at least {least} m")


def in_range(what: str, value: Any, low: float, high: float) -> None:
    """Raise InvalidSetupError where a number lies outside its range."""
    if not is_finite(value) or not low - 1e-9 <= value <= high + 1e-9:
        raise InvalidSetupError(f"{what} is {value!r}; possible: {low:.4g} to {high:.4g}")


def _plain(value: Any) -> Any:
    """Numbers as floats of Python; whatever else there is as it is, for `check` to refuse."""
    if is_finite(value):
        return float(value)
    try:
        array = np.asarray(value)
    except ValueError:
        return value
    return array.astype(np.float64).tolist() if array.dtype.kind in "iuf" else value


def upright(yaw: float) -> NDArray[np.float64]:
    """Quaternion of an object that stands upright, turned by `yaw` [rad]."""
    return quaternion.from_rotation_vector(np.array([0.0, 0.0, yaw]))
