"""A small alphabet of single strokes: capital letters as the lines that a pen draws, without width.

Letters are drawn in a box of width 1 and height 1, y up, as strokes of corner points; round parts are sampled arcs.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lfd_gym.errors import InvalidArgumentError

Array = NDArray[np.float64]
Stroke = list[tuple[float, float]]

MAX_LETTERS = 6
HEIGHT, ASPECT, SPACING = 0.06, 0.62, 0.28
"""Height of a letter [m], its width over its height, and the space between letters over the height."""
MAX_WIDTH = 0.18
"""Of a word [m]; longer words are written smaller."""


def _arc(x: float, y: float, rx: float, ry: float, start: float, end: float) -> Stroke:
    """An elliptic arc about (x, y) from one angle to another [degrees], counterclockwise where the end is larger."""
    n = max(round(abs(end - start) / 15.0), 1)
    angles = [math.radians(start + (end - start) * i / n) for i in range(n + 1)]
    return [(x + rx * math.cos(a), y + ry * math.sin(a)) for a in angles]


_BOW: Stroke = [(0, 0), (0, 1), (0.6, 1), *_arc(0.6, 0.74, 0.4, 0.26, 90, -90), (0, 0.48)]

LETTERS: dict[str, list[Stroke]] = {
    "A": [[(0, 0), (0.5, 1), (1, 0)], [(0.2, 0.4), (0.8, 0.4)]],
    "B": [
        [(0, 0), (0, 1), (0.5, 1), *_arc(0.5, 0.76, 0.38, 0.24, 90, -90), (0, 0.52)],
        [(0, 0.52), (0.55, 0.52), *_arc(0.55, 0.26, 0.45, 0.26, 90, -90), (0, 0)],
    ],
    "C": [_arc(0.5, 0.5, 0.5, 0.5, 45, 315)],
    "D": [[(0, 0), (0, 1), (0.4, 1), *_arc(0.4, 0.5, 0.6, 0.5, 90, -90), (0, 0)]],
    "E": [[(1, 1), (0, 1), (0, 0), (1, 0)], [(0, 0.5), (0.8, 0.5)]],
    "F": [[(1, 1), (0, 1), (0, 0)], [(0, 0.5), (0.8, 0.5)]],
    "G": [[*_arc(0.5, 0.5, 0.5, 0.5, 60, 315), (0.85, 0.42), (0.45, 0.42)]],
    "H": [[(0, 1), (0, 0)], [(1, 1), (1, 0)], [(0, 0.5), (1, 0.5)]],
    "I": [[(0.5, 1), (0.5, 0)]],
    "J": [[(0.8, 1), (0.8, 0.3), *_arc(0.45, 0.3, 0.35, 0.3, 0, -180)]],
    "K": [[(0, 1), (0, 0)], [(1, 1), (0, 0.45), (1, 0)]],
    "L": [[(0, 1), (0, 0), (0.9, 0)]],
    "M": [[(0, 0), (0, 1), (0.5, 0.3), (1, 1), (1, 0)]],
    "N": [[(0, 0), (0, 1), (1, 0), (1, 1)]],
    "O": [_arc(0.5, 0.5, 0.5, 0.5, 90, 450)],
    "P": [_BOW],
    "Q": [_arc(0.5, 0.5, 0.5, 0.5, 90, 450), [(0.4, 0.45), (1, 0)]],
    "R": [[*_BOW, (0.4, 0.48), (1, 0)]],
    "S": [[*_arc(0.5, 0.75, 0.45, 0.25, 30, 270), *_arc(0.5, 0.25, 0.45, 0.25, 75, -150)]],
    "T": [[(0, 1), (1, 1)], [(0.5, 1), (0.5, 0)]],
    "U": [[(0, 1), (0, 0.35), *_arc(0.5, 0.35, 0.5, 0.35, 180, 360), (1, 1)]],
    "V": [[(0, 1), (0.5, 0), (1, 1)]],
    "W": [[(0, 1), (0.25, 0), (0.5, 0.7), (0.75, 0), (1, 1)]],
    "X": [[(0, 1), (1, 0)], [(1, 1), (0, 0)]],
    "Y": [[(0, 1), (0.5, 0.5), (1, 1)], [(0.5, 0.5), (0.5, 0)]],
    "Z": [[(0, 1), (1, 1), (0, 0), (1, 0)]],
}


def strokes(word: str) -> list[Array]:
    """The strokes of a word centred at the origin, x along the writing, y up; each an array of corners (k, 2) [m].

    Raises:
        InvalidArgumentError: not 1 to 6 capital letters.
    """
    if not isinstance(word, str) or not 1 <= len(word) <= MAX_LETTERS or set(word) - set(LETTERS):
        raise InvalidArgumentError(f"word {word!r}; possible: 1 to {MAX_LETTERS} capital letters A-Z")
    width = len(word) * ASPECT + (len(word) - 1) * SPACING
    height = min(HEIGHT, MAX_WIDTH / width)
    return [
        height * (np.array(stroke) * [ASPECT, 1.0] + [i * (ASPECT + SPACING) - 0.5 * width, -0.5])
        for i, letter in enumerate(word)
        for stroke in LETTERS[letter]
    ]


def two_words(words: Sequence[str]) -> list[list[Array]]:
    """The strokes of each of two words. Raises InvalidArgumentError for anything else."""
    if isinstance(words, str) or not isinstance(words, Sequence) or len(words) != 2:
        raise InvalidArgumentError(f"words {words!r}; possible: two words of capital letters, as ('IAS', 'HRI')")
    return [strokes(word) for word in words]


def sample(stroke: Array, spacing: float) -> Array:
    """Points along a stroke at equal distances of at most `spacing` [m], both ends included, shape (n, 2)."""
    steps = np.linalg.norm(np.diff(stroke, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.linspace(0.0, way[-1], max(math.ceil(way[-1] / spacing), 1) + 1)
    return np.stack([np.interp(at, way, stroke[:, i]) for i in range(2)], axis=1)
