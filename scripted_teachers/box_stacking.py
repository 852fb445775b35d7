"""The teacher of BoxStacking (thesis 3.5.2, Figure 3.9)."""

from collections.abc import Iterator

import numpy as np

from lfd_gym import quaternion
from lfd_gym.demonstration import Primitive
from scripted_teachers.teacher import HOLD, POSITION, Movement, ScriptedTeacher, above, at, primitive

OPEN, CLOSED = np.array([0.0, 0.7, 0.7, 0.7]), np.array([0.0, 2.0, 2.0, 2.0])
"""Half open, so that the fingers pass between two boxes [rad]."""
GRASP_HEIGHT = 0.010
"""Of the tool point over the centre of a box [m]."""
SIZE, GAP = 0.070, 0.002
"""Edge of a box, and how far above the one below it is let go [m]."""
STACKED = ("green", "red", "blue")
ABOVE, LOWER, GRASP, LIFT, CARRY, STACK, RELEASE, WITHDRAW = range(8)
ACROSS, UPWARD = ("position", "position", "hold"), ("hold", "hold", "position")


def _primitives(level: int, name: str) -> tuple[Primitive, ...]:
    """The eight movements that put one box on the stack, which has `level` boxes on the yellow one before.

    Thirteen entity primitives in all: seven positions (three boxes, four heights over the yellow one), four
    orientations (aligned with each box), two of the hand.
    """
    box, low, high = f"box_{name}", 3 + level, 4 + level
    own, yellow = (level, box, POSITION), (3, "box_yellow", POSITION)
    kept = (3, "box_yellow", HOLD)
    return (
        primitive(f"move over {name}", (level, box, ACROSS), own, (0, True)),
        primitive(f"lower to {name}", own, own, (0, True)),
        primitive(f"grasp {name}", (level, box, HOLD), (level, box, HOLD), (1, True)),
        primitive(f"lift {name}", (high, "box_yellow", UPWARD), (level, box, HOLD), (1, True)),
        primitive(f"align {name} over stack", (high, "box_yellow", POSITION), yellow, (1, True)),
        primitive(f"put {name} on stack", (low, "box_yellow", POSITION), yellow, (1, True)),
        primitive(f"release {name}", (low, "box_yellow", HOLD), kept, (0, True)),
        primitive(f"withdraw from {name}", (high, "box_yellow", POSITION), kept, (0, True)),
    )


class BoxStackingTeacher(ScriptedTeacher):
    """Stacks green, red and blue on yellow, each from straight above: 24 movements of 13 entity primitives.

    A box is grasped aligned, lifted, aligned over the yellow one, lowered by one box, and let go.
    """

    primitives = tuple(p for level, name in enumerate(STACKED) for p in _primitives(level, name))

    def script(self) -> Iterator[Movement]:
        """Over the box, down, grasp, lift, over the stack, down, release, up; three times."""
        for level, name in enumerate(STACKED):
            box, first = f"box_{name}", 8 * level
            low = GRASP_HEIGHT + (level + 1) * SIZE
            high, level_height = above("box_yellow", low + SIZE), self.observation["tool_position"][2]
            lift = high(self.observation)[2]
            over = self.observation[f"frame_{box}"][:2]
            grasp = above(box, GRASP_HEIGHT)
            aligned = self._aligned(box)
            yield Movement(first + ABOVE, position=at(*over, level_height), orientation=aligned, hand=OPEN, steady=True)
            yield Movement(first + LOWER, position=grasp, orientation=aligned, hand=OPEN, steady=True)
            yield Movement(first + GRASP, hand=CLOSED, steady=True)
            yield Movement(first + LIFT, position=at(np.nan, np.nan, lift), hand=CLOSED)
            aligned = self._aligned("box_yellow")
            yield Movement(first + CARRY, position=high, orientation=aligned, hand=CLOSED, steady=True)
            put = above("box_yellow", low + GAP)
            yield Movement(first + STACK, position=put, orientation=aligned, hand=CLOSED, steady=True)
            yield Movement(first + RELEASE, hand=OPEN, steady=True)
            yield Movement(first + WITHDRAW, position=high, hand=OPEN)

    def _aligned(self, frame: str) -> np.ndarray:
        """The tool points down, its axes along those of a box."""
        return quaternion.multiply(self.observation[f"frame_{frame}"][3:], self.layout.reference_quaternion)
