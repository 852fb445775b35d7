"""CylinderGrasp: the features of Table 2.2, one body of three lengths, which grasp was used, and recovery from a slip."""

import math
from itertools import pairwise

import numpy as np
import pytest

from lfd_gym import quaternion
from lfd_gym.envs.cylinder_grasp import LENGTHS, MASS_PER_LENGTH, POSTURES, CylinderGraspEnv, about_its_axis
from lfd_gym.rollout import TeacherPolicy, rollout
from scripted_teachers import cylinder_grasp
from scripted_teachers.cylinder_grasp import APPROACH_INITIAL, LIFT, CylinderGraspTeacher

SEED = 100500


@pytest.fixture(scope="module")
def env():
    """One environment for all tests."""
    return CylinderGraspEnv()


def put(length, posture, yaw=0.4):
    """Options of a reset."""
    return {"setup": {"cylinder": {"position": [0.6, 0.05], "yaw": yaw, "length": length, "posture": posture}}}


def test_a_length_in_single_precision_is_that_length(env) -> None:
    observation, _ = env.reset(seed=SEED, options=put(np.float32(0.24), "standing"))
    assert observation["cylinder"][0] == pytest.approx(0.24, abs=1e-9)


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize(
    ("posture", "inclination"), [("standing", 0.0), ("upside down", math.pi), ("lying", math.pi / 2)]
)
def test_features_tell_length_inclination_and_rotation(env, length, posture, inclination):
    observation, _ = env.reset(seed=SEED, options=put(length, posture))
    expected = length, inclination, 0.4 - math.pi / 2
    n = 3 if posture == "lying" else 2
    assert observation["cylinder"][:n] == pytest.approx(expected[:n], abs=5e-3)
    ends = [observation[f"frame_cylinder_{end}"][:3] for end in ("top", "bottom")]
    assert np.linalg.norm(np.subtract(*ends)) == pytest.approx(length)


@pytest.mark.parametrize("posture", POSTURES)
def test_the_cylinder_rests_on_one_set_of_geoms_and_weighs_by_its_length(env, posture):
    for length in LENGTHS:
        before, _ = env.reset(seed=SEED, options=put(length, posture))
        still = env.action_layout.encode(before["tool_position"], before["tool_quaternion"], hand=np.zeros(4))
        for _ in range(100):
            after, *_ = env.step(still)
        assert after["frame_cylinder"][:3] == pytest.approx(before["frame_cylinder"][:3], abs=1e-4)
        assert abs(after["frame_cylinder"][3:] @ before["frame_cylinder"][3:]) == pytest.approx(1.0)
        touching = {env.model.geom(i).name for i in np.unique(env.data.contact.geom)} - {"table"}
        assert touching
        assert all(f"_{round(100 * length)}" in name for name in touching)
        assert env.model.body("cylinder").mass[0] == pytest.approx(MASS_PER_LENGTH * length)


def test_a_tracker_sees_the_axis_alone():
    rng = np.random.default_rng(0)
    for _ in range(100):
        q = quaternion.from_rotation_vector(rng.uniform(-2.0, 2.0, 3))
        rolled = quaternion.multiply(q, quaternion.from_rotation_vector(np.array([0.0, 0.0, rng.uniform(-3.0, 3.0)])))
        seen = about_its_axis(q)
        assert seen == pytest.approx(about_its_axis(rolled), abs=1e-9)
        z = np.array([0.0, 0.0, 1.0])
        assert quaternion.rotate(seen, z) == pytest.approx(quaternion.rotate(q, z))


def test_the_grasp_is_told_apart_from_the_demonstrated_one(env, monkeypatch):
    policy = TeacherPolicy(CylinderGraspTeacher(noise=0.0))
    *_, pinched = rollout(env, policy, SEED, put(LENGTHS[1], "lying"))
    assert pinched.info["is_success"]
    assert pinched.info["subtask/demonstrated_grasp"]
    monkeypatch.setattr(cylinder_grasp, "MEDIUM", (0.0, 0.0))
    *_, caged = rollout(env, policy, SEED, put(LENGTHS[1], "lying"))
    assert caged.info["is_success"]
    assert not caged.info["subtask/demonstrated_grasp"]


def test_after_a_slip_the_teacher_starts_over(env, monkeypatch):
    grips = iter([-cylinder_grasp.FIRM])
    firm = CylinderGraspTeacher._closed
    monkeypatch.setattr(CylinderGraspTeacher, "_closed", lambda self, pinch: firm(self, pinch) + next(grips, 0.0))
    labels, held = [], None
    for step in rollout(env, TeacherPolicy(CylinderGraspTeacher(noise=0.0)), SEED, put(LENGTHS[1], "standing")):
        label = int(step.state[0][0])
        if not labels or labels[-1] != label:
            labels.append(label)
        held = step.info["is_success"]
    assert (LIFT, APPROACH_INITIAL) in pairwise(labels)
    assert labels[-1] == LIFT
    assert held
