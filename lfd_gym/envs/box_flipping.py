"""Flip a box against an obstacle (thesis 3.5.1)."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control.utils.rewards import tolerance
from numpy.typing import NDArray

from lfd_gym import quaternion, wam
from lfd_gym.envs import setups
from lfd_gym.envs.manipulation_env import ManipulationEnv
from lfd_gym.envs.touch import count_contacts, robot_geoms

Array = NDArray[np.float64]

AREA_LOW, AREA_HIGH = np.array([0.53, -0.35]), np.array([0.63, -0.25])
"""Where the middle of the obstacle's edge may lie, x and y [m]."""
MAX_YAW = math.radians(20.0)
BOX_HALF = np.array([0.15, 0.08, 0.035])
"""Half sizes of the box: along the edge, away from it, up [m]."""
GAP_LOW, GAP_HIGH = 0.05, 0.15
"""Between obstacle and box [m]."""
MAX_ALONG = 0.08
"""Between the middles of edge and box, along the edge [m]."""
MAX_SKEW = math.radians(5.0)
"""Of the box to the edge."""
EDGE_AXES = np.array([0.5, 0.5, 0.5, 0.5])
"""Quaternion of the edge's axes in those of the upright obstacle: x away from it (world y), y up, z along the edge."""
TOLERANCE = math.radians(5.0)
"""Of the flipped box from upright [rad]."""
CLEARANCE = 0.16
"""Of the tool from the box's centre when it has withdrawn [m]."""
REST = (0.02, 0.1)
"""Largest component of the box's velocity at rest, linear [m/s] and angular [rad/s]."""


