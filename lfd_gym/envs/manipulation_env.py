"""The base of all tasks: one robot, one controller, one clock; a task adds objects, a predicate and its rewards."""

import copy
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, cast

import gymnasium
import mujoco
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Dict
from gymnasium.utils import EzPickle
from numpy.typing import ArrayLike, NDArray

from lfd_gym import random_state, wam
from lfd_gym.action import ActionLayout
from lfd_gym.envs import arguments, measured, setups
from lfd_gym.envs.arguments import PHYSICS_HZ
from lfd_gym.errors import InvalidArgumentError, UnknownNameError
from lfd_gym.perturbation import SLIPPERY, Perturbation, Schedule
from lfd_gym.robot import Robot

Array = NDArray[np.float64]

HOLD_TIME = 1.0
"""Success must hold this long [s]."""
TIPS_FIRST = 2
"""Contact priority with which the fingertips' friction counts, whatever they touch."""
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


class ManipulationEnv(gymnasium.Env[dict[str, Array], NDArray[np.float32]], EzPickle):
    """A WAM with a tool over a table; subclasses declare the task.

    **Action**: `Box(-1, 1)`, the effective attractor goal, see `lfd_gym.action`.

    **Observation**: a flat dictionary of bounded arrays in SI units; quaternions are (w, x, y, z).

    | key | size | meaning |
    |---|---|---|
    | `joint_position`, `joint_velocity` | 7 | of the arm |
    | `tool_position`, `tool_quaternion` | 3, 4 | pose of the tool point, world (quaternion in the half space of "down") |
    | `tool_velocity` | 6 | linear, angular, world axes |
    | `reference_position`, `_quaternion`, `_velocity` | 3, 4, 6 | of the attractor inside the controller |
    | `wrench` | 6 | force, torque that the world exerts on the tool, world axes, about the sensor, mean over the step |
    | `hand_position`, `hand_torque` | 4 | spread and three fingers (absent with a pen) |
    | `frame_<name>` | 7 | position and quaternion (w >= 0) of a tracked object |

    **Reward**: 1 while the success has held for a second; before that `sparse` is 0, `dense` 0.95 times the task's progress.

    **Info** (the same keys in `reset` and `step`): `is_success`, `success` (alias), `broken`,
    `subtask/<name>`, and the task's own `measures`.

    Args:
        reward_type: "sparse" or "dense".
        control_hz: decisions per second; divides the physics rate of 500 Hz.
        terminate_on_success: end the episode when success has held for a second.
        fingertip_friction: sliding friction between the fingertips and all that they touch, at most 1.2; their torsional
            friction then counts as well. None: 1.0, or the object's own friction where it varies in a grasp (BoxStacking,
            CylinderGrasp).
        perturbation: strengths of what goes wrong, names and units as in `lfd_gym.perturbation.Perturbation`.
        render_mode: None, "rgb_array" or "human".
        width, height: of rendered frames [px].
        camera: name of a camera of the scene.

    A copied or pickled environment is a new one with the same arguments; `get_state` and `set_state` carry over the rest. A
    subclass with a constructor of its own tells its arguments: `EzPickle.__init__(self, ...)` after `super().__init__(...)`.

    Raises:
        InvalidArgumentError: an argument lies outside what is possible.
    """

    metadata = {"render_modes": list(arguments.RENDER_MODES), "render_fps": 50}  # noqa: RUF012 - Gymnasium's convention

    scene: ClassVar[str]
    """File of the scene in `assets/`."""
    tool: ClassVar[str] = "hand"
    tool_offset: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 0.0)
    """Displacement of the tool point in the tool's axes [m]."""
    frames: ClassVar[tuple[str, ...]]
    """Bodies whose poses are tracked, each observed as `frame_<name>`."""
    features: ClassVar[Mapping[str, tuple[ArrayLike, ArrayLike]]] = {}
    """Further observations of the task, which `derive` fills in: {key: (lowest, highest values)}."""
    pushable: ClassVar[str | None] = None
    """Body that the perturbation `push_object` pushes."""
    subtasks: ClassVar[tuple[str, ...]]
    """How far the task got, reported as `subtask/<name>`."""
    layout: ClassVar[ActionLayout]
    time_limit: ClassVar[float]
    """Length of an episode [s]."""
    stiffness: ClassVar[float] = 900.0
    """Of the PID that tracks the reference [1/s^2]."""
    watch: Callable[[], None] | None = None
    """Called after every physics step, where a task must see each of them."""
    controls: ClassVar[tuple[str, ...]] = ("x", "y", "z", "yaw", "grip")
    """Dimensions that the task needs, for the RL view (`lfd_gym.wrappers.RLView`)."""
    hand_open: ClassVar[tuple[float, ...]] = (0.0, 0.0, 0.0, 0.0)
    hand_closed: ClassVar[tuple[float, ...]] = (0.0, 2.0, 2.0, 2.0)
    """Ends of the RL view's `grip` [rad]."""
    n_hidden: ClassVar[int] = 0
    """Size of the task's own hidden memory, which is part of the state."""

    def __init__(
        self,
        reward_type: str = "sparse",
        control_hz: float = 50.0,
        terminate_on_success: bool = True,
        fingertip_friction: float | None = None,
        perturbation: Mapping[str, float] | None = None,
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        camera: str = "overview",
    ) -> None:
        given = (reward_type, control_hz, terminate_on_success, fingertip_friction, perturbation, render_mode)
        EzPickle.__init__(self, *given, width, height, camera)
        arguments.check(reward_type, control_hz, terminate_on_success, fingertip_friction, render_mode, (width, height))
        self.reward_type, self.terminate_on_success = reward_type, terminate_on_success
        self.render_mode, self._size, self._camera = render_mode, (height, width), camera
        self.action_layout = self.layout
        self.physics_dt, self.dt = 1.0 / PHYSICS_HZ, 1.0 / float(control_hz)
        self._n_substeps = int(PHYSICS_HZ // control_hz)
        self.metadata = {**self.metadata, "render_fps": round(control_hz)}

        self.perturbation = Perturbation.of(perturbation)
        self._schedule = Schedule(self.perturbation, len(self.frames))
        self._schedule.check(self.dt)
        spec = wam.scene_spec(self.scene, self.tool, self.tool_offset)
        self.model = spec.compile()
        cameras = [self.model.camera(i).name for i in range(self.model.ncam)]
        if camera not in cameras:
            raise UnknownNameError("camera", camera, cameras)
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.data = mujoco.MjData(self.model)
        self._tips = [i for i in range(self.model.ngeom) if self.model.geom(i).name.endswith("_tip")]
        if fingertip_friction is not None:
            self._set_tips(fingertip_friction, TIPS_FIRST)
        self._tip_contact = self.model.geom_friction[self._tips, 0], self.model.geom_priority[self._tips]
        self._slippery = np.minimum(self._tip_contact[0], SLIPPERY), TIPS_FIRST
        self._pushed = None if self.pushable is None else self.data.body(self.pushable).id
        self.robot = Robot(self.model, self.data, self.tool, self.layout, self.frames, self.stiffness)
        self._randomised: list[Array] = []
        """Views of the model fields that a reset may change; they are part of the state."""
        self._hidden = np.zeros(self.n_hidden)
        self._broken = self._ready = False
        self._subtask_keys = tuple(f"subtask/{name}" for name in self.subtasks)
        self._held = -self.dt
        """Since when the predicate holds [s]; one step below zero while it does not."""
        self._setup: dict[str, Any] = {}
        self._build_spaces()
        self.build()
        self._nominal = [view.copy() for view in self._randomised]
        self._renderer: Any = None

    # what a task provides

    def build(self) -> None:
        """Look up what the task needs once and register the model fields that it varies with `vary`."""

    def sample_setup(self, rng: np.random.Generator) -> dict[str, Any]:
        """Where the objects stand: {object: {"position": [x, y], "yaw": angle}}."""
        raise NotImplementedError

    def check_setup(self, setup: Mapping[str, Any]) -> None:
        """Raise InvalidSetupError for a setup that cannot be."""
        raise NotImplementedError

    def place(self, setup: Mapping[str, Any]) -> None:
        """Put the objects into the simulation."""
        raise NotImplementedError

    def randomise(self, rng: np.random.Generator) -> None:
        """Draw what varies and is hidden; the fields have their nominal values before."""

    def after_physics(self) -> None:
        """What the world does between two control steps (a thread that ends), and what the predicates need of it."""

    def derive(self, observation: dict[str, Array]) -> None:
        """Write in place what follows from the other measurements: the `features`, the pose of a symmetric object."""

    def succeeded(self) -> bool:
        """The predicate: does the simulation's truth show the task done at this moment."""
        raise NotImplementedError

    def progress(self) -> float:
        """Dense reward in [0, 1]."""
        raise NotImplementedError

    def measures(self) -> dict[str, float]:
        """Further entries of the info, always under the same names: how well the task is done, in SI units."""
        return {}

    def subtask_flags(self) -> tuple[bool, ...]:
        """One flag for each name of `subtasks`."""
        raise NotImplementedError

    @staticmethod
    def press_direction(observation: Mapping[str, Array]) -> Array:
        """World direction (3,) of the RL view's `press`, from what is observed; upwards by default."""
        return np.array([0.0, 0.0, 1.0])

    # Gymnasium

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Begin an episode on a random setup, or on `options={"setup": {object: {"position": [x, y], "yaw": a}}}`.

        Objects that the setup does not name are drawn at random around those that it does.

        Raises:
            InvalidSetupError: an object is unknown, out of reach, or overlaps another; the episode before goes on.
        """
        if not isinstance(options, Mapping | None) or set(options or ()) - {"setup"}:
            raise InvalidArgumentError(f"reset options {options!r}; possible: {{'setup': {{object: {{...}}}}}}")
        before = copy.deepcopy(self._np_random), self._np_random_seed
        super().reset(seed=seed)
        wanted, rng = (options or {}).get("setup"), self.np_random
        try:
            self._setup = setups.complete(wanted, lambda: self.sample_setup(rng), self.check_setup)
        except BaseException:
            self._np_random, self._np_random_seed = before
            raise
        mujoco.mj_resetData(self.model, self.data)
        self._restore_nominal()
        self._hidden[:] = 0.0
        self.randomise(rng)
        self._schedule.draw(rng)
        if self._randomised:
            mujoco.mj_setConst(self.model, self.data)
            mujoco.mj_resetData(self.model, self.data)
        self.place(self._setup)
        if self._schedule.acts:
            self._perturb(-self.dt)
        self.robot.reset()
        if self._schedule.misreads:
            self.robot.sensor_error[:] = self._schedule.misreading(rng)
        self._held = -self.dt
        self.after_physics()
        observation = self._observe()
        self._ready = True
        if self.render_mode == "human":
            self.render()
        return observation, self._info(self.succeeded())

    def step(self, action: ArrayLike) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """Command a goal for one control step. Raises InvalidActionError (NaN, a wrong shape), ResetNeeded before a reset."""
        if not self._ready:
            raise ResetNeeded("an environment, and a copy of one, needs a reset or set_state before its first step")
        self.robot.command(action)
        if self._schedule.acts:
            self._perturb(self.data.time)
        if self._schedule.misreads:
            self.robot.sensor_error[:] = self._schedule.misreading(self.np_random)
        model, data, tick, watch = self.model, self.data, self.robot.tick, self.watch
        for _ in range(self._n_substeps):
            tick()
            mujoco.mj_step2(model, data)
            mujoco.mj_step1(model, data)
            if watch is not None:
                watch()
        self.after_physics()
        observation = self._observe()
        holds = self.succeeded()
        self._held = self._held + self.dt if holds else -self.dt
        info = self._info(holds)
        terminated = info["broken"] or (self.terminate_on_success and info["is_success"])
        reward = self._reward(info["is_success"])
        if self.render_mode == "human":
            self.render()
        return observation, reward, terminated, bool(data.time >= self.time_limit - 1e-9), info

    def reward(self) -> float:
        """What the last step into the present state pays; the same after `set_state`."""
        return self._reward(self._info(self.succeeded())["is_success"])

    def render(self) -> NDArray[np.uint8] | None:
        """An image (height, width, 3) in mode "rgb_array"; a viewer window in mode "human"."""
        if self.render_mode is None:
            raise InvalidArgumentError(
                "nothing to render: make the environment with render_mode='rgb_array' or 'human'"
            )
        if self._renderer is None:
            from lfd_gym import rendering

            self._renderer = rendering.renderer(self.model, self.data, self.render_mode, self._size, self._camera)
        return self._renderer.frame(self.decorate)

    def decorate(self, scene: mujoco.MjvScene) -> None:
        """Add to a rendered scene what is not physical (ink); nothing by default."""

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def set_guidance(self, guidance: ArrayLike | None) -> None:
        """Let an outside hand guide the arm, as in kinesthetic teaching; None gives the arm back to the controller.

        While it is guided the arm is gravity compensated and ignores the goals of pose and force; the fingers still follow
        the action. The guidance acts on the link above the wrist sensor, which therefore does not feel it (thesis 3.1.2).

        Args:
            guidance: a wrench about the tool point (force, torque), world axes, shape (6,); or, for a hand that holds the
                tool with a human's impedance (`lfd_gym.guidance.Impedance`), its position, quaternion, twist, and a force
                that it exerts beside, shape (16,). A wrist this light cannot be held by a wrench that is constant over a
                control step. Stays until the next call or reset.
        """
        self.robot.guide(guidance)

    # state

    def __getstate__(self) -> dict[str, Any]:
        """What a copy or a pickle is made of: the arguments, and how Gymnasium made it."""
        return {**EzPickle.__getstate__(self), "spec": self.spec}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make a new environment of them."""
        EzPickle.__setstate__(self, state)
        self.spec = state["spec"]

    def setup(self) -> dict[str, Any]:
        """Where the objects stood at the last reset, in the form that `options={"setup": ...}` takes."""
        return {name: dict(pose) for name, pose in self._setup.items()}

    def get_state(self) -> Array:
        """Everything that the future depends on, as one flat float64 array of constant size.

        Simulation (`mjSTATE_INTEGRATION`), sensors, controller, varied model fields, timers, perturbations, random
        generator.
        """
        physics = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self.data, physics, _STATE)
        varied = [view.ravel() for view in self._randomised]
        return np.concatenate(
            [
                physics,
                self.data.sensordata,
                self.robot.get_state(),
                *varied,
                self._hidden,
                [self._held],
                self._schedule.state,
                random_state.pack(self.np_random),
            ]
        )

    def set_state(self, state: ArrayLike) -> None:
        """Restore what `get_state` returned, also in a fresh process. Raises InvalidArgumentError for what it never returns."""
        array = np.asarray(state, dtype=np.float64)
        expected = self.get_state().shape
        if array.shape != expected:
            raise InvalidArgumentError(f"state of shape {array.shape}; expected {expected}")
        sizes = [mujoco.mj_stateSize(self.model, _STATE), self.model.nsensordata, self.robot.state_size]
        sizes += [view.size for view in self._randomised] + [self.n_hidden, 1, self._schedule.state.size]
        physics, sensors, robot, *varied, hidden, held, schedule, rng = np.split(array, np.cumsum(sizes))
        random_state.unpack(self.np_random, rng)
        for view, values in zip(self._randomised, varied, strict=True):
            view[...] = values.reshape(view.shape)
        if self._randomised:
            mujoco.mj_setConst(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, physics, _STATE)
        self._schedule.state[:] = schedule
        self._push(0.0, 0.0)
        if self._schedule.acts:
            self._perturb(self.data.time - self.dt)
        mujoco.mj_step1(self.model, self.data)
        self.data.sensordata[:] = sensors
        self.robot.set_state(robot)
        self._hidden[:], self._held = hidden, float(held[0])
        self._broken = not np.isfinite(physics).all()
        self.after_physics()
        self._ready = True

    # inside

    def vary(self, *fields: Array) -> None:
        """Register views of model fields that `randomise` changes."""
        self._randomised += fields

    def between(self, rng: np.random.Generator, low: float, high: float, size: int | None = None) -> Any:
        """What varies: uniform in a range that a perturbation may have widened about its middle; stays positive."""
        middle, half = 0.5 * (low + high), 0.5 * (high - low) * self.perturbation.variation
        return rng.uniform(max(middle - half, 0.1 * low), middle + half, size)

    def _restore_nominal(self) -> None:
        for view, values in zip(self._randomised, self._nominal, strict=True):
            view[...] = values

    def _build_spaces(self) -> None:
        bounds = measured.bounds(self.model.jnt_range, self.tool, self.frames, self.features)
        self._low = np.concatenate([low for low, _ in bounds.values()])
        self._high = np.concatenate([high for _, high in bounds.values()])
        ends = np.cumsum([low.size for low, _ in bounds.values()])
        self._slices = {
            key: slice(int(end) - low.size, int(end)) for (key, (low, _)), end in zip(bounds.items(), ends, strict=True)
        }
        boxes: dict[str, gymnasium.Space[Any]] = {
            key: Box(low, high, dtype=np.float64) for key, (low, high) in bounds.items()
        }
        first = self._slices[f"frame_{self.frames[0]}"].start
        self._tracked = slice(first, first + 7 * len(self.frames))
        self.observation_space = cast("gymnasium.Space[dict[str, Array]]", Dict(boxes))
        self.action_space = Box(-1.0, 1.0, (self.layout.size,), np.float32)

    def _observe(self) -> dict[str, Array]:
        flat = np.zeros(self._low.size)
        self._broken = not self.robot.observe(flat)
        if self._schedule.misplaces:
            self._schedule.misplace(flat[self._tracked])
        observation = {key: flat[where] for key, where in self._slices.items()}
        self.derive(observation)
        if self._broken:
            np.nan_to_num(flat, copy=False)
        np.maximum(flat, self._low, out=flat)
        np.minimum(flat, self._high, out=flat)
        return observation

    def _perturb(self, time: float) -> None:
        """Push the arm and an object, make the fingertips slippery, as scheduled for a control step that begins then [s]."""
        schedule = self._schedule
        self._push(*schedule.pushes(time))
        self._set_tips(*(self._slippery if schedule.slips(time) else self._tip_contact))

    def _push(self, arm: ArrayLike, thing: ArrayLike) -> None:
        """Forces (3,) on the arm and on the object that may be pushed, world frame [N]."""
        self.robot.push(arm)
        if self._pushed is not None:
            self.data.xfrc_applied[self._pushed, :3] = thing

    def _set_tips(self, friction: ArrayLike, priority: ArrayLike) -> None:
        """Friction of the fingertips; it acts where nothing that they touch has a higher priority or, with equal, more."""
        self.model.geom_friction[self._tips, 0] = friction
        self.model.geom_priority[self._tips] = priority

    def _reward(self, success: bool) -> float:
        if success or self.reward_type == "sparse" or self._broken:
            return float(success)
        return 0.95 * self.progress()

    def _info(self, holds: bool) -> dict[str, Any]:
        success = bool(holds) and not self._broken and self._held >= HOLD_TIME - 1e-9
        info: dict[str, Any] = {"is_success": success, "success": success, "broken": self._broken}
        info.update(zip(self._subtask_keys, map(bool, self.subtask_flags()), strict=True))
        info.update(self.measures())
        return info
