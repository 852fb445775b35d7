"""Segments seen in every task space: world and objects, Cartesian and cylindrical, rotations, joints (thesis 3.2).

Coordinates x of the samples in a task space, and how they move:

    position, cartesian     x (N, 3) in axes of the frame [m]
    position, cylindrical   x = (r, r0 theta, z) (N, 3) [m] about the frame's z axis, where r0 is the space's `radius`
    orientation, rotation   x (N, 9) the rows of the rotation matrix R_frame^T R of the tool relative to the frame
    hand, joints            x (N, 4) [rad]

Velocities are those of x, but of an orientation the angular velocity (N, 3) [rad/s] in axes of the frame. A frame may move:
samples are taken relative to where it was at their time.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lfd_gym.demonstration import Demonstration
from policies.decomposition.segmentation import MOTION_WINDOW, Segment, segment, signals, smooth

Array = NDArray[np.float64]

END_TIME = 0.16
"""The end of a segment is its mean over this time, at rest [s]."""
LEVEL_SHARE = 1.0 / 3.0
"""The force of a segment is the median of this last share of it: what was pressed when the movement had arrived."""
FREE, PRESSED = 2.0, 5.0
"""[N]: a force below the former is none, from the latter on only its direction counts."""
DIRECTION = 0.15
"""How much the direction of a force counts, against whether there is one."""
SMALLEST_RADIUS = 0.05
"""[m]: nearer to its axis a cylindrical space says little."""


class TaskSpace(NamedTuple):
    """Where a primitive's goal may be constant."""

    frame: str
    """ "world", or the name of a tracked frame."""
    space: str
    """ "cartesian", "cylindrical", "rotation" or "joints", as in a primitive table."""
    radius: float = 1.0
    """r0 [m] of a cylindrical space, the median distance of all ends from its axis, at least `SMALLEST_RADIUS`; else 1."""


class View(NamedTuple):
    """One segment in one task space."""

    samples: Array
    """(N, d) x, from the segment's first sample to its last; all angles end within one turn, see `widest_gap`."""
    velocities: Array
    """(N, d) or, of an orientation, (N, 3)."""
    force: Array
    """(N, 3) smoothed force of the tool on the world along the coordinates of a position [N]; zeros for other entities."""
    start: Array
    """(d,) first sample."""
    end: Array
    """(d,) mean of the last samples; of a hand the first ones after it moved: what it holds may still give way."""
    force_level: Array
    """(3,) median force of the last part, along the coordinates of a position [N]."""
    log_jacobian: float
    """log |dx / d(Cartesian)| at the end; 0 but for cylindrical spaces."""

    @property
    def way(self) -> Array:
        """(d,) from start to end."""
        return self.end - self.start

    @property
    def length(self) -> float:
        """Distance from start to end; of an orientation the angle [rad]."""
        if len(self.start) == 9:
            trace = float(self.start @ self.end)
            return float(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))
        return float(np.linalg.norm(self.way))


class EntitySegments(NamedTuple):
    """All segments of one entity, and how they look in all of its task spaces."""

    entity: str
    segments: tuple[Segment, ...]
    spaces: tuple[TaskSpace, ...]
    views: tuple[tuple[View, ...], ...]
    """Per segment, per space."""
    dt: float
    """[s]."""

    def of(self, demonstration: int) -> list[int]:
        """Indices of the segments of one demonstration, in order."""
        return [i for i, part in enumerate(self.segments) if part.demonstration == demonstration]


def entity_segments(
    demonstrations: Sequence[Demonstration], entity: str, parts: Sequence[Segment] | None = None
) -> EntitySegments:
    """Segments of "position", "orientation" or "hand", in all task spaces that the tracked frames offer.

    parts: other segments than those of `segment`.
    """
    parts = segment(demonstrations, entity) if parts is None else parts
    tracked = sorted(n.removeprefix("frame_") for n in demonstrations[0].observations if n.startswith("frame_"))
    kinds = {"position": ("cartesian",), "orientation": ("rotation",), "hand": ("joints",)}[entity]
    spaces = [TaskSpace(frame, kind) for frame in ("world", *tracked) for kind in kinds]
    if entity == "hand":
        spaces = spaces[:1]
    if entity == "position":
        spaces += [TaskSpace(frame, "cylindrical") for frame in tracked]
    rows, dt = [], float(demonstrations[0].dt)
    for i, space in enumerate(spaces):
        whole, seam = [coordinates(demonstration, entity, space) for demonstration in demonstrations], 0.0
        if space.space == "cylindrical":
            ends = np.array([whole[part.demonstration][0][part.stop] for part in parts])
            spaces[i] = space._replace(radius=max(float(np.median(np.hypot(*ends[:, :2].T))), SMALLEST_RADIUS))
            seam = widest_gap(np.arctan2(ends[:, 1], ends[:, 0]))
            whole = [_cylindrical(x, force, spaces[i].radius) for x, force in whole]
        rows.append([_view(*whole[part.demonstration], part, spaces[i], seam, dt) for part in parts])
    return EntitySegments(entity, tuple(parts), tuple(spaces), tuple(zip(*rows, strict=True)), dt)


