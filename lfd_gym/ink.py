"""Ink on boards: cells of a raster that a pen's tip has touched, and how well they show the words that were wanted.

A board's surface is divided into square cells; a cell is inked or not, so that resting on a spot leaves no more than passing
it. With T the points along the wanted strokes and C the centres of the inked cells,

    coverage  = |{t in T: some c in C is within the tolerance of t}| / |T|
    precision = |{c in C: some t in T is within the tolerance of c}| / |C|,   0 without ink
    faintest  = the least coverage of a single stroke: 0 where one is missing.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lfd_gym.alphabet import sample
from lfd_gym.compiled import bound

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

HALF_SIZE = (0.11, 0.07)
"""Half width and half height of a board [m]."""
CELL = 0.002
"""Width of a cell [m]."""
TOLERANCE = 0.004
"""Between ink and stroke [m]."""
SPACING = 0.001
"""Between the points of a wanted stroke [m]."""
COLUMNS, ROWS = round(2 * HALF_SIZE[0] / CELL), round(2 * HALF_SIZE[1] / CELL)
BITS = 32
WORDS = math.ceil(COLUMNS * ROWS / BITS)
"""Size of a board's memory: cells are the bits of integers that a float64 holds exactly."""


class Tally(NamedTuple):
    """What is on one board."""

    covered: int
    """Points of the wanted strokes with ink near them."""
    wanted: int
    """Points of the wanted strokes."""
    good: int
    """Inked cells near a wanted stroke."""
    inked: int
    """Inked cells."""
    faintest: float
    """Fraction that is inked of the stroke of which least is."""

    @property
    def coverage(self) -> float:
        """Fraction of the wanted strokes that is inked."""
        return self.covered / self.wanted

    @property
    def precision(self) -> float:
        """Fraction of the ink that is wanted."""
        return self.good / max(self.inked, 1)

    def __add__(self, other: "Tally") -> "Tally":  # type: ignore[override]
        """Two boards together."""
        return Tally(
            self.covered + other.covered, self.wanted + other.wanted, self.good + other.good, self.inked + other.inked,
            min(self.faintest, other.faintest),
        )  # fmt: skip


class Ink:
    """The ink on one board.

    Args:
        strokes: what shall be written, arrays of corners (k, 2) in the board's axes [m].
        memory: where the cells are kept, shape (`WORDS`,); all zeros is a clean board.
    """

    def __init__(self, strokes: list[Array], memory: Array) -> None:
        self.memory = memory
        points_of = [sample(stroke, SPACING) for stroke in strokes]
        wanted, sizes = np.concatenate(points_of), np.array([len(points) for points in points_of])
        reach = np.arange(-math.ceil(TOLERANCE / CELL), math.ceil(TOLERANCE / CELL) + 1)
        offsets = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
        places = np.floor((wanted + HALF_SIZE) / CELL).astype(np.int64)[:, None] + offsets
        distance = np.linalg.norm((places + 0.5) * CELL - HALF_SIZE - wanted[:, None], axis=2)
        near = (distance <= TOLERANCE) & ((places >= 0) & (places < (COLUMNS, ROWS))).all(axis=2)
        cells = places[near] @ (1, COLUMNS)
        # the points near each cell, cell after cell
        points = np.nonzero(near)[0][np.argsort(cells, kind="stable")]
        starts = np.searchsorted(np.sort(cells), np.arange(COLUMNS * ROWS + 1))
        read, covered = np.zeros(WORDS), np.zeros(len(wanted), dtype=bool)
        self._read = bound(_read_ink, memory, read, covered, starts, points)
        read[:], covered[:] = 0.0, False
        self._tally = Tally(0, len(wanted), 0, 0, 0.0)
        self._covered, self._sizes, self._begins = covered, sizes, np.cumsum(sizes) - sizes

    def mark(self, x: float, y: float) -> None:
        """Touch the board at a point in its axes [m]; beside the board nothing is left."""
        mark(self.memory, x, y)

    def tally(self) -> Tally:
        """Compare what is written with what was wanted."""
        changed, covered, good, inked = self._read()
        if changed:
            t, of_strokes = self._tally, np.add.reduceat(self._covered, self._begins, dtype=np.int64)
            faintest = float((of_strokes / self._sizes).min())
            self._tally = Tally(t.covered + covered, t.wanted, t.good + good, t.inked + inked, faintest)
        return self._tally

    def points(self) -> Array:
        """Centres of the inked cells in the board's axes, shape (n, 2) [m]."""
        words = self.memory.astype(np.uint32).view(np.uint8)
        return centres(np.flatnonzero(np.unpackbits(words, bitorder="little")))


