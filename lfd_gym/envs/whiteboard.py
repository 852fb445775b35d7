"""Write a word on each of two whiteboards (thesis 4.4.2)."""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
from dm_control.utils.rewards import tolerance
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from lfd_gym import alphabet, ink, quaternion, wam
from lfd_gym.compiled import bound
from lfd_gym.envs import setups
from lfd_gym.envs.manipulation_env import ManipulationEnv

Array = NDArray[np.float64]

AREA_LOW = {"board_1": np.array([0.545, 0.13]), "board_2": np.array([0.545, -0.33])}
AREA_HIGH = {"board_1": np.array([0.695, 0.33]), "board_2": np.array([0.695, -0.13])}
"""Where the boards may stand, x and y of their middles [m]."""
MAX_YAW = math.radians(30.0)
"""Of a board [rad]."""
TILT_LOW, TILT_HIGH = math.radians(35.0), math.radians(50.0)
"""Of a board from the horizontal [rad]."""
FACING_ROBOT = np.array([math.sqrt(0.5), 0.0, 0.0, -math.sqrt(0.5)])
"""Quaternion of a flat board that is written from left to right as the robot sees it: x to its right."""
FOOT = 0.010
"""Of the lower edge's middle over the table [m]."""
INK_FORCE = 0.5
"""A softer touch leaves no ink [N]."""
TIP_RADIUS = 0.004
"""Of the pen [m]."""
ENOUGH = 0.9
"""Share of all wanted strokes that must be inked, and of the ink that must lie on them."""
LEAST = 0.5
"""Share of every stroke of the pen that must be inked, however short it is: a letter without its bar is another letter. What
is less than half a stroke, or a tenth of the ink, does not tell letters apart: P passes for R in a word, and T for I."""
LIFTED = 0.10
"""The pen has withdrawn from the boards [m]."""


