"""The robot in one simulation: what it is told, what it measures, and its controller at the physics rate."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lfd_gym import controller, quaternion, records, sensing, servo, wam
from lfd_gym.action import ActionLayout
from lfd_gym.compiled import bound
from lfd_gym.errors import InvalidArgumentError
from lfd_gym.guidance import Impedance

Array = NDArray[np.float64]


RESET_RATE = 4.0
"""Gain of the PID's integral over its stiffness [1/s]: a constant disturbance is forgotten in a quarter of a second."""
INTEGRAL_LIMIT = (4.0, 40.0)
"""Most that the integral adds, linear [m/s^2] and angular [rad/s^2]; it bounds what is stored while the tool is blocked."""
LEAD_LIMIT = (0.03, 0.3)
"""How far the reference may run ahead of a blocked tool, linear [m] and angular [rad]."""
FORCE_INTEGRAL, FORCE_DAMPING = 20.0, 20.0
"""Along a regulated force [1/s]: gain of its integral, and damping of the motion, so that what comes loose moves slowly."""
FORCE_CUTOFF = 20.0
"""Low pass of the measured force [Hz]; what slides sticks and slips, and is felt in every tick."""
JOINT_BRAKE = 20.0
"""A joint may be as fast as this times its way to the limit [1/s]."""
FRICTION_COMPENSATION = 0.7
"""Fraction of the joints' Coulomb friction that the controller feeds forward; all of it would make limit cycles."""
FRICTION_SPEED = 0.05
"""Joint speed over which the compensated friction changes its sign [rad/s]; at once it would chatter."""


