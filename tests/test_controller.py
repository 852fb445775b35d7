"""The controller keeps equation (2.2) and what follows from it: reference, null space, limits."""

import itertools
from dataclasses import replace

import gymnasium
import mujoco
import numpy as np
import pytest
from bare_robot import FAST, LAYOUT, BareRobot, hand_spec

from lfd_gym import attractor, controller, quaternion, wam
from lfd_gym.controller import HybridController
from lfd_gym.registry import ENVIRONMENTS

Array = np.ndarray


def random_state(bare: BareRobot, rng: np.random.Generator) -> None:
    """A random posture with random joint speeds."""
    low, high = bare.model.jnt_range[:7].T
    bare.data.qpos[:7] = rng.uniform(low, high)
    bare.data.qvel[:7] = rng.normal(size=7)
    mujoco.mj_forward(bare.model, bare.data)


def jacobian(bare: BareRobot) -> tuple[Array, Array]:
    """J (6, 7) of the tool point and Jdot qdot (6,), by MuJoCo."""
    model, data = bare.model, bare.data
    site = data.site("hand/tool")
    j, change = np.zeros((6, model.nv)), np.zeros((6, model.nv))
    mujoco.mj_jacSite(model, data, j[:3], j[3:], site.id)
    body = model.site("hand/tool").bodyid[0]
    mujoco.mj_jacDot(model, data, change[:3], change[3:], site.xpos, body)
    return j[:, :7].copy(), change @ data.qvel


def inertia(bare: BareRobot) -> Array:
    """M (7, 7) of the arm."""
    full = np.zeros((bare.model.nv, bare.model.nv))
    mujoco.mj_fullM(bare.model, bare.data, full)
    return full[:7, :7].copy()


@pytest.fixture(scope="module")
def bare() -> BareRobot:
    return BareRobot(hand_spec())


def test_jacobian_and_drift_are_those_of_the_simulation(bare: BareRobot) -> None:
    rng = np.random.default_rng(0)
    j, drift = np.empty((6, 7)), np.empty(6)
    for _ in range(20):
        random_state(bare, rng)
        d = bare.data
        controller.arm_jacobian(d.xanchor, d.xaxis, d.qvel, bare.position, j, drift)
        expected, expected_drift = jacobian(bare)
        np.testing.assert_allclose(j, expected, atol=1e-12)
        np.testing.assert_allclose(drift, expected_drift, atol=1e-9)


def test_the_drift_is_the_acceleration_of_the_tool_at_constant_joint_speed(bare: BareRobot) -> None:
    rng, h = np.random.default_rng(1), 1e-6
    j, drift = np.empty((6, 7)), np.empty(6)
    for _ in range(5):
        random_state(bare, rng)
        start, speed, twists = bare.arm, bare.data.qvel.copy(), []
        d = bare.data
        controller.arm_jacobian(d.xanchor, d.xaxis, d.qvel, bare.position, j, drift)
        expected = drift.copy()
        for side in (-h, h):
            d.qpos[:7] = start + side * speed[:7]
            mujoco.mj_forward(bare.model, d)
            controller.arm_jacobian(d.xanchor, d.xaxis, speed, bare.position, j, drift)
            twists.append(j @ speed[:7])
        np.testing.assert_allclose(expected, (twists[1] - twists[0]) / (2 * h), atol=1e-6)


def test_the_kernel_is_equation_2_2(bare: BareRobot) -> None:
    rng = np.random.default_rng(2)
    low, high = bare.model.jnt_range[:7].T
    hybrid = HybridController(wam.HOME, low, high)
    for case in range(30):
        random_state(bare, rng)
        q, qd, bias = bare.arm, bare.data.qvel[:7].copy(), bare.data.qfrc_bias[:7].copy()
        m = inertia(bare)
        j, drift = jacobian(bare)
        e_x, e_d, e_f = 10.0 * rng.normal(size=(3, 6)) * ([[1.0]] * 3 if case % 2 else [[1.0], [0.0], [0.0]])
        basis = np.linalg.qr(rng.normal(size=(6, case % 7)))[0] if case % 7 else np.zeros((6, 0))
        s = np.eye(6) - basis @ basis.T
        given = (q, qd, m, j, drift, bias, e_x, s, e_f, e_d)
        copies = [a.copy() for a in given]
        torque = hybrid.torque(*given)

        half, centre = 0.5 * (high - low), 0.5 * (high + low)
        beyond = np.maximum(np.abs(q - centre) - 0.75 * half, 0.0)
        xi = 9.0 * qd + 20.0 * (q - wam.HOME) + 200.0 * np.sign(q - centre) * beyond
        m_inverse = np.linalg.inv(m)
        pseudo = m_inverse @ j.T @ np.linalg.inv(j @ m_inverse @ j.T + 1e-6 * np.eye(6))
        reference = (
            m @ pseudo @ s @ (e_x - drift)
            + j.T @ (np.eye(6) - s) @ e_f
            + m @ pseudo @ (np.eye(6) - s) @ (e_d - drift)
            - m @ (np.eye(7) - pseudo @ j) @ xi
            + bias
        )
        np.testing.assert_allclose(torque, reference, rtol=1e-9, atol=1e-9)
        for array, copy in zip(given, copies, strict=True):
            np.testing.assert_array_equal(array, copy)


