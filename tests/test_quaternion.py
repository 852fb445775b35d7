"""Quaternions against scipy's rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lfd_gym import quaternion

RNG = np.random.default_rng(0)
QUATERNIONS = Rotation.random(50, rng=RNG).as_quat(scalar_first=True) * RNG.choice([-1.0, 1.0], (50, 1))
PAIRS = list(zip(QUATERNIONS, np.roll(QUATERNIONS, 1, axis=0), strict=True))


def rotation(q: np.ndarray) -> Rotation:
    return Rotation.from_quat(q, scalar_first=True)


def same(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two quaternions stand for the same orientation."""
    return abs(abs(a @ b) - 1.0) < 1e-12


def test_products_compose_rotations() -> None:
    for a, b in PAIRS:
        assert same(quaternion.multiply(a, b), (rotation(a) * rotation(b)).as_quat(scalar_first=True))


def test_conjugates_are_inverses() -> None:
    for q in QUATERNIONS:
        np.testing.assert_allclose(quaternion.multiply(q, quaternion.conjugate(q)), [1, 0, 0, 0], atol=1e-12)


def test_vectors_turn_as_by_matrices() -> None:
    for q, v in zip(QUATERNIONS, RNG.normal(size=(50, 3)), strict=True):
        np.testing.assert_allclose(quaternion.rotate(q, v), rotation(q).apply(v), atol=1e-12)
        np.testing.assert_allclose(quaternion.to_matrix(q), rotation(q).as_matrix(), atol=1e-12)


def test_matrices_come_back_in_all_four_cases() -> None:
    half_turns = np.concatenate([np.eye(4), Rotation.from_rotvec(3.1 * np.eye(3)).as_quat(scalar_first=True)])
    for q in np.concatenate([QUATERNIONS, half_turns]):
        back = quaternion.from_matrix(quaternion.to_matrix(q))
        assert same(back, q)
        assert back[0] >= 0.0


def test_rotation_vectors_are_exponential_and_logarithm() -> None:
    for q in QUATERNIONS:
        r = quaternion.to_rotation_vector(q)
        np.testing.assert_allclose(r, rotation(q).as_rotvec(), atol=1e-12)
        assert np.linalg.norm(r) <= np.pi + 1e-12
        assert same(quaternion.from_rotation_vector(r), q)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 0.9e-4, 1.1e-4, 1e-3, np.pi - 1e-9])
def test_small_and_large_angles_keep_their_precision(angle: float) -> None:
    r = angle * np.array([0.6, -0.48, 0.64])
    q = quaternion.from_rotation_vector(r)
    np.testing.assert_allclose(q, Rotation.from_rotvec(r).as_quat(scalar_first=True), atol=1e-15, rtol=1e-12)
    np.testing.assert_allclose(quaternion.to_rotation_vector(q), r, atol=1e-15, rtol=1e-9)


def test_the_canonical_sign_is_that_of_positive_w() -> None:
    for q in QUATERNIONS:
        np.testing.assert_array_equal(quaternion.canonical(q), q if q[0] >= 0 else -q)


def test_yaw_is_the_turn_about_the_vertical() -> None:
    for angle in np.linspace(-3.1, 3.1, 13):
        assert quaternion.yaw(Rotation.from_euler("z", angle).as_quat(scalar_first=True)) == pytest.approx(angle)
    for q in QUATERNIONS:
        x, y, _ = rotation(q).apply([1.0, 0.0, 0.0])
        assert quaternion.yaw(q) == pytest.approx(np.arctan2(y, x))


def test_arguments_stay_as_they_are() -> None:
    a, b, v = QUATERNIONS[0].copy(), QUATERNIONS[1].copy(), np.ones(3)
    copies = a.copy(), b.copy(), v.copy()
    for result in (quaternion.multiply(a, b), quaternion.canonical(a), quaternion.rotate(a, v)):
        result += 1.0
    for left, right in zip((a, b, v), copies, strict=True):
        np.testing.assert_array_equal(left, right)
