"""Stack four boxes (thesis 3.5.2)."""

import math
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
from dm_control.utils.rewards import tolerance

from lfd_gym import quaternion, wam
from lfd_gym.envs import setups
from lfd_gym.envs.manipulation_env import ManipulationEnv
from lfd_gym.envs.touch import robot_geoms
from lfd_gym.errors import InvalidSetupError

AREA_LOW, AREA_HIGH = np.array([0.46, -0.30]), np.array([0.71, 0.30])
"""Where the boxes may stand, x and y [m]; its far corners are as far as the arm reaches over the finished stack."""
NEAREST = 0.52
"""Distance from the axis of the robot's base [m], below which the wrist comes near its singularity at a low grasp."""
MIN_DISTANCE = 0.16
"""Between the centres of two boxes [m]: room for the fingers."""
SIZE = 0.07
"""Edge of a box [m]."""
TOLERANCE = 0.02
"""Of a box from the one below [m]."""
REST = 0.02
"""Largest component of a box's velocity at rest [m/s]."""


class BoxStackingEnv(ManipulationEnv):
    """Put the green box on the yellow one, the red on the green, the blue on the red (thesis 3.5.2, Figure 3.8).

    | what           |                                                                                                    |
    |----------------|----------------------------------------------------------------------------------------------------|
    | frames         | `box_yellow`, `box_green`, `box_red`, `box_blue` (their centres)                                   |
    | start          | four boxes of 7 cm in 25 x 60 cm, at least 52 cm from the robot, any yaw, 16 cm between centres    |
    | varies, hidden | mass 0.08-0.16 kg and friction 0.6-1.0 of every box                                                |
    | success        | stacked in order, each at most 2 cm off the one below, at rest, nothing of the robot touches them  |
    | subtasks       | `green_on_yellow`, `red_on_green`, `blue_on_red`                                                   |
    | dense reward   | for every box a third: reach 0.2, lift 0.2, carry 0.3, stacked and let go 0.3                      |
    | info           | `placement_error/<box>` [m] and `yaw_error/<box>` [rad] of green, red, blue to the box below       |
    | time limit     | 90 s                                                                                               |

    A box looks the same from four sides. A tracker cannot tell its yaw from the three others: it first reports the one
    within +-45 degrees, and follows the box from there. So the way to grasp a box is the same in its frame whatever its
    yaw. The yaw error, too, is that of the nearest equivalent; success does not depend on it.

    Workspace of the tool point: x 0.40-0.75, y -0.35-0.35, z 0.02-0.36 m; tilt 0.3 rad, yaw 1.6 rad; alpha 16, beta 4 1/s.
    Other arguments: see `ManipulationEnv`.

    Version history: v0, first version.
    """

    scene = "box_stacking.xml"
    frames = ("box_yellow", "box_green", "box_red", "box_blue")
    pushable = "box_green"
    subtasks = ("green_on_yellow", "red_on_green", "blue_on_red")
    time_limit = 90.0
    layout = wam.action_layout((0.40, -0.35, 0.02), (0.75, 0.35, 0.36))

    def build(self) -> None:
        """Find the boxes and register their masses and frictions."""
        model, data = self.model, self.data
        bodies = np.array([model.body(name).id for name in self.frames])
        first, joints = int(bodies[0]), [data.joint(f"{name}_joint") for name in self.frames]
        self._masses, self._inertias = model.body_mass[first : first + 4], model.body_inertia[first : first + 4]
        self._frictions = [model.geom_friction[model.geom(name).id, 0:1] for name in self.frames]
        self.vary(self._masses, self._inertias, *self._frictions)
        self._poses, self._twists = [joint.qpos for joint in joints], [joint.qvel for joint in joints]
        self._bodies, self._touched = bodies, np.zeros(4, dtype=bool)
        self._is_robot = robot_geoms(model)
        self._tool = data.site("hand/tool").xpos
        self._error_keys = tuple((f"placement_error/{name}", f"yaw_error/{name}") for name in ("green", "red", "blue"))

    def sample_setup(self, rng: np.random.Generator) -> dict[str, Any]:
        """Uniform in the area; all four are drawn again where two are too close."""
        while True:
            places, yaws = rng.uniform(AREA_LOW, AREA_HIGH, (4, 2)), rng.uniform(-math.pi, math.pi, 4)
            apart = min(math.dist(a, b) for a, b in combinations(places, 2)) >= MIN_DISTANCE
            if apart and np.linalg.norm(places, axis=1).min() >= NEAREST:
                return {
                    name: {"position": place.tolist(), "yaw": float(yaw)}
                    for name, place, yaw in zip(self.frames, places, yaws, strict=True)
                }

    def check_setup(self, setup: Mapping[str, Any]) -> None:
        """All in the area, not too near to the robot, and apart."""
        for name in self.frames:
            setups.within(name, setup[name]["position"], AREA_LOW, AREA_HIGH)
            setups.check_reach(name, setup[name]["position"], NEAREST)
        for a, b in combinations(self.frames, 2):
            distance = math.dist(setup[a]["position"], setup[b]["position"])
            if distance < MIN_DISTANCE - 1e-9:
                raise InvalidSetupError(f"{a} and {b} are {distance:.3f} m apart; possible: at least {MIN_DISTANCE} m")

    def place(self, setup: Mapping[str, Any]) -> None:
        """All stand on the table, turned to the equivalent yaw within 45 degrees."""
        for name, pose in zip(self.frames, self._poses, strict=True):
            pose[:2], pose[2] = setup[name]["position"], SIZE / 2.0
            pose[3:] = setups.upright(nearest_quarter(setup[name]["yaw"]))

    def randomise(self, rng: np.random.Generator) -> None:
        """Masses (with their inertias) and frictions."""
        factors = self.between(rng, 0.08, 0.16, 4) / self._masses
        self._masses *= factors
        self._inertias *= factors[:, None]
        for friction in self._frictions:
            friction[0] = min(self.between(rng, 0.6, 1.0), wam.MAX_FINGERTIP_FRICTION)

    def after_physics(self) -> None:
        """See which boxes the robot touches."""
        pairs = self.data.contact.geom
        self._touched = np.isin(self._bodies, self.model.geom_bodyid[pairs[self._is_robot[pairs].any(axis=1)]])

    def _offset(self, box: int) -> float:
        """Horizontal distance of a box to the one it belongs on [m]."""
        return math.dist(self._poses[box][:2], self._poses[box - 1][:2])

    def _stacked(self, box: int) -> bool:
        """Whether a box lies on the one below, let go."""
        rise = self._poses[box][2] - self._poses[box - 1][2]
        return bool(self._offset(box) < TOLERANCE and abs(rise - SIZE) < 0.005 and not self._touched[box])

    def succeeded(self) -> bool:
        """All stacked, free and at rest."""
        return (
            all(self._stacked(box) for box in (1, 2, 3))
            and not self._touched.any()
            and max(float(np.abs(twist[:3]).max()) for twist in self._twists) < REST
        )

    def subtask_flags(self) -> tuple[bool, ...]:
        """Which boxes lie where they belong."""
        return self._stacked(1), self._stacked(2), self._stacked(3)

    def measures(self) -> dict[str, float]:
        """Offset and yaw of every stacked box to the one below."""
        result = {}
        for box, (placement, yaw) in enumerate(self._error_keys, start=1):
            result[placement] = self._offset(box)
            turn = quaternion.yaw(self._poses[box][3:]) - quaternion.yaw(self._poses[box - 1][3:])
            result[yaw] = abs(nearest_quarter(turn))
        return result

    def progress(self) -> float:
        """Reach, lift, carry and let go of the next box; all below it stay stacked."""
        for box in (1, 2, 3):
            if not self._stacked(box):
                goal = self._poses[box - 1][2] + SIZE
                reach = tolerance(math.dist(self._tool, self._poses[box][:3]), (0.0, 0.02), margin=0.3)
                lift = tolerance(self._poses[box][2], (goal, math.inf), margin=goal)
                carry = tolerance(self._offset(box), (0.0, TOLERANCE), margin=0.4)
                return float((box - 1 + 0.2 * reach + 0.2 * lift + 0.3 * carry) / 3.0)
        return 1.0


def nearest_quarter(yaw: float) -> float:
    """The equivalent of a box's yaw [rad] within 45 degrees."""
    return math.remainder(yaw, math.pi / 2.0)
