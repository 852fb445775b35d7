"""The robot is the published one: kinematics, limits, inertias, hand, drives and wrist sensor."""

import mujoco
import numpy as np
import pytest
from bare_robot import BareRobot, hand_spec
from placed_arm import inverse_kinematics

from lfd_gym import wam

DH = (
    (0.0, -90.0, 0.0),
    (0.0, 90.0, 0.0),
    (0.045, -90.0, 0.55),
    (-0.045, 90.0, 0.0),
    (0.0, -90.0, 0.3),
    (0.0, 90.0, 0.0),
    (0.0, 0.0, 0.0609),
)
"""a [m], alpha [degrees], d [m] of every joint: WAM user manual D1001, table 5."""
SHOULDER = (0.0, 0.0, -0.10 + 0.346)
"""The base stands 10 cm below the table."""
RANGES = ((-2.6, 2.6), (-2.0, 2.0), (-2.8, 2.8), (-0.9, 3.1), (-4.76, 1.24), (-1.6, 1.6), (-3.0, 3.0))
TORQUES = (77.3, 160.6, 95.6, 29.4, 11.6, 11.6, 2.7)
ARMATURE = (0.2052, 0.1888, 0.0669, 0.0346, 0.0032, 0.0032, 0.00032)
VISCOUS = (1.27, 1.15, 0.41, 0.23, 0.016, 0.016, 0.003)
COULOMB = (0.8, 0.8, 0.5, 0.4, 0.1, 0.1, 0.03)
LINKS = (
    (10.7677, (-4.43, -0.66, -121.89), (0.134880, 0.090463, 0.113284), (-1.25e-4, 2.13e-3, -6.86e-4)),
    (3.8749, (-2.37, 31.06, 15.42), (0.021410, 0.013779, 0.015589), (2.72e-4, 2.46e-5, -1.82e-3)),
    (1.8023, (6.74, 0.03, 342.49), (0.059111, 0.059270, 0.003246), (7.4e-6, 2.50e-3, 1.8e-5)),
    (2.1727, (-39.47, 0.07, 119.28), (0.010675, 0.010587, 0.002820), (4.5e-5, -1.36e-3, -1.1e-4)),
    (0.3566, (0.05, 1.48, -28.86), (0.000371, 0.000382, 0.000194), (0.0, 0.0, 1.6e-5)),
    (0.4092, (-0.06, -16.86, 24.19), (0.000549, 0.000238, 0.000451), (0.0, 0.0, -4.4e-5)),
    (0.0755, (0.15, 0.07, 57.55), (0.000039, 0.000039, 0.000076), (0.0, 0.0, 0.0)),
)
"""Mass [kg], centre [mm], moments and products (xy, xz, yz) [kg m^2], in frames parallel to the base at zero angles."""
ORIGINS = ((0, 0, 0.346), (0, 0, 0), (0, 0, 0), (0.045, 0, 0.55), (-0.045, 0, 0.3), (0, 0, 0), (0, 0, 0))
AXES = "zyzyzyz"
SENSOR_MASS, HAND_MASS = 0.136, 0.664 + 3 * 0.179
FINGERTIPS = {0: (161, 116), 34: (108, 172), 45: (84, 181), 60: (52, 184), 70: (31, 180), 80: (11, 172), 90: (-6, 160)}
"""Finger angle [degrees]: distance from the hand's axis and height over its base [mm] of a fingertip 58 mm long, computed
without the 3 mm by which the distal axis lies off the inner link."""
G = 9.81


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return hand_spec().compile()


@pytest.fixture
def data(model: mujoco.MjModel) -> mujoco.MjData:
    return mujoco.MjData(model)


def random_postures(n: int, seed: int = 0) -> np.ndarray:
    low, high = np.array(RANGES).T
    return np.random.default_rng(seed).uniform(low, high, (n, 7))


