"""The action: the effective attractor goal. The only place that knows the layout of the action vector.

Every movement primitive of the thesis, a linear attractor (2.1) as well as a mixture of them (4.9), only chooses the goal g of
an attractor, so g is the action. All parts are scaled to [-1, 1]:

| part | size | physical meaning |
|---|---|---|
| position | 3 | goal of the tool point, world frame [m], over the workspace box |
| rotation | 3 | rotation vector r [rad]: R_goal = exp(r) R_ref in world axes, over the rotation limits |
| force | 3 | force of the tool *on the world*, world frame [N], over the force limit; below `DEAD_ZONE` of it none |
| hand | 4 | goal joint angles of spread and three fingers [rad]; absent where a pen is mounted |

The dead zone is subtracted and what remains is stretched, so that force 1 is the force limit and the force starts from zero.
Not every pose in the workspace box is within the arm's reach: a goal beyond is followed as far as the arm can.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lfd_gym import quaternion
from lfd_gym.errors import InvalidActionError

Array = NDArray[np.float64]

DEAD_ZONE = 0.25
"""Fraction of the force limit below which no force is commanded."""


class Goal(NamedTuple):
    """What an action means."""

    position: Array
    """Goal of the tool point, world frame, shape (3,) [m]."""
    quaternion: Array
    """Goal orientation of the tool (w, x, y, z), world frame."""
    force: Array
    """Force of the tool on the world, world frame, shape (3,) [N]; zero means none."""
    hand: Array
    """Goal angles of spread and fingers, shape (4,) or (0,) [rad]."""


@dataclass(frozen=True)
class ActionLayout:
    """Scales of one environment's actions and the attractor that they feed; stored with every demonstration."""

    workspace_low: Array
    """Lower corner of the workspace box of the tool point, world frame, shape (3,) [m]."""
    workspace_high: Array
    """Upper corner, shape (3,) [m]."""
    rotation_limit: Array
    """Largest absolute components of the rotation vector (tilt, tilt, yaw), shape (3,) [rad]."""
    force_limit: float
    """Largest force [N]."""
    hand_low: Array
    """Smallest joint angles of the hand, shape (4,), or (0,) without a hand [rad]."""
    hand_high: Array
    """Largest joint angles of the hand [rad]."""
    reference_quaternion: Array
    """R_ref: the tool points down."""
    alpha: float
    """Gain of the attractor [1/s]."""
    beta: float
    """Gain of the attractor [1/s]."""
    speed_limit: float
    """Largest speed of the reference [m/s]."""
    turn_limit: float
    """Largest angular speed of the reference [rad/s]."""

    def __post_init__(self) -> None:
        """Own the arrays and freeze them."""
        for field in fields(self):
            value = getattr(self, field.name)
            if field.type is not float and not isinstance(value, float | int):
                array = np.array(value, dtype=np.float64)
                array.setflags(write=False)
                object.__setattr__(self, field.name, array)

    position = slice(0, 3)
    rotation = slice(3, 6)
    force = slice(6, 9)
    hand = slice(9, 13)

    @property
    def size(self) -> int:
        """Number of components of an action."""
        return 9 + self.hand_low.size

    def decode(self, action: ArrayLike) -> Goal:
        """The physical meaning of an action; finite values outside [-1, 1] are clipped.

        Raises:
            InvalidActionError: wrong shape, or not finite.
        """
        a = np.asarray(action, dtype=np.float64)
        if a.shape != (self.size,):
            raise InvalidActionError(f"action of shape {a.shape}; expected ({self.size},)")
        goal = decode_array(
            a,
            self.workspace_low,
            self.workspace_high,
            self.rotation_limit,
            self.force_limit,
            self.hand_low,
            self.hand_high,
            self.reference_quaternion,
        )
        if goal[0] != goal[0]:
            where = ", ".join(map(str, np.flatnonzero(~np.isfinite(a))))
            raise InvalidActionError(f"action is not finite in component {where}; expected numbers in [-1, 1]")
        return Goal(goal[0:3], goal[3:7], goal[7:10], goal[10:])

    def encode(
        self, position: ArrayLike, quaternion_: ArrayLike, force: ArrayLike = (0.0, 0.0, 0.0), hand: ArrayLike = ()
    ) -> NDArray[np.float32]:
        """The action for a physical goal, as far as the box allows; inverse of `decode` inside it.

        Raises:
            InvalidActionError: the number of hand angles does not fit.
        """
        f, angles = np.asarray(force, float), np.asarray(hand, float)
        if angles.shape != self.hand_low.shape:
            raise InvalidActionError(f"{angles.size} hand angles; expected {self.hand_low.size}")
        return encode_array(
            np.asarray(position, float),
            np.asarray(quaternion_, float),
            f,
            math.sqrt(f @ f),
            angles,
            self.workspace_low,
            self.workspace_high,
            self.rotation_limit,
            self.force_limit,
            self.hand_low,
            self.hand_high,
            self.reference_quaternion,
        )

    def force_scale(self, action: ArrayLike, factor: float) -> float:
        """What multiplies the force components of an action so that it commands `factor` times its force [N].

        As far as the limit allows; 1 where no force is commanded, or the factor is 1.
        """
        size = float(np.linalg.norm(np.asarray(action, dtype=np.float64)[self.force]))
        if factor == 1.0 or size <= DEAD_ZONE:
            return 1.0
        return (DEAD_ZONE + min(factor * (size - DEAD_ZONE), 1.0 - DEAD_ZONE)) / size

    def to_dict(self) -> dict[str, Any]:
        """JSON-able fields; `from_dict` is the inverse."""
        return {
            f.name: value.tolist() if isinstance(value := getattr(self, f.name), np.ndarray) else float(value)
            for f in fields(self)
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> "ActionLayout":
        """The layout that `to_dict` wrote."""
        return cls(**values)

    def __eq__(self, other: object) -> bool:
        """Equal where every number is."""
        return isinstance(other, ActionLayout) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        """Hash of the numbers."""
        return hash(json.dumps(self.to_dict()))


@njit(cache=True)
def decode_array(
    action: Array,
    low: Array,
    high: Array,
    rotation_limit: Array,
    force_limit: float,
    hand_low: Array,
    hand_high: Array,
    reference: Array,
) -> Array:
    """Position, quaternion, force and hand angles in one array (10 or 14,); NaN first where the action is not finite."""
    goal = np.empty(10 + hand_low.size)
    for value in action:
        if not np.isfinite(value):
            goal[0] = np.nan
            return goal
    a = np.minimum(np.maximum(action, -1.0), 1.0)
    goal[0:3] = low + 0.5 * (a[0:3] + 1.0) * (high - low)
    goal[3:7] = quaternion.multiply(quaternion.from_rotation_vector(a[3:6] * rotation_limit), reference)
    magnitude = math.sqrt(a[6] * a[6] + a[7] * a[7] + a[8] * a[8])
    scale = 0.0
    if magnitude > DEAD_ZONE:
        scale = force_limit * min((magnitude - DEAD_ZONE) / (1.0 - DEAD_ZONE), 1.0) / magnitude
    goal[7:10] = scale * a[6:9]
    goal[10:] = hand_low + 0.5 * (a[9:] + 1.0) * (hand_high - hand_low)
    return goal


@njit(cache=True)
def encode_array(
    position: Array,
    orientation: Array,
    force: Array,
    magnitude: float,
    hand: Array,
    low: Array,
    high: Array,
    rotation_limit: Array,
    force_limit: float,
    hand_low: Array,
    hand_high: Array,
    reference: Array,
) -> NDArray[np.float32]:
    """The action (9,) or (13,) of a goal whose force has the given magnitude [N]."""
    out = np.zeros(9 + hand_low.size)
    out[0:3] = 2.0 * (position - low) / (high - low) - 1.0
    relative = quaternion.multiply(orientation, quaternion.conjugate(reference))
    out[3:6] = quaternion.to_rotation_vector(relative) / rotation_limit
    if magnitude != 0.0:
        stretched = DEAD_ZONE + (1.0 - DEAD_ZONE) * min(magnitude / force_limit, 1.0)
        out[6:9] = force * (stretched / magnitude)
    out[9:] = 2.0 * (hand - hand_low) / (hand_high - hand_low) - 1.0
    return np.minimum(np.maximum(out, -1.0), 1.0).astype(np.float32)
