"""The teacher of CylinderGrasp (thesis 2.5.3, Figures 2.13 and 2.14)."""

import math
from collections.abc import Callable, Iterator

import numpy as np

from lfd_gym import quaternion
from scripted_teachers.teacher import (
    HOLD,
    POSITION,
    Array,
    Movement,
    Observation,
    ScriptedTeacher,
    at,
    primitive,
    tool_down,
)

OPEN, CLOSED = np.zeros(4), np.array([0.0, 1.28, 1.28, 1.25])
"""The fingers touch the cylinder when they have closed so far [rad]."""
SIDEWAYS = np.pi / 2.0
"""Spread of a pinch [rad]."""
PINCH_OPEN, PINCH_CLOSED = np.array([SIDEWAYS, 0.0, 0.0, 0.0]), np.array([SIDEWAYS, 1.47, 1.47, 0.0])
FIRM, WEAK = 0.08, 0.012
"""How much further the fingers are told to close [rad]: 0.04 is all that their drives give."""
INITIAL = (0.60, 0.0, 0.33)
"""Where the tool waits, in the world [m]."""
END_DEPTH = 0.035
"""Of the tool point below the upper end of a standing cylinder [m]."""
GRASP_HEIGHT = 0.018
"""Of the tool point over the table, beside a lying cylinder [m]: the fingertips just clear the table as they close."""
RADIUS = 0.025
"""Of a cylinder [m]."""
LIFT_HEIGHT = 0.345
"""Of the tool point over the table [m]."""
SLIPPED = 0.02
"""A cylinder that moved in the hand by this much [m] has slipped."""
MEDIUM = (0.12, 0.20)
"""Lengths between these [m] are pinched where they lie."""
APPROACH_INITIAL, TOP, BOTTOM, POWER, POWER_TURNED, PINCH, PINCH_TURNED, CLOSE, CLOSE_PINCH, LIFT = range(10)


class CylinderGraspTeacher(ScriptedTeacher):
    """Grasps a standing cylinder by its upper end, a lying one about its middle, and lifts it; starts over if it slips.

    A lying cylinder of medium length is pinched, any other one gets a power grasp, each with the one of two wrist angles
    that is nearer to the hand's: six ways on from the initial position.

    A human does not always grip firmly: at noise 1 the grip is uniform between a weak and a firm one. So a heavy or
    smooth cylinder slips now and then, and may hold the next time.
    """

    primitives = (
        primitive("approach initial", (0, "world", POSITION), (0, "world", POSITION), (0, True)),
        primitive("approach top", (1, "cylinder_top", POSITION), (0, "world", HOLD), (0, True)),
        primitive("approach bottom", (2, "cylinder_bottom", POSITION), (0, "world", HOLD), (0, True)),
        primitive("approach for power", (3, "cylinder", POSITION), (1, "cylinder", POSITION), (0, True)),
        primitive("approach for power, turned", (3, "cylinder", POSITION), (2, "cylinder", POSITION), (0, True)),
        primitive("approach for pinch", (3, "cylinder", POSITION), (3, "cylinder", POSITION), (1, True)),
        primitive("approach for pinch, turned", (3, "cylinder", POSITION), (4, "cylinder", POSITION), (1, True)),
        primitive("power grasp", (3, "world", HOLD), (0, "world", HOLD), (2, True)),
        primitive("pinch", (3, "world", HOLD), (0, "world", HOLD), (3, True)),
        primitive("lift", (4, "world", ("hold", "hold", "position")), (0, "world", HOLD), (2, False)),
    )

    def script(self) -> Iterator[Movement]:
        """Initial position, pre-grasp, grasp, lift; from the beginning where the cylinder slips."""
        while True:
            yield Movement(APPROACH_INITIAL, position=at(*INITIAL), orientation=tool_down(self.layout), hand=OPEN)
            approach, position, yaw = self._choose()
            pinch = approach in (PINCH, PINCH_TURNED)
            turned = None if yaw is None else tool_down(self.layout, yaw)
            yield Movement(approach, position, turned, hand=PINCH_OPEN if pinch else OPEN, steady=True)
            yield Movement(CLOSE_PINCH if pinch else CLOSE, hand=self._closed(pinch), steady=True)
            held = self._in_hand(self.observation)

            def slipped(observation: Observation, factor: float, held: Array = held) -> bool:
                return bool(np.linalg.norm(self._in_hand(observation) - held) > SLIPPED * factor)

            yield Movement(LIFT, position=at(np.nan, np.nan, LIFT_HEIGHT), ends=slipped)
            if not slipped(self.observation, 1.0):
                return

    def _choose(self) -> tuple[int, Callable[[Observation], Array], float | None]:
        """Which approach, where to, and the yaw of the hand."""
        length, inclination, rotation = self.observation["cylinder"]
        if inclination < math.pi / 4.0:
            return TOP, at(*(self.observation["frame_cylinder_top"][:3] - [0.0, 0.0, END_DEPTH])), None
        if inclination > 3.0 * math.pi / 4.0:
            return BOTTOM, at(*(self.observation["frame_cylinder_bottom"][:3] - [0.0, 0.0, END_DEPTH])), None
        x, y, z = self.observation["frame_cylinder"][:3]
        place = at(x, y, z + GRASP_HEIGHT - RADIUS)
        hand = quaternion.rotate(self.observation["tool_quaternion"], np.array([0.0, 1.0, 0.0]))
        yaw = math.atan2(-hand[0], hand[1])
        pinch = MEDIUM[0] < length < MEDIUM[1]
        # the hand's y axis comes along the cylinder (pinch) or across it, by the shorter turn
        wanted = rotation if pinch else rotation - math.pi / 2.0
        turn = math.remainder(wanted, math.pi)
        turned = abs(math.remainder(wanted - turn, 2.0 * math.pi)) > 1.0
        return (PINCH if pinch else POWER) + turned, place, yaw + turn

    def _closed(self, pinch: bool) -> Array:
        """Goal angles of the closing hand."""
        grip = max(FIRM - (FIRM - WEAK) * self.noise * self.rng.uniform(), WEAK)
        return (PINCH_CLOSED if pinch else CLOSED) + grip * (
            np.array([0, 1, 1, 0]) if pinch else np.array([0, 1, 1, 1])
        )

    def _in_hand(self, observation: Observation) -> Array:
        """Centre of the cylinder relative to the tool, world axes [m]."""
        return observation["frame_cylinder"][:3] - observation["tool_position"]
