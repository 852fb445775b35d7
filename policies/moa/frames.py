"""Coordinate frames in which attractors stand, at rest or moving, in any dimension (thesis 4.2.3)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from lfd_gym.errors import InvalidArgumentError

Array = NDArray[np.float64]

AT_REST = 1e-9
"""Frames that move less than this, in units of their origins and entries of their axes, stand still."""
ORTHOGONAL = 1e-6
"""Products of the axes of a frame differ by less than this from those of an orthogonal matrix."""


@dataclass(frozen=True)
class Frames:
    """F coordinate frames of a d-dimensional space, at one instant or at N time steps.

    `axes` are orthogonal matrices that map local to world vectors. A space that stacks several entities, such as a point and
    the columns of a rotation matrix, has block-diagonal axes.

    Raises:
        InvalidArgumentError: shapes that do not belong together, no frame, values that are not finite, or frames at rest whose
            axes are not orthogonal.
    """

    origins: Array
    """(F, d) or (N, F, d): origin of each frame in world coordinates, units of the trajectory."""
    axes: Array
    """(F, d, d) or (N, F, d, d): columns are the frame's axes in world coordinates."""

    def __post_init__(self) -> None:
        origins, axes = np.array(self.origins, dtype=np.float64), np.array(self.axes, dtype=np.float64)
        if origins.ndim not in (2, 3) or axes.shape != (*origins.shape, origins.shape[-1]) or not origins.size:
            raise InvalidArgumentError(
                f"frames have origins {origins.shape} and axes {axes.shape}; needed: (F, d) with (F, d, d), "
                "or one more leading axis for N time steps"
            )
        if not (np.isfinite(origins).all() and np.isfinite(axes).all()):
            raise InvalidArgumentError("the pose of a frame is not finite")
        if origins.ndim == 3 and np.ptp(origins, axis=0).max() < AT_REST and np.ptp(axes, axis=0).max() < AT_REST:
            origins, axes = origins[0], axes[0]
        if origins.ndim == 2 and np.abs(axes @ axes.swapaxes(1, 2) - np.eye(origins.shape[1])).max() > ORTHOGONAL:
            raise InvalidArgumentError("the axes of a frame are not orthogonal, or not of length one")
        origins.setflags(write=False)
        axes.setflags(write=False)
        object.__setattr__(self, "origins", origins)
        object.__setattr__(self, "axes", axes)

    @classmethod
    def world(cls, n_dimensions: int) -> Self:
        """The world frame alone."""
        return cls(np.zeros((1, n_dimensions)), np.eye(n_dimensions)[None])

    @classmethod
    def at(cls, points: ArrayLike) -> Self:
        """Frames with the world's axes at points (F, d), such as start and end of a movement (thesis 4.4.1)."""
        points = np.asarray(points, dtype=np.float64)
        return cls(points, np.tile(np.eye(points.shape[-1]), (*points.shape[:-1], 1, 1)))

    @classmethod
    def of_poses(cls, poses: ArrayLike) -> Self:
        """Frames in 3-D from poses (F, 7) or (N, F, 7): position [m] and quaternion (w, x, y, z)."""
        poses = np.asarray(poses, dtype=np.float64)
        if poses.shape[-1:] != (7,) or not np.isfinite(poses).all():
            raise InvalidArgumentError(f"poses are finite arrays (..., F, 7), not one of shape {poses.shape}")
        turns = Rotation.from_quat(poses[..., 3:].reshape(-1, 4), scalar_first=True).as_matrix()
        return cls(poses[..., :3], turns.reshape(*poses.shape[:-1], 3, 3))

    @classmethod
    def joined(cls, parts: Sequence["Frames"]) -> Self:
        """All frames of the parts, in their order; where one part moves, all get its time steps."""
        steps = next((part.origins.shape[:1] for part in parts if part.moving), ())
        origins = [np.broadcast_to(part.origins, (*steps, *part.origins.shape[-2:])) for part in parts]
        axes = [np.broadcast_to(part.axes, (*steps, *part.axes.shape[-3:])) for part in parts]
        return cls(np.concatenate(origins, axis=-2), np.concatenate(axes, axis=-3))

    @property
    def moving(self) -> bool:
        """Whether a frame moves."""
        return self.origins.ndim == 3

    @property
    def n_steps(self) -> int | None:
        """Time steps N of moving frames; None where all stand still."""
        return len(self.origins) if self.moving else None

    @property
    def n_dimensions(self) -> int:
        """Dimension d of the space."""
        return self.origins.shape[-1]

    def __len__(self) -> int:
        return self.origins.shape[-2]

    def local(self, points: Array) -> Array:
        """Points (N, d) seen from every frame, (N, F, d); axes are orthogonal matrices."""
        return np.einsum("...fji,...fj->...fi", self.axes, points[:, None] - self.origins)

    def resampled(self, index: Array) -> Self:
        """The frames at fractional time steps (N,), linearly between neighbours; frames at rest stay as they are."""
        if not self.moving:
            return self
        return type(self)(resample(self.origins, index), resample(self.axes, index))

    def moved(self, turn: ArrayLike, shift: ArrayLike) -> Self:
        """The frames of a scene that was turned by a matrix (d, d), then shifted by a vector (d,)."""
        turn = np.asarray(turn, dtype=np.float64)
        return type(self)(self.origins @ turn.T + np.asarray(shift), turn @ self.axes)


def resample(values: Array, index: Array) -> Array:
    """Rows of (N, ...) at fractional indices (M,), linearly interpolated."""
    below = np.clip(index.astype(np.int64), 0, max(len(values) - 2, 0))
    part = (index - below).reshape(-1, *[1] * (values.ndim - 1))
    return (1.0 - part) * values[below] + part * values[np.minimum(below + 1, len(values) - 1)]
