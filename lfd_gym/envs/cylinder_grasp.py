"""Grasp and lift cylinders of different lengths (thesis 2.5.3)."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control.utils.rewards import tolerance
from numba import njit
from numpy.typing import NDArray

from lfd_gym import quaternion, wam
from lfd_gym.envs import setups
from lfd_gym.envs.manipulation_env import ManipulationEnv
from lfd_gym.envs.touch import count_contacts, robot_geoms
from lfd_gym.errors import InvalidSetupError

Array = NDArray[np.float64]

AREA_LOW, AREA_HIGH = np.array([0.48, -0.20]), np.array([0.73, 0.20])
"""Where the centre of the cylinder may be, x and y [m]; its far corners are as far as the arm can lift."""
NEAREST = 0.52
"""Distance from the axis of the robot's base [m], below which the wrist comes near its singularity at a low grasp."""
LENGTHS = (0.08, 0.16, 0.24)
"""[m]."""
POSTURES = ("standing", "upside down", "lying")
RADIUS = 0.025
"""[m]."""
MASS_PER_LENGTH = 2.5
"""[kg/m]: 0.2, 0.4 and 0.6 kg, heavy enough to slip where the friction is low."""
LIFTED = 0.10
"""Height of the lowest point over the table [m]."""
PINCH_SPREAD = math.radians(45.0)
"""From this spread on, a grasp with the fingers 1 and 2 is a pinch."""
_HIDDEN = 5
"""Group of geoms that are not rendered."""


