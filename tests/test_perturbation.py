"""What goes wrong on purpose: off by default, seeded, exact in the state, and it does what it says."""

import numpy as np
import pytest

from lfd_gym import contact, quaternion, wam
from lfd_gym.errors import InvalidArgumentError, LfdGymError, UnknownNameError
from lfd_gym.perturbation import EARLIEST, LATEST, PUSH_TIME, SLIPPERY, Perturbation, Schedule
from lfd_gym.registry import make
from lfd_gym.rollout import TeacherPolicy, rollout
from scripted_teachers.move_object import MoveObjectTeacher

SEED = 200000


def path(env, body: str, n_steps: int) -> np.ndarray:
    """Of a body, after every control step, while the tool is held where it is."""
    observation, _ = env.reset(seed=SEED)
    action = env.unwrapped.action_layout.encode(
        observation["tool_position"], observation["tool_quaternion"], hand=observation["hand_position"]
    )
    positions = []
    for _ in range(n_steps):
        env.step(action)
        positions.append(env.unwrapped.data.body(body).xipos.copy())
    return np.array(positions)


def pushed(body: str, which: int, **strengths: float) -> tuple[np.ndarray, np.ndarray]:
    """What a push did to a body: its shifts before, and then for a second and a half how far it went along the force [m]."""
    env = make("move-object", perturbation=strengths)
    env.reset(seed=SEED)
    schedule, dt = env.unwrapped._schedule, env.unwrapped.dt
    forces = np.array([schedule.pushes(i * dt)[which] for i in range(round((LATEST + 1.0) / dt))])
    during = np.flatnonzero(forces.any(axis=1))
    first, strength = during[0], max(strengths.values())
    assert EARLIEST <= first * dt <= LATEST + dt
    assert len(during) == round(PUSH_TIME / dt)
    assert np.hypot(*forces[first, :2]) == pytest.approx(strength)
    n_steps = first + round(1.5 / dt)
    shifts = path(env, body, n_steps) - path(make("move-object"), body, n_steps)
    return shifts[:first], shifts[first:] @ forces[first] / strength


def test_nothing_is_perturbed_by_default() -> None:
    schedule = Schedule(Perturbation(), 2)
    schedule.draw(np.random.default_rng(0))
    assert not schedule.misplaces
    assert not schedule.misreads
    assert not schedule.acts
    plain, zero = make("move-object").reset(seed=SEED)[0], make("move-object", perturbation={}).reset(seed=SEED)[0]
    assert all(np.array_equal(plain[key], zero[key]) for key in plain)


def test_tracked_frames_err_by_the_given_spread_and_stay_so() -> None:
    env = make("move-object", perturbation={"tracking_position": 0.01})
    errors = []
    for seed in range(SEED, SEED + 40):
        observation, _ = env.reset(seed=seed)
        errors.append(observation["frame_target"][:2] - env.unwrapped.setup()["target"]["position"])
    assert 0.007 < np.std(errors) < 0.013
    first, _ = env.reset(seed=SEED)
    later, *_ = env.step(np.zeros(env.action_space.shape))
    assert np.array_equal(first["frame_target"], later["frame_target"])


def test_tracked_frames_are_turned_by_the_given_spread_and_stay_so() -> None:
    env = make("move-object", perturbation={"tracking_rotation": 0.1})
    turns = []
    for seed in range(SEED, SEED + 40):
        observation, _ = env.reset(seed=seed)
        seen, target = observation["frame_target"], env.unwrapped.data.body("target")
        assert np.array_equal(seen[:3], target.xpos)
        turns.append(quaternion.to_rotation_vector(quaternion.multiply(seen[3:], quaternion.conjugate(target.xquat))))
    assert 0.07 < np.std(turns) < 0.13
    assert np.std(turns, axis=0).min() > 0.05
    later, *_ = env.step(np.zeros(env.action_space.shape))
    assert np.array_equal(seen, later["frame_target"])