class Robot:
    """A WAM with its tool and controller.

    Args:
        model, data: the simulation, the arm first in the tree.
        tool: "hand" or "pen".
        layout: workspace and attractor of the environment.
        frames: names of the tracked bodies.
        stiffness: of the PID that tracks the reference [1/s^2]; its damping is critical.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        tool: str,
        layout: ActionLayout,
        frames: Sequence[str],
        stiffness: float = 900.0,
    ) -> None:
        self.model, self.data, self.layout = model, data, layout
        self._settings = np.zeros(1, records.SETTINGS)
        self._command = np.zeros(1, records.COMMAND)
        self._memory = np.zeros(1, records.MEMORY)
        self._handles = wam.handles(model, data, tool)
        self._write_settings(tool, stiffness)
        self._frames = np.array([model.body(name).id for name in frames], dtype=np.int64)
        self._guided_link, self._pushed_link = model.body("wam_link_7").id, model.body("wam_link_5").id
        self.sensor_error: Array = self._command["sensor_error"][0]
        """Of the wrist sensor (6,), force [N] and torque [N m] in world axes; what is felt and what is observed errs by it."""
        self._site = data.site(f"{tool}/tool")
        self._bind()
        self._memory_fields = {name: self._memory[name][0] for name in ("position", "quaternion", "hand")}
        self.state_size = records.MEMORY.itemsize // 8

    def _write_settings(self, tool: str, stiffness: float) -> None:
        n, s, model = wam.N_JOINTS, self._settings[0], self.model
        for name in ("alpha", "beta", "speed_limit", "turn_limit", "workspace_low", "workspace_high"):
            s[name] = getattr(self.layout, name)
        s["dt"], (s["upper_arm"], s["forearm"]), s["bend"] = model.opt.timestep, wam.REACH, wam.BEND
        s["stiffness"], s["damping"], s["integral"] = stiffness, 2.0 * np.sqrt(stiffness), RESET_RATE * stiffness
        s["integral_limit"], s["lead_limit"] = INTEGRAL_LIMIT, LEAD_LIMIT
        s["force_integral"], s["force_damping"], s["filter"] = FORCE_INTEGRAL, FORCE_DAMPING, 2.0 * np.pi * FORCE_CUTOFF
        s["rest"] = wam.HOME
        s["joint_low"], s["joint_high"] = model.jnt_range[:n].T
        s["joint_speed"], s["joint_brake"] = wam.JOINT_SPEED, JOINT_BRAKE
        s["torque_limit"] = model.actuator_ctrlrange[:n, 1]
        s["joint_damping"] = model.dof_damping[:n]
        s["joint_friction"] = FRICTION_COMPENSATION * model.dof_frictionloss[:n]
        s["friction_speed"] = FRICTION_SPEED
        s["tool_mass"], s["gravity"] = model.body(f"{tool}/{tool}").subtreemass[0], model.opt.gravity
        s["n_hand"] = self._handles.hand.size
        s["hand_speed"], s["hand_stall"] = wam.HAND_SPEED, wam.HAND_STALL
        if s["n_hand"]:
            s["hand_stiffness"] = model.actuator_gainprm[n : n + 4, 0]

    def _bind(self) -> None:
        """Bind the compiled functions to this simulation's arrays, past Numba's type dispatch, which costs as much again."""
        mujoco.mj_forward(self.model, self.data)
        state, layout = (self._settings, self._command, self._memory), self.layout
        data, found = self.data, self._handles
        hand_on_tool = Impedance().holding(self._mobility(), self.model.opt.timestep)
        guided = data.xipos[self._guided_link], data.xfrc_applied[self._guided_link], hand_on_tool
        arrays = (*found.joints, *found.dynamics, *found.tool, found.hand, found.ctrl)
        self.tick = bound(servo.tick, *state, *arrays, *guided, np.zeros((27, 14)), controller.NullSpace())
        """One step of the controller."""
        scales = (layout.workspace_low, layout.workspace_high, layout.rotation_limit, layout.force_limit)
        hand = (layout.hand_low, layout.hand_high)
        self._set_goal = bound(
            servo.set_goal, self._command, *scales, *hand, layout.reference_quaternion, call=(np.zeros(layout.size),)
        )
        n = sensing.size(found.hand.size)
        bodies = (data.xpos, data.xquat, self._frames, layout.reference_quaternion)
        self._measure = bound(
            sensing.observe, *state, *found.joints, *found.tool, found.hand, data.actuator_force, data.qacc,
            *bodies, call=(np.zeros(n + 7 * self._frames.size),),
        )  # fmt: skip

    def _mobility(self) -> Array:
        """How easily the guided link moves along and turns about the tool's axes at home (6,): diagonal of J M^-1 J^T."""
        model, data = self.model, mujoco.MjData(self.model)
        data.qpos[: wam.N_JOINTS] = wam.HOME
        mujoco.mj_forward(model, data)
        jacobian, solved = np.zeros((6, model.nv)), np.zeros((6, model.nv))
        mujoco.mj_jacBodyCom(model, data, jacobian[:3], jacobian[3:], self._guided_link)
        jacobian = np.kron(np.eye(2), data.site_xmat[self._site.id].reshape(3, 3).T) @ jacobian
        mujoco.mj_solveM(model, data, solved, jacobian)
        return np.einsum("ij,ij->i", jacobian, solved)

    def reset(self) -> None:
        """Stand in the home posture, hand open, reference at the tool, nothing commanded."""
        self._memory[:] = 0
        self.data.qpos[: wam.N_JOINTS] = wam.HOME
        mujoco.mj_forward(self.model, self.data)
        hand = self.data.qpos[self._handles.hand]
        m = self._memory_fields
        m["position"][:], m["quaternion"][:] = self._site.xpos, self.tool_quaternion()
        m["hand"][: hand.size] = hand
        c = self._command[0]
        c["position"], c["quaternion"], c["force"] = m["position"], m["quaternion"], 0.0
        c["hand"] = m["hand"]
        self.tick()
        mujoco.mj_forward(self.model, self.data)
        self._memory["wrench_sum"], self._memory["ticks"], self._memory["pressed"] = 0.0, 0.0, 0.0

    def command(self, action: ArrayLike) -> None:
        """Set the goal that the next ticks are attracted to. Raises InvalidActionError."""
        array = np.ascontiguousarray(action, dtype=np.float64)
        if array.shape != (self.layout.size,) or not self._set_goal(array):
            self.layout.decode(array)

    def guide(self, guidance: ArrayLike | None) -> None:
        """Let an outside hand guide the tool; None lets go. Raises InvalidArgumentError.

        Args:
            guidance: a wrench about the tool point (6,), or where the hand holds the tool (position, quaternion), its twist,
                and a force that it exerts beside (16,); world axes.
        """
        memory, values = self._memory, np.asarray(np.zeros(6) if guidance is None else guidance, dtype=np.float64)
        if values.shape not in ((6,), (16,)) or not np.isfinite(values).all():
            raise InvalidArgumentError(f"guidance of shape {values.shape}; expected 6 or 16 finite numbers")
        memory["guided"] = guidance is not None
        self.data.xfrc_applied[self._guided_link] = 0.0
        if guidance is None:
            return
        memory["guide_holds"], memory["guide_torque"] = values.size == 16, 0.0
        if values.size == 6:
            memory["guide_force"], memory["guide_torque"] = values[:3], values[3:]
            return
        for name, part in zip(
            ("position", "quaternion", "velocity", "force"), np.split(values, (3, 7, 13)), strict=True
        ):
            memory[f"guide_{name}"] = part

    def push(self, force: ArrayLike) -> None:
        """A force (3,) of the world on the wrist, world frame [N]."""
        self.data.xfrc_applied[self._pushed_link, :3] = force

    def tool_quaternion(self) -> Array:
        """Orientation of the tool, world frame, in the half space of the layout's reference."""
        q = quaternion.from_matrix(self._site.xmat.reshape(3, 3))
        return q if q @ self.layout.reference_quaternion >= 0.0 else -q

    def observe(self, flat: Array) -> bool:
        """Write all measurements and frames into `flat`; False where the simulation is not finite."""
        return self._measure(flat)

    def get_state(self) -> Array:
        """The controller's memory as floats."""
        return self._memory.view(np.float64).copy()

    def set_state(self, state: Array) -> None:
        """Restore what `get_state` returned."""
        self._memory.view(np.float64)[:] = state