class CylinderGraspEnv(ManipulationEnv):
    """Grasp a cylinder as its length and posture ask for, and lift it; it may slip (thesis 2.5.3, Figure 2.13).

    | what           |                                                                                                    |
    |----------------|----------------------------------------------------------------------------------------------------|
    | frames         | `cylinder` (its centre), `cylinder_top`, `cylinder_bottom` (centres of its end faces)              |
    | features       | `cylinder`: length [m], inclination, rotation [rad] (thesis Table 2.2, Figure 2.14)                |
    | start          | 8, 16 or 24 cm long, radius 2.5 cm; standing, upside down or lying; in 25 x 40 cm, at least 52 cm  |
    |                | from the robot, any yaw                                                                            |
    | varies, hidden | friction 0.4-1.0, so that it may slip; the mass is 2.5 kg per metre of length                       |
    | success        | the lowest point of the cylinder is 10 cm over the table, and the hand holds it                    |
    | subtasks       | `grasped` (two contacts with the hand), `lifted`, `demonstrated_grasp` (held by a pinch if it is   |
    |                | the lying cylinder of 16 cm, else by a power grasp, as it lay when it was touched)                 |
    | dense reward   | reach 0.3, grasp 0.2, lift 0.5                                                                     |
    | time limit     | 60 s                                                                                               |

    The inclination is the angle between the upward vertical and the cylinder's axis, which points from bottom to top: 0
    standing, pi upside down. The rotation is the angle about the vertical from the hand's y axis to the cylinder's axis; where
    that is vertical the rotation is nothing but noise, in every direction.

    A cylinder looks the same all around, so a tracker measures its axis alone. The frames' z axis is the cylinder's axis;
    their x axis points upwards where it lies, and along the world's x axis where it stands. A power grasp closes three
    fingers along the hand's y axis, a pinch two of them along its x axis (spread 90 degrees).

    Setup: `{"cylinder": {"position": [x, y], "yaw": angle, "length": 0.16, "posture": "lying"}}`; the yaw of a lying
    cylinder is that of its axis. Tool point 5 mm off the hand's axis, where three fingers meet. Workspace: x 0.40-0.82,
    y -0.40-0.40, z 0.005-0.36 m; tilt 0.3 rad, yaw 2.0 rad; alpha 16, beta 4 1/s. Other arguments: see `ManipulationEnv`.

    Version history: v0, first version.
    """

    scene = "cylinder_grasp.xml"
    tool_offset = (0.0, -0.005, 0.0)
    frames = ("cylinder", "cylinder_top", "cylinder_bottom")
    features = {"cylinder": ((0.0, 0.0, -math.pi), (0.3, math.pi, math.pi))}  # noqa: RUF012
    pushable = "cylinder"
    subtasks = ("grasped", "lifted", "demonstrated_grasp")
    time_limit = 60.0
    n_hidden = 1
    layout = wam.action_layout((0.40, -0.40, 0.005), (0.82, 0.40, 0.36), rotation_limit=(0.3, 0.3, 2.0))

    def build(self) -> None:
        """Find the cylinder; register its friction and all that differs between the lengths."""
        model, data = self.model, self.data
        body = model.body("cylinder").id
        own = model.geom_bodyid == body
        first, last = np.flatnonzero(own)[[0, -1]]
        geoms = slice(int(first), int(last) + 1)
        self._friction = model.geom_friction[geoms, 0]
        self._contype, self._conaffinity = model.geom_contype[geoms], model.geom_conaffinity[geoms]
        self._group = model.geom_group[geoms]
        self._mass, self._inertia = model.body_mass[body : body + 1], model.body_inertia[body]
        self._ends = [model.body_pos[model.body(name).id] for name in self.frames[1:]]
        self.vary(self._friction, self._contype, self._conaffinity, self._group, self._mass, self._inertia, *self._ends)
        names = [model.geom(i).name for i in range(geoms.start, geoms.stop)]
        self._of_length = {
            length: np.array([f"_{round(100 * length)}" in name for name in names]) for length in LENGTHS
        }
        self._is_paint = np.array(["paint" in name for name in names])
        self._is_cylinder = own
        self._is_robot = robot_geoms(model)
        self._pose, self._axis = data.joint("cylinder_joint").qpos, data.body("cylinder").xmat.reshape(3, 3)[:, 2]
        self._tool = data.site("hand/tool").xpos
        self._spread = data.joint("hand/finger_1_spread").qpos
        self._n_touches = 0

    @property
    def _length(self) -> float:
        return 2.0 * float(self._ends[0][2])

    def sample_setup(self, rng: np.random.Generator) -> dict[str, Any]:
        """Length, posture and yaw at random, uniform in the area."""
        while True:
            place = rng.uniform(AREA_LOW, AREA_HIGH)
            length, posture, yaw = rng.choice(LENGTHS), rng.choice(POSTURES), rng.uniform(-math.pi, math.pi)
            if math.hypot(*place) >= NEAREST:
                pose = {"position": place.tolist(), "yaw": float(yaw), "length": float(length), "posture": str(posture)}
                return {"cylinder": pose}

    def check_setup(self, setup: Mapping[str, Any]) -> None:
        """In the area, not too near to the robot, of a length and in a posture that there is."""
        pose = setup["cylinder"]
        setups.within("cylinder", pose["position"], AREA_LOW, AREA_HIGH)
        setups.check_reach("cylinder", pose["position"], NEAREST)
        if not any(math.isclose(pose["length"], length, rel_tol=1e-6) for length in LENGTHS):
            raise InvalidSetupError(f"length {pose['length']!r}; possible: {', '.join(map(str, LENGTHS))} m")
        if pose["posture"] not in POSTURES:
            raise InvalidSetupError(f"posture {pose['posture']!r}; possible: {', '.join(POSTURES)}")

    def randomise(self, rng: np.random.Generator) -> None:
        """The cylinder becomes as long as the setup says; its friction."""
        length = min(LENGTHS, key=lambda length: abs(length - self._setup["cylinder"]["length"]))
        chosen = self._of_length[length]
        self._contype *= chosen
        self._conaffinity *= chosen
        self._group[self._is_paint & ~chosen] = _HIDDEN
        self._ends[0][2], self._ends[1][2] = 0.5 * length, -0.5 * length
        mass = MASS_PER_LENGTH * length
        self._mass[0] = mass
        self._inertia[:] = mass * np.array([1.0, 1.0, 0.0]) * (3.0 * RADIUS**2 + length**2) / 12.0
        self._inertia[2] = 0.5 * mass * RADIUS**2
        self._friction[:] = min(self.between(rng, 0.4, 1.0), wam.MAX_FINGERTIP_FRICTION)

    def place(self, setup: Mapping[str, Any]) -> None:
        """The cylinder stands or lies on the table."""
        pose = setup["cylinder"]
        tilt = {"standing": 0.0, "upside down": math.pi, "lying": math.pi / 2.0}[pose["posture"]]
        turn = quaternion.from_rotation_vector(np.array([0.0, 0.0, float(pose["yaw"])]))
        self._pose[:2] = pose["position"]
        self._pose[2] = RADIUS if pose["posture"] == "lying" else 0.5 * self._length
        self._pose[3:] = quaternion.multiply(turn, quaternion.from_rotation_vector(np.array([0.0, tilt, 0.0])))

    def after_physics(self) -> None:
        """Count the contacts with the hand; remember how the cylinder lay when it was last free."""
        self._n_touches = count_contacts(self.data.contact.geom, self._is_cylinder, self._is_robot)
        if self._n_touches == 0:
            self._hidden[0] = float(abs(self._axis[2]) < math.cos(math.pi / 4.0))

    def derive(self, observation: dict[str, Array]) -> None:
        """The tracker's view of the frames, and length, inclination, rotation."""
        for name in self.frames:
            frame = observation[f"frame_{name}"]
            frame[3:] = about_its_axis(frame[3:])
        axis = quaternion.rotate(observation["frame_cylinder"][3:], np.array([0.0, 0.0, 1.0]))
        hand = quaternion.rotate(observation["tool_quaternion"], np.array([0.0, 1.0, 0.0]))
        features = observation["cylinder"]
        features[0], features[1] = self._length, math.acos(min(max(axis[2], -1.0), 1.0))
        features[2] = math.remainder(math.atan2(axis[1], axis[0]) - math.atan2(hand[1], hand[0]), 2.0 * math.pi)

    def _clearance(self) -> float:
        """Height of the cylinder's lowest point over the table [m]."""
        upright = min(abs(float(self._axis[2])), 1.0)
        return float(self._pose[2]) - 0.5 * self._length * upright - RADIUS * math.sqrt(1.0 - upright**2)

    def succeeded(self) -> bool:
        """Lifted and held."""
        return self._n_touches >= 2 and self._clearance() >= LIFTED

    def subtask_flags(self) -> tuple[bool, ...]:
        """Grasped, lifted, and lifted as demonstrated."""
        lifted = self.succeeded()
        wanted = bool(self._hidden[0]) and abs(self._length - LENGTHS[1]) < 1e-3
        return self._n_touches >= 2, lifted, lifted and (self._spread[0] > PINCH_SPREAD) == wanted

    def progress(self) -> float:
        """Reach, grasp, lift."""
        reach = tolerance(math.dist(self._tool, self._pose[:3]), (0.0, 0.5 * self._length), margin=0.3)
        lift = tolerance(self._clearance(), (LIFTED, math.inf), margin=LIFTED, sigmoid="linear")
        return float(0.3 * reach + (self._n_touches >= 2) * (0.2 + 0.5 * lift))


@njit(cache=True)
def about_its_axis(q: Array) -> Array:
    """The orientation with the same z axis whose x axis points upwards (lying) or along the world's x axis (standing)."""
    z = quaternion.rotate(q, np.array([0.0, 0.0, 1.0]))
    lies = abs(z[2]) < math.sqrt(0.5)
    x = np.array([0.0, 0.0, 1.0]) if lies else np.array([1.0, 0.0, 0.0])
    x -= np.dot(x, z) * z
    x /= math.sqrt(np.dot(x, x))
    matrix = np.empty((3, 3))
    matrix[:, 0], matrix[:, 1], matrix[:, 2] = x, np.cross(z, x), z
    return quaternion.canonical(quaternion.from_matrix(matrix))
