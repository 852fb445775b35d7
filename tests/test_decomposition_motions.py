"""What is a movement and what is not: planted motions and forces, one at a time."""

import numpy as np
import pytest
from numpy.typing import NDArray

from policies.decomposition.segmentation import Signals, motions

DT, N = 0.02, 500
Array = NDArray[np.float64]


def planted(ways: list[tuple[float, float, float]], pressed: list[tuple[float, float]]) -> Signals:
    """Minimum-jerk motions (begin [s], end [s], way along x [m]) and stretches in which 10 N are pressed."""
    time = DT * np.arange(N)
    x, force = np.zeros(N), np.zeros((N, 3))
    for begin, end, way in ways:
        s = np.clip((time - begin) / (end - begin), 0.0, 1.0)
        x += way * (10 * s**3 - 15 * s**4 + 6 * s**5)
    for begin, end in pressed:
        force[(begin <= time) & (time < end), 2] = 10.0
    values = np.stack([x, 0 * x, 0 * x], axis=1)
    velocity = np.gradient(values, DT, axis=0)
    return Signals(values, velocity, np.linalg.norm(velocity, axis=1), force)


def times(observed: Signals) -> Array:
    return DT * np.array(motions(observed, "position", DT), dtype=float).reshape(-1, 2)


@pytest.mark.parametrize(
    ("way", "pressed", "count"),
    [(0.015, [], 1), (0.015, [(1.5, 6.0)], 0), (0.015, [(2.2, 6.0)], 0), (0.1, [(1.5, 6.0)], 1), (0.004, [], 0)],
)
def test_a_tool_that_presses_wanders(way: float, pressed: list[tuple[float, float]], count: int) -> None:
    assert len(times(planted([(2.0, 2.4, way)], pressed))) == count


def test_what_springs_back_when_a_contact_is_lost_belongs_to_the_next_motion() -> None:
    ways = [(4.0, 4.3, 0.025), (4.34, 5.0, -0.03)]
    assert len(times(planted(ways, []))) == 2
    found = times(planted(ways, [(2.0, 4.1)]))
    assert len(found) == 1
    np.testing.assert_allclose(found[0], [4.0, 5.0], atol=0.1)


def test_a_motion_before_a_rest_stands_alone() -> None:
    assert len(times(planted([(4.0, 4.3, 0.03), (5.0, 5.6, -0.03)], [(2.0, 4.1)]))) == 2
