"""Activations that are free at support points and interpolated between them (thesis 4.2.2)."""

from typing import NamedTuple, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym.errors import InvalidArgumentError, is_number

Array = NDArray[np.float64]

NEGLIGIBLE = 1e-17
"""Interpolation weights below this are 0."""


class Interpolation(NamedTuple):
    """Weights W (N, N_S) with a_i = S w_i (4.19), each row without the zeros at its ends."""

    first: NDArray[np.int64]
    """(N,) support point of the first weight of each row."""
    values: Array
    """(N, width) weights of the support points first, first + 1, ..."""
    n_support: int
    """N_S."""

    @classmethod
    def of_matrix(cls, weights: Array) -> Self:
        """From the full matrix (N, N_S)."""
        n_support = weights.shape[1]
        present = weights > NEGLIGIBLE
        start = present.argmax(axis=1)
        stop = np.where(present.any(axis=1), n_support - present[:, ::-1].argmax(axis=1), start)
        width = max(int((stop - start).max()), 1)
        first = np.minimum(start, n_support - width)
        values = np.take_along_axis(np.where(present, weights, 0.0), first[:, None] + np.arange(width), axis=1)
        return cls(first.astype(np.int64), np.ascontiguousarray(values), n_support)

    @property
    def matrix(self) -> Array:
        """The full matrix (N, N_S)."""
        return self.interpolated(np.eye(self.n_support))

    def interpolated(self, z: Array) -> Array:
        """W z, (N, P)."""
        return np.asarray(_interpolated(self.first, self.values, z))

    def transposed(self, forces: Array) -> Array:
        """W' v, (N_S, P)."""
        return np.asarray(_transposed(self.first, self.values, forces, self.n_support))

    def without_last(self) -> Self:
        """The weights of all support points but the last."""
        return type(self).of_matrix(self.matrix[:, :-1])


def bandwidth(spacing: float, overlap: float) -> float:
    """gamma of (4.20), in 1 / unit of the spacing: the RBF has the value `overlap` at the centre of its neighbour."""
    return float(np.sqrt(np.log(1.0 / overlap)) / spacing)


def normalised_rbf(squared_distances: Array, gamma: float) -> Interpolation:
    """Weights w_is of (4.20) from squared distances (N, N_S) of N points to N_S centres; every row sums to one."""
    exponent = -(gamma**2) * squared_distances
    weights = np.exp(exponent - exponent.max(axis=1, keepdims=True))
    return Interpolation.of_matrix(weights / weights.sum(axis=1, keepdims=True))


def interpolation(n_steps: int, n_support: int | None, overlap: float, n_extended: int | None = None) -> Interpolation:
    """Weights of N_S support points that are equally spaced in time from the first to the last step.

    With n_support None every step has its own activations (4.16) and W is the identity. n_extended > n_steps evaluates the
    weights beyond the last step, where the last support point takes over.

    Raises:
        InvalidArgumentError: fewer than 2 or more support points than time steps, or an overlap outside (0, 1).
    """
    rows = np.arange(n_steps if n_extended is None else n_extended)
    if n_support is None:
        return Interpolation(np.minimum(rows, n_steps - 1), np.ones((len(rows), 1)), n_steps)
    if not 2 <= n_support <= n_steps:
        raise InvalidArgumentError(f"{n_support} support points; possible: 2 to the number of time steps, {n_steps}")
    if not (is_number(overlap) and 0.0 < overlap < 1.0):
        raise InvalidArgumentError(f"the overlap is {overlap}; it must lie between 0 and 1")
    centres = np.linspace(0.0, n_steps - 1.0, n_support)
    return normalised_rbf((rows[:, None] - centres) ** 2, bandwidth(centres[1], overlap))


@njit(cache=True)
def _interpolated(first: NDArray[np.int64], values: Array, z: Array) -> Array:
    out = np.zeros((len(first), z.shape[1]))
    for i in range(len(first)):
        for j in range(values.shape[1]):
            for k in range(z.shape[1]):
                out[i, k] += values[i, j] * z[first[i] + j, k]
    return out


@njit(cache=True)
def _transposed(first: NDArray[np.int64], values: Array, forces: Array, n_support: int) -> Array:
    out = np.zeros((n_support, forces.shape[1]))
    for i in range(len(first)):
        for j in range(values.shape[1]):
            for k in range(forces.shape[1]):
                out[first[i] + j, k] += values[i, j] * forces[i, k]
    return out
