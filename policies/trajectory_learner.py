"""The base of all learners of paths over time: demonstrations aligned, presses, orientation and hand taken along."""

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lfd_gym.action import ActionLayout
from lfd_gym.demonstration import Demonstration, check_quaternions, taught_seeds
from lfd_gym.errors import DemonstrationError
from policies.arguments import check_number
from policies.learner import Learner
from policies.moa.alignment import align
from policies.moa.frames import Frames, resample
from policies.movement_primitives import GRIP, PRESSES
from policies.orientation_schedule import learn_orientations
from policies.path_generators import Generator
from policies.path_skill import PathSkill
from policies.press_schedule import in_contact, learn_presses
from policies.task_data import WORLD

Array = NDArray[np.float64]

LARGEST = 1e3
"""Distances and times that are asked for are at most so long [m], [s]."""


class TrajectoryLearner(Learner):
    """Base: tool paths relative to the world and to every tracked frame as it is at the beginning, aligned in time.

    Demonstrations show the same sequence of movements. They are aligned by DTW over the frames (4.30) with the hand and the
    contact as further coordinates, whose scale is `events`. Labels are not needed.

    A subclass fits the path, `generator`, and has the parameter `events`: the distance [m] that counts as much as one radian of
    a finger, or as a contact that is there or not. Its other parameters are checked by its `check_arguments`.
    """

    needs = ("tool_position", "tool_quaternion", "wrench")
    reads = ("hand_",)
    needs_labels = False

    events: float
    warps_: list[Array]
    """Per demonstration the fractional time steps (N,) that match those of the skill."""

    @abstractmethod
    def generator(
        self, points: Sequence[Array], frames: Sequence[Frames], warps: Sequence[Array], layout: ActionLayout, dt: float
    ) -> Generator:
        """The path's generator from paths (N_m, 3), frames at rest and warps (N,)."""

    def check_arguments(self, dt: float) -> None:
        """Raise InvalidArgumentError for an argument of the constructor that is not possible with time steps dt [s]."""
        check_number("events", self.events, 0.0, LARGEST)

    def learn(self, demonstrations: Sequence[Demonstration]) -> PathSkill:
        """Align, fit the path, and take orientation, hand and presses along."""
        first = demonstrations[0]
        self.check_arguments(first.dt)
        names = sorted(name.removeprefix("frame_") for name in first.observations if name.startswith("frame_"))
        poses = [np.array([WORLD, *(d.observations[f"frame_{n}"][0] for n in names)]) for d in demonstrations]
        for i, pose in enumerate(poses):
            if not np.isfinite(pose).all():
                raise DemonstrationError(f"a frame of demonstration {i} is not finite at its first step")
            for name, row in zip(names, pose[1:], strict=True):
                check_quaternions(f"'frame_{name}' of demonstration {i}", row[None, 3:])
        frames = [Frames.of_poses(pose) for pose in poses]
        points = [demonstration.observations["tool_position"] for demonstration in demonstrations]
        warps = self.warps_ = self._aligned(demonstrations, points, frames)
        layout = first.layout
        generator = self.generator(points, frames, warps, layout, first.dt)

        wrenches, quaternions = (_at(demonstrations, name, warps) for name in ("wrench", "tool_quaternion"))
        axes = [frame.axes for frame in frames]
        local = [frame.local(resample(x, index)) for x, frame, index in zip(points, frames, warps, strict=True)]
        return PathSkill(
            generator,
            names,
            learn_presses(local, axes, wrenches, first.dt),
            learn_orientations(quaternions, axes, first.dt),
            _hand(demonstrations, warps),
            layout,
            first.dt,
            env_id=first.env_id,
            taught_seeds=taught_seeds(demonstrations),
            metadata={"learner": repr(self), "n_demonstrations": len(demonstrations)},
        )

    def _aligned(
        self, demonstrations: Sequence[Demonstration], points: Sequence[Array], frames: Sequence[Frames]
    ) -> list[Array]:
        """Warps of the paths, with contact and hand as coordinates that are the same in every frame."""
        events = [_events(demonstration) * self.events for demonstration in demonstrations]
        extended = [np.hstack([x, more]) for x, more in zip(points, events, strict=True)]
        return align(extended, [_extended(frame, events[0].shape[1]) for frame in frames])


def _events(demonstration: Demonstration) -> Array:
    """Contact (0 or 1) and angles of the hand [rad], (N, 1 + H)."""
    contact = in_contact(demonstration.observations["wrench"]).astype(np.float64)[:, None]
    return np.hstack([contact, _measured_hand(demonstration)])


def _measured_hand(demonstration: Demonstration) -> Array:
    return demonstration.observations.get("hand_position", np.empty((len(demonstration) + 1, 0)))


def _extended(frames: Frames, n_more: int) -> Frames:
    """The frames with more coordinates, the same in each of them."""
    f, d = frames.origins.shape
    origins, axes = np.zeros((f, d + n_more)), np.tile(np.eye(d + n_more), (f, 1, 1))
    origins[:, :d], axes[:, :d, :d] = frames.origins, frames.axes
    return Frames(origins, axes)


def _at(demonstrations: Sequence[Demonstration], name: str, warps: Sequence[Array]) -> list[Array]:
    """An observation at the steps nearest to the aligned ones."""
    rows = zip(demonstrations, warps, strict=True)
    return [demonstration.observations[name][np.rint(index).astype(int)] for demonstration, index in rows]


def _hand(demonstrations: Sequence[Demonstration], warps: Sequence[Array]) -> Array:
    """Mean angles (N, H) [rad], beyond where most drives bear torque: there the hand presses on something."""
    rows = zip(demonstrations, warps, strict=True)
    angles = np.mean([resample(_measured_hand(demonstration), index) for demonstration, index in rows], axis=0)
    if angles.shape[1] and "hand_torque" in demonstrations[0].observations:
        torque = np.median(_at(demonstrations, "hand_torque", warps), axis=0)
        angles += GRIP * np.sign(torque) * (np.abs(torque) > PRESSES)
    return np.asarray(angles)