def widest_gap(angles: Array) -> float:
    """The middle of the widest arc without angles (N,), in (-2 pi, 0]: angles counted from there do not part neighbours."""
    there = np.sort(angles % (2.0 * np.pi))
    gaps = np.diff(there, append=there[:1] + 2.0 * np.pi)
    widest = int(np.argmax(gaps))
    return float((there[widest] + 0.5 * gaps[widest]) % (2.0 * np.pi) - 2.0 * np.pi)


def pressing(force: Array) -> Array:
    """Whether and where forces (..., 3) [N] press: (..., 4), how surely, and that share of `DIRECTION` times the direction.

    Nothing below `FREE`, surely above `PRESSED`: how hard a human presses varies by a factor of three, and what a held object
    weighs is no pressing. The direction counts less, for what is meant comes with forces sideways.
    """
    strength = np.linalg.norm(force, axis=-1, keepdims=True)
    surely = np.clip((strength - FREE) / (PRESSED - FREE), 0.0, 1.0)
    return np.concatenate([surely, DIRECTION * surely * force / np.maximum(strength, 1e-12)], axis=-1)


def coordinates(demonstration: Demonstration, entity: str, space: TaskSpace) -> tuple[Array, Array]:
    """x (T + 1, d) and force (T + 1, 3) of a whole demonstration; Cartesian for a position in any space."""
    observed = signals(demonstration, entity)
    if entity == "hand":
        return observed.values, observed.force
    n = len(observed.values)
    poses = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (n, 1))
    if space.frame != "world":
        poses = np.asarray(demonstration.observations[f"frame_{space.frame}"])
    to_frame = Rotation.from_quat(poses[:, 3:], scalar_first=True).inv()
    if entity == "orientation":
        relative = to_frame * Rotation.from_quat(observed.values, scalar_first=True)
        return relative.as_matrix().reshape(n, 9), observed.force
    return to_frame.apply(observed.values - poses[:, :3]), to_frame.apply(observed.force)


def _cylindrical(x: Array, force: Array, radius: float) -> tuple[Array, Array]:
    angle = np.unwrap(np.arctan2(x[:, 1], x[:, 0]))
    c, s = np.cos(angle), np.sin(angle)
    along = np.stack([c * force[:, 0] + s * force[:, 1], c * force[:, 1] - s * force[:, 0], force[:, 2]], axis=1)
    return np.stack([np.hypot(x[:, 0], x[:, 1]), radius * angle, x[:, 2]], axis=1), along


def _view(x: Array, force: Array, part: Segment, space: TaskSpace, seam: float, dt: float) -> View:
    at = slice(part.start, part.stop + 1)
    samples, pressed, log_jacobian = x[at].copy(), force[at], 0.0
    if space.space == "cylindrical":
        turns = np.floor((samples[-1, 1] / space.radius - seam) / (2.0 * np.pi))
        samples[:, 1] -= turns * 2.0 * np.pi * space.radius
        log_jacobian = float(np.log(space.radius / max(samples[-1, 0], 1e-3)))
    if space.space == "rotation":
        velocities = _angular_velocity(samples, dt)
    else:
        velocities = np.gradient(samples, dt, axis=0) if len(samples) > 1 else np.zeros_like(samples)
    n_end = end_samples(dt)
    end = samples[-n_end:].mean(axis=0)
    if space.space == "joints" and part.moves:
        end = samples[part.rest - part.start :][:n_end].mean(axis=0)
    if space.space == "rotation":
        end = nearest_rotation(end.reshape(3, 3)).ravel()
    last = pressed[-max(round(LEVEL_SHARE * len(pressed)), 1) :]
    return View(samples, velocities, pressed, samples[0], end, np.median(last, axis=0), log_jacobian)


def end_samples(dt: float) -> int:
    """Over how many samples of a time step [s] the end of a segment is averaged."""
    return max(round(END_TIME / dt), 1)


def nearest_rotation(matrix: Array) -> Array:
    """The rotation (3, 3) nearest to a matrix (Higham 1989, with the determinant kept at 1)."""
    u, _, vt = np.linalg.svd(matrix)
    result: Array = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return result


def _angular_velocity(samples: Array, dt: float) -> Array:
    """Angular velocity (N, 3) [rad/s] of rotations (N, 9), axes of the frame."""
    if len(samples) < 2:
        return np.zeros((len(samples), 3))
    turned = Rotation.from_matrix(samples.reshape(-1, 3, 3))
    steps = (turned[1:] * turned[:-1].inv()).as_rotvec() / dt
    return smooth(np.vstack([steps, steps[-1:]]), MOTION_WINDOW / dt)