class BoxFlippingEnv(ManipulationEnv):
    """Push a box against a fixed obstacle and flip it about the obstacle's lower edge (thesis 3.5.1, Figures 3.5 and 3.6).

    | what | |
    |---|---|
    | frames | `obstacle_edge`: middle of the obstacle's lower edge, x away from it, y up, z along it; in cylindrical |
    | | coordinates it is the axis that the box turns about; the box itself is not tracked |
    | start | obstacle +- 5 cm, +- 20 degrees; box 5-15 cm before it, +- 8 cm along it, skewed by +- 5 degrees |
    | varies, hidden | mass of the box 0.25-0.40 kg, its friction with table and obstacle 0.2-0.3 |
    | success | the box rests on its other face, turned by 90 +- 5 degrees, not touched, the tool is 16 cm away |
    | subtasks | `at_obstacle`, `tilted` (by 30 degrees), `flipped` |
    | measures | `turned`: how far the box is turned about the edge [rad] |
    | dense reward | reach 0.2, push 0.2, turn 0.4, withdraw 0.15 |
    | time limit | 30 s |

    The box is 30 cm long, 16 cm deep, 7 cm high, the obstacle 13 cm high. The tool point lies between the fingertips 1 and 2
    when their outer links point down at a spread of 0.6 rad (`hand_open`), 17 cm from each other. Workspace: x 0.36-0.80,
    y -0.40-0.18, z 0.02-0.40 m; tilt 0.3 rad, yaw 0.6 rad; alpha 16, beta 4 1/s. Other arguments: see `ManipulationEnv`.

    Version history: v0, first version.
    """

    scene = "box_flipping.xml"
    tool_offset = (0.0, -0.087, -0.006)
    frames = ("obstacle_edge",)
    pushable = "box"
    subtasks = ("at_obstacle", "tilted", "flipped")
    time_limit = 30.0
    controls = ("x", "y", "z", "yaw", "press")
    hand_open = (0.6, 0.6, 0.6, 2.44)
    layout = wam.action_layout((0.36, -0.40, 0.02), (0.80, 0.18, 0.40), rotation_limit=(0.3, 0.3, 0.6))

    @staticmethod
    def press_direction(observation: Mapping[str, Array]) -> Array:
        """From the tool towards the edge."""
        pose = observation["frame_obstacle_edge"]
        away = observation["tool_position"] - pose[:3]
        edge = quaternion.rotate(pose[3:], np.array([0.0, 0.0, 1.0]))
        away = away - (away @ edge) * edge
        return -away / max(float(np.linalg.norm(away)), 1e-9)

    def build(self) -> None:
        """Find box and edge; register the box's mass and friction."""
        model, data, body = self.model, self.data, self.model.body("box").id
        self._mass, self._inertia = model.body_mass[body : body + 1], model.body_inertia[body]
        self._friction = model.pair_friction[:, :2]
        self.vary(self._mass, self._inertia, self._friction)
        self._is_box = model.geom_bodyid == body
        self._is_robot = robot_geoms(model)
        self._untouched = True
        self._pose, self._twist = data.joint("box_joint").qpos, data.joint("box_joint").qvel
        self._box, self._box_axes = data.body("box").xpos, data.body("box").xmat.reshape(3, 3)
        self._edge, self._edge_axes = data.body("obstacle_edge").xpos, data.body("obstacle_edge").xmat.reshape(3, 3)
        self._tool = data.site("hand/tool").xpos

    def sample_setup(self, rng: np.random.Generator) -> dict[str, Any]:
        """Uniform; the box relative to the obstacle."""
        place, yaw = rng.uniform(AREA_LOW, AREA_HIGH), float(rng.uniform(-MAX_YAW, MAX_YAW))
        away = BOX_HALF[1] + rng.uniform(GAP_LOW, GAP_HIGH)
        along, skew = rng.uniform(-MAX_ALONG, MAX_ALONG), rng.uniform(-MAX_SKEW, MAX_SKEW)
        c, s = math.cos(yaw), math.sin(yaw)
        box = [place[0] + c * along - s * away, place[1] + s * along + c * away]
        return {
            "obstacle": {"position": place.tolist(), "yaw": yaw},
            "box": {"position": [float(value) for value in box], "yaw": yaw + float(skew)},
        }

    def check_setup(self, setup: Mapping[str, Any]) -> None:
        """The obstacle in its area, the box before it."""
        setups.within("obstacle", setup["obstacle"]["position"], AREA_LOW, AREA_HIGH)
        setups.within("box", setup["box"]["position"], AREA_LOW - 1.0, AREA_HIGH + 1.0)
        yaw, box_yaw = setup["obstacle"]["yaw"], setup["box"]["yaw"]
        setups.in_range("yaw of 'obstacle'", yaw, -MAX_YAW, MAX_YAW)
        setups.in_range("yaw of 'box'", box_yaw, -MAX_YAW - MAX_SKEW, MAX_YAW + MAX_SKEW)
        setups.in_range("yaw of 'box'", box_yaw, yaw - MAX_SKEW, yaw + MAX_SKEW)
        along, away = _before(setup)
        setups.in_range("gap between 'obstacle' and 'box'", away - BOX_HALF[1], GAP_LOW, GAP_HIGH)
        setups.in_range("place of 'box' along the edge", along, -MAX_ALONG, MAX_ALONG)

    def place(self, setup: Mapping[str, Any]) -> None:
        """Obstacle and box on the table."""
        self.data.mocap_pos[0, :2] = setup["obstacle"]["position"]
        self.data.mocap_quat[0] = quaternion.multiply(setups.upright(setup["obstacle"]["yaw"]), EDGE_AXES)
        self._pose[:2], self._pose[2] = setup["box"]["position"], BOX_HALF[2]
        self._pose[3:] = setups.upright(setup["box"]["yaw"])

    def randomise(self, rng: np.random.Generator) -> None:
        """Mass (with its inertia) of the box, its friction with table and obstacle."""
        factor = self.between(rng, 0.25, 0.40) / self._mass[0]
        self._mass *= factor
        self._inertia *= factor
        self._friction[:] = self.between(rng, 0.2, 0.3)

    def after_physics(self) -> None:
        """See whether the robot touches the box."""
        self._untouched = count_contacts(self.data.contact.geom, self._is_box, self._is_robot) == 0

    def _turned(self) -> float:
        """Angle of the box's side that faced away from the obstacle, from lying (0) to up (pi/2)."""
        return math.atan2(self._box_axes[2, 1], self._box_axes[2, 2])

    def _gap(self) -> float:
        """Between obstacle and the nearest corner of the box [m]."""
        away = self._edge_axes[:, 0]
        return float(away @ (self._box - self._edge) - np.abs(away @ self._box_axes) @ BOX_HALF)

    def _flipped(self) -> bool:
        return bool(self._box_axes[2, 1] > math.cos(TOLERANCE) and abs(self._box[2] - BOX_HALF[1]) < 0.01)

    def succeeded(self) -> bool:
        """On its other face, at rest, free, the tool withdrawn."""
        return (
            self._flipped()
            and float(np.abs(self._twist[:3]).max()) < REST[0]
            and float(np.abs(self._twist[3:]).max()) < REST[1]
            and math.dist(self._tool, self._box) > CLEARANCE
            and self._untouched
        )

    def subtask_flags(self) -> tuple[bool, ...]:
        """At the obstacle, tilted, flipped."""
        return self._gap() < 0.015, self._turned() > math.radians(30.0), self._flipped()

    def measures(self) -> dict[str, float]:
        """How far the box is turned."""
        return {"turned": self._turned()}

    def progress(self) -> float:
        """Reach, push, turn, withdraw."""
        distance = math.dist(self._tool, self._box)
        if self._flipped():
            return float(0.8 + 0.15 * tolerance(distance, (CLEARANCE, math.inf), margin=CLEARANCE) * self._untouched)
        reach = tolerance(distance, (0.0, BOX_HALF[1] + 0.02), margin=0.3)
        push = tolerance(self._gap(), (0.0, 0.01), margin=GAP_HIGH)
        turn = min(max(self._turned() / (0.5 * math.pi), 0.0), 1.0)
        return float(0.2 * reach + 0.2 * push + 0.4 * turn)


def _before(setup: Mapping[str, Any]) -> tuple[float, float]:
    """Where the box is from the middle of the edge: along it and away from it [m]."""
    yaw = setup["obstacle"]["yaw"]
    x, y = np.subtract(setup["box"]["position"], setup["obstacle"]["position"]).tolist()
    c, s = math.cos(yaw), math.sin(yaw)
    return c * x + s * y, c * y - s * x
