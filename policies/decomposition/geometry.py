"""Positions and orientations as points about a mean, for the Directional Normal Distribution (thesis 3.3.2, appendix B.2).

An orientation S that turns with the angular velocity of unit axis a (both in the axes of the frame, active) reaches
R(t) = (D cos t + E sin t + F) S with D = I - a a^T, E = [a]x, F = a a^T. It is nearest to a goal G at

    t* = atan2(<G S^T, E>, <G S^T, D>)

about which its way is linearised, which keeps the error small where it matters.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from policies.decomposition.task_spaces import nearest_rotation

Array = NDArray[np.float64]


class Geometry(Protocol):
    """N points with their velocities."""

    x: Array
    """(N, D) as given."""

    def centre(self, weights: Array) -> Array:
        """(D,) a mean to begin with."""
        ...

    def about(self, mean: Array) -> tuple[Array, Array]:
        """Points and velocities (..., N, d) about means (..., D)."""
        ...

    def moved(self, mean: Array, shift: Array) -> Array:
        """Means (..., D) moved by (..., d)."""
        ...


class Euclidean:
    """Positions, forces, joint angles."""

    def __init__(self, x: Array, v: Array) -> None:
        """x (N, d), v (N, d)."""
        self.x, self.v = x, v

    def centre(self, weights: Array) -> Array:
        """The weighted mean."""
        return np.asarray(weights @ self.x / weights.sum())

    def about(self, mean: Array) -> tuple[Array, Array]:
        """x - mean, and v."""
        x = self.x - mean[..., None, :]
        return x, np.broadcast_to(self.v, x.shape)

    def moved(self, mean: Array, shift: Array) -> Array:
        """The sum."""
        return mean + shift


class Rotations:
    """Orientations as rotation vectors (3) about the mean: R = exp(x) mean, axes of the frame."""

    def __init__(self, x: Array, v: Array) -> None:
        """x (N, 9) rows of rotation matrices, v (N, 3) angular velocities; their direction counts, 0 is an anchor."""
        self.x = x
        self.matrices = x.reshape(-1, 3, 3)
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        self.axes = v / np.where(speed > 0.0, speed, 1.0)
        self.moving = (speed > 0.0)[:, 0]
        self.quaternions = _quaternions(self.matrices)

    def centre(self, weights: Array) -> Array:
        """The weighted mean of the matrices, made a rotation."""
        return nearest_rotation((weights @ self.x / weights.sum()).reshape(3, 3)).ravel()

    def about(self, mean: Array) -> tuple[Array, Array]:
        """Rotation vectors to where the points are nearest to the mean, carried back along their derivative."""
        goal = _quaternions(mean.reshape(-1, 3, 3)).reshape(*mean.shape[:-1], 1, 4) * [1.0, -1.0, -1.0, -1.0]
        w, u = _multiply(self.quaternions[:, :1], self.quaternions[:, 1:], goal[..., :1], goal[..., 1:])
        w, u = np.abs(w), np.where(w < 0.0, -u, u)
        half = np.where(self.moving[:, None], np.arctan2(-(self.axes * u).sum(axis=-1, keepdims=True), w), 0.0)
        w, u = _multiply(np.cos(half), np.sin(half) * self.axes, w, u)
        w, u = np.abs(w), np.where(w < 0.0, -u, u)
        size = np.linalg.norm(u, axis=-1, keepdims=True)
        x = np.where(size > 1e-9, 2.0 * np.arctan2(size, w) / np.maximum(size, 1e-9), 2.0) * u
        v = np.where(self.moving[:, None], _derivative(x, self.axes), 0.0)
        return x - 2.0 * half * v, v

    def moved(self, mean: Array, shift: Array) -> Array:
        """exp(shift) mean."""
        matrices = Rotation.from_rotvec(shift.reshape(-1, 3)).as_matrix() @ mean.reshape(-1, 3, 3)
        return np.asarray(matrices.reshape(mean.shape))


class Matrices(Rotations):
    """Orientations as the nine numbers of their matrices, as in (3.14), corrected."""

    def about(self, mean: Array) -> tuple[Array, Array]:
        """x = d cos t* + e sin t* + f - t* v and v = e cos t* - d sin t*, about the mean."""
        turned = mean.reshape(*mean.shape[:-1], 1, 3, 3) @ np.swapaxes(self.matrices, -1, -2)
        t = self._nearest(turned)[..., None]
        d, e, f = ((part @ self.matrices).reshape(-1, 9) for part in parts(self.axes))
        v = np.where(self.moving[:, None], e * np.cos(t) - d * np.sin(t), 0.0)
        x = np.where(self.moving[:, None], d * np.cos(t) + e * np.sin(t) + f, self.x)
        return x - t * v - mean[..., None, :], v

    def moved(self, mean: Array, shift: Array) -> Array:
        """The rotation nearest to the sum (Higham 1989)."""
        rows = (mean + shift).reshape(-1, 3, 3)
        return np.array([nearest_rotation(row) for row in rows]).reshape(mean.shape)

    def _nearest(self, turned: Array) -> Array:
        """t* (..., N) of goals relative to the points, (..., N, 3, 3); 0 of anchors."""
        d, e, _ = parts(self.axes)
        t = np.arctan2((turned * e).sum(axis=(-2, -1)), (turned * d).sum(axis=(-2, -1)))
        return np.where(self.moving, t, 0.0)


GEOMETRIES: dict[str, Callable[[Array, Array], Geometry]] = {
    "euclidean": Euclidean,
    "rotation": Rotations,
    "matrix": Matrices,
}


def parts(axes: Array) -> tuple[Array, Array, Array]:
    """D, E, F (N, 3, 3) of unit axes (N, 3), in the active form: B.2 prints E with its sign flipped."""
    f = axes[:, :, None] * axes[:, None, :]
    e = np.zeros_like(f)
    e[:, [2, 0, 1], [1, 2, 0]], e[:, [1, 2, 0], [2, 0, 1]] = axes, -axes
    return np.eye(3) - f, e, f


def _derivative(x: Array, axes: Array) -> Array:
    """How the rotation vector x (..., N, 3) of exp(x) changes when it is turned about axes: J_left(x)^-1 a."""
    angle = np.linalg.norm(x, axis=-1, keepdims=True)
    safe = np.maximum(angle, 1e-6)
    factor = np.where(angle < 1e-3, 1.0 / 12.0, (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2)
    once = np.cross(x, np.broadcast_to(axes, x.shape))
    return np.asarray(axes - 0.5 * once + factor * np.cross(x, once))


def _quaternions(matrices: Array) -> Array:
    """(N, 4), scalar first."""
    return np.asarray(Rotation.from_matrix(matrices).as_quat(scalar_first=True))


def _multiply(w: Array, u: Array, w_other: Array, u_other: Array) -> tuple[Array, Array]:
    """Product of quaternions with scalars (..., 1) and vectors (..., 3)."""
    vector = (
        w * u_other + w_other * u + np.cross(u, np.broadcast_to(u_other, np.broadcast_shapes(u.shape, u_other.shape)))
    )
    return w * w_other - (u * u_other).sum(axis=-1, keepdims=True), vector