def centres(cells: Integers) -> Array:
    """Centres of cells by their numbers, shape (n, 2) [m]."""
    place = np.stack([cells % COLUMNS, cells // COLUMNS], axis=1)
    return (place + 0.5) * CELL - np.array(HALF_SIZE)


@njit(cache=True)
def mark(memory: Array, x: float, y: float) -> None:
    """Ink the cell at a point of the board, if it is on the board."""
    column, row = math.floor((x + HALF_SIZE[0]) / CELL), math.floor((y + HALF_SIZE[1]) / CELL)
    if 0 <= column < COLUMNS and 0 <= row < ROWS:
        cell = row * COLUMNS + column
        memory[cell // BITS] = float(int(memory[cell // BITS]) | (1 << (cell % BITS)))


@njit(cache=True)
def _read_ink(
    memory: Array, read: Array, covered: NDArray[np.bool_], starts: Integers, points: Integers
) -> tuple[bool, int, int, int]:
    """Whether the memory has changed since it was last read, and how many points, good cells and cells are inked more.

    Args:
        memory: of the board; where ink has gone, as after a reset, it is read from the beginning.
        read, covered: the memory as last read, and the points covered by then; both are brought up to date.
        starts, points: points near cell c are ``points[starts[c] : starts[c + 1]]``.
    """
    changed = False
    new_points = new_good = new_cells = 0
    for word in range(memory.size):
        if int(read[word]) & ~int(memory[word]):
            for other in range(memory.size):
                for cell in range(other * BITS, min((other + 1) * BITS, starts.size - 1)):
                    if (int(read[other]) >> (cell % BITS)) & 1:
                        new_cells -= 1
                        new_good -= starts[cell + 1] > starts[cell]
                read[other] = 0.0
            new_points -= covered.sum()
            covered[:] = False
            changed = True
            break
    for word in range(memory.size):
        if memory[word] == read[word]:
            continue
        fresh = int(memory[word]) & ~int(read[word])
        read[word] = memory[word]
        changed = True
        for bit in range(BITS):
            if not (fresh >> bit) & 1:
                continue
            cell = word * BITS + bit
            new_cells += 1
            new_good += starts[cell + 1] > starts[cell]
            for i in range(starts[cell], starts[cell + 1]):
                new_points += not covered[points[i]]
                covered[points[i]] = True
    return changed, new_points, new_good, new_cells


@njit(cache=True)
def draw(
    memories: Array, pressed: Array, threshold: float, tip: Array, reach: float, origins: Array, axes: Array
) -> None:
    """Leave ink where a pen presses on a board: called after every physics step.

    Args:
        memories: of all boards, (n, WORDS).
        pressed: force on the tip, (1,) [N]; below the threshold nothing is left.
        tip: centre of the tip, world frame [m]; `reach` from it to the surface at most.
        origins, axes: frames of the boards, world, (n, 3) and (n, 9).
    """
    if pressed[0] < threshold:
        return
    for board in range(memories.shape[0]):
        x, y, z = _on_board(tip, origins[board], axes[board])
        if abs(z) < reach:
            mark(memories[board], x, y)


@njit(cache=True)
def clearance(tip: Array, origins: Array, axes: Array) -> float:
    """Distance of a point from the nearest board, below 0 behind it [m]; arguments as of `draw`."""
    nearest = np.inf
    for board in range(origins.shape[0]):
        x, y, z = _on_board(tip, origins[board], axes[board])
        dx, dy = max(abs(x) - HALF_SIZE[0], 0.0), max(abs(y) - HALF_SIZE[1], 0.0)
        nearest = min(nearest, math.sqrt(dx * dx + dy * dy + z * z) if dx + dy > 0.0 else z)
    return nearest


@njit(cache=True)
def _on_board(point: Array, origin: Array, axes: Array) -> tuple[float, float, float]:
    x = y = z = 0.0
    for i in range(3):
        offset = point[i] - origin[i]
        x += axes[3 * i] * offset
        y += axes[3 * i + 1] * offset
        z += axes[3 * i + 2] * offset
    return x, y, z
