"""A scripted teacher: performs one task from observations alone, with a human's variations, and knows what it is doing.

A subclass writes its task as a generator of `Movement`s. Every movement is one primitive activation: its label is the ground
truth of a demonstration. The teacher commands attractor goals that run along a bowed path with a minimum-jerk profile; after
the path it waits until the goal is reached, pauses, and looks at the world again before it chooses the next movement.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lfd_gym import quaternion
from lfd_gym.action import ActionLayout
from lfd_gym.demonstration import EntityControl, Primitive
from lfd_gym.errors import InvalidArgumentError, is_number
from scripted_teachers import noise as noise_model
from scripted_teachers.kinesthetic import OutsideHand

Array = NDArray[np.float64]
Observation = Mapping[str, Array]

MODES = ("commanded", "kinesthetic")
SPEED = 0.3
"""Mean speed of a clean movement [m/s]."""
TURN_SPEED = 1.5
"""Mean angular speed of a clean movement [rad/s]."""
SHORTEST = 0.4
"""Duration of the shortest movement [s]."""
PATIENCE = 1.0
"""How long a teacher waits for a goal that is not reached [s]."""
ARRIVED_POSITION, ARRIVED_ROTATION, ARRIVED_SPEED = 0.004, np.radians(1.5), 0.01
"""A tool that is so near its goal [m], [rad] and so slow [m/s] has arrived."""
HAND_STILL, FINGER_STILL = 0.15, 0.005
"""A hand that moved less in this time [s] than this [rad] has closed or opened."""
REACTION = 0.2
"""Time from an event to the teacher's reaction [s]."""

POSITION, HOLD, FORCE = ("position",) * 3, ("hold",) * 3, ("position", "position", "force")


def primitive(
    name: str,
    position: tuple[int, str, tuple[str, ...]],
    orientation: tuple[int, str, tuple[str, ...]],
    hand: tuple[int, bool],
) -> Primitive:
    """A row of a primitive table: per entity its own primitive id, frame and controlled axes; `hand` = (id, moves)."""
    return Primitive(
        name,
        EntityControl(position[0], position[1], "cartesian", position[2]),
        EntityControl(orientation[0], orientation[1], "rotation", orientation[2]),
        EntityControl(hand[0], "world", "joints", ("position" if hand[1] else "hold",) * 4),
    )


@dataclass(frozen=True)
class Movement:
    """One activation of a primitive. Entities without a goal keep theirs."""

    label: int
    """Index into the teacher's primitive table."""
    position: Callable[[Observation], Array] | None = None
    """Goal of the tool point in the world [m], from the latest observation; NaN on axes that hold."""
    orientation: Array | None = None
    """Goal quaternion in the world."""
    hand: Array | None = None
    """Goal angles of spread and fingers [rad]."""
    force: Array | None = None
    """Force on the world [N]; begins and ends with the movement."""
    ends: Callable[[Observation, float], bool] | None = None
    """Ends the movement at once when true of (observation, threshold factor), after the reaction time."""
    dwell: float = 0.0
    """Time to keep going after the goal is reached [s]."""
    steady: bool = False
    """Contact-critical: smaller spread, never stopped early."""
    path: Callable[[Observation, float], tuple[Array, Array]] | None = None
    """Goal in the world [m] and force on the world [N] at a fraction of `duration`, in place of a straight line; a path varies
    by itself."""
    duration: float = SHORTEST
    """Of the clean movement along `path` [s]."""
    waits: Callable[[Observation, float], bool] | None = None
    """The movement's clock stands still while true of (observation, fraction of the duration), for `PATIENCE` at a stretch."""


