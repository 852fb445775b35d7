"""What goes wrong on purpose: off by default, seeded, exact in the state, and it does what it says."""

import numpy as np
import pytest

from lfd_gym.errors import InvalidArgumentError, LfdGymError, UnknownNameError
from lfd_gym.perturbation import EARLIEST, LATEST, PUSH_TIME, Perturbation, Schedule
from lfd_gym.registry import make
from lfd_gym.rollout import TeacherPolicy, rollout
from scripted_teachers.move_object import MoveObjectTeacher

SEED = 200000


def hold(env, seconds: float) -> dict[str, np.ndarray]:
    """Keep the tool where it is."""
    observation, _ = env.reset(seed=SEED)
    action = env.unwrapped.action_layout.encode(
        observation["tool_position"], observation["tool_quaternion"], hand=observation["hand_position"]
    )
    for _ in range(round(seconds / env.unwrapped.dt)):
        observation, *_ = env.step(action)
    return observation


def test_nothing_is_perturbed_by_default() -> None:
    schedule = Schedule(Perturbation(), 2)
    schedule.draw(np.random.default_rng(0))
    assert not schedule.senses
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
    later, *_ = env.step(env.action_space.sample())
    assert np.array_equal(first["frame_target"], later["frame_target"])


def test_the_wrench_is_noisy_and_biased_as_asked() -> None:
    env = make("move-object", perturbation={"wrench_noise": 0.3})
    env.reset(seed=SEED)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    forces = np.array([env.step(action)[0]["wrench"][0] for _ in range(150)])[50:]
    assert 0.2 < forces.std() < 0.45
    biased = make("move-object", perturbation={"wrench_bias": 1.0})
    at_rest = [biased.reset(seed=seed)[0]["wrench"][:2] for seed in range(SEED, SEED + 40)]
    assert 0.7 < np.std(at_rest) < 1.3


def test_a_push_moves_the_arm_while_it_lasts_and_only_then() -> None:
    env = make("move-object", perturbation={"push_arm": 40.0})
    env.reset(seed=SEED)
    schedule = env.unwrapped._schedule
    starts = [t for t in np.arange(0.0, LATEST + 1.0, 0.01) if schedule.pushes(t)[0].any()]
    assert EARLIEST <= starts[0] <= LATEST
    assert starts[-1] - starts[0] <= PUSH_TIME
    still, pushed = hold(make("move-object"), starts[-1] + 0.02), hold(env, starts[-1] + 0.02)
    assert np.linalg.norm(pushed["tool_position"] - still["tool_position"]) > 1e-4


def test_slippery_fingertips_decide_the_friction_of_a_contact() -> None:
    env = make("move-object", perturbation={"slip": 0.5})
    env.reset(seed=SEED)
    world = env.unwrapped
    start = next(t for t in np.arange(0.0, LATEST + 1.0, 0.02) if world._schedule.slips(t))
    world.data.time = start + 0.1
    env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert set(world.model.geom_priority[world._tips]) == {2}
    world.data.time = start + 1.0
    env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert set(world.model.geom_priority[world._tips]) == {0}


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
