"""The Hessian of a tracking problem in band form, without ever building the thesis's Lambda.

Support points act on a neighbourhood in time only: their interpolation weights are narrow and the attractor forgets. So the
Hessian, ordered by support points, is a band of blocks. Where frames stand still it is (G'G) kron (Phi'Phi), Phi = Gamma W;
where they move the blocks are accumulated over short stretches of time.
"""

from collections.abc import Iterator

import numpy as np
from numba import njit
from numpy.typing import NDArray

from policies.moa.tracking import Group, TrackingProblem

Array = NDArray[np.float64]

STRETCH = 32
"""Time steps of moving frames that are treated at once."""
NEGLIGIBLE = 1e-14
"""Correlation of two support points below which their block is left out; the solver's gradients stay exact."""


def band(problem: TrackingProblem, basis: Array) -> Array:
    """Lower band (n, k + 1) of the Hessian: row j holds H_jj, H_j+1,j, ...; its transpose is LAPACK's form.

    basis (P, Q) has the directions of the Q unknowns of every support point, n = N_S Q.
    """
    n_support, q = problem.n_support, basis.shape[1]
    parts = [_Still(g, basis) if len(g.matrices) == 1 else _Moving(g, basis) for g in problem.groups]
    width = max([part.width for part in parts] + [min(1, n_support - 1) if problem.switching else 0])
    hessian = np.zeros((n_support * q, (width + 1) * q))
    for part in parts:
        part.add_to(hessian)
    if problem.switching:
        along = basis[: problem.n_frames]
        weights = problem.switching * (along.T @ along)
        chain = np.diag(np.bincount([0, n_support - 1], minlength=n_support) * -1.0 + 2.0)
        chain -= np.eye(n_support, k=1) + np.eye(n_support, k=-1)
        _add_kronecker(hessian, chain, weights, 1)
    return hessian


class _Still:
    """(G'G) kron (Phi'Phi)."""

    def __init__(self, group: Group, basis: Array) -> None:
        filtered = group.response.forced(group.weights.matrix)
        self._time = 2.0 * (filtered.T @ filtered)
        self._space = np.asarray((group.matrices[0] @ basis).T @ (group.matrices[0] @ basis))
        size = np.sqrt(np.maximum(np.diag(self._time), np.finfo(float).tiny))
        rows, columns = np.nonzero(np.abs(self._time) > NEGLIGIBLE * size * size[:, None])
        self.width = int(np.abs(rows - columns).max(initial=0))

    def add_to(self, hessian: Array) -> None:
        _add_kronecker(hessian, self._time, self._space, self.width)


class _Moving:
    """Gram matrices of the filtered columns over stretches of time."""

    def __init__(self, group: Group, basis: Array) -> None:
        self._group, self._basis = group, basis
        present = group.weights.matrix > 0.0
        n = len(present)
        first = np.where(present.any(axis=0), present.argmax(axis=0), n)
        last = np.where(present.any(axis=0), n - 1 - present[::-1].argmax(axis=0), 0)
        self._first, self._last = first, last + group.response.memory
        self.width = max(stop - start - 1 for _, _, start, stop in self._stretches())

    def _stretches(self) -> Iterator[tuple[int, int, int, int]]:
        """Time steps [begin, end) and the support points [start, stop) that are felt there."""
        n = len(self._group.targets)
        for begin in range(0, n, STRETCH):
            end = min(begin + STRETCH, n)
            felt = np.flatnonzero((self._first < end) & (self._last >= begin))
            yield begin, end, int(felt[0]), int(felt[-1]) + 1

    def add_to(self, hessian: Array) -> None:
        group, basis = self._group, self._basis
        everywhere, n_support = group.weights.matrix, group.weights.n_support
        memory = np.zeros((2, n_support, group.matrices.shape[1], basis.shape[1]))
        for begin, end, start, stop in self._stretches():
            weights = everywhere[begin:end, start:stop].copy()
            weights[: max(2 - begin, 0)] = 0.0
            matrices = group.matrices[begin:end] @ basis
            columns = _filtered(weights, matrices, memory[:, start:stop], *group.response)
            flat = columns.reshape(-1, columns.shape[2] * columns.shape[3])
            _add_gram(hessian, 2.0 * flat.T @ flat, start * basis.shape[1])


@njit(cache=True)
def _filtered(weights: Array, matrices: Array, memory: Array, c1: float, c2: float, c3: float) -> Array:
    """Responses (L, D, A, Q) to goals weights[i, a] matrices[i]; memory (2, A, D, Q) holds the two steps before."""
    n, active = weights.shape
    rows, q = matrices.shape[1:]
    out = np.empty((n, rows, active, q))
    for i in range(n):
        for a in range(active):
            for d in range(rows):
                for k in range(q):
                    value = c1 * memory[0, a, d, k] + c2 * memory[1, a, d, k] + c3 * weights[i, a] * matrices[i, d, k]
                    memory[1, a, d, k] = memory[0, a, d, k]
                    memory[0, a, d, k] = value
                    out[i, d, a, k] = value
    return out


@njit(cache=True)
def _add_gram(hessian: Array, gram: Array, first: int) -> None:
    """Add a dense symmetric matrix whose first row is unknown `first` to the band."""
    n = len(gram)
    for j in range(n):
        for i in range(j, min(n, j + hessian.shape[1])):
            hessian[first + j, i - j] += gram[i, j]


@njit(cache=True)
def _add_kronecker(hessian: Array, time: Array, space: Array, width: int) -> None:
    """Add time (N_S, N_S) kron space (Q, Q), blocks up to `width` off the diagonal, to the band."""
    n, q = len(time), len(space)
    for s in range(n):
        for j in range(q):
            for r in range(s, min(n, s + width + 1)):
                for i in range(j if r == s else 0, q):
                    hessian[s * q + j, (r - s) * q + i - j] += time[r, s] * space[i, j]
