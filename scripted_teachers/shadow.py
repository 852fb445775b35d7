"""A clean teacher that watches someone else perform, and says at every moment what it would be doing."""

from collections.abc import Iterator

import numpy as np

from lfd_gym import quaternion
from lfd_gym.action import ActionLayout
from scripted_teachers.noise import GOAL_POSITION, GOAL_ROTATION, PAUSE, STEADY_POSITION, STEADY_ROTATION
from scripted_teachers.teacher import (
    ARRIVED_POSITION,
    ARRIVED_ROTATION,
    ARRIVED_SPEED,
    FINGER_STILL,
    HAND_STILL,
    PATIENCE,
    REACTION,
    Array,
    Movement,
    Observation,
    ScriptedTeacher,
)

WITHIN = 3.0
"""Standard deviations of a human's goals from which on a place is another one."""
RESTING_TURN = 0.05
"""A tool that turns more slowly is at rest [rad/s]."""
FINGER_MOVED = 0.1
"""A hand that moved less within `HAND_STILL` rests; one that moved more since a movement began has begun to follow it, and one
nearer to its goal need not [rad]."""


class Shadow:
    """The noise-free teacher's state machine, run on what somebody else performs.

    A teacher that acts times its movements itself, and goes on once it is exactly where it wanted to be. Nobody else keeps
    this clock or has these goals in mind, so a shadow reads the same script and ends a movement by what it measures alone.

    - A movement is over when the tool rests at its goal, where the movement has one, and the hand rests, after it followed
      a new goal. At the goal means within `WITHIN` standard deviations of a human's goals (3.4 cm and 10.5 degrees; 1.2 cm
      and 4.5 degrees where contact is critical). Along a force, and along axes that hold, there is no goal; a movement
      along a path has the path's end.
    - Tool and hand that have rested elsewhere for `PATIENCE` will not arrive: the movement is over too.
    - As for the acting teacher a movement's dwell follows, and an event (`Movement.ends`) ends a movement after the reaction
      time.

    Then the shadow turns to the next movement, whose clocks stand still until the performer begins it too. A teacher that
    acts would still wait before that, which is the `leeway`: it pauses, and where it misses its goal by some millimetres it
    waits for it first.

    Where it breaks: a place that is crossed slowly, below 1 cm/s, counts as reached.

    Args:
        teacher: one without noise that has a hand; the shadow runs its script, and it must not act besides.
    """

    leeway: float
    """How long the acting teacher might wait at most before it begins the movement that the shadow is at [s]."""

    def __init__(self, teacher: ScriptedTeacher) -> None:
        self.teacher = teacher

    def reset(self, rng: np.random.Generator, layout: ActionLayout, dt: float) -> None:
        """Begin an episode; arguments as of `ScriptedTeacher.reset`."""
        self.teacher.reset(rng, layout, dt)
        self._dt, self._still_for = dt, max(round(HAND_STILL / dt), 1)
        self._labels, self.leeway = self._episode(), 0.0

    def watch(self, observation: Observation, performed: int) -> int:
        """The label of the primitive that is due, where somebody performs the primitive `performed`."""
        self.teacher.observation, self._performed = observation, performed
        return next(self._labels)

    def _episode(self) -> Iterator[int]:
        self._hand_goal = self.teacher.observation["hand_position"].copy()
        label = -1
        for movement in self.teacher.script():
            label = movement.label
            yield from self._movement(movement)
        while True:
            yield label

    def _movement(self, movement: Movement) -> Iterator[int]:
        hands = [self.teacher.observation["hand_position"].copy()]
        follows = movement.hand is not None and not np.allclose(movement.hand, self._hand_goal)
        if movement.hand is not None:
            self._hand_goal = movement.hand
        while self._performed != movement.label:
            yield movement.label
        arrived, rested, dwelt, reaction = False, 0.0, 0.0, 0.0
        while dwelt <= movement.dwell and reaction <= REACTION:
            yield movement.label
            o = self.teacher.observation
            hands.append(o["hand_position"].copy())
            if movement.ends is not None and movement.ends(o, 1.0):
                reaction += self._dt
                continue
            rests = self._tool_rests(o) and self._hand_rests(hands)
            rested = rested + self._dt if rests else 0.0
            there = rests and (not follows or self._has_followed(hands)) and _at_goal(movement, o)
            arrived = arrived or there or rested > PATIENCE
            dwelt += self._dt * arrived
        self.leeway = 0.0 if reaction > REACTION else PAUSE + PATIENCE

    def _tool_rests(self, o: Observation) -> bool:
        linear, angular = np.linalg.norm(o["tool_velocity"][:3]), np.linalg.norm(o["tool_velocity"][3:])
        return bool(linear < ARRIVED_SPEED and angular < RESTING_TURN)

    def _hand_rests(self, hands: list[Array]) -> bool:
        return len(hands) > self._still_for and bool(
            np.abs(hands[-1] - hands[-1 - self._still_for]).max(initial=0.0) < FINGER_STILL
        )

    def _has_followed(self, hands: list[Array]) -> bool:
        moved, left = np.abs(hands[-1] - hands[0]), np.abs(hands[-1] - self._hand_goal)
        return bool(moved.max(initial=0.0) > FINGER_MOVED or left.max(initial=0.0) < FINGER_MOVED)


def _at_goal(movement: Movement, o: Observation) -> bool:
    """Whether the tool is where a movement ends."""
    force = movement.force
    if movement.path is not None:
        wanted, force = movement.path(o, 1.0)
    else:
        wanted = np.full(3, np.nan) if movement.position is None else movement.position(o)
    error = np.where(np.isnan(wanted), 0.0, o["tool_position"] - wanted)
    if force is not None and force.any():
        along = force / np.linalg.norm(force)
        error = error - (error @ along) * along
    turn = np.zeros(3)
    if movement.orientation is not None:
        left = quaternion.multiply(movement.orientation, quaternion.conjugate(o["tool_quaternion"]))
        turn = quaternion.to_rotation_vector(left)
    spread = (STEADY_POSITION, STEADY_ROTATION) if movement.steady else (GOAL_POSITION, GOAL_ROTATION)
    return bool(
        np.linalg.norm(error) < ARRIVED_POSITION + WITHIN * spread[0]
        and np.linalg.norm(turn) < ARRIVED_ROTATION + WITHIN * spread[1]
    )
