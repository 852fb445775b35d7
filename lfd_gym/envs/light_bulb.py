"""Unscrew a light bulb and drop it into a box (thesis 2.5.2)."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control.utils.rewards import tolerance
from numba import njit
from numpy.typing import NDArray

from lfd_gym import wam
from lfd_gym.compiled import bound
from lfd_gym.envs import setups
from lfd_gym.envs.manipulation_env import ManipulationEnv
from lfd_gym.envs.touch import count_contacts, robot_geoms

AREA_LOW, AREA_HIGH = np.array([0.48, -0.30]), np.array([0.73, 0.30])
"""Where holder and box may stand, x and y [m]."""
MIN_DISTANCE = 0.20
"""Between holder and box [m]."""
SEAT = 0.020
"""Height of the cap's foot when screwed in [m]."""
BOX_HALF = 0.084
"""Half the inner width of the box [m]."""
CLEARANCE = 0.15
"""Of the tool from the bulb when it has withdrawn [m]."""
REST = (0.05, 0.5)
"""Largest component of the bulb's velocity at rest, linear [m/s] and angular [rad/s]: in the box it may still rock."""


class LightBulbEnv(ManipulationEnv):
    """Unscrew a light bulb by caging it below its widest point and put it into a box (thesis 2.5.2, Figure 2.10).

    | what | |
    |---|---|
    | frames | `bulb_holder`, `box` (both on the table); the bulb itself is not tracked |
    | start | holder and box anywhere in 25 x 60 cm, any yaw, at least 20 cm apart |
    | varies, hidden | turns until the bulb is loose 1-2, friction torque of the thread 0.06-0.12 N m |
    | success | the bulb lies at rest in the box, nothing of the robot touches it, the tool is 15 cm away from it |
    | subtasks | `grasped` (the robot touches the bulb in two places), `loose`, `lifted`, `in_box` |
    | dense reward | reach 0.15, turn 0.35, lift 0.1, carry 0.2, in the box and withdraw 0.2 |
    | time limit | 90 s |

    The tool point is where the planes of the three fingers meet at a spread of 60 degrees. Workspace: x 0.43-0.78,
    y -0.35-0.35, z 0.03-0.40 m; tilt 0.3 rad, yaw 1.6 rad; alpha 16, beta 4 1/s. Other arguments: see `ManipulationEnv`.

    Version history: v0, first version.
    """

    scene = "light_bulb.xml"
    tool_offset = (0.0, 0.0144, 0.0)
    frames = ("bulb_holder", "box")
    pushable = "bulb"
    subtasks = ("grasped", "loose", "lifted", "in_box")
    time_limit = 90.0
    controls = ("x", "y", "z", "yaw", "grip", "press")
    hand_open = (math.radians(60.0), 0.0, 0.0, 0.0)
    hand_closed = (math.radians(60.0), 2.0, 2.0, 2.0)
    n_hidden = 1
    layout = wam.action_layout((0.43, -0.35, 0.03), (0.78, 0.35, 0.40))

    def build(self) -> None:
        """Find bulb, thread and fingers; register the thread's friction."""
        model, data = self.model, self.data
        self._is_bulb = model.geom_bodyid == model.body("bulb").id
        self._n_touches = 0
        turn = model.joint("nut_turn")
        self._thread_friction = model.dof_frictionloss[turn.dofadr[0] : turn.dofadr[0] + 1]
        self.vary(self._thread_friction)
        self._weld = model.equality("bulb_in_thread").id
        self._turn = data.joint("nut_turn").qpos
        self._rise = data.joint("nut_rise").qpos
        self._pose, self._twist = data.joint("bulb_joint").qpos, data.joint("bulb_joint").qvel
        self._glass = data.geom("bulb_glass").xpos
        self._tool = data.site("hand/tool").xpos
        self._holder = data.mocap_pos[model.body("bulb_holder").mocapid[0]]
        self._holder_quat = data.mocap_quat[model.body("bulb_holder").mocapid[0]]
        self._box = data.mocap_pos[model.body("box").mocapid[0]]
        self._box_quat = data.mocap_quat[model.body("box").mocapid[0]]
        self._box_frame = data.body("box").xmat
        self._is_robot = robot_geoms(model)
        self.watch = bound(end_thread, self._turn, self._hidden, self.data.eq_active[self._weld : self._weld + 1])

    @property
    def _loose(self) -> bool:
        return not self.data.eq_active[self._weld]

    def sample_setup(self, rng: np.random.Generator) -> dict[str, Any]:
        """Uniform in the area, by rejection of pairs that are too close."""
        return setups.apart(rng, self.frames, AREA_LOW, AREA_HIGH, MIN_DISTANCE)

    def check_setup(self, setup: Mapping[str, Any]) -> None:
        """Both in the area and apart."""
        setups.check_apart(setup, AREA_LOW, AREA_HIGH, MIN_DISTANCE)

    def place(self, setup: Mapping[str, Any]) -> None:
        """Holder and box stand on the table, the bulb is screwed in."""
        self._holder[:2], self._box[:2] = setup["bulb_holder"]["position"], setup["box"]["position"]
        self._holder_quat[:] = setups.upright(setup["bulb_holder"]["yaw"])
        self._box_quat[:] = setups.upright(setup["box"]["yaw"])
        self._pose[:2], self._pose[2], self._pose[3:] = self._holder[:2], SEAT, self._holder_quat

    def randomise(self, rng: np.random.Generator) -> None:
        """How many turns the bulb needs, and how hard it turns."""
        self._hidden[0] = 2.0 * math.pi * rng.uniform(1.0, 2.0)
        self._thread_friction[0] = self.between(rng, 0.06, 0.12)

    def after_physics(self) -> None:
        """Count the robot's contacts with the bulb."""
        self._n_touches = count_contacts(self.data.contact.geom, self._is_bulb, self._is_robot)

    def _in_box(self) -> bool:
        offset = self._box_frame.reshape(3, 3).T @ (self._glass - self._box)
        return bool(abs(offset[0]) < BOX_HALF and abs(offset[1]) < BOX_HALF and offset[2] < 0.08)

    def succeeded(self) -> bool:
        """At rest in the box, released, arm withdrawn."""
        return (
            self._loose
            and self._in_box()
            and float(np.abs(self._twist[:3]).max()) < REST[0]
            and float(np.abs(self._twist[3:]).max()) < REST[1]
            and math.dist(self._tool, self._glass) > CLEARANCE
            and self._n_touches == 0
        )

    def subtask_flags(self) -> tuple[bool, ...]:
        """Grasped, loose, lifted, in the box."""
        return self._n_touches >= 2, self._loose, self._pose[2] > SEAT + 0.04, self._in_box()

    def progress(self) -> float:
        """Reach, turn, lift, carry, withdraw."""
        if self._in_box():
            return float(
                0.8 + 0.2 * tolerance(math.dist(self._tool, self._glass), (CLEARANCE, math.inf), margin=CLEARANCE)
            )
        reach = tolerance(math.dist(self._tool, self._glass), (0.0, 0.03), margin=0.3)
        turn = 1.0 if self._loose else min(max(self._turn[0] / self._hidden[0], 0.0), 1.0)
        lift = tolerance(self._pose[2] - SEAT, (0.04, math.inf), margin=0.04) if self._loose else 0.0
        away = math.dist(self._glass[:2], self._box[:2])
        carry = tolerance(away, (0.0, 0.05), margin=0.5) if self._loose else 0.0
        return float(0.15 * reach + 0.35 * turn + 0.1 * lift + 0.2 * carry)


@njit(cache=True)
def end_thread(turned: NDArray[np.float64], turns: NDArray[np.float64], screwed: NDArray[np.uint8]) -> None:
    """Free the bulb where its thread ends: called after every physics step.

    Args:
        turned: angle of the nut, (1,) [rad].
        turns: at which it ends, (1,) [rad].
        screwed: whether the bulb is held by the nut, (1,).
    """
    if turned[0] > turns[0]:
        screwed[0] = 0
