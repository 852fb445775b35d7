"""The robot in one simulation: what it is told, what it measures, and its controller at the physics rate."""

from collections.abc import Callable
from functools import partial

import mujoco
import numpy as np
from numba import typeof
from numpy.typing import NDArray

from lfd_gym import controller, quaternion, servo, wam
from lfd_gym.action import ActionLayout, Goal

Array = NDArray[np.float64]


FRICTION_COMPENSATION = 0.7
"""Fraction of the joints' Coulomb friction that the controller feeds forward; all of it would make limit cycles."""


class Robot:
    """A WAM with its tool and controller.

    Args:
        model, data: the simulation, the arm first in the tree.
        tool: "hand" or "pen".
        layout: workspace and attractor of the environment.
        stiffness: of the PID that tracks the reference [1/s^2]; its damping is critical.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, tool: str, layout: ActionLayout, stiffness: float = 900.0
    ) -> None:
        self.model, self.data, self.layout = model, data, layout
        self._settings = np.zeros(1, servo.SETTINGS)
        self._command = np.zeros(1, servo.COMMAND)
        self._memory = np.zeros(1, servo.MEMORY)
        self._handles = wam.handles(model, data, tool)
        self._write_settings(tool, stiffness)
        self.tick = self._bind()
        self._site = data.site(f"{tool}/tool")
        self._memory_fields = {name: self._memory[name][0] for name in ("position", "quaternion", "hand")}
        self._goal = tuple(self._command[name][0] for name in ("position", "quaternion", "force", "hand"))
        self.state_size = servo.MEMORY.itemsize // 8

    def _write_settings(self, tool: str, stiffness: float) -> None:
        n, s, model = wam.N_JOINTS, self._settings[0], self.model
        for name in ("alpha", "beta", "speed_limit", "turn_limit", "workspace_low", "workspace_high"):
            s[name] = getattr(self.layout, name)
        s["dt"] = model.opt.timestep
        s["stiffness"], s["damping"], s["integral"] = stiffness, 2.0 * np.sqrt(stiffness), 4.0 * stiffness
        s["integral_limit"], s["lead_limit"] = (4.0, 40.0), (0.03, 0.3)
        s["force_integral"], s["force_damping"], s["filter"] = 4.0, 20.0, 2.0 * np.pi * 20.0
        s["rest"] = wam.HOME
        s["joint_low"], s["joint_high"] = model.jnt_range[:n].T
        s["torque_limit"] = model.actuator_ctrlrange[:n, 1]
        s["joint_damping"] = model.dof_damping[:n]
        s["joint_friction"] = FRICTION_COMPENSATION * model.dof_frictionloss[:n]
        s["friction_speed"] = 0.05
        s["tool_mass"], s["gravity"] = model.body(f"{tool}/{tool}").subtreemass[0], model.opt.gravity
        s["n_hand"] = self._handles.hand_addresses.size
        s["hand_speed"], s["hand_stall"] = wam.HAND_SPEED, wam.HAND_STALL
        if s["n_hand"]:
            s["hand_stiffness"] = model.actuator_gainprm[n : n + 4, 0]

    def _bind(self) -> Callable[[], None]:
        """The controller's step as a function without arguments, past Numba's type dispatch, which costs as much again."""
        arguments = (
            *(self._settings, self._command, self._memory),
            *self._handles.arguments,
            np.zeros((24, 14)),
            controller.NullSpace(),
        )
        mujoco.mj_forward(self.model, self.data)
        servo.tick(*arguments)
        signature = tuple(typeof(argument) for argument in arguments)
        return partial(servo.tick.overloads[signature].entry_point, *arguments)

    def reset(self) -> None:
        """Stand in the home posture, hand open, reference at the tool, nothing commanded."""
        self._memory[:] = 0
        self.data.qpos[: wam.N_JOINTS] = wam.HOME
        mujoco.mj_forward(self.model, self.data)
        hand = self.data.qpos[self._handles.hand_addresses]
        m = self._memory_fields
        m["position"][:], m["quaternion"][:] = self._site.xpos, self.tool_quaternion()
        m["hand"][: hand.size] = hand
        self.command(Goal(m["position"], m["quaternion"], np.zeros(3), hand))
        self.tick()
        mujoco.mj_forward(self.model, self.data)
        self._memory["wrench_sum"], self._memory["ticks"], self._memory["pressed"] = 0.0, 0.0, 0.0

    def command(self, goal: Goal) -> None:
        """Set the goal that the next ticks are attracted to."""
        position, orientation, force, hand = self._goal
        position[:], orientation[:], force[:] = goal.position, goal.quaternion, goal.force
        hand[: goal.hand.size] = goal.hand

    def tool_quaternion(self) -> Array:
        """Orientation of the tool, world frame, in the half space of the layout's reference."""
        q = quaternion.from_matrix(self._site.xmat.reshape(3, 3))
        return q if q @ self.layout.reference_quaternion >= 0.0 else -q

    def observe(self, flat: Array, frames: NDArray[np.int64]) -> bool:
        """Write all measurements into `flat`, in the order of the observation space; False where one is not finite.

        Args:
            flat: shape (n,).
            frames: ids of the tracked bodies.
        """
        data, reference = self.data, self.layout.reference_quaternion
        return servo.observe(
            flat, self._settings, self._memory, *self._handles.arguments[:2], *self._handles.arguments[6:13],
            data.actuator_force, data.qacc, data.xpos, data.xquat, frames, reference,
        )  # fmt: skip

    def get_state(self) -> Array:
        """The controller's memory as floats."""
        return self._memory.view(np.float64).copy()

    def set_state(self, state: Array) -> None:
        """Restore what `get_state` returned."""
        self._memory.view(np.float64)[:] = state
