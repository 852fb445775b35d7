"""The robot alone over an empty floor, or with whatever a test adds: scenes, and a loop that commands goals."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from lfd_gym import paths, wam
from lfd_gym.action import ActionLayout
from lfd_gym.robot import Robot

LAYOUT = wam.action_layout((0.30, -0.5, -0.05), (0.90, 0.5, 0.60), rotation_limit=(1.0, 1.0, 1.6))
FAST = replace(LAYOUT, alpha=8.0, beta=2.0, speed_limit=100.0, turn_limit=100.0)
"""Nothing saturates: an attractor slow enough for the motors, without speed limits."""

PEN = """
<mujoco model="pen">
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <body name="pen">
      <inertial mass=".1" pos="0 0 .06" diaginertia=".0002 .0002 .00002"/>
      <site name="wrist_sensor" pos="0 0 0"/>
      <site name="tool" pos="0 0 .15"/>
      <geom name="tip" type="sphere" size=".004" pos="0 0 .146" mass="0" contype="2" conaffinity="0" condim="4" priority="1"
            friction=".2 .01 .0005" solref=".02 1" solimp="0 .9 .002 .5 2"/>
    </body>
  </worldbody>
  <sensor>
    <force name="wrist_force" site="wrist_sensor"/>
    <torque name="wrist_torque" site="wrist_sensor"/>
  </sensor>
</mujoco>
"""


def hand_spec() -> mujoco.MjSpec:
    """Arm and hand."""
    return wam.scene_spec("wam.xml", "hand")


def pen_spec() -> mujoco.MjSpec:
    """Arm with a rod whose tip is a small soft sphere."""
    spec = mujoco.MjSpec.from_file(str(paths.assets() / "wam.xml"))
    spec.attach(mujoco.MjSpec.from_string(PEN), site=spec.site("flange"), prefix="pen/")
    return spec


class BareRobot:
    """A robot that is stepped physics step by physics step and commanded with goals that keep what is not given."""

    def __init__(self, spec: mujoco.MjSpec, tool: str = "hand", layout: ActionLayout = LAYOUT, **kwargs: Any) -> None:
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.tool = tool
        self.robot = Robot(self.model, self.data, tool, layout, (), **kwargs)
        self.robot.reset()
        self._flat = np.empty(54 if tool == "hand" else 46)

    @property
    def position(self) -> np.ndarray:
        """Of the tool point (3,) [m]."""
        return self.data.site(f"{self.tool}/tool").xpos.copy()

    @property
    def quaternion(self) -> np.ndarray:
        """Of the tool."""
        return self.robot.tool_quaternion()

    @property
    def arm(self) -> np.ndarray:
        """Joint angles (7,) [rad]."""
        return self.data.qpos[: wam.N_JOINTS].copy()

    @property
    def memory(self) -> Any:
        """The controller's state: a record of `records.MEMORY`."""
        return self.robot._memory[0]

    def stand(self, arm: np.ndarray) -> None:
        """Put the arm into a posture at rest, the reference at the tool."""
        self.data.qpos[: wam.N_JOINTS] = arm
        self.data.qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        self.memory["position"][:], self.memory["quaternion"][:] = self.position, self.quaternion
        self.command(position=self.position, quaternion=self.quaternion)

    def command(self, **parts: ArrayLike) -> None:
        """Change parts of the goal: position, quaternion, force, hand, without the limits of an action."""
        for name, part in parts.items():
            self.robot._command[name][0] = part

    def steps(self, seconds: float, before: Callable[[float], None] | None = None) -> Iterator[float]:
        """Step the physics, yielding the time since the call after each step.

        `before(time)` runs between the controller and the physics.
        """
        dt = self.model.opt.timestep
        for k in range(round(seconds / dt)):
            self.robot.tick()
            if before is not None:
                before(k * dt)
            mujoco.mj_step2(self.model, self.data)
            mujoco.mj_step1(self.model, self.data)
            yield (k + 1) * dt

    def run(self, seconds: float, before: Callable[[float], None] | None = None) -> None:
        """Step the physics."""
        for _ in self.steps(seconds, before):
            pass

    def wrench(self) -> np.ndarray:
        """The observed wrench (6,), mean since the last call."""
        assert self.robot.observe(self._flat)
        return self._flat[40:46].copy()
