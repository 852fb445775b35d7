"""The layout of the action vector: what encodes and decodes is the same goal."""

import json

import numpy as np
import pytest
from bare_robot import LAYOUT
from scipy.spatial.transform import Rotation

from lfd_gym import quaternion, wam
from lfd_gym.action import DEAD_ZONE, ActionLayout
from lfd_gym.errors import InvalidActionError

ROTATION = np.array([0.2, -0.3, 1.1])
TURNED = quaternion.multiply(quaternion.from_rotation_vector(ROTATION), wam.TOOL_DOWN)
POSITION, HAND = np.array([0.5, -0.1, 0.2]), np.array([0.5, 1.0, 1.5, 2.0])
RESOLUTION = 1e-6
"""A float32 in [-1, 1] resolves 6e-8 of a range of at most 2 m, 3.2 rad or 40 N."""


def without_hand() -> ActionLayout:
    return ActionLayout.from_dict({**LAYOUT.to_dict(), "hand_low": [], "hand_high": []})


def test_decoding_is_the_inverse_of_encoding() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        position = rng.uniform(LAYOUT.workspace_low, LAYOUT.workspace_high)
        r = rng.uniform(-LAYOUT.rotation_limit, LAYOUT.rotation_limit)
        q = quaternion.multiply(quaternion.from_rotation_vector(r), LAYOUT.reference_quaternion)
        force = Rotation.random(rng=rng).apply([rng.uniform(0.0, LAYOUT.force_limit * 0.999), 0.0, 0.0])
        hand = rng.uniform(LAYOUT.hand_low, LAYOUT.hand_high)
        goal = LAYOUT.decode(LAYOUT.encode(position, q, force, hand))
        np.testing.assert_allclose(goal.position, position, atol=RESOLUTION)
        assert abs(goal.quaternion @ q) == pytest.approx(1.0, abs=1e-10)
        np.testing.assert_allclose(goal.force, force, atol=5 * RESOLUTION)
        np.testing.assert_allclose(goal.hand, hand, atol=RESOLUTION)


def test_encoding_is_the_inverse_of_decoding() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        action = rng.uniform(-1.0, 1.0, 13).astype(np.float32)
        direction = rng.normal(size=3)
        action[6:9] = direction / np.linalg.norm(direction) * rng.uniform(DEAD_ZONE + 0.01, 1.0)
        np.testing.assert_allclose(LAYOUT.encode(*LAYOUT.decode(action)), action, atol=1e-5)


def test_the_parts_have_the_meaning_of_the_table() -> None:
    action = np.zeros(13)
    goal = LAYOUT.decode(action)
    np.testing.assert_allclose(goal.position, 0.5 * (LAYOUT.workspace_low + LAYOUT.workspace_high))
    np.testing.assert_allclose(goal.quaternion, wam.TOOL_DOWN)
    np.testing.assert_allclose(goal.force, 0.0)
    np.testing.assert_allclose(goal.hand, 0.5 * (LAYOUT.hand_low + LAYOUT.hand_high))
    action[[0, 5, 8, 9]] = 1.0
    goal = LAYOUT.decode(action)
    assert goal.position[0] == pytest.approx(LAYOUT.workspace_high[0])
    turn = Rotation.from_quat(goal.quaternion, scalar_first=True).as_matrix()
    # R_goal = exp(r) R_ref in world axes, the reference is diag(-1, 1, -1)
    expected = Rotation.from_rotvec([0, 0, LAYOUT.rotation_limit[2]]).as_matrix() @ np.diag([-1, 1, -1])
    np.testing.assert_allclose(turn, expected, atol=1e-12)
    np.testing.assert_allclose(goal.force, [0, 0, LAYOUT.force_limit])
    assert goal.hand[0] == pytest.approx(np.pi)


@pytest.mark.parametrize("length", [0.0, 0.1, 0.249])
def test_in_the_dead_zone_there_is_no_force(length: float) -> None:
    action = np.zeros(13)
    action[6:9] = length * np.array([0.6, 0.0, -0.8])
    np.testing.assert_array_equal(LAYOUT.decode(action).force, 0.0)


