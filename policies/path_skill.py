"""A skill that plays a path over time: drawn for the scene as it is at the beginning, then followed by attractor goals."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from lfd_gym import attractor, quaternion
from lfd_gym.action import ActionLayout
from lfd_gym.registry import load
from policies.consistency import SCHEDULE_SHAPES, check_path
from policies.moa.frames import Frames
from policies.orientation_schedule import OrientationSchedule
from policies.path_generators import Generator
from policies.press_schedule import YIELDS, PressSchedule
from policies.skill import Observation, Skill, State
from policies.task_data import WORLD

Array = NDArray[np.float64]

GENERATORS: dict[str, str] = {
    "attractors": "policies.path_generators:AttractorPath",
    "mixture": "policies.trajectory_baselines.gaussian_mixture:MixturePath",
    "dmp": "policies.trajectory_baselines.dynamic_movement_primitives:SegmentedDMP",
    "promp": "policies.trajectory_baselines.promp:ConditionedPath",
    "fixed": "policies.trajectory_baselines.replay:FixedPath",
}
"""Name written in a skill's file -> the generator of its path."""

FELT = 0.4
"""A tool that presses has come into contact once it feels this fraction of the force."""
LAG = 0.01
"""The path waits for a tool that is further away from it [m], across the direction of a press."""
PATIENCE = 1.0
"""The longest wait for one thing [s]."""


class Memory(NamedTuple):
    """State of a skill, one row per environment."""

    step: NDArray[np.int64]
    """(n,) time step of the path; -1 before the first observation."""
    waited: Array
    """(n,) for how long the path has been waiting for what is missing now [s]."""
    path: Array
    """(n, N, 3) of the tool point in the scene as it was at the first observation, world frame [m]."""
    frames: Array
    """(n, F, 7) poses of the frames at the first observation."""


class PathSkill(Skill):
    """Follows a path over time (thesis 4.4.2), and presses and turns by schedules.

    The goal of step i makes the controller's attractor follow the path x exactly, g_i = x_i + (x_i'' / alpha + x_i') / beta.
    Its clock stops while the tool should press and feels no contact, and while it lags behind the path by more than `LAG`:
    at that time of the demonstrations the tool was in contact and on the path. A wait lasts `PATIENCE` at most. Then the
    path goes on until nothing is missing any more, while patience recovers as fast as it was spent. A press is given up
    where the tool has moved along it from its place by more than `YIELDS`: no wall is there.
    """

    kind: ClassVar[str] = "path"

    def __init__(
        self,
        generator: Generator,
        frames: Sequence[str],
        press: PressSchedule,
        orientation: OrientationSchedule,
        hand: Array,
        layout: ActionLayout,
        dt: float,
        **facts: Any,
    ) -> None:
        """frames are the names beside the world, which comes first; hand (N, H) angles [rad]; dt is the control step [s];
        facts as in `Skill`."""
        super().__init__(**facts)
        self.generator, self.frames = generator, tuple(frames)
        self.press, self.orientation, self.hand = press, orientation, hand
        self.layout, self.dt = layout, dt

    def start(self, n: int) -> State:
        """Nothing is drawn before the first observation."""
        shapes = (n, len(self.hand), 3), (n, len(self.frames) + 1, 7)
        return Memory(np.full(n, -1), np.zeros(n), *(np.zeros(shape) for shape in shapes))

    def decide(self, observation: Observation, state: State) -> tuple[NDArray[np.float32], State]:
        """The goals of this time step, and the next one unless the tool has to be waited for."""
        memory = Memory(*state)
        if memory.step < 0:
            memory = self._begin(observation)
        i = int(memory.step)
        pressed = int(self.press.frame[i])
        force = quaternion.rotate(memory.frames[pressed, 3:], self.press.force[i])
        error = observation["tool_position"] - memory.path[i]
        if _yields(error, force):
            force = np.zeros(3)
        lags = _lags(error, observation["wrench"], force)
        waits = lags and memory.waited < PATIENCE
        turned = memory.frames[self.orientation.frame[i], 3:]
        goal = memory.path[i] if waits else self._goal(memory.path, i)
        action = self.layout.encode(
            goal, quaternion.multiply(turned, self.orientation.quaternion[i]), force, self.hand[i]
        )
        if waits:
            return action, memory._replace(waited=memory.waited + self.dt)
        following = min(i + 1, len(memory.path) - 1)
        waited = memory.waited if lags else np.maximum(memory.waited - self.dt, 0.0)
        return action, memory._replace(step=np.array(following), waited=waited)

    def _begin(self, observation: Observation) -> Memory:
        poses = np.array([WORLD, *(observation[f"frame_{name}"] for name in self.frames)])
        first = np.asarray(observation["tool_position"], dtype=np.float64)
        path = self.generator.path(Frames.of_poses(poses), first)
        return Memory(np.array(0), np.array(0.0), path, poses)

    def _goal(self, path: Array, i: int) -> Array:
        """Goal (3,) of step i; the end of the path is held, however fast it was come to."""
        if i == len(path) - 1:
            return path[i]
        before, here, after = path[max(i - 1, 0)], path[i], path[i + 1]
        velocity, acceleration = 0.5 * (after - before) / self.dt, (after - 2.0 * here + before) / self.dt**2
        return attractor.goal(here, velocity, acceleration, self.layout.alpha, self.layout.beta)

    def to_arrays(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        """Path, schedules and layout."""
        kinds = {path.partition(":")[2]: name for name, path in GENERATORS.items()}
        parts: dict[str, Any] = {"path": self.generator, "press": self.press, "orientation": self.orientation}
        arrays = {f"{part}_{name}": a for part, values in parts.items() for name, a in values._asdict().items()}
        values = {
            "generator": kinds[type(self.generator).__name__],
            "frames": list(self.frames),
            "layout": self.layout.to_dict(),
            "dt": self.dt,
        }
        return values, arrays | {"hand": self.hand}

    @classmethod
    def from_arrays(cls, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], **facts: Any) -> Self:
        """The skill that `to_arrays` described."""

        def part(kind: Any, prefix: str) -> Any:
            return kind(**{name: arrays[f"{prefix}_{name}"] for name in kind._fields})

        generator = part(load(GENERATORS[header["generator"]]), "path")
        press, orientation = part(PressSchedule, "press"), part(OrientationSchedule, "orientation")
        layout = ActionLayout.from_dict(header["layout"])
        schedules = {name: arrays[name] for name in SCHEDULE_SHAPES}
        check_path(header["generator"], generator._asdict(), schedules, header["frames"], layout, header["dt"])
        return cls(generator, header["frames"], press, orientation, arrays["hand"], layout, header["dt"], **facts)


def _lags(error: Array, wrench: Array, force: Array) -> bool:
    """Whether the tool, so far from its place (3,) [m], has to be waited for while it shall exert a force (3,) [N]."""
    magnitude = float(np.linalg.norm(force))
    if magnitude > 0.0:
        direction = force / magnitude
        if -wrench[:3] @ direction < FELT * magnitude:
            return True
        error = error - (error @ direction) * direction
    return bool(np.linalg.norm(error) > LAG)


def _yields(error: Array, force: Array) -> bool:
    """Whether the tool is so far along a force (3,) [N] from its place, (3,) [m], that nothing can bear it."""
    return bool(error @ force > YIELDS * np.linalg.norm(force))
