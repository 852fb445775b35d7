"""BoxFlipping: the box turns because it is pressed, lies where the setup says, and counts as flipped when it is left."""

import numpy as np
import pytest
from placed_arm import succeeds_with_tool_at

from lfd_gym import quaternion, wam
from lfd_gym.envs.box_flipping import BOX_HALF, BoxFlippingEnv
from lfd_gym.errors import InvalidArgumentError, InvalidSetupError
from lfd_gym.rollout import TeacherPolicy, rollout
from scripted_teachers.box_flipping import FLIP, BoxFlippingTeacher

SEED = 100500


@pytest.fixture(scope="module")
def env():
    """One environment for all tests."""
    return BoxFlippingEnv()


def steps(env, seed, **teacher):
    """An episode of the teacher."""
    return list(rollout(env, TeacherPolicy(BoxFlippingTeacher(**teacher)), seed))


def test_teacher_flips_the_box_and_presses_as_it_says(env):
    episode = steps(env, SEED, noise=0.0, press=8.0)
    assert episode[-1].info["is_success"]
    assert episode[-1].info["turned"] == pytest.approx(np.pi / 2, abs=np.radians(5.0))
    radial = []
    for step in episode:
        seen = step.next_observation
        if step.state[0][0] == FLIP and np.radians(5.0) < step.info["turned"] < np.radians(70.0):
            frame = seen["frame_obstacle_edge"]
            axes = quaternion.to_matrix(frame[3:])[:, :2]
            outwards = axes @ axes.T @ (seen["tool_position"] - frame[:3])
            radial.append(seen["wrench"][:3] @ outwards / np.linalg.norm(outwards))
    assert np.mean(radial) == pytest.approx(8.0, rel=0.2)


@pytest.mark.parametrize("seed", range(SEED, SEED + 3))
def test_a_press_below_one_newton_flips_nothing(env, seed):
    episode = steps(env, seed, noise=0.0, press=0.9)
    assert any(step.info["subtask/at_obstacle"] for step in episode)
    assert not any(step.info["subtask/tilted"] for step in episode)


def test_half_the_weight_needs_more_than_one_newton(env):
    masses = []
    for seed in range(SEED, SEED + 50):
        env.reset(seed=seed)
        masses.append(float(env._mass[0]))
    assert min(masses) * 9.81 / 2 > 0.9 * wam.MAX_FINGERTIP_FRICTION


def test_friction_of_the_box_is_that_of_the_pairs(env):
    env.reset(seed=SEED)
    for _ in range(5):
        env.step(np.zeros(13))
    box = env.model.geom("box").id
    contacts = [c for c in env.data.contact if box in c.geom]
    assert len(contacts) == 4
    assert all(c.friction[0] == env._friction[0, 0] < 0.3 for c in contacts)


def test_setup_puts_the_box_before_the_obstacle(env):
    env.reset(
        options={
            "setup": {
                "obstacle": {"position": [0.58, -0.3], "yaw": 0.0},
                "box": {"position": [0.60, -0.12], "yaw": 0.0},
            }
        }
    )
    assert env._gap() == pytest.approx(0.18 - BOX_HALF[1])
    assert env.measures()["turned"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("setup", "what"),
    [
        ({"obstacle": {"yaw": 1.0}}, "yaw of 'obstacle'"),
        ({"box": {"position": [0.6, 0.5]}}, "gap"),
        ({"obstacle": {"position": [0.58, -0.3], "yaw": 0.0}, "box": {"position": [0.7, -0.12], "yaw": 0.0}}, "along"),
    ],
)
def test_impossible_setups_say_what_is_possible(env, setup, what):
    with pytest.raises(InvalidSetupError, match=what):
        env.reset(seed=SEED, options={"setup": setup})


def test_a_press_above_the_limit_is_refused():
    with pytest.raises(InvalidArgumentError, match="up to 15"):
        BoxFlippingTeacher(press=30.0)


def succeeds(env, turned=90.0, leaning=0.0, up=0.0, twist=(0,) * 6, tool=(0.0, 0.0, 0.25)):
    """With the box at the obstacle so far turned [degrees] and moving, and the tool so far from it."""
    env.reset(seed=SEED, options={"setup": {"obstacle": {"position": [0.58, -0.3], "yaw": 0.0}}})
    body, place = env.data.joint("box_joint"), np.array([0.58, -0.265, BOX_HALF[1] + up])
    turn, lean = np.radians([turned, 0.0, 0.0]), np.radians([0.0, leaning, 0.0])
    body.qpos[:3] = place
    body.qpos[3:] = quaternion.multiply(*map(quaternion.from_rotation_vector, (lean, turn)))
    body.qvel[:] = twist
    return succeeds_with_tool_at(env, place + tool)


@pytest.mark.parametrize(
    ("inside", "outside"),
    [
        ({"turned": 85.2}, {"turned": 84.8}),
        ({"turned": 94.8}, {"turned": 95.2}),
        ({"turned": 90.0}, {"turned": -90.0}),
        ({"leaning": 4.8}, {"leaning": 5.2}),
        ({"up": 0.009}, {"up": 0.011}),
        ({"twist": (0, -0.019, 0, 0, 0, 0)}, {"twist": (0, -0.021, 0, 0, 0, 0)}),
        ({"twist": (0, 0, 0, -0.09, 0, 0)}, {"twist": (0, 0, 0, -0.11, 0, 0)}),
        ({"tool": (0.0, 0.0, 0.161)}, {"tool": (0.0, 0.0, 0.159)}),
        ({"tool": (-0.165, 0.05, 0.038)}, {"tool": (-0.165, 0.05, 0.034)}),
    ],
    ids=["short", "beyond", "other face", "leaning", "height", "speed", "turning", "tool", "fingertip"],
)
def test_success_needs_the_box_on_its_other_face_at_rest_and_left(env, inside, outside):
    assert succeeds(env, **inside)
    assert not succeeds(env, **outside)