def test_force_starts_from_zero_at_the_border_of_the_dead_zone() -> None:
    action = np.zeros(13)
    for length, expected in ((0.2501, 0.0), (0.625, 0.5), (1.0, 1.0)):
        action[8] = -length
        np.testing.assert_allclose(LAYOUT.decode(action).force, [0, 0, -expected * LAYOUT.force_limit], atol=0.01)


def test_a_force_beyond_the_limit_keeps_its_direction() -> None:
    action = np.zeros(13)
    action[6:9] = (1.0, -1.0, 1.0)
    force = LAYOUT.decode(action).force
    np.testing.assert_allclose(force, LAYOUT.force_limit / np.sqrt(3) * np.array([1, -1, 1]))
    encoded = LAYOUT.encode(POSITION, TURNED, [0.0, 0.0, 100.0], HAND)
    np.testing.assert_allclose(LAYOUT.decode(encoded).force, [0, 0, LAYOUT.force_limit], rtol=1e-6)


def test_goals_outside_the_box_are_clipped() -> None:
    encoded = LAYOUT.encode([9.0, -9.0, 0.1], TURNED, [0, 0, 0], [-1.0, 9.0, 1.0, 1.0])
    assert encoded.dtype == np.float32
    assert np.abs(encoded).max() <= 1.0
    goal = LAYOUT.decode(encoded)
    np.testing.assert_allclose(goal.position, [0.9, -0.5, 0.1], atol=RESOLUTION)
    np.testing.assert_allclose(goal.hand, [0.0, 2.44, 1.0, 1.0], atol=RESOLUTION)


def test_finite_actions_outside_the_box_are_clipped() -> None:
    wild = np.linspace(-7.0, 7.0, 13)
    for clipped, goal in zip(LAYOUT.decode(np.clip(wild, -1, 1)), LAYOUT.decode(wild), strict=True):
        np.testing.assert_array_equal(clipped, goal)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("index", range(13))
def test_an_action_that_is_not_finite_is_refused(value: float, index: int) -> None:
    action = np.zeros(13)
    action[index] = value
    with pytest.raises(InvalidActionError, match=f"component {index};"):
        LAYOUT.decode(action)


@pytest.mark.parametrize("shape", [(0,), (9,), (12,), (14,), (1, 13), ()])
def test_an_action_of_the_wrong_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InvalidActionError, match=r"expected \(13,\)"):
        LAYOUT.decode(np.zeros(shape))


def test_a_hand_of_the_wrong_size_is_refused() -> None:
    with pytest.raises(InvalidActionError, match="3 hand angles; expected 4"):
        LAYOUT.encode(POSITION, TURNED, [0, 0, 0], [0.0, 0.0, 0.0])


def test_a_tool_without_a_hand_has_nine_components() -> None:
    layout = without_hand()
    assert (layout.size, LAYOUT.size) == (9, 13)
    goal = layout.decode(layout.encode(POSITION, TURNED, [0.0, 0.0, -5.0]))
    assert goal.hand.size == 0
    np.testing.assert_allclose(goal.force, [0, 0, -5.0], atol=5 * RESOLUTION)
    with pytest.raises(InvalidActionError, match="4 hand angles; expected 0"):
        layout.encode(POSITION, TURNED, [0, 0, 0], HAND)


@pytest.mark.parametrize("layout", [LAYOUT, without_hand()])
def test_a_layout_survives_json(layout: ActionLayout) -> None:
    back = ActionLayout.from_dict(json.loads(json.dumps(layout.to_dict())))
    assert back == layout
    assert hash(back) == hash(layout)
    action = np.linspace(-1, 1, layout.size)
    for a, b in zip(back.decode(action), layout.decode(action), strict=True):
        np.testing.assert_array_equal(a, b)


def test_layouts_with_other_numbers_differ() -> None:
    assert ActionLayout.from_dict({**LAYOUT.to_dict(), "force_limit": 19.0}) != LAYOUT
    assert LAYOUT != "a layout"


def test_a_layout_is_frozen_and_owns_its_arrays() -> None:
    low = np.array([0.3, -0.5, 0.0])
    layout = ActionLayout.from_dict({**LAYOUT.to_dict(), "workspace_low": low})
    low[0] = 9.0
    assert layout.workspace_low[0] == 0.3
    with pytest.raises(ValueError, match="read-only"):
        layout.workspace_low[0] = 1.0
