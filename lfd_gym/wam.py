"""The robot: Barrett WAM with a BarrettHand BH8-280 or a pen behind a wrist force/torque sensor.

Sources: joint ranges from the WAM user manual D1001 (table 6), torque limits as published with the HERB robot, drives and
sensor from Barrett's data sheets. The kinematics and inertias stand in ``assets/wam.xml``.
"""

import math
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lfd_gym import paths
from lfd_gym.action import ActionLayout
from lfd_gym.errors import UnknownNameError

N_JOINTS = 7
HAND_JOINT_NAMES = ("finger_1_spread", "finger_1_proximal", "finger_2_proximal", "finger_3_proximal")
TOOLS = {"hand": "barrett_hand.xml", "pen": "pen.xml"}
"""What can be mounted on the wrist sensor, and its file; its names carry the prefix `hand/` or `pen/`."""

TOOL_DOWN = np.array([0.0, 0.0, 1.0, 0.0])
"""Quaternion of diag(-1, 1, -1): the tool points down, the hand's y axis along the world's y axis."""
HOME = np.array([0.0, 0.58, 0.0, 1.67, 0.0, math.pi - 2.25, 0.0])
"""Working posture [rad] with the tool pointing down over the middle of the table."""
REACH = (0.545, 0.30)
"""Lengths of upper arm and forearm [m], less 1 cm in all, so that the elbow is never straight."""
BEND = (math.cos(1.65), math.cos(1.35))
"""Cosines of the largest angles between the line from elbow to wrist and the hand, the wrist bent forwards and backwards: its
joint limits, 1.6 rad, and 0.15 rad that this line lies off the forearm's axis; less 0.1 rad."""
JOINT_SPEED = 2.0 * math.pi
"""Joint speed [rad/s] beyond which the controller brakes: near a singularity of the wrist it would ask for any."""

HAND_STALL = (2.0, 0.8, 0.8, 0.8)
"""Torques [N m] at which spread and fingers stop closing: about 8 N at a fingertip."""
HAND_SPEED = (3.0, 2.44, 2.44, 2.44)
"""Speeds of spread and fingers [rad/s]: the hand opens or closes in one second."""
HAND_LOW, HAND_HIGH = (0.0, 0.0, 0.0, 0.0), (math.pi, 2.44, 2.44, 2.44)
MAX_FINGERTIP_FRICTION = 1.2
"""No simulated fingertip grips better than soft rubber on wood."""


class Handles(NamedTuple):
    """Views into one simulation that the controller reads and writes at every step; looked up once."""

    joints: tuple[NDArray, ...]
    """Positions and velocities of all joints."""
    dynamics: tuple[NDArray, ...]
    """Inertia matrix, bias torques, and the joints' anchors and axes in the world."""
    tool: tuple[NDArray, ...]
    """Place and rotation of the tool point and of the wrist sensor, its reading, and where all that hangs on it has its centre
    of mass."""
    hand: NDArray[np.int64]
    """Addresses of spread and finger angles among the positions; empty for a pen."""
    ctrl: NDArray
    """What the arm's motors and the fingers' drives are told."""


def action_layout(low: ArrayLike, high: ArrayLike, **differs: Any) -> ActionLayout:
    """The actions of the arm with its hand, which may turn by 0.3 rad in tilt and 1.6 rad in yaw.

    Args:
        low: lower corner of the workspace box of the tool point, world frame, shape (3,) [m].
        high: its upper corner.
        differs: the other fields of `ActionLayout`, where a task needs them otherwise.
    """
    usual: dict[str, Any] = {
        "rotation_limit": (0.3, 0.3, 1.6), "force_limit": 20.0, "hand_low": HAND_LOW, "hand_high": HAND_HIGH,
        "reference_quaternion": TOOL_DOWN, "alpha": 16.0, "beta": 4.0, "speed_limit": 0.5, "turn_limit": 1.8,
    }  # fmt: skip
    return ActionLayout(np.asarray(low), np.asarray(high), **(usual | differs))


def scene_spec(
    scene: str, tool: str = "hand", tool_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> mujoco.MjSpec:
    """The specification of a scene from `assets/` with the tool mounted on the wrist sensor.

    Args:
        scene: file name of the scene, which includes the arm.
        tool: a name of `TOOLS`.
        tool_offset: displacement of the tool point in the tool's axes [m].
    """
    if tool not in TOOLS:
        raise UnknownNameError("tool", tool, TOOLS)
    folder = paths.assets()
    spec = mujoco.MjSpec.from_file(str(folder / scene))
    spec.attach(mujoco.MjSpec.from_file(str(folder / TOOLS[tool])), site=spec.site("flange"), prefix=f"{tool}/")
    spec.site(f"{tool}/tool").pos += np.array(tool_offset)
    return spec


def handles(model: mujoco.MjModel, data: mujoco.MjData, tool: str) -> Handles:
    """Find everything that the controller needs by name."""
    site, sensor = data.site(f"{tool}/tool"), data.site(f"{tool}/wrist_sensor")
    first = model.sensor(f"{tool}/wrist_force").adr[0]
    addresses = np.array(
        [model.joint(f"{tool}/{name}").qposadr[0] for name in HAND_JOINT_NAMES] if tool == "hand" else [],
        dtype=np.int64,
    )
    reading, tool_com = data.sensordata[first : first + 6], data.body(f"{tool}/{tool}").subtree_com
    return Handles(
        joints=(data.qpos, data.qvel),
        dynamics=(data.M, data.qfrc_bias, data.xanchor, data.xaxis),
        tool=(site.xpos, site.xmat, sensor.xpos, sensor.xmat, reading, tool_com),
        hand=addresses,
        ctrl=data.ctrl,
    )