def test_without_a_selection_everything_is_position_controlled(bare: BareRobot) -> None:
    random_state(bare, np.random.default_rng(3))
    hybrid = HybridController(wam.HOME, *bare.model.jnt_range[:7].T)
    dynamics = (bare.arm, bare.data.qvel[:7], inertia(bare), *jacobian(bare), bare.data.qfrc_bias[:7])
    e_x = np.arange(6.0)
    plain = hybrid.torque(*dynamics, e_x)
    np.testing.assert_array_equal(plain, hybrid.torque(*dynamics, e_x, np.eye(6), np.ones(6), np.ones(6)))


def test_the_tool_accelerates_as_the_controller_asks(bare: BareRobot) -> None:
    rng = np.random.default_rng(4)
    hybrid = HybridController(wam.HOME, *bare.model.jnt_range[:7].T)
    for _ in range(10):
        random_state(bare, rng)
        bare.data.qvel[:7] *= 0.3
        m, bias = inertia(bare), bare.data.qfrc_bias[:7]
        j, drift = jacobian(bare)
        if np.linalg.svd(j)[1][-1] < 0.1:
            continue
        e_x = rng.normal(size=6)
        torque = hybrid.torque(bare.arm, bare.data.qvel[:7], m, j, drift, bias, e_x)
        acceleration = j @ np.linalg.solve(m, torque - bias) + drift
        np.testing.assert_allclose(acceleration, e_x, atol=2e-3)


def test_gravity_compensation_alone_holds_the_arm() -> None:
    frictionless = BareRobot(hand_spec())
    frictionless.model.dof_frictionloss[:] = 0.0
    frictionless.model.dof_damping[:7] = 0.0
    start = frictionless.position

    def compensate(time: float) -> None:
        frictionless.data.ctrl[:7] = frictionless.data.qfrc_bias[:7]

    frictionless.run(5.0, compensate)
    assert np.linalg.norm(frictionless.position - start) < 1e-3


@pytest.mark.parametrize("posture", [wam.HOME, wam.HOME + np.array([0.8, 0.3, -0.4, -0.5, 0.6, 0.3, -0.9])])
def test_a_pose_is_held_for_10_s_within_a_millimetre(posture: Array) -> None:
    bare = BareRobot(hand_spec())
    bare.stand(posture)
    start, orientation, far, turned = bare.position, bare.quaternion, 0.0, 0.0
    for _ in bare.steps(10.0):
        far = max(far, float(np.linalg.norm(bare.position - start)))
        turned = max(turned, angle(bare.quaternion, orientation))
    assert far < 1e-3
    assert turned < np.radians(0.3)


def angle(a: Array, b: Array) -> float:
    """Between two orientations [rad]."""
    return float(2.0 * np.arccos(min(abs(a @ b), 1.0)))


@pytest.mark.parametrize(
    "way",
    [(0.0, 0.30, 0.0), (0.0, -0.30, 0.0), (0.0, 0.0, 0.28), (0.05, 0.2, 0.2)],
    ids=["left", "right", "up", "across"],
)
def test_a_point_to_point_movement_follows_the_attractor_in_spite_of_joint_friction(way: tuple[float, ...]) -> None:
    bare = BareRobot(hand_spec(), layout=FAST)
    assert (bare.model.dof_frictionloss[:7] > 0).all()
    bare.command(position=[0.6, 0.0, 0.12], quaternion=wam.TOOL_DOWN)
    bare.run(3.0)
    start = bare.position
    goal = np.array([0.6, 0.0, 0.12]) + way
    bare.command(position=goal)
    off, saturated = 0.0, 0.0
    for time in bare.steps(3.0):
        wanted = attractor.response(np.array(time), start, goal, FAST.alpha)
        off = max(off, float(np.linalg.norm(bare.position - wanted)))
        saturated = max(saturated, float(np.abs(bare.data.ctrl[:7] / bare.model.actuator_ctrlrange[:7, 1]).max()))
    assert saturated < 1.0
    assert off < 3e-3
    assert np.linalg.norm(bare.position - goal) < 1.5e-3
    assert angle(bare.quaternion, wam.TOOL_DOWN) < np.radians(0.3)


