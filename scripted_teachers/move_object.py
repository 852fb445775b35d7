"""The teacher of MoveObject (thesis 2.5.1, Table 2.1)."""

from collections.abc import Iterator

import numpy as np

from scripted_teachers.teacher import HOLD, POSITION, Movement, ScriptedTeacher, above, at, primitive, tool_down

OPEN, CLOSED = np.array([0.0, 0.0, 0.0, 0.0]), np.array([0.0, 2.0, 2.0, 2.0])
INITIAL = (0.58, 0.0, 0.28)
"""Where the tool begins, in the world [m]."""
GRASP_HEIGHT = 0.012
"""Of the tool point over the object's centre [m]."""
PLACE_HEIGHT = 0.059
"""Of the tool point over the target [m]: the object a little above the table, so that it is not pressed into it."""
LIFT_HEIGHT = 0.18
"""Of the tool point over the table [m]."""
APPROACH_INITIAL, APPROACH, GRASP, LIFT, CARRY, RELEASE, WITHDRAW = range(7)


class MoveObjectTeacher(ScriptedTeacher):
    """Grasps the object from above, lifts it, carries it to the target, lets go and withdraws.

    Table 2.1 with one primitive more: the object is lifted before it is carried, so that it is not dragged over the table.
    """

    primitives = (
        primitive("approach initial", (0, "world", POSITION), (0, "world", POSITION), (0, True)),
        primitive("approach object", (1, "object", POSITION), (0, "world", HOLD), (0, True)),
        primitive("grasp", (1, "object", HOLD), (0, "world", HOLD), (1, True)),
        primitive("lift", (2, "world", ("hold", "hold", "position")), (0, "world", HOLD), (1, True)),
        primitive("carry to target", (3, "target", POSITION), (0, "world", HOLD), (1, True)),
        primitive("release", (3, "target", HOLD), (0, "world", HOLD), (0, True)),
        primitive("withdraw", (4, "world", POSITION), (0, "world", POSITION), (0, True)),
    )

    def script(self) -> Iterator[Movement]:
        """Initial position, object, target, final position."""
        down = tool_down(self.layout)
        yield Movement(APPROACH_INITIAL, position=at(*INITIAL), orientation=down, hand=OPEN)
        yield Movement(APPROACH, position=above("object", GRASP_HEIGHT), hand=OPEN, steady=True)
        yield Movement(GRASP, hand=CLOSED, steady=True)
        yield Movement(LIFT, position=at(np.nan, np.nan, LIFT_HEIGHT), hand=CLOSED)
        yield Movement(CARRY, position=above("target", PLACE_HEIGHT), hand=CLOSED, steady=True)
        yield Movement(RELEASE, hand=OPEN, steady=True)
        yield Movement(WITHDRAW, position=at(*INITIAL), orientation=down, hand=OPEN)
