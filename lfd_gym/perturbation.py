"""What can go wrong in a real lab, off by default: imperfect tracking and sensing, pushes, slips, unusual objects."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from lfd_gym import quaternion
from lfd_gym.errors import InvalidArgumentError, UnknownNameError, is_finite

Array = NDArray[np.float64]

EARLIEST, LATEST = 1.0, 15.0
"""When a push or a slip happens, uniformly in between [s]."""
PUSH_TIME = 0.2
"""How long a push lasts [s]."""
SLIPPERY = 0.1
"""Friction of the fingertips during a slip."""


@dataclass(frozen=True)
class Perturbation:
    """Strengths of all perturbations; an environment takes them as `perturbation={"push_arm": 20, ...}`."""

    tracking_position: float = 0.0
    """Standard deviation of the error of every tracked position, one draw per episode [m]."""
    tracking_rotation: float = 0.0
    """Standard deviation of the error of every tracked orientation, one draw per episode [rad]."""
    wrench_noise: float = 0.0
    """Standard deviation of the wrist sensor's force, white, each control step [N]; a tenth of it for the torque [N m]. The
    controller regulates forces by this sensor, and errs with it."""
    wrench_bias: float = 0.0
    """Standard deviation of a constant error of the same [N]; a tenth of it for the torque [N m]."""
    variation: float = 1.0
    """Factor on the width of the ranges of mass and friction."""
    push_arm: float = 0.0
    """Horizontal force on the wrist for 0.2 s, in whole control steps, at a random time between 1 and 15 s [N]."""
    push_object: float = 0.0
    """Horizontal force on an object for 0.2 s at a random time [N]."""
    slip: float = 0.0
    """The fingertips are slippery for this long from a random time on [s]."""

    def __post_init__(self) -> None:
        """Raise InvalidArgumentError for a strength that is negative or not finite."""
        for field in fields(self):
            value = getattr(self, field.name)
            if not is_finite(value) or value < 0.0:
                raise InvalidArgumentError(f"perturbation {field.name}={value!r}; possible: 0 and above")

    @classmethod
    def of(cls, values: "Mapping[str, float] | Perturbation | None") -> "Perturbation":
        """From a mapping of names to strengths. Raises UnknownNameError for a name that does not exist."""
        if isinstance(values, Perturbation):
            return values
        if not isinstance(values, Mapping | None):
            raise InvalidArgumentError(f'perturbation {values!r}; possible: a mapping such as {{"push_arm": 20}}')
        known = [field.name for field in fields(cls)]
        for name in values or ():
            if name not in known:
                raise UnknownNameError("perturbation", name, known)
        return cls(**(values or {}))


class Schedule:
    """The draws of one episode: what a `Perturbation` does, and when.

    Args:
        perturbation: strengths.
        n_frames: number of tracked frames.
    """

    def __init__(self, perturbation: Perturbation, n_frames: int) -> None:
        self.perturbation, self._n_frames = perturbation, n_frames
        self.state = np.zeros(6 * n_frames + 6 + 3 * 2 + 3)
        """All draws of the episode: frame errors, wrench bias, two pushes, times of pushes and slip."""
        self._errors, self._bias, self._pushes, self._times = np.split(self.state, np.cumsum([6 * n_frames, 6, 6]))
        self.misplaces = any((perturbation.tracking_position, perturbation.tracking_rotation))
        self.misreads = any((perturbation.wrench_noise, perturbation.wrench_bias))
        self.acts = any((perturbation.push_arm, perturbation.push_object, perturbation.slip))

    def check(self, dt: float) -> None:
        """Raise InvalidArgumentError where a push or a slip is shorter than a control step [s]: it might never be seen."""
        p = self.perturbation
        lasting = [PUSH_TIME] * any((p.push_arm, p.push_object)) + [p.slip] * (p.slip > 0.0)
        if lasting and dt > min(lasting) + 1e-9:
            raise InvalidArgumentError(
                f"control_hz {1.0 / dt:g}; what lasts {min(lasting):g} s needs {1.0 / min(lasting):g} or more"
            )

    def draw(self, rng: np.random.Generator) -> None:
        """Begin an episode; the number of draws does not depend on the strengths."""
        p = self.perturbation
        errors = rng.standard_normal((self._n_frames, 6)) * np.repeat([p.tracking_position, p.tracking_rotation], 3)
        self._errors[:] = errors.ravel()
        self._bias[:] = rng.standard_normal(6) * p.wrench_bias * np.repeat([1.0, 0.1], 3)
        angles = rng.uniform(-math.pi, math.pi, 2)
        for i, strength in enumerate((p.push_arm, p.push_object)):
            self._pushes[3 * i : 3 * i + 2] = strength * np.cos(angles[i]), strength * np.sin(angles[i])
        self._times[:] = rng.uniform(EARLIEST, LATEST, 3)

    def misplace(self, frames: Array) -> None:
        """Falsify tracked poses (n_frames * 7,) in place."""
        for i in range(self._n_frames):
            pose, error = frames[7 * i : 7 * i + 7], self._errors[6 * i : 6 * i + 6]
            pose[:3] += error[:3]
            turned = quaternion.multiply(quaternion.from_rotation_vector(error[3:]), pose[3:])
            pose[3:] = quaternion.canonical(turned)

    def misreading(self, rng: np.random.Generator) -> Array:
        """By how much the wrist sensor errs for one control step (6,)."""
        noise = self.perturbation.wrench_noise
        return self._bias + rng.standard_normal(6) * noise * np.repeat([1.0, 0.1], 3) if noise else self._bias

    def pushes(self, time: float) -> tuple[Array, Array]:
        """Forces (3,) on the arm and on the object at this time, world frame [N]."""
        arm, thing = self._pushes[:3], self._pushes[3:]
        return (
            arm if self._times[0] <= time < self._times[0] + PUSH_TIME else np.zeros(3),
            thing if self._times[1] <= time < self._times[1] + PUSH_TIME else np.zeros(3),
        )

    def slips(self, time: float) -> bool:
        """Whether the fingertips are slippery now."""
        return bool(self._times[2] <= time < self._times[2] + self.perturbation.slip)