@pytest.mark.parametrize("factor", [0.0, 0.5, 2.0])
def test_variation_widens_the_ranges_about_their_middles(factor: float) -> None:
    """Of the object's mass, 0.1 to 0.2 kg, and friction with the table, 0.6 to 1.0."""
    middles, drawn = np.array([0.15, 0.8]), []
    for env in (make("move-object"), make("move-object", perturbation={"variation": factor})):
        model, rows = env.unwrapped.model, []
        for seed in range(SEED, SEED + 10):
            env.reset(seed=seed)
            rows.append([model.body("object").mass[0], model.geom("object_foot").friction[0]])
        drawn.append(rows - middles)
    assert np.ptp(drawn[0], axis=0).min() > 0.03
    np.testing.assert_allclose(drawn[1], factor * drawn[0], atol=1e-12)


@pytest.mark.parametrize("name", ["box-stacking", "cylinder-grasp"])
def test_no_variation_makes_a_grip_better_than_soft_rubber(name: str) -> None:
    env = make(name, perturbation={"variation": 4.0})
    highest = []
    for seed in range(SEED, SEED + 20):
        env.reset(seed=seed)
        highest.append(env.unwrapped.model.geom_friction[:, 0].max())
    assert max(highest) == wam.MAX_FINGERTIP_FRICTION


def test_the_wrench_is_noisy_and_biased_as_asked() -> None:
    env = make("move-object", perturbation={"wrench_noise": 0.3})
    env.reset(seed=SEED)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    forces = np.array([env.step(action)[0]["wrench"][0] for _ in range(150)])[50:]
    assert 0.2 < forces.std() < 0.45
    biased = make("move-object", perturbation={"wrench_bias": 1.0})
    at_rest = [biased.reset(seed=seed)[0]["wrench"][:2] for seed in range(SEED, SEED + 40)]
    assert 0.7 < np.std(at_rest) < 1.3


def test_a_biased_sensor_misleads_the_controller_as_well() -> None:
    """A board is pressed until the sensor says what is commanded, so that the tip is off by the bias."""
    env = make("whiteboard", perturbation={"wrench_bias": 0.7}).unwrapped
    observation, _ = env.reset(seed=SEED + 4)
    towards = env.press_direction(observation)
    bias = env._schedule.misreading(env.np_random)[:3] @ towards
    place = observation["frame_board_1"][:3] - 0.02 * towards
    for force in [0.0] * 100 + [3.0] * 150:
        action = env.action_layout.encode(place, observation["tool_quaternion"], force * towards)
        observation, *_ = env.step(action)
    said = -observation["wrench"][:3] @ towards
    plain = make("whiteboard").unwrapped
    plain.reset(seed=SEED)
    plain.set_state(env.get_state())
    true = -plain.step(action)[0]["wrench"][:3] @ towards
    assert abs(bias) > 0.3
    assert said == pytest.approx(3.0, abs=0.2)
    assert true == pytest.approx(3.0 + bias, abs=0.2)


def test_a_contact_that_a_biased_sensor_makes_up_takes_the_tool_nowhere_fast() -> None:
    """In empty air, and not beyond the workspace."""
    env = make("whiteboard", perturbation={"wrench_bias": 1.0}).unwrapped
    observation, _ = env.reset(seed=6)
    layout, modes, speeds = env.action_layout, set(), []
    action = layout.encode(observation["tool_position"], layout.reference_quaternion, [0.0, 3.0, 0.0])
    for _ in range(300):
        observation, *_ = env.step(action)
        modes.add(int(env.robot._memory["mode"][0]))
        speeds.append(np.linalg.norm(observation["tool_velocity"][:3]))
        assert observation["tool_position"][1] < layout.workspace_high[1] + 0.02
    assert -env._schedule.misreading(env.np_random)[1] > 0.8
    assert contact.CONTACT in modes
    assert max(speeds) < 1.2 * layout.speed_limit


@pytest.mark.parametrize(
    ("strength", "hz", "message"),
    [({"push_arm": 20.0}, 4.0, "0.2 s needs 5 or more"), ({"slip": 0.1}, 5.0, "0.1 s needs 10 or more")],
)
def test_what_is_shorter_than_a_control_step_is_refused(strength, hz, message) -> None:
    with pytest.raises(InvalidArgumentError, match=message):
        make("move-object", perturbation=strength, control_hz=hz)