class WhiteboardEnv(ManipulationEnv):
    """Write a word on each of two whiteboards with a pen on the wrist (thesis 4.4.2, Figures 4.1 and 4.5).

    | what | |
    |---|---|
    | frames | `board_1`, `board_2`: middle of the surface, x along the writing, y up the slope, z out of the board |
    | start | each board in 15 x 20 cm, yaw +- 30 degrees, tilt 35-50 degrees |
    | varies, hidden | friction of the pen's tip 0.1-0.3 |
    | success | at least 90 % of the wanted strokes inked, half of each; 90 % of the ink on them; pen withdrawn |
    | subtasks | `word_1`, `word_2` (the same on that board), `lifted` (10 cm off both boards, once there is good ink) |
    | measures | `coverage`, `precision`: of the strokes and of the ink what is within 4 mm of the other, see `lfd_gym.ink` |
    | dense reward | reach 0.1, coverage times precision 0.75, lift 0.1 |
    | time limit | 60 s |

    A tip that presses on a board with at least 0.5 N leaves ink, wanted or not, at every physics step. Letters are 6 cm high
    (`lfd_gym.alphabet`), smaller in words of more than four letters. The tool point is the centre of the pen's round tip, 4 mm
    off the board while it writes. Workspace: x 0.40-0.80, y -0.47-0.47, z 0.0-0.40 m; tilt 0.3 rad, yaw 0.6 rad;
    alpha 40, beta 10 1/s. Arguments other than `words`: see `ManipulationEnv`; there are no fingertips to be slippery and no
    object to be pushed.

    Args:
        words: one word for each board, 1 to 6 capital letters each.

    Raises:
        InvalidArgumentError: other words.

    Version history: v0, first version.
    """

    scene = "whiteboard.xml"
    tool = "pen"
    frames = ("board_1", "board_2")
    subtasks = ("word_1", "word_2", "lifted")
    time_limit = 60.0
    stiffness = 1600.0
    controls = ("x", "y", "z", "press")
    n_hidden = 2 * ink.WORDS
    layout = wam.action_layout(
        (0.40, -0.47, 0.0),
        (0.80, 0.47, 0.40),
        rotation_limit=(0.3, 0.3, 0.6),
        force_limit=10.0,
        hand_low=(),
        hand_high=(),
        alpha=40.0,
        beta=10.0,
    )

    def __init__(self, words: Sequence[str] = ("IAS", "HRI"), **kwargs: Any) -> None:
        self._strokes = alphabet.two_words(words)
        self.words = tuple(words)
        super().__init__(**kwargs)
        EzPickle.__init__(self, self.words, **kwargs)

    @classmethod
    def press_direction(cls, observation: Mapping[str, Array]) -> Array:
        """Into the board whose middle is nearest."""
        boards = [observation[f"frame_{name}"] for name in cls.frames]
        nearest = min(boards, key=lambda pose: math.dist(pose[:3], observation["tool_position"]))
        return -quaternion.to_matrix(nearest[3:])[:, 2]

    def build(self) -> None:
        """Find tip and boards; lay out the ink."""
        model, data = self.model, self.data
        self._friction = model.geom_friction[model.geom("pen/pen_point").id, 0:1]
        self.vary(self._friction)
        memories = self._hidden.reshape(len(self.frames), ink.WORDS)
        self.boards = [ink.Ink(strokes, memory) for strokes, memory in zip(self._strokes, memories, strict=True)]
        first = model.body(self.frames[0]).id
        self._origins, self._axes = data.xpos[first : first + 2], data.xmat[first : first + 2]
        self._tip = data.site("pen/tool").xpos
        pressed = data.sensor("pen/touch").data
        arguments = (memories, pressed, INK_FORCE, self._tip, 1.5 * TIP_RADIUS, self._origins, self._axes)
        self.watch = bound(ink.draw, *arguments)
        self._clearance = bound(ink.clearance, self._tip, self._origins, self._axes)

    def sample_setup(self, rng: np.random.Generator) -> dict[str, Any]:
        """Uniform, each in its own area."""
        return {
            name: {
                "position": rng.uniform(AREA_LOW[name], AREA_HIGH[name]).tolist(),
                "yaw": float(rng.uniform(-MAX_YAW, MAX_YAW)),
                "tilt": float(rng.uniform(TILT_LOW, TILT_HIGH)),
            }
            for name in self.frames
        }

    def check_setup(self, setup: Mapping[str, Any]) -> None:
        """Each in its area."""
        for name in self.frames:
            setups.within(name, setup[name]["position"], AREA_LOW[name], AREA_HIGH[name])
            setups.in_range(f"yaw of '{name}'", setup[name]["yaw"], -MAX_YAW, MAX_YAW)
            setups.in_range(f"tilt of '{name}'", setup[name]["tilt"], TILT_LOW, TILT_HIGH)

    def place(self, setup: Mapping[str, Any]) -> None:
        """The boards stand on their lower edges."""
        for i, name in enumerate(self.frames):
            tilt = setup[name]["tilt"]
            self.data.mocap_pos[i, :2] = setup[name]["position"]
            self.data.mocap_pos[i, 2] = FOOT + ink.HALF_SIZE[1] * math.sin(tilt)
            flat = quaternion.multiply(setups.upright(setup[name]["yaw"]), FACING_ROBOT)
            slope = quaternion.from_rotation_vector(np.array([tilt, 0.0, 0.0]))
            self.data.mocap_quat[i] = quaternion.multiply(flat, slope)

    def randomise(self, rng: np.random.Generator) -> None:
        """Friction of the tip."""
        self._friction[0] = self.between(rng, 0.1, 0.3)

    def after_physics(self) -> None:
        """Read what is written, and see whether the pen is off."""
        self._tallies = [board.tally() for board in self.boards]
        self._total = self._tallies[0] + self._tallies[1]
        self._lifted = self._clearance() > LIFTED + TIP_RADIUS

    def succeeded(self) -> bool:
        """Both words stand there, no stroke missing and little ink beside them, and the pen is withdrawn."""
        return _enough(self._total) and self._lifted

    def subtask_flags(self) -> tuple[bool, ...]:
        """First word, second word, withdrawn from what was written."""
        return _enough(self._tallies[0]), _enough(self._tallies[1]), self._lifted and self._total.coverage > 0.0

    def measures(self) -> dict[str, float]:
        """Coverage and precision."""
        return {"coverage": self._total.coverage, "precision": self._total.precision}

    def progress(self) -> float:
        """Reach, write, lift. Of a finished word the reach is kept."""
        unfinished = [i for i, tally in enumerate(self._tallies) if not _enough(tally)]
        if not unfinished:
            return 0.85 + 0.1 * self._lifted
        near = tolerance(math.dist(self._tip, self._origins[unfinished[0]]), (0.0, 0.08), margin=0.3)
        reach = (len(self._tallies) - len(unfinished) + near) / len(self._tallies)
        return float(0.1 * reach + 0.75 * self._total.coverage * self._total.precision)

    def decorate(self, scene: mujoco.MjvScene) -> None:
        """Draw the wanted strokes, pale, and the ink."""
        for i, board in enumerate(self.boards):
            axes, origin = self._axes[i].reshape(3, 3), self._origins[i]
            for stroke in self._strokes[i]:
                corners = origin + np.pad(stroke, ((0, 0), (0, 1)), constant_values=0.0002) @ axes.T
                for a, b in pairwise(corners):
                    geom = _new_geom(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, origin, axes, PALE)
                    if geom is not None:
                        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.0008, a, b)
            for point in board.points():
                place = origin + axes @ np.array([*point, 0.0008])
                _new_geom(scene, mujoco.mjtGeom.mjGEOM_CYLINDER, place, axes, INKED)


PALE, INKED = np.array([0.70, 0.75, 0.82, 1.0], np.float32), np.array([0.05, 0.12, 0.45, 1.0], np.float32)


def _enough(tally: ink.Tally) -> bool:
    return tally.coverage >= ENOUGH and tally.precision >= ENOUGH and tally.faintest >= LEAST


def _new_geom(
    scene: mujoco.MjvScene, kind: mujoco.mjtGeom, place: Array, axes: Array, rgba: NDArray[np.float32]
) -> mujoco.MjvGeom | None:
    """A flat disc of the size of a cell at the end of a scene; None where the scene is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(geom, kind, np.array([ink.CELL, ink.CELL, 0.0003]), place, axes.ravel(), rgba)
    scene.ngeom += 1
    return geom
