"""MoA-S: attractors activated by position (thesis 4.4.1)."""

import numpy as np
import pytest

from lfd_gym.errors import DemonstrationError, InvalidArgumentError
from policies.moa.frames import Frames
from policies.moa.spatial import SpatialMixtureOfAttractors
from policies.moa.start_and_end import start_and_end

SETTINGS = {"n_support": 15, "alpha": 100.0, "dt": 0.01}


def arcs(n):
    """Half circles with a little error that come to rest, of several lengths."""
    rng = np.random.default_rng(0)
    found = []
    for _ in range(n):
        phase = np.pi * np.sin(0.5 * np.pi * np.linspace(0.0, 1.0, rng.integers(120, 200))) ** 2
        found.append(np.stack([-np.cos(phase), np.sin(phase)], axis=1) * (1.0 + 0.02 * rng.normal()))
    return found


def test_a_simple_curve_is_followed_without_time():
    points = arcs(4)
    moa = SpatialMixtureOfAttractors(**SETTINGS).fit(points)
    x = moa.predict(Frames.world(2), points[0][0], 600, points[0][10])
    assert np.abs(np.linalg.norm(x[np.linalg.norm(x - x[0], axis=1) > 0.2], axis=1) - 1.0).max() < 0.15
    assert np.linalg.norm(x[-1] - points[0][-1]) < 0.2


def test_activations_are_the_certified_minimum_and_reproducible():
    points = arcs(3)
    frames = [start_and_end(x) for x in points]
    moa = SpatialMixtureOfAttractors(**SETTINGS).fit(points, frames)
    assert moa.solution_.relative_gap <= 1e-6
    np.testing.assert_array_equal(SpatialMixtureOfAttractors(**SETTINGS).fit(points, frames).z_, moa.z_)


def test_shifting_the_scene_shifts_the_answer():
    points, shift = arcs(2), np.array([3.0, -1.0])
    frames = [start_and_end(x) for x in points]
    here = SpatialMixtureOfAttractors(**SETTINGS).fit(points, frames)
    there = SpatialMixtureOfAttractors(**SETTINGS).fit(
        [x + shift for x in points], [f.moved(np.eye(2), shift) for f in frames]
    )
    x = here.predict(frames[0], points[0][0], 300, points[0][1])
    y = there.predict(frames[0].moved(np.eye(2), shift), points[0][0] + shift, 300, points[0][1] + shift)
    np.testing.assert_allclose(y, x + shift, atol=5e-3)


def test_impossible_arguments_are_refused():
    with pytest.raises(InvalidArgumentError, match="9000 support points; possible: 2 to the number of points"):
        SpatialMixtureOfAttractors(n_support=9000).fit(arcs(2))
    with pytest.raises(InvalidArgumentError, match="no frame 1; possible: 0 to 0"):
        SpatialMixtureOfAttractors(gate_frame=1).fit(arcs(2))
    for name, value in (("n_support", 2.5), ("gate_frame", 0.5), ("margin", np.nan), ("overlap", 2), ("tolerance", 0)):
        with pytest.raises(InvalidArgumentError, match=f"{name} is {value}; possible"):
            SpatialMixtureOfAttractors(**{name: value}).fit(arcs(2))
    with pytest.raises(DemonstrationError, match="not finite"):
        SpatialMixtureOfAttractors().fit([np.full((20, 2), np.nan)])
    moving, moa = Frames.at(np.linspace(0, 1, 30)[:, None, None] * np.ones(2)), SpatialMixtureOfAttractors(**SETTINGS)
    with pytest.raises(InvalidArgumentError, match="the frames move"):
        moa.fit(arcs(1)).predict(moving, np.zeros(2), 30)