def test_a_turn_follows_the_attractor() -> None:
    bare = BareRobot(hand_spec(), layout=FAST)
    bare.command(position=[0.6, 0.0, 0.2], quaternion=wam.TOOL_DOWN)
    bare.run(2.0)
    goal = quaternion.multiply(quaternion.from_rotation_vector(np.array([0.0, 0.0, 1.0])), wam.TOOL_DOWN)
    bare.command(quaternion=goal)
    off = 0.0
    for time in bare.steps(3.0):
        wanted = attractor.response(np.array(time), 1.0, 0.0, FAST.alpha)
        off = max(off, abs(angle(bare.quaternion, goal) - wanted))
    assert off < np.radians(1.0)
    assert angle(bare.quaternion, goal) < np.radians(0.3)


def test_the_reference_is_the_closed_form_of_the_attractor() -> None:
    bare = BareRobot(hand_spec(), layout=FAST)
    start = bare.position
    goal = start + np.array([-0.05, 0.1, 0.05])
    bare.command(position=goal)
    for time in bare.steps(1.5):
        wanted = attractor.response(np.array(time), start, goal, FAST.alpha)
        np.testing.assert_allclose(bare.memory["position"], wanted, atol=2e-5)


def test_a_far_goal_is_approached_at_the_speed_limit_on_a_straight_path() -> None:
    bare = BareRobot(hand_spec(), layout=replace(LAYOUT, speed_limit=0.2))
    bare.command(position=[0.6, -0.25, 0.15], quaternion=wam.TOOL_DOWN)
    bare.run(4.0)
    start, goal = bare.position, np.array([0.6, 0.25, 0.25])
    along = (goal - start) / np.linalg.norm(goal - start)
    bare.command(position=goal)
    speeds, references, sideways = [], [], 0.0
    for _ in bare.steps(4.0):
        speeds.append(np.linalg.norm(bare.memory["tool_velocity"][:3]))
        references.append(np.linalg.norm(bare.memory["velocity"][:3]))
        offset = bare.position - start
        sideways = max(sideways, float(np.linalg.norm(offset - (offset @ along) * along)))
    assert max(references) <= 0.2 + 1e-6
    assert max(speeds) < 0.21
    assert np.median(speeds[250:750]) == pytest.approx(0.2, rel=0.02)
    assert sideways < 2e-3
    assert np.linalg.norm(bare.position - goal) < 1.5e-3


def test_turning_stops_at_its_speed_limit() -> None:
    bare = BareRobot(hand_spec(), layout=replace(LAYOUT, turn_limit=0.5))
    turn = quaternion.from_rotation_vector(np.array([0.0, 0.0, 1.5]))
    bare.command(quaternion=quaternion.multiply(turn, wam.TOOL_DOWN))
    speeds = [np.linalg.norm(bare.memory["tool_velocity"][3:]) for _ in bare.steps(2.5)]
    assert max(speeds) < 0.53
    assert np.median(speeds[250:750]) == pytest.approx(0.5, rel=0.03)


def test_goals_turn_the_shorter_way_round() -> None:
    bare = BareRobot(hand_spec())
    turn = quaternion.from_rotation_vector(np.array([0.0, 0.0, 0.5]))
    bare.command(quaternion=-quaternion.multiply(turn, wam.TOOL_DOWN))
    largest = max(angle(bare.quaternion, wam.TOOL_DOWN) for _ in bare.steps(2.0))
    assert largest == pytest.approx(0.5, abs=0.02)


