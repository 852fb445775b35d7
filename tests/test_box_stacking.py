"""BoxStacking: what counts as a stack, and what a tracker sees of boxes that look the same from four sides."""

import math

import numpy as np
import pytest

from lfd_gym.envs.box_stacking import SIZE, BoxStackingEnv
from lfd_gym.envs.setups import upright
from scripted_teachers.box_stacking import BoxStackingTeacher

SEED = 100500
PLACES = {"box_yellow": [0.60, 0.20], "box_green": [0.53, -0.03], "box_red": [0.6, -0.28], "box_blue": [0.7, -0.1]}


@pytest.fixture(scope="module")
def env():
    """One environment for all tests."""
    return BoxStackingEnv()


def stand(env, order, offset=0.0, yaw=0.0):
    """Boxes on top of each other, each moved and turned against the one below; the info after one step."""
    observation, _ = env.reset(seed=SEED, options={"setup": {n: {"position": p} for n, p in PLACES.items()}})
    for level, name in enumerate(order):
        pose = env.data.joint(f"box_{name}_joint").qpos
        pose[:3] = 0.60 + level * offset, 0.20, (level + 0.5) * SIZE
        pose[3:] = upright(level * yaw)
    still = env.action_layout.encode(
        observation["tool_position"], observation["tool_quaternion"], hand=observation["hand_position"]
    )
    for _ in range(60):
        *_, info = env.step(still)
    return info


def test_four_boxes_in_order_are_a_stack(env):
    assert stand(env, ("yellow", "green", "red", "blue"), 0.015)["is_success"]


def test_another_order_or_too_large_an_offset_is_not(env):
    assert not stand(env, ("yellow", "red", "green", "blue"))["is_success"]
    wide = stand(env, ("yellow", "green", "red", "blue"), 0.021)
    assert not wide["is_success"]
    assert not wide["subtask/red_on_green"]


def test_errors_are_those_to_the_box_below(env):
    info = stand(env, ("yellow", "green", "red", "blue"), 0.012, math.radians(80.0))
    for name in ("green", "red", "blue"):
        assert info[f"placement_error/{name}"] == pytest.approx(0.012, abs=5e-4)
        assert info[f"yaw_error/{name}"] == pytest.approx(math.radians(10.0), abs=5e-3)


def test_a_quarter_turn_is_not_seen(env):
    seen = []
    for turns in range(-2, 3):
        setup = {n: {"position": p, "yaw": 0.7 + turns * math.pi / 2} for n, p in PLACES.items()}
        seen.append(env.reset(seed=SEED, options={"setup": setup})[0]["frame_box_red"])
    assert np.allclose(seen, seen[0])


def test_the_teacher_has_the_thirteen_primitives_of_the_thesis():
    rows = BoxStackingTeacher.primitives
    assert len({row.position.primitive for row in rows}) == 7
    assert len({row.orientation.primitive for row in rows}) == 4
    assert len({row.hand.primitive for row in rows}) == 2
    for entity in ("position", "orientation"):
        frames = {(getattr(row, entity).primitive, getattr(row, entity).frame) for row in rows}
        assert len(frames) == len({primitive for primitive, _ in frames})
