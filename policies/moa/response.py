"""How a time-discretised attractor answers to its goals (thesis 4.2.1)."""

from typing import NamedTuple, Self

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym.errors import InvalidArgumentError, is_number

Array = NDArray[np.float64]

LARGEST = 1e30
"""Gains [1/s] and time steps [s] are smaller, so that their product is a number."""


class Response(NamedTuple):
    """x_i = c1 x_{i-1} + c2 x_{i-2} + c3 g_i for i = 3, 4, ... with x_1 and x_2 given (4.11).

    Goals and positions have time steps along their first axis. Goals at the first two steps never matter.
    """

    c1: float
    c2: float
    """-1 / (1 + alpha h + alpha beta h^2), corrected: c1 + c2 + c3 = 1; with the printed sign the trajectory explodes."""
    c3: float

    @classmethod
    def of_attractor(cls, alpha: float, beta: float | None, dt: float) -> Self:
        """The response of x'' = alpha (beta (g - x) - x') (4.7) at a time step dt [s], by the differences (4.10).

        alpha and beta are in 1/s; beta = alpha / 4, critical damping, where it is None.

        Raises InvalidArgumentError for what is no positive number, or too large to be multiplied.
        """
        given = {"alpha": alpha, "dt": dt} | ({} if beta is None else {"beta": beta})
        for name, value in given.items():
            if not (is_number(value) and 0.0 < value < LARGEST):
                raise InvalidArgumentError(f"{name} is {value!r}; it must be positive, and below {LARGEST:g}")
        beta = alpha / 4.0 if beta is None else beta
        scale = 1.0 + alpha * dt + alpha * beta * dt**2
        return cls((2.0 + alpha * dt) / scale, -1.0 / scale, alpha * beta * dt**2 / scale)

    @classmethod
    def none(cls) -> Self:
        """x_i = g_i: no dynamics."""
        return cls(0.0, 0.0, 1.0)

    def forced(self, goals: Array) -> Array:
        """sum_j gamma_ij g_j of (4.13), shape (N, C): the part of the trajectory that the goals (N, C) make."""
        start = np.zeros((2, goals.shape[1]))
        return np.asarray(_recursion(goals, start, self.c1, self.c2, self.c3))

    def forced_transposed(self, forces: Array) -> Array:
        """sum_i gamma_ij v_i, the adjoint of `forced`; shapes (N, C)."""
        return np.asarray(_recursion_transposed(forces, self.c1, self.c2, self.c3))

    def free(self, first: Array, second: Array, n: int) -> Array:
        """lambda_i x_2 + mu_i x_1 of (4.13), shape (n, d): the part that the first two positions (d,) make."""
        return np.asarray(_recursion(np.zeros((n, len(first))), np.array([first, second]), self.c1, self.c2, self.c3))

    def simulate(self, goals: Array, first: Array, second: Array) -> Array:
        """The trajectory (N, d) from goals (N, d) and its first two positions (d,), step by step (4.11)."""
        return np.asarray(_recursion(goals, np.array([first, second]), self.c1, self.c2, self.c3))

    def wanted_goals(self, positions: Array) -> Array:
        """The goals (N - 2, d) of steps 3, 4, ... that make the next position exact from the two before it (4.33)."""
        return (positions[2:] - self.c1 * positions[1:-1] - self.c2 * positions[:-2]) / self.c3

    @property
    def memory(self) -> int:
        """Time steps after which an impulse has decayed below 1e-15 of its sum."""
        radius = float(np.abs(np.roots([1.0, -self.c1, -self.c2])).max())
        if radius == 0.0:
            return 0
        steps = np.arange(1, 2 + int(np.ceil(45.0 / -np.log(radius))))
        left = steps * radius**steps
        return int(steps[np.flatnonzero(left > 1e-15)[-1]])


@njit(cache=True)
def _recursion(goals: Array, start: Array, c1: float, c2: float, c3: float) -> Array:
    x = np.empty(goals.shape)
    x[:2] = start[: len(x)]
    for i in range(2, len(x)):
        for k in range(goals.shape[1]):
            x[i, k] = c1 * x[i - 1, k] + c2 * x[i - 2, k] + c3 * goals[i, k]
    return x


@njit(cache=True)
def _recursion_transposed(forces: Array, c1: float, c2: float, c3: float) -> Array:
    n, width = forces.shape
    back = np.zeros((n, width))
    for k in range(width):
        one, two = 0.0, 0.0
        for i in range(n - 1, 1, -1):
            one, two = forces[i, k] + c1 * one + c2 * two, one
            back[i, k] = c3 * one
    return back
