"""Kinesthetic teaching: an outside hand moves the gravity-compensated arm as a human would (thesis 2.5, 3.1.2).

The environment gives the hand its impedance; what it does with it is decided here: it goes where the tool shall be, ahead of
a tool that lags, with the slow correction of somebody who looks, and with a tremor.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lfd_gym import quaternion

Array = NDArray[np.float64]

CORRECTION = 1.5
"""How fast a lasting error is corrected [1/s]."""
REACH, TURN_REACH = 0.04, 0.4
"""How far the hand goes beyond where the tool shall be [m, rad]."""
EFFORT = 4.0
"""How much harder, or softer, the hand presses than it means to while it does not feel what it means to [N]."""
TREMOR, TREMOR_FREQUENCY = 0.0005, 8.0
"""Amplitude of the tremor at noise 1 [m], and its frequency [Hz]."""


class OutsideHand:
    """The hand that guides the tool in one episode.

    Args:
        rng: source of the tremor's phases.
        noise: scale of the tremor.
        dt: time between two observations [s].
    """

    def __init__(self, rng: np.random.Generator, noise: float, dt: float) -> None:
        self._phases = rng.uniform(0.0, 2.0 * np.pi, 3)
        self._tremor, self._dt, self._time = noise * TREMOR, dt, 0.0
        self._offset, self._turn, self._effort = np.zeros(3), np.zeros(3), 0.0
        self._before: tuple[Array, Array] | None = None

    def guide(self, observation: Mapping[str, Array], position: Array, orientation: Array, force: Array) -> Array:
        """What `set_guidance` takes (16,): pose, twist and force of the hand, world frame.

        Args:
            observation: what the teacher sees.
            position, orientation: where the tool should be now.
            force: what the tool shall exert on the world beside [N]; zero means none.
        """
        last_position, last_orientation = self._before or (position, orientation)
        self._before = position.copy(), orientation.copy()
        self._time += self._dt
        self._offset = _at_most(self._offset + CORRECTION * self._dt * (position - observation["tool_position"]), REACH)
        strength = float(np.linalg.norm(force))
        if strength > 0.0:
            d = force / strength
            self._offset = self._offset - (self._offset @ d) * d
            missing_force = strength + observation["wrench"][:3] @ d
            self._effort = float(np.clip(self._effort + CORRECTION * self._dt * missing_force, -EFFORT, EFFORT))
            force = (strength + self._effort) * d
        else:
            self._effort = 0.0
        missing = _rotation(observation["tool_quaternion"], orientation)
        self._turn = _at_most(self._turn + CORRECTION * self._dt * missing, TURN_REACH)
        shake = self._tremor * np.sin(2.0 * np.pi * TREMOR_FREQUENCY * self._time + self._phases)
        return np.concatenate(
            [
                position + self._offset + shake,
                quaternion.multiply(quaternion.from_rotation_vector(self._turn), orientation),
                (position - last_position) / self._dt,
                _rotation(last_orientation, orientation) / self._dt,
                force,
            ]
        )


def _rotation(start: Array, end: Array) -> Array:
    return quaternion.to_rotation_vector(quaternion.multiply(end, quaternion.conjugate(start)))


def _at_most(vector: Array, length: float) -> Array:
    return vector * min(1.0, length / max(float(np.linalg.norm(vector)), 1e-12))
