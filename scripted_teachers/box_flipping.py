"""The teacher of BoxFlipping (thesis 3.5.1, Table 3.1)."""

from collections.abc import Callable, Iterator

import numpy as np

from lfd_gym import quaternion
from lfd_gym.demonstration import EntityControl, Primitive
from lfd_gym.errors import InvalidArgumentError, is_number
from scripted_teachers.noise import STEADY_POSITION, STEADY_ROTATION
from scripted_teachers.teacher import (
    HOLD,
    POSITION,
    Array,
    Movement,
    Observation,
    ScriptedTeacher,
    minimum_jerk,
    primitive,
)

HAND = np.array([0.6, 0.6, 0.6, 2.44])
"""Two fingers spread by 17 cm, their outer links upright, the third tucked [rad]."""
BEHIND = (0.38, 0.035)
"""Away from the edge and up: behind the box, wherever it is [m]."""
PUSHED = (0.172, 0.035)
"""The box lies at the obstacle: its depth, the radius of a fingertip, and a little more [m]."""
FINAL = (0.18, 0.30)
"""The same of where the tool withdraws to [m]."""
LAST_ANGLE = np.radians(84.0)
"""The arc ends above the box that stands on its other face [rad]."""
FLIP_SPEED = 0.35
"""Angular speed of the flip about the edge [rad/s]."""
MAX_PRESS = 15.0
"""Firmest press that can be asked for [N]."""
FELT = 0.5
"""The flip begins when this fraction of its press is felt."""
APPROACH, PUSH, FLIP, WITHDRAW = range(4)


class BoxFlippingTeacher(ScriptedTeacher):
    """Pushes the box against the obstacle and flips it: four primitives, the third presses towards the edge.

    The box is not observed: the teacher begins where it cannot be and pushes it as far as the obstacle is. While it flips the
    force points to the edge, from wherever the fingers are, and the position runs along the arc.

    Args:
        noise, mode: see `ScriptedTeacher`.
        press: force of the flip [N]; None draws a human's.

    Raises:
        InvalidArgumentError: a press that is not positive, or above 15 N.
    """

    primitives = (
        primitive("approach box", (0, "obstacle_edge", POSITION), (0, "obstacle_edge", POSITION), (0, True)),
        primitive("push box", (1, "obstacle_edge", POSITION), (0, "world", HOLD), (0, True)),
        Primitive(
            "flip box",
            EntityControl(2, "obstacle_edge", "cylindrical", ("force", "position", "position")),
            EntityControl(0, "world", "rotation", HOLD),
            EntityControl(0, "world", "joints", ("position",) * 4),
        ),
        Primitive(
            "approach final position",
            EntityControl(3, "obstacle_edge", "cylindrical", POSITION),
            EntityControl(0, "world", "rotation", HOLD),
            EntityControl(0, "world", "joints", ("position",) * 4),
        ),
    )

    def __init__(self, noise: float = 1.0, mode: str = "commanded", press: float | None = None) -> None:
        super().__init__(noise, mode)
        if press is not None and not (is_number(press) and 0.0 < press <= MAX_PRESS):
            raise InvalidArgumentError(f"press {press!r} N; possible: above 0, up to {MAX_PRESS:g}")
        self.press = press

    def script(self) -> Iterator[Movement]:
        """Approach, push, flip, withdraw."""
        yield Movement(APPROACH, position=_at(*BEHIND), orientation=self._facing(), hand=HAND, steady=True)
        yield Movement(PUSH, position=_at(*PUSHED), hand=HAND, steady=True)
        press = self.pull() if self.press is None else self.press
        _, first, along = _cylindrical(self.observation)
        last = LAST_ANGLE + self.noise * STEADY_ROTATION * self.rng.standard_normal()
        along += self.noise * STEADY_POSITION * self.rng.standard_normal()

        def flip(observation: Observation, progress: float) -> tuple[Array, Array]:
            axes, origin = _edge(observation)
            radius, angle, _ = _cylindrical(observation)
            wanted = first + minimum_jerk(progress) * (last - first)
            goal = origin + axes @ np.array([radius * np.cos(wanted), radius * np.sin(wanted), along])
            return goal, -press * (axes @ np.array([np.cos(angle), np.sin(angle), 0.0]))

        def waits(observation: Observation, progress: float) -> bool:
            axes, _ = _edge(observation)
            _, angle, _ = _cylindrical(observation)
            felt = observation["wrench"][:3] @ axes @ np.array([np.cos(angle), np.sin(angle), 0.0])
            return progress == 0.0 and bool(felt < FELT * press)

        duration = (last - first) / FLIP_SPEED
        yield Movement(FLIP, path=flip, duration=duration, waits=waits, hand=HAND, steady=True)
        yield Movement(WITHDRAW, position=_at(*FINAL), hand=HAND)

    def _facing(self) -> Array:
        """The tool points down, the fingers towards the obstacle."""
        away = _edge(self.observation)[0][:, 0]
        turn = np.array([0.0, 0.0, np.arctan2(-away[0], away[1])])
        return quaternion.multiply(quaternion.from_rotation_vector(turn), self.layout.reference_quaternion)


def _edge(observation: Observation) -> tuple[Array, Array]:
    """Axes (3, 3) and origin (3,) of the edge."""
    frame = observation["frame_obstacle_edge"]
    return quaternion.to_matrix(frame[3:]), frame[:3]


def _cylindrical(observation: Observation) -> tuple[float, float, float]:
    """Radius [m], angle [rad] and place along the edge [m] of the tool."""
    axes, origin = _edge(observation)
    x, y, z = axes.T @ (observation["tool_position"] - origin)
    return float(np.hypot(x, y)), float(np.arctan2(y, x)), float(z)


def _at(away: float, up: float) -> Callable[[Observation], Array]:
    """A goal at a distance from the middle of the edge and above the table [m]."""

    def goal(observation: Observation) -> Array:
        axes, origin = _edge(observation)
        return origin + axes @ np.array([away, up, 0.0])

    return goal