class ScriptedTeacher:
    """Base of all teachers.

    Args:
        noise: scale of a human's variations, see `scripted_teachers.noise`; 0 is clean.
        mode: "commanded" sends attractor goals, "kinesthetic" guides the arm by hand: `act` then also sets `guidance`, and
            of its action only the fingers count.

    Raises:
        InvalidArgumentError: negative noise, or an unknown mode.
    """

    guidance: Array | None = None
    """Pose, twist and force of the outside hand (16,), for `env.unwrapped.set_guidance`; None in commanded mode."""
    primitives: ClassVar[tuple[Primitive, ...]]

    def __init__(self, noise: float = 1.0, mode: str = "commanded") -> None:
        if mode not in MODES:
            raise InvalidArgumentError(f"mode '{mode}'; possible: {', '.join(MODES)}")
        self.mode = mode
        if not (is_number(noise) and 0.0 <= noise <= noise_model.MOST):
            raise InvalidArgumentError(
                f"noise {noise!r}; possible: 0 (clean), 1 (a human's), up to {noise_model.MOST:g}"
            )
        self.noise = float(noise)

    def script(self) -> Iterator[Movement]:
        """The task as a sequence of movements; `self.observation` is the world as it is when the next one is chosen."""
        raise NotImplementedError

    def reset(self, rng: np.random.Generator, layout: ActionLayout, dt: float) -> None:
        """Begin an episode.

        Args:
            rng: source of all variations.
            layout: of the environment's actions.
            dt: time between two observations [s].
        """
        self.rng, self.layout, self.dt = rng, layout, dt
        self._steps = self._episode()
        self._outside_hand = OutsideHand(rng, self.noise, dt) if self.mode == "kinesthetic" else None

    def act(self, observation: Observation) -> tuple[NDArray[np.float32], int]:
        """The action for an observation, and the label of the primitive that is performed."""
        self.observation = observation
        action, label = next(self._steps)
        if self._outside_hand is not None:
            self.guidance = self._outside_hand.guide(observation, *self._wanted)
        return action, label

    def __getstate__(self) -> dict[str, Any]:
        """Without the episode that is going on: a generator cannot be copied."""
        return {name: value for name, value in vars(self).items() if name != "_steps"}

    def pull(self) -> float:
        """The strength of a pull [N]."""
        return noise_model.pull(self.rng, self.noise, self.layout.force_limit)

    def _episode(self) -> Iterator[tuple[NDArray[np.float32], int]]:
        observation = self.observation
        self._goal_position = observation["reference_position"].copy()
        self._goal_orientation = observation["reference_quaternion"].copy()
        self._goal_hand = observation["hand_position"].copy() if "hand_position" in observation else np.empty(0)
        movement = None
        for movement in self.script():
            yield from self._perform(movement)
        if movement is None:
            raise InvalidArgumentError(f"{type(self).__name__} has an empty script")
        while True:
            yield self._action(self._goal_position, self._goal_orientation), movement.label

    def _perform(self, movement: Movement) -> Iterator[tuple[NDArray[np.float32], int]]:
        """Actions of one movement, until what ends it was seen for the time of a reaction, or until it has arrived and rested.

        `elapsed` runs while nothing is waited for, `stood` since when something is; after the way `waited` counts for how long
        the goal is not reached, and `rest` for how long it is [s].
        """
        variation = noise_model.vary(self.rng, self.noise, movement.steady)
        if movement.hand is not None:
            self._goal_hand = movement.hand
        force = np.zeros(3) if movement.force is None else movement.force
        fastest = SHORTEST if movement.path is None else movement.duration / variation.speed
        start, start_orientation = self._goal_position, self._goal_orientation
        goal, orientation = self._goals(movement, variation, start)
        bow = self._bow(variation, goal - start)
        turn = quaternion.to_rotation_vector(quaternion.multiply(orientation, quaternion.conjugate(start_orientation)))
        duration = max(
            float(np.linalg.norm(goal - start)) / SPEED / variation.speed,
            float(np.linalg.norm(turn)) / TURN_SPEED / variation.speed,
            fastest,
        )
        rest = waited = reaction = 0.0
        elapsed, stood, arrived = 0.0, 0.0, False
        hands = [self.observation.get("hand_position", np.empty(0)).copy()]
        while True:
            if movement.waits is not None and movement.waits(self.observation, elapsed / duration) and stood < PATIENCE:
                stood += self.dt
            else:
                elapsed, stood = elapsed + self.dt, 0.0
            progress = min(elapsed / duration, variation.completeness)
            s = minimum_jerk(progress)
            if movement.path is None:
                goal, _ = self._goals(movement, variation, start)
                self._goal_position = start + s * (goal - start) + np.sin(np.pi * s) * bow
            else:
                self._goal_position, force = movement.path(self.observation, progress)
            self._goal_orientation = quaternion.multiply(quaternion.from_rotation_vector(s * turn), start_orientation)
            yield self._action(self._goal_position, self._goal_orientation, force), movement.label
            hands.append(self.observation.get("hand_position", np.empty(0)).copy())
            if movement.ends is not None and movement.ends(self.observation, variation.threshold):
                reaction += self.dt
                if reaction > REACTION:
                    break
                continue
            if progress < variation.completeness:
                continue
            waited += self.dt
            arrived = arrived or waited > PATIENCE or self._arrived(movement, variation, hands, force)
            if arrived:
                rest += self.dt
                if rest > movement.dwell + variation.pause:
                    break

    def _goals(self, movement: Movement, variation: noise_model.Variation, start: Array) -> tuple[Array, Array]:
        goal, orientation = start, self._goal_orientation
        if movement.position is not None:
            wanted = movement.position(self.observation)
            goal = np.where(np.isnan(wanted), start, wanted + variation.position)
        if movement.orientation is not None:
            orientation = quaternion.multiply(quaternion.from_rotation_vector(variation.rotation), movement.orientation)
        return goal, orientation

    def _bow(self, variation: noise_model.Variation, path: Array) -> Array:
        length = float(np.linalg.norm(path))
        if length < 1e-6:
            return np.zeros(3)
        along = path / length
        return length * (variation.bow - (variation.bow @ along) * along)

    def _arrived(self, movement: Movement, variation: noise_model.Variation, hands: list[Array], force: Array) -> bool:
        o, factor = self.observation, variation.threshold
        still = max(round(HAND_STILL / self.dt), 1)
        if movement.hand is not None and (
            len(hands) <= still or np.abs(hands[-1] - hands[-1 - still]).max(initial=0.0) > FINGER_STILL
        ):
            return False
        error = o["tool_position"] - self._goal_position
        if force.any():
            along = force / np.linalg.norm(force)
            error = error - (error @ along) * along
        turn = quaternion.multiply(self._goal_orientation, quaternion.conjugate(o["tool_quaternion"]))
        return bool(
            np.linalg.norm(error) < ARRIVED_POSITION * factor
            and np.linalg.norm(quaternion.to_rotation_vector(turn)) < ARRIVED_ROTATION * factor
            and np.linalg.norm(o["tool_velocity"][:3]) < ARRIVED_SPEED * factor
        )

    def _action(self, position: Array, orientation: Array, force: Array | None = None) -> NDArray[np.float32]:
        self._wanted = position, orientation, np.zeros(3) if force is None else force
        return self.layout.encode(*self._wanted, self._goal_hand)


def minimum_jerk(s: float) -> float:
    """Fraction of the way after the fraction s of the time, with velocity and acceleration zero at both ends."""
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


def tool_down(layout: ActionLayout, yaw: float = 0.0) -> Array:
    """The tool points down, turned by `yaw` [rad] about the vertical."""
    return quaternion.multiply(quaternion.from_rotation_vector(np.array([0.0, 0.0, yaw])), layout.reference_quaternion)


def above(frame: str, height: float) -> Callable[[Observation], Array]:
    """A goal at a height [m] over the origin of a frame that stands upright."""
    offset = np.array([0.0, 0.0, height])
    return lambda observation: observation[f"frame_{frame}"][:3] + offset


def at(*position: float) -> Callable[[Observation], Array]:
    """A fixed goal in the world [m]; NaN keeps an axis where it is."""
    fixed = np.array(position)
    return lambda observation: fixed
