"""The teacher of LightBulb (thesis 2.5.2, Figure 2.10)."""

from collections.abc import Iterator

import numpy as np

from scripted_teachers.teacher import (
    FORCE,
    HOLD,
    POSITION,
    Movement,
    Observation,
    ScriptedTeacher,
    above,
    at,
    primitive,
    tool_down,
)

SPREAD = np.radians(60.0)
"""Of fingers 1 and 2, so that three fingers cage the bulb [rad]."""
OPEN, CLOSED = np.array([SPREAD, 0.0, 0.0, 0.0]), np.array([SPREAD, 2.0, 2.0, 2.0])
INITIAL = (0.58, 0.0, 0.30)
"""Where the tool begins and withdraws to, in the world [m]."""
GRASP_HEIGHT = 0.064
"""Of the tool point over the foot of the holder [m]: the fingertips close below the glass."""
DROP_HEIGHT = 0.11
"""Of the tool point over the box's floor [m]."""
TWIST = np.radians(60.0)
"""The wrist turns from minus to plus this angle [rad]."""
LOOSE_RISE = 0.025
"""The hand has risen by this much since it began to pull [m]: the bulb is loose."""
PULL_DWELL = 0.5
"""How long the teacher feels at the end of a twist whether the bulb comes [s]."""
APPROACH_INITIAL, APPROACH, GRASP, UNSCREW, RELEASE, ROTATE_BACK, TO_BOX = range(7)


class LightBulbTeacher(ScriptedTeacher):
    """Unscrews the bulb by caging it, as often as it needs, and drops it into the box: seven primitives.

    The bulb is not observed: that it is loose shows in the hand, which pulls and suddenly rises.
    """

    primitives = (
        primitive("approach initial", (0, "world", POSITION), (0, "world", POSITION), (0, False)),
        primitive("approach bulb", (1, "bulb_holder", POSITION), (1, "world", HOLD), (1, True)),
        primitive("close hand", (1, "bulb_holder", POSITION), (1, "world", HOLD), (2, True)),
        primitive("unscrew", (2, "bulb_holder", FORCE), (2, "world", POSITION), (2, True)),
        primitive("open hand", (3, "world", HOLD), (1, "world", HOLD), (1, True)),
        primitive("rotate wrist back", (1, "bulb_holder", POSITION), (3, "world", POSITION), (1, True)),
        primitive("approach box", (4, "box", POSITION), (1, "world", HOLD), (2, True)),
    )

    def script(self) -> Iterator[Movement]:
        """Approach; close, unscrew, open, rotate back until the bulb is loose; lift it, drop it, return."""
        back, turned = tool_down(self.layout, -TWIST), tool_down(self.layout, TWIST)
        bulb = above("bulb_holder", GRASP_HEIGHT)
        yield Movement(APPROACH_INITIAL, position=at(*INITIAL), orientation=back)
        yield Movement(APPROACH, position=bulb, hand=OPEN, steady=True)
        while True:
            yield Movement(GRASP, position=bulb, hand=CLOSED, steady=True)
            start = self.observation["tool_position"][2]

            def loose(observation: Observation, factor: float, start: float = start) -> bool:
                return bool(observation["tool_position"][2] - start > LOOSE_RISE * factor)

            yield Movement(
                UNSCREW,
                position=bulb,
                orientation=turned,
                hand=CLOSED,
                force=np.array([0.0, 0.0, self.pull()]),
                ends=loose,
                dwell=PULL_DWELL,
                steady=True,
            )
            if loose(self.observation, 1.0):
                break
            yield Movement(RELEASE, hand=OPEN, steady=True)
            yield Movement(ROTATE_BACK, position=bulb, orientation=back, hand=OPEN, steady=True)
        yield Movement(APPROACH_INITIAL, position=at(*INITIAL), orientation=back, hand=CLOSED)
        yield Movement(TO_BOX, position=above("box", DROP_HEIGHT), hand=CLOSED)
        yield Movement(RELEASE, hand=OPEN, steady=True)
        yield Movement(APPROACH_INITIAL, position=at(*INITIAL), orientation=back)
