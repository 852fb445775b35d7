"""The teacher of Whiteboard (thesis 4.4.2)."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from lfd_gym import alphabet, quaternion
from lfd_gym.demonstration import EntityControl, Primitive
from scripted_teachers.teacher import (
    FORCE,
    HOLD,
    POSITION,
    Array,
    Movement,
    Observation,
    ScriptedTeacher,
    at,
    tool_down,
)

FINAL = (0.55, 0.0, 0.28)
HOVER = 0.06
"""Height of the tool point over a board before and after a word [m]."""
LIFT, TOUCH = 0.014, 0.006
"""Of the tool point over a board: between two strokes, and where the pen begins to feel for the board [m]."""
WRITING_SPEED, MOVING_SPEED = 0.06, 0.25
"""On the board and between strokes [m/s]."""
SHORTEST = 0.05
"""Time from one knot of the path to the next at least [s]."""
ARRIVED, FELT = 0.002, 0.4
"""The writer goes on when the pen is this near the end of a stroke [m] and feels this fraction of its press."""
PRESS, PRESS_SPREAD, WEAKEST_PRESS = 2.5, 1.0, 1.0
"""Force of the pen on the board, the half width of its range at noise 1, and its least [N]."""
PLACE_SPREAD, SIZE_SPREAD, SLOPE_SPREAD, STROKE_SPREAD = 0.001, 0.015, np.radians(0.7), 0.0005
"""Standard deviations at noise 1: place [m], size and slope [rad] of a word, and place of each of its strokes [m]."""
APPROACH, WRITE_1, MOVE_OVER, WRITE_2, WITHDRAW = range(5)


def _entities(index: int, frame: str, axes: tuple[str, ...]) -> tuple[EntityControl, EntityControl, None]:
    """The position in a frame; the pen always points down; there is no hand."""
    return EntityControl(index, frame, "cartesian", axes), EntityControl(0, "world", "rotation", HOLD), None


class WhiteboardTeacher(ScriptedTeacher):
    """Writes a word on each board in one go: five primitives; the strokes of a word and the hops between them are one.

    | what | noise 1 |
    |---|---|
    | place of a word | 1 mm standard deviation per axis: a human writes more steadily than it grasps |
    | its size and slope | 1.5 %, 0.7 degrees |
    | place of every stroke | 0.5 mm |
    | press | 1.5-3.5 N, one for each word |
    | all else | see `scripted_teachers.noise` |

    Args:
        noise, mode: see `ScriptedTeacher`.
        words: what to write, see `lfd_gym.alphabet`.

    Raises:
        InvalidArgumentError: other words.
    """

    primitives = (
        Primitive("approach first board", *_entities(0, "board_1", POSITION)),
        Primitive("write first word", *_entities(1, "board_1", FORCE)),
        Primitive("move over", *_entities(2, "board_2", POSITION)),
        Primitive("write second word", *_entities(3, "board_2", FORCE)),
        Primitive("withdraw", *_entities(4, "world", POSITION)),
    )

    def __init__(self, noise: float = 1.0, mode: str = "commanded", words: Sequence[str] = ("IAS", "HRI")) -> None:
        super().__init__(noise, mode)
        self._strokes = alphabet.two_words(words)

    def script(self) -> Iterator[Movement]:
        """Approach, write, move over, write, withdraw."""
        down = tool_down(self.layout)
        for i, frame in enumerate(("board_1", "board_2")):
            press = PRESS + PRESS_SPREAD * self.noise * self.rng.uniform(-1.0, 1.0)
            writing = _Writing(self._by_hand(self._strokes[i]), frame, max(press, WEAKEST_PRESS))
            yield Movement((APPROACH, MOVE_OVER)[i], position=writing.start, orientation=down, steady=True)
            yield Movement(
                (WRITE_1, WRITE_2)[i], path=writing.path, duration=writing.duration, waits=writing.waits, steady=True
            )
        yield Movement(WITHDRAW, position=at(*FINAL), orientation=down)

    def _by_hand(self, strokes: list[Array]) -> list[Array]:
        """A word as a human writes it: a little larger or smaller, sloping, every stroke a little off."""
        size, slope = self.noise * self.rng.standard_normal(2) * np.array([SIZE_SPREAD, SLOPE_SPREAD])
        c, s = (1.0 + size) * np.cos(slope), (1.0 + size) * np.sin(slope)
        place = self.noise * PLACE_SPREAD * self.rng.standard_normal(2)
        places = place + self.noise * STROKE_SPREAD * self.rng.standard_normal((len(strokes), 2))
        return [stroke @ np.array([[c, s], [-s, c]]) + off for stroke, off in zip(strokes, places, strict=True)]


class _Knot(NamedTuple):
    """A point that the pen passes."""

    time: float
    """Since the beginning of the word [s]."""
    place: Array
    """Of the tool point, board axes, shape (3,) [m]."""
    presses: bool
    """Whether the pen presses from here to the next knot."""
    waits: bool
    """Whether the writer waits here until the pen has come, and, if it presses, feels the board."""


class _Writing:
    """A word that is being written: where the pen shall be, and when the writer has to wait for it."""

    def __init__(self, strokes: list[Array], frame: str, press: float) -> None:
        self._frame, self._press = frame, press
        self._knots = _knots(strokes)
        self._passed = 0
        self.duration = self._knots[-1].time

    def start(self, observation: Observation) -> Array:
        """Over the beginning of the first stroke, world frame [m]."""
        return self._in_world(observation, self._knots[0].place)

    def waits(self, observation: Observation, progress: float) -> bool:
        """Whether the pen has not yet come where it ought to be after this fraction of the duration."""
        while self._passed + 2 < len(self._knots) and self._knots[self._passed + 1].time <= progress * self.duration:
            if self._knots[self._passed + 1].waits and not self._has_come(observation):
                return True
            self._passed += 1
        return False

    def path(self, observation: Observation, progress: float) -> tuple[Array, Array]:
        """Goal [m] and force [N], world frame, the board wherever it is."""
        last, following = self._knots[self._passed : self._passed + 2]
        part = min((progress * self.duration - last.time) / (following.time - last.time), 1.0)
        place = last.place + part * (following.place - last.place)
        return self._in_world(observation, place), -self._press * last.presses * self._out(observation)

    def _has_come(self, observation: Observation) -> bool:
        presses, following = self._knots[self._passed].presses, self._knots[self._passed + 1]
        out = self._out(observation)
        error = self._in_world(observation, following.place) - observation["tool_position"]
        if presses:
            error = error - (error @ out) * out
            if observation["wrench"][:3] @ out < FELT * self._press:
                return False
        return bool(np.linalg.norm(error) < ARRIVED)

    def _out(self, observation: Observation) -> Array:
        return quaternion.to_matrix(observation[f"frame_{self._frame}"][3:])[:, 2]

    def _in_world(self, observation: Observation, place: Array) -> Array:
        pose = observation[f"frame_{self._frame}"]
        return pose[:3] + quaternion.rotate(pose[3:], place)


def _knots(strokes: list[Array]) -> list[_Knot]:
    """When the pen is where: over to a stroke, down to the board, along the stroke, off."""
    knots = [_Knot(0.0, np.array([*strokes[0][0], HOVER]), False, False)]

    def go(point: Array, height: float, speed: float, presses: bool = False, waits: bool = False) -> None:
        last, place = knots[-1], np.array([*point, height])
        knots[-1] = last._replace(presses=presses)
        duration = max(float(np.linalg.norm(place - last.place)) / speed, SHORTEST)
        knots.append(_Knot(last.time + duration, place, False, waits))

    for stroke in strokes:
        go(stroke[0], LIFT, MOVING_SPEED)
        go(stroke[0], TOUCH, MOVING_SPEED, waits=True)
        go(stroke[0], TOUCH, MOVING_SPEED, presses=True, waits=True)
        for corner in stroke[1:]:
            go(corner, TOUCH, WRITING_SPEED, presses=True)
        knots[-1] = knots[-1]._replace(waits=True)
        go(stroke[-1], LIFT, MOVING_SPEED)
    go(strokes[-1][-1], HOVER, MOVING_SPEED)
    return knots
