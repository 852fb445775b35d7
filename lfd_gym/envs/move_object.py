"""Move an object to a target (thesis 2.5.1)."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from dm_control.utils.rewards import tolerance

from lfd_gym import wam
from lfd_gym.envs import setups
from lfd_gym.envs.manipulation_env import ManipulationEnv
from lfd_gym.envs.touch import count_contacts

AREA_LOW, AREA_HIGH = np.array([0.48, -0.25]), np.array([0.73, 0.25])
"""Where object and target may stand, x and y [m]."""
MIN_DISTANCE = 0.15
"""Between object and target [m]."""
HEIGHT = 0.045
"""Height of the standing object's centre [m]."""
TOLERANCE = 0.02
"""Of the object from the target [m]."""
CLEARANCE = 0.10
"""Of the tool from the object when it has withdrawn [m]."""
REST = 0.02
"""Largest component of the object's velocity at rest [m/s]."""
CARRIED = 0.04
"""How high it pays to carry the object [m]."""


class MoveObjectEnv(ManipulationEnv):
    """Grasp an object, put it on a target, let go and withdraw (thesis 2.5.1, Figure 2.7).

    | what | |
    |---|---|
    | frames | `object` (its centre), `target` (on the table) |
    | start | object and target anywhere in 25 x 50 cm, any yaw, at least 15 cm apart |
    | varies, hidden | mass of the object 0.1-0.2 kg, its friction with the table 0.6-1.0 |
    | success | the object stands at rest within 2 cm of the target, nothing touches it, the tool is 10 cm away; it may have |
    | | been pushed there |
    | subtasks | `grasped` (lifted by 2 cm), `at_target`, `released` (there) |
    | dense reward | reach 0.1, grip 0.1, bring to the target 0.3, let stand 0.1, release 0.15, withdraw 0.2 |
    | time limit | 30 s |

    Workspace of the tool point: x 0.43-0.78, y -0.30-0.30, z 0.01-0.40 m; tilt 0.3 rad, yaw 1.6 rad; alpha 16, beta 4 1/s.
    Other arguments: see `ManipulationEnv`.

    Version history: v0, first version.
    """

    scene = "move_object.xml"
    frames = ("object", "target")
    pushable = "object"
    subtasks = ("grasped", "at_target", "released")
    time_limit = 30.0
    layout = wam.action_layout((0.43, -0.30, 0.01), (0.78, 0.30, 0.40))

    def build(self) -> None:
        """Find the object and register its mass and friction."""
        model, body = self.model, self.model.body("object").id
        self._is_object = model.geom_bodyid == body
        self._untouched = True
        self._mass, self._inertia = model.body_mass[body : body + 1], model.body_inertia[body]
        self._friction = model.geom_friction[model.geom("object_foot").id, 0:1]
        self.vary(self._mass, self._inertia, self._friction)
        self._moves = (model.body_weldid[model.geom_bodyid] != 0) & (model.geom_bodyid != body)
        owners = [model.body(i).name for i in model.geom_bodyid]
        self._fingers = np.array([name.startswith(("hand/finger_1", "hand/finger_2")) for name in owners])
        self._thumb = np.array([name.startswith("hand/finger_3") for name in owners])
        self._pose = self.data.joint("object_joint").qpos
        self._twist = self.data.joint("object_joint").qvel
        self._object, self._target = self.data.body("object").xpos, self.data.body("target").xpos
        self._matrix = self.data.body("object").xmat
        self._tool = self.data.site("hand/tool").xpos

    def sample_setup(self, rng: np.random.Generator) -> dict[str, Any]:
        """Uniform in the area, by rejection of pairs that are too close."""
        return setups.apart(rng, self.frames, AREA_LOW, AREA_HIGH, MIN_DISTANCE)

    def check_setup(self, setup: Mapping[str, Any]) -> None:
        """Both in the area and apart."""
        setups.check_apart(setup, AREA_LOW, AREA_HIGH, MIN_DISTANCE)

    def place(self, setup: Mapping[str, Any]) -> None:
        """The object stands on the table, the target lies on it."""
        self._pose[:2], self._pose[2] = setup["object"]["position"], HEIGHT
        self._pose[3:] = setups.upright(setup["object"]["yaw"])
        self.data.mocap_pos[0, :2], self.data.mocap_pos[0, 2] = setup["target"]["position"], 0.0
        self.data.mocap_quat[0] = setups.upright(setup["target"]["yaw"])

    def randomise(self, rng: np.random.Generator) -> None:
        """Mass (with its inertia) of the object, its friction with the table."""
        factor = self.between(rng, 0.1, 0.2) / self._mass[0]
        self._mass *= factor
        self._inertia *= factor
        self._friction[0] = self.between(rng, 0.6, 1.0)

    def after_physics(self) -> None:
        """See whether the object touches nothing but what is fixed to the world."""
        self._untouched = not count_contacts(self.data.contact.geom, self._is_object, self._moves)

    def _off_target(self) -> float:
        dx, dy = self._object[0] - self._target[0], self._object[1] - self._target[1]
        return math.hypot(dx, dy)

    def _standing(self) -> bool:
        return abs(self._object[2] - HEIGHT) < 0.005 and abs(self._matrix[8]) > 0.98

    def succeeded(self) -> bool:
        """Standing at rest on the target, free, the tool withdrawn."""
        return (
            self._off_target() < TOLERANCE
            and self._standing()
            and float(np.abs(self._twist[:3]).max()) < REST
            and math.dist(self._tool, self._object) > CLEARANCE
            and self._untouched
        )

    def subtask_flags(self) -> tuple[bool, ...]:
        """Lifted, on target, left there."""
        lifted, there = self._object[2] > HEIGHT + 0.02, self._off_target() < TOLERANCE
        return lifted, there, there and not lifted and self._untouched

    def progress(self) -> float:
        """Reach, grip, bring nearer, let stand, let go and withdraw.

        Being near the target pays only in the grip: otherwise it would be safest not to touch what may fall over. A grip is
        felt on both sides, at any height. The way to the target is a funnel, as high as the object is away and at most
        `CARRIED`, so that it pays to lift what would be dragged and to lower it on the way, and nowhere to stay.
        """
        off, height = self._off_target(), self._object[2] - HEIGHT
        if off < TOLERANCE and self._standing():
            withdrawn = tolerance(math.dist(self._tool, self._object), (CLEARANCE, math.inf), margin=CLEARANCE)
            return float(0.6 + (0.15 + 0.2 * withdrawn) * self._untouched)
        reach = 0.1 * tolerance(math.dist(self._tool, self._object), (0.0, 0.03), margin=0.3)
        if not self._gripped():
            return float(reach)
        too_high = height - min(off, CARRIED)
        way = off + max(too_high, -3.0 * too_high)
        near = tolerance(way, margin=0.8, sigmoid="linear", value_at_margin=0.0)
        close = tolerance(way, margin=0.05, sigmoid="long_tail")
        return float(reach + 0.1 + 0.15 * near + 0.15 * close)

    def _gripped(self) -> bool:
        """Whether the finger that opposes the other two and one of these touch the object."""
        pairs = self.data.contact.geom
        sides = (self._thumb, self._fingers)
        return all(count_contacts(pairs, self._is_object, side) for side in sides)