def test_a_state_from_the_middle_of_a_push_does_not_push_for_ever() -> None:
    pushed_env, plain = make("move-object", perturbation={"push_arm": 20.0, "push_object": 3.0}), make("move-object")
    plain.reset(seed=SEED)
    observation, _ = pushed_env.reset(seed=SEED)
    still = pushed_env.unwrapped.action_layout.encode(
        observation["tool_position"], observation["tool_quaternion"], hand=observation["hand_position"]
    )
    while not pushed_env.unwrapped.data.xfrc_applied.any():
        pushed_env.step(still)
    plain.unwrapped.set_state(pushed_env.unwrapped.get_state())
    assert not plain.unwrapped.data.xfrc_applied.any()


def test_a_push_moves_the_arm_while_it_lasts_and_only_then() -> None:
    before, along = pushed("wam_link_5", 0, push_arm=40.0)
    assert not before.any()
    assert (along[:10] > 0.0).all()
    assert along[9] > 5e-3
    assert abs(along[-1]) < 1e-3


def test_a_push_sets_the_object_in_motion_and_then_leaves_it() -> None:
    before, along = pushed("object", 1, push_object=3.0)
    speed = np.diff(along) / 0.02
    assert not before.any()
    assert along[9] > 0.05
    assert speed[20:].max() < 0.5 * speed[8]


def test_slippery_fingertips_decide_the_friction_of_a_contact() -> None:
    env = make("move-object", perturbation={"slip": 0.5})
    env.reset(seed=SEED)
    world = env.unwrapped
    usual = world.model.geom_friction[world._tips, 0].copy()
    start = next(t for t in np.arange(0.0, LATEST + 1.0, 0.02) if world._schedule.slips(t))
    world.data.time = start + 0.1
    env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert set(world.model.geom_priority[world._tips]) == {2}
    assert set(world.model.geom_friction[world._tips, 0]) == {SLIPPERY}
    assert usual.min() > SLIPPERY
    world.data.time = start + 1.0
    env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert set(world.model.geom_priority[world._tips]) == {0}
    assert np.array_equal(world.model.geom_friction[world._tips, 0], usual)


def test_a_slip_never_improves_a_grip() -> None:
    env = make("move-object", fingertip_friction=0.05, perturbation={"slip": 0.5})
    env.reset(seed=SEED)
    world = env.unwrapped
    world.data.time = next(t for t in np.arange(0.0, LATEST + 1.0, 0.02) if world._schedule.slips(t)) + 0.1
    env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert set(world.model.geom_friction[world._tips, 0]) == {0.05}


def test_a_perturbed_state_is_restored_exactly() -> None:
    strengths = {"tracking_position": 0.01, "wrench_noise": 0.2, "push_arm": 20.0, "push_object": 2.0, "slip": 0.5}
    env, other = make("move-object", perturbation=strengths), make("move-object", perturbation=strengths)
    env.reset(seed=SEED)
    other.reset(seed=SEED + 1)
    for _ in range(60):
        env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    other.unwrapped.set_state(env.unwrapped.get_state())
    for _ in range(60):
        ours, *_ = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
        theirs, *_ = other.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert all(np.array_equal(ours[key], theirs[key]) for key in ours)


def test_a_slip_is_restored_in_the_middle_of_a_grasp() -> None:
    env, other = (make("move-object", perturbation={"slip": 0.5}) for _ in range(2))
    other.reset(seed=SEED)
    world, restored, around = env.unwrapped, other.unwrapped, 0
    for step in rollout(env, TeacherPolicy(MoveObjectTeacher(noise=0.0)), SEED + 1):
        if around:
            theirs = other.step(step.action)[0]
            assert all(np.array_equal(step.next_observation[key], theirs[key]) for key in theirs)
        changes = world._schedule.slips(world.data.time) != world._schedule.slips(world.data.time - world.dt)
        around = 3 if changes else max(around - 1, 0)
        if around:
            restored.set_state(world.get_state())
    assert step.info["is_success"]


@pytest.mark.parametrize(
    ("strengths", "error"),
    [({"push": 1.0}, UnknownNameError), ({"slip": -1.0}, InvalidArgumentError), (3, InvalidArgumentError)],
)
def test_perturbations_that_cannot_be_are_refused(strengths, error: type[LfdGymError]) -> None:
    with pytest.raises(error, match="possible"):
        Perturbation.of(strengths)
