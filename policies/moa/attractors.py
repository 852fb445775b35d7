"""Attractors at the corners of a box in every frame (thesis 4.3.1), and their activations in short form.

Only the convex hull of a frame's attractors matters, and the hull of a box's 2^d corners is the box. With alpha_f the summed
activation of frame f, c_f and h_f centre and half widths of its box, the goal that the corners of all frames mix is

    G a = sum_f alpha_f (p_f + R_f c_f) + R_f diag(h_f) rho_f,   |rho_fd| <= alpha_f,   sum_f alpha_f = 1,

so F (1 + d) numbers z = (alpha, rho) per support point replace F 2^d activations without changing what can be reached, the
cost or its minimum. `corner_activations` returns to the thesis's a.
"""

from itertools import product
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from policies.moa.frames import Frames

Array = NDArray[np.float64]


class BoxAttractors(NamedTuple):
    """A box per frame."""

    low: Array
    """(F, d) lower corner in the coordinates of each frame."""
    high: Array
    """(F, d) upper corner."""

    @classmethod
    def around(cls, points: Array, margin: float) -> Self:
        """Bounding boxes of local points (N, F, d), widened on each side by a fraction of their extent.

        The goal has to be able to lead the trajectory, so a box without margin costs accuracy.
        """
        low, high = points.min(axis=0), points.max(axis=0)
        return cls(low - margin * (high - low), high + margin * (high - low))

    @property
    def n_frames(self) -> int:
        """F."""
        return self.low.shape[0]

    @property
    def n_dimensions(self) -> int:
        """d."""
        return self.low.shape[1]

    def goal_matrix(self, frames: Frames) -> Array:
        """Matrix of shape (d, F (1 + d)), or (N, d, F (1 + d)) for moving frames, that maps z to the goal G a."""
        centre, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        middles = frames.origins + np.einsum("...fij,fj->...fi", frames.axes, centre)
        sides = frames.axes * half[:, None, :]
        columns = np.moveaxis(sides, -3, -2).reshape(*sides.shape[:-3], self.n_dimensions, -1)
        return np.concatenate([np.moveaxis(middles, -1, -2), columns], axis=-1)

    def corners(self) -> Array:
        """Local attractor goals (F, 2^d, d) in the order of `corner_activations`."""
        centre, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return centre[:, None] + half[:, None] * self._signs()

    def corner_matrix(self) -> Array:
        """Matrix V (F (1 + d), K) with z = V a, the corners frame by frame; the thesis's G is goal_matrix @ V."""
        n = self.n_frames
        parts = np.vstack([np.ones(2**self.n_dimensions), self._signs().T])
        blocks = np.einsum("fg,pk->fpgk", np.eye(n), parts).reshape(n, 1 + self.n_dimensions, -1)
        return np.vstack([blocks[:, 0], blocks[:, 1:].reshape(n * self.n_dimensions, -1)])

    def corner_activations(self, z: Array) -> Array:
        """Activations (..., F, 2^d) of the corners from z (..., F (1 + d)): non-negative, their sum is one.

        Within a frame the product of d barycentric weights, the one choice of largest entropy among all with equal goals.
        """
        alpha, rho = split(z, self.n_frames)
        rest = np.where(alpha > 0.0, alpha, 1.0)[..., None]
        part = np.clip(rho / rest, -1.0, 1.0)[..., None, :]
        return alpha[..., None] * np.prod(0.5 * (1.0 + self._signs() * part), axis=-1)

    def _signs(self) -> Array:
        return np.array(list(product((-1.0, 1.0), repeat=self.n_dimensions)))


def split(z: Array, n_frames: int) -> tuple[Array, Array]:
    """Frame activations alpha (..., F) and offsets rho (..., F, d) of z (..., F (1 + d))."""
    return z[..., :n_frames], z[..., n_frames:].reshape(*z.shape[:-1], n_frames, -1)


def join(alpha: Array, rho: Array) -> Array:
    """The inverse of `split`."""
    return np.concatenate([alpha, rho.reshape(*alpha.shape[:-1], -1)], axis=-1)


def projected(z: Array, n_frames: int) -> Array:
    """z (..., F (1 + d)) made feasible: alpha clipped at 0 and normalised to sum one, rho clipped to |rho| <= alpha."""
    alpha, rho = split(z, n_frames)
    alpha = np.maximum(alpha, 0.0)
    alpha = alpha / alpha.sum(axis=-1, keepdims=True)
    return join(alpha, np.clip(rho, -alpha[..., None], alpha[..., None]))