def turn(axis: str, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) if axis == "z" else np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def denavit_hartenberg(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and rotation of the tool plate in the world, from the published table."""
    position, rotation = np.array(SHOULDER), np.eye(3)
    for angle, (a, alpha, d) in zip(angles, DH, strict=True):
        rotation = rotation @ turn("z", angle)
        position = position + rotation @ np.array([a, 0.0, d])
        c, s = np.cos(np.radians(alpha)), np.sin(np.radians(alpha))
        rotation = rotation @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return position, rotation


def test_forward_kinematics_are_those_of_the_published_table(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    for angles in random_postures(20):
        data.qpos[:7] = angles
        mujoco.mj_kinematics(model, data)
        position, rotation = denavit_hartenberg(angles)
        plate = data.body("wrist_sensor_body")
        np.testing.assert_allclose(plate.xpos, position, atol=1e-9)
        np.testing.assert_allclose(plate.xmat.reshape(3, 3), rotation, atol=1e-9)


def test_the_hand_sits_on_the_wrist_sensor(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.body("hand/hand").xpos, [0, 0, SHOULDER[2] + 0.55 + 0.3 + 0.0729], atol=1e-9)
    np.testing.assert_allclose(data.site("hand/tool").xpos - data.body("hand/hand").xpos, [0, 0, 0.172], atol=1e-9)


def test_joint_ranges_and_torque_limits_are_the_published_ones(model: mujoco.MjModel) -> None:
    np.testing.assert_allclose(model.jnt_range[:7], RANGES)
    np.testing.assert_allclose(model.actuator_ctrlrange[:7], np.outer(TORQUES, (-1, 1)))
    assert [model.joint(i).name for i in range(7)] == [f"wam_joint_{i}" for i in range(1, 8)]
    assert all(model.jnt_limited[:7])


def test_drives_have_the_published_inertia_and_friction(model: mujoco.MjModel) -> None:
    np.testing.assert_allclose(model.dof_armature[:7], ARMATURE)
    np.testing.assert_allclose(model.dof_damping[:7], VISCOUS)
    np.testing.assert_allclose(model.dof_frictionloss[:7], COULOMB)


def test_links_have_the_published_masses_centres_and_inertias(model: mujoco.MjModel) -> None:
    for i, (mass, centre, moments, products) in enumerate(LINKS, start=1):
        body = model.body(f"wam_link_{i}")
        assert body.mass[0] == pytest.approx(mass)
        np.testing.assert_allclose(body.ipos, np.array(centre) / 1000, atol=1e-9)
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, body.iquat)
        r = rotation.reshape(3, 3)
        xy, xz, yz = products
        published = np.diag(moments) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
        np.testing.assert_allclose(r @ np.diag(body.inertia) @ r.T, published, atol=1e-8)


def test_the_wrist_carries_the_masses_of_sensor_and_hand(model: mujoco.MjModel) -> None:
    assert model.body("wrist_sensor_body").mass[0] == pytest.approx(SENSOR_MASS)
    assert model.body("hand/hand").subtreemass[0] == pytest.approx(HAND_MASS, abs=1e-6)
    for finger in (1, 2, 3):
        assert model.body(f"hand/finger_{finger}_knuckle").subtreemass[0] == pytest.approx(0.179, abs=1e-6)


def test_gravity_torques_are_the_sum_over_the_links(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    hand = model.body("hand/hand")
    mujoco.mj_forward(model, data)
    hand_centre = data.body("hand/hand").subtree_com - data.body("wam_link_7").xpos
    for angles in random_postures(20, seed=1):
        data.qpos[:7] = angles
        mujoco.mj_forward(model, data)
        position, rotation = np.array([0.0, 0.0, -0.10]), np.eye(3)
        anchors, axes, torque = [], [], np.zeros(7)
        for i in range(7):
            position = position + rotation @ np.array(ORIGINS[i])
            anchors.append(position)
            axes.append(rotation @ np.eye(3)["xyz".index(AXES[i])])
            rotation = rotation @ turn(AXES[i], angles[i])
            weights = [(LINKS[i][0], np.array(LINKS[i][1]) / 1000)]
            if i == 6:
                weights += [(SENSOR_MASS, np.array([0, 0, 0.0669])), (hand.subtreemass[0], hand_centre)]
            for mass, centre in weights:
                for j in range(i + 1):
                    lever = position + rotation @ centre - anchors[j]
                    torque[j] += axes[j] @ np.cross(lever, [0, 0, mass * G])
        np.testing.assert_allclose(data.qfrc_bias[:7], torque, atol=1e-6)


@pytest.mark.parametrize("finger", [1, 2, 3])
def test_fingertips_move_along_the_published_curve(model: mujoco.MjModel, data: mujoco.MjData, finger: int) -> None:
    outward = 1.0 if finger == 3 else -1.0
    for degrees, (r, z) in FINGERTIPS.items():
        data.joint(f"hand/finger_{finger}_proximal").qpos = np.radians(degrees)
        data.joint(f"hand/finger_{finger}_distal").qpos = np.radians(degrees) / 3
        mujoco.mj_kinematics(model, data)
        base, outer = data.body("hand/hand"), data.body(f"hand/finger_{finger}_outer")
        to_hand = base.xmat.reshape(3, 3).T
        tip = to_hand @ (outer.xpos + outer.xmat.reshape(3, 3) @ np.array([0, 0.058, 0]) - base.xpos)
        assert 1000 * outward * tip[1] == pytest.approx(r, abs=4.0)
        assert 1000 * tip[2] == pytest.approx(z, abs=4.0)
        q, outer_angle = np.radians(degrees), np.radians(degrees * 4 / 3 + 45)
        closed_form = (
            0.05 + 0.06994 * np.cos(q) - 0.003 * np.sin(q) + 0.058 * np.cos(outer_angle),
            0.0754 + 0.06994 * np.sin(q) + 0.003 * np.cos(q) + 0.058 * np.sin(outer_angle),
        )
        np.testing.assert_allclose((outward * tip[1], tip[2]), closed_form, atol=1e-6)
        assert tip[0] == pytest.approx({1: -0.025, 2: 0.025, 3: 0.0}[finger], abs=1e-9)


def test_distal_joints_follow_the_proximal_ones() -> None:
    bare = BareRobot(hand_spec())
    for angle in (0.6, 1.5, 2.4):
        bare.command(hand=[0.0, angle, angle, angle])
        bare.run(1.0)
        for finger in (1, 2, 3):
            proximal = bare.data.joint(f"hand/finger_{finger}_proximal").qpos[0]
            distal = bare.data.joint(f"hand/finger_{finger}_distal").qpos[0]
            assert proximal == pytest.approx(angle, abs=0.05)
            assert distal == pytest.approx(proximal * 48 / 140, abs=0.01)


def test_one_motor_spreads_two_fingers_in_opposite_directions() -> None:
    bare = BareRobot(hand_spec())
    bare.command(hand=[1.0, 0.0, 0.0, 0.0])
    bare.run(1.0)
    hand = bare.data.body("hand/hand")
    tips = [hand.xmat.reshape(3, 3).T @ (bare.data.body(f"hand/finger_{i}_inner").xpos - hand.xpos) for i in (1, 2)]
    assert bare.data.joint("hand/finger_1_spread").qpos[0] == pytest.approx(1.0, abs=0.02)
    assert bare.data.joint("hand/finger_2_spread").qpos[0] == pytest.approx(1.0, abs=0.02)
    np.testing.assert_allclose(tips[0], tips[1] * [-1, 1, 1], atol=1e-3)
    # spread around the palm's corners, away from each other: 25 mm + 50 mm sin(1)
    assert tips[1][0] == pytest.approx(0.025 + 0.05 * np.sin(1.0), abs=2e-3)


def test_a_blocked_finger_stalls_at_its_torque_and_cannot_be_driven_back() -> None:
    spec = hand_spec()
    spec.body("wrist_sensor_body").add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.025, 0.06, 0], pos=[0, 0, 0.16], mass=0, contype=1, conaffinity=2
    )
    bare = BareRobot(spec)
    bare.command(hand=[0.0, 2.4, 2.4, 2.4])
    bare.run(1.5)
    drive, joint = bare.data.actuator("hand/finger_3_drive"), bare.data.joint("hand/finger_3_proximal")
    blocked = float(joint.qpos[0])
    assert blocked < 2.0
    assert drive.force[0] == pytest.approx(wam.HAND_STALL[3], abs=0.05)
    held = float(bare.memory["hand"][3])
    joint.qfrc_applied[:] = -2.0
    bare.run(1.0)
    assert bare.memory["hand"][3] == pytest.approx(held, abs=1e-3)
    pushed = blocked - float(joint.qpos[0])
    # the drive does not turn: what gives is its spring of 20 N m/rad
    assert pushed < 2.0 / 20.0 + 0.01
    joint.qfrc_applied[:] = 0.0
    bare.run(1.0)
    assert joint.qpos[0] == pytest.approx(blocked, abs=0.01)


def test_the_hand_opens_and_closes_in_a_second() -> None:
    bare = BareRobot(hand_spec())
    for goal in (2.44, 0.0):
        bare.command(hand=[0.0, goal, goal, goal])
        bare.run(0.5)
        assert bare.data.joint("hand/finger_1_proximal").qpos[0] == pytest.approx(1.22, abs=0.15)
        bare.run(0.6)
        assert bare.data.joint("hand/finger_1_proximal").qpos[0] == pytest.approx(goal, abs=0.05)


def hold_still(bare: BareRobot, hung: float = 0.0, offset: np.ndarray | None = None) -> None:
    """Torques that carry the arm's weight and `hung` kilograms at `offset` from the hand."""
    body = bare.model.body("hand/hand").id
    jacobian = np.zeros((3, bare.model.nv))

    def carry(time: float) -> None:
        bare.data.ctrl[:7] = bare.data.qfrc_bias[:7]
        if offset is not None:
            point = bare.data.xpos[body] + bare.data.xmat[body].reshape(3, 3) @ offset
            mujoco.mj_jac(bare.model, bare.data, jacobian, None, point, body)
            bare.data.ctrl[:7] += jacobian[2, :7] * hung * G

    bare.run(0.6, carry)
    bare.wrench()
    bare.run(0.02, carry)


def test_at_rest_in_free_space_the_wrench_is_zero_in_every_orientation() -> None:
    bare = BareRobot(hand_spec())
    for angles in random_postures(20, seed=2):
        bare.stand(0.9 * angles)
        hold_still(bare)
        wrench = bare.wrench()
        assert np.abs(bare.data.qvel[:7]).max() < 1e-3
        assert np.linalg.norm(wrench[:3]) < 0.2
        assert np.linalg.norm(wrench[3:]) < 0.02


def test_a_hung_kilogram_reads_its_weight_in_every_orientation() -> None:
    offset = np.array([0.03, -0.02, 0.20])
    spec = hand_spec()
    ball = spec.worldbody.add_body(name="ball")
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], mass=1.0, contype=0, conaffinity=0)
    spec.add_equality(
        name="hung",
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        name1="hand/hand",
        name2="ball",
        data=[0, 0, 0, *offset, 1, 0, 0, 0, 1, 0],
    )
    bare = BareRobot(spec)
    hand = bare.data.body("hand/hand")
    for angles in random_postures(20, seed=3):
        bare.stand(0.9 * angles)
        pose = bare.data.joint(bare.model.body("ball").jntadr[0]).qpos
        pose[:3], pose[3:] = hand.xpos + hand.xmat.reshape(3, 3) @ offset, hand.xquat
        mujoco.mj_forward(bare.model, bare.data)
        hold_still(bare, 1.0, offset)
        wrench = bare.wrench()
        weight = np.array([0.0, 0.0, -G])
        lever = bare.data.body("ball").xpos - bare.data.site("hand/wrist_sensor").xpos
        np.testing.assert_allclose(wrench[:3], weight, atol=0.2)
        np.testing.assert_allclose(wrench[3:], np.cross(lever, weight), atol=0.03)


def test_inverse_kinematics_reach_what_forward_kinematics_say(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    position = np.array([0.62, 0.2, 0.1])
    angles = inverse_kinematics(model, "hand", position, wam.TOOL_DOWN)
    assert angles is not None
    data.qpos[:7] = angles
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.site("hand/tool").xpos, position, atol=1e-4)
    np.testing.assert_allclose(data.site("hand/tool").xmat.reshape(3, 3), np.diag([-1, 1, -1]), atol=1e-3)
    assert inverse_kinematics(model, "hand", np.array([1.6, 0.0, 0.1]), wam.TOOL_DOWN) is None