def test_motion_in_the_null_space_leaves_the_tool_still() -> None:
    bare = BareRobot(hand_spec())
    bare.run(1.0)
    start, orientation, arm = bare.position, bare.quaternion, bare.arm
    elbow = bare.data.body("wam_link_4").xpos.copy()
    far = turned = swivelled = 0.0

    def push(time: float) -> None:
        j, _ = jacobian(bare)
        null = np.linalg.svd(j)[2][-1]
        null *= np.sign(null[2])
        # M n accelerates the arm along n, which does not move the tool
        bare.data.qfrc_applied[:7] = 25.0 * np.sin(np.pi * time) * inertia(bare) @ null

    for _ in bare.steps(4.0, push):
        far = max(far, float(np.linalg.norm(bare.position - start)))
        turned = max(turned, angle(bare.quaternion, orientation))
        swivelled = max(swivelled, float(np.linalg.norm(bare.data.body("wam_link_4").xpos - elbow)))
    assert np.abs(bare.arm - arm).max() > 0.1
    assert swivelled > 0.05
    assert far < 1e-3
    assert turned < np.radians(0.5)


def test_the_null_space_pushes_away_from_joint_limits() -> None:
    low, high = np.full(7, -2.0), np.full(7, 2.0)
    xi = np.empty(7)
    gains = controller.NullSpace()
    for q in (1.4, 1.6, 1.9):
        controller.null_space_acceleration(np.full(7, q), np.zeros(7), np.full(7, q), low, high, gains, xi)
        np.testing.assert_allclose(xi, 200.0 * max(q - 1.5, 0.0), atol=1e-9)
        controller.null_space_acceleration(np.full(7, -q), np.zeros(7), np.full(7, -q), low, high, gains, xi)
        np.testing.assert_allclose(xi, -200.0 * max(q - 1.5, 0.0), atol=1e-9)


def wild_actions(rng: np.random.Generator, size: int, n: int) -> Array:
    """Random actions: some new at every step, some kept for half a second, some at the corners of the box."""
    actions, action = [], np.zeros(size)
    while len(actions) < n:
        kind = rng.integers(3)
        length = 1 if kind == 0 else int(rng.integers(5, 40))
        action = rng.uniform(-1, 1, size) if kind < 2 else rng.choice([-1.0, 1.0], size)
        if rng.uniform() < 0.5:
            action[6:9] = 0.0
        actions += [action] * length
    return np.array(actions[:n], dtype=np.float32)


@pytest.mark.parametrize("env_id", ENVIRONMENTS)
def test_the_arm_comes_to_rest_at_every_corner_of_the_workspace(env_id: str) -> None:
    """Also where it is too short, or where its wrist cannot bend enough."""
    env = gymnasium.make(env_id, terminate_on_success=False).unwrapped
    layout = env.action_layout
    borders, hand = (layout.workspace_low, layout.workspace_high), layout.hand_low
    for corner in itertools.product((0, 1), repeat=3):
        env.reset(seed=100000)
        goal = [borders[side][i] for i, side in enumerate(corner)]
        action = layout.encode(goal, layout.reference_quaternion, hand=hand)
        speeds = [np.linalg.norm(env.step(action)[0]["tool_velocity"][:3]) for _ in range(250)]
        assert max(speeds) < 1.2 * layout.speed_limit
        assert max(speeds[200:]) < 0.06


@pytest.mark.slow  # 10,000 steps are 200 s of simulation
@pytest.mark.parametrize(
    ("env_id", "episodes"),
    [(env_id, 10 if env_id in ("lfd_gym/MoveObject-v0", "lfd_gym/LightBulb-v0") else 2) for env_id in ENVIRONMENTS],
)
def test_random_actions_break_no_limit(env_id: str, episodes: int) -> None:
    env = gymnasium.make(env_id, terminate_on_success=False).unwrapped
    low, high = env.model.jnt_range[:7].T
    limit = env.model.actuator_ctrlrange[:7, 1]
    worst_joint = worst_torque = 0.0
    tick = env.robot.tick

    def watched() -> None:
        nonlocal worst_joint, worst_torque
        tick()
        q = env.data.qpos[:7]
        worst_joint = max(worst_joint, (q - high).max(), (low - q).max())
        worst_torque = max(worst_torque, np.abs(env.data.ctrl[:7] / limit).max())

    env.robot.tick = watched
    rng = np.random.default_rng(5)
    for episode in range(episodes):
        env.reset(seed=episode)
        for action in wild_actions(rng, env.action_space.shape[0], 1000):
            observation, reward, _, _, info = env.step(action)
            assert not info["broken"]
            assert np.isfinite(reward)
            assert all(np.isfinite(value).all() for value in observation.values())
    assert worst_torque <= 1.0
    assert worst_joint < np.radians(2.0)
