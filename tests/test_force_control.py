"""Forces are regulated along any axis, also while it moves and turns; joint friction is on."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from bare_robot import LAYOUT, BareRobot, pen_spec
from placed_arm import posture
from scipy.spatial.transform import Rotation

from lfd_gym import contact, quaternion, wam
from lfd_gym.action import ActionLayout

TOP = 0.10
"""Height of the surfaces [m]."""
CENTRE, UP = np.array([0.60, 0.0, TOP]), np.array([0.0, 0.0, 1.0])


def over_plane(tilt: float = 0.0, layout: ActionLayout = LAYOUT) -> BareRobot:
    """A pen over a plate whose top passes through CENTRE, inclined by `tilt` degrees about the y axis."""
    spec = pen_spec()
    a = np.radians(tilt)
    normal = np.array([np.sin(a), 0.0, np.cos(a)])
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.2, 0.3, 0.02],
        pos=CENTRE - 0.02 * normal,
        quat=[np.cos(a / 2), 0, np.sin(a / 2), 0],
    )
    return BareRobot(spec, "pen", layout)


def above(height: float) -> np.ndarray:
    """The point at a height over the middle of the plate [m]."""
    return CENTRE + height * UP


def start_over(bare: BareRobot, position: np.ndarray) -> None:
    bare.stand(posture(bare.model, "pen", position))
    bare.run(0.5)


def mean_force(bare: BareRobot, seconds: float) -> np.ndarray:
    """What the tool exerts on the world, averaged (3,) [N]."""
    bare.wrench()
    bare.run(seconds)
    return -bare.wrench()[:3]


def tolerance(newtons: float) -> float:
    return max(0.05 * newtons, 0.3)


@pytest.mark.parametrize("newtons", [5.0, 10.0, 15.0])
@pytest.mark.parametrize("tilt", [0.0, 35.0])
def test_a_force_is_held_on_a_plane(newtons: float, tilt: float) -> None:
    bare = over_plane(tilt)
    assert (bare.model.dof_frictionloss[:7] > 0).all()
    a = np.radians(tilt)
    inward = -np.array([np.sin(a), 0.0, np.cos(a)])
    start_over(bare, CENTRE - 0.03 * inward)
    bare.command(position=CENTRE, force=newtons * inward)
    bare.run(2.5)
    assert bare.memory["mode"] == contact.CONTACT
    assert mean_force(bare, 1.0) @ inward == pytest.approx(newtons, abs=tolerance(newtons))


@pytest.mark.parametrize("newtons", [5.0, 10.0, 15.0])
@pytest.mark.parametrize("tilt", [0.0, 35.0])
def test_a_force_is_held_while_sliding_at_5_cm_per_second(newtons: float, tilt: float) -> None:
    bare = over_plane(tilt)
    a = np.radians(tilt)
    inward, along = -np.array([np.sin(a), 0.0, np.cos(a)]), np.array([0.0, 1.0, 0.0])
    start = CENTRE - 0.08 * along
    start_over(bare, start - 0.02 * inward)
    bare.command(position=start, force=newtons * inward)
    bare.run(2.0)
    assert bare.memory["mode"] == contact.CONTACT
    begin = bare.position

    def slide(time: float) -> None:
        # the reference of an attractor lags behind a moving goal by speed / beta
        bare.command(position=start + (0.05 * time + 0.05 / LAYOUT.beta) * along)

    bare.run(1.0, slide)
    forces = []
    for time in bare.steps(2.0, lambda time: slide(1.0 + time)):
        if time > 1.0:
            forces.append(-bare.wrench()[:3] @ inward)
    assert np.mean(forces) == pytest.approx(newtons, abs=tolerance(newtons))
    assert min(forces) > 0.0
    assert (bare.position - begin) @ along == pytest.approx(0.15, abs=0.01)
    assert abs((bare.position - CENTRE) @ np.cross(inward, along)) < 0.003


def test_a_force_is_regulated_along_a_turning_axis() -> None:
    radius, newtons = 0.12, 8.0
    spec = pen_spec()
    middle = np.array([0.60, 0.0, 0.02])
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, 0.3, 0], pos=middle, quat=[np.sqrt(0.5), 0, np.sqrt(0.5), 0]
    )
    bare = BareRobot(spec, "pen")

    def outward(angle: float) -> np.ndarray:
        return np.array([0.0, np.sin(angle), np.cos(angle)])

    first, last, seconds = np.radians(-40), np.radians(40), 4.0

    def press(angle: float, ahead: float = 0.0) -> None:
        orientation = Rotation.from_rotvec([-0.6 * angle, 0, 0]) * Rotation.from_quat(wam.TOOL_DOWN, scalar_first=True)
        bare.command(
            position=middle + radius * outward(angle + ahead),
            quaternion=orientation.as_quat(scalar_first=True),
            force=-newtons * outward(angle),
        )

    start_over(bare, middle + (radius + 0.05) * outward(0.0))
    bare.command(position=middle + (radius + 0.03) * outward(first))
    bare.run(2.0)
    press(first)
    bare.run(2.0)
    assert bare.memory["mode"] == contact.CONTACT
    bare.wrench()
    speed = (last - first) / seconds
    forces = []

    def turn(time: float) -> None:
        press(first + speed * time, speed / LAYOUT.beta)

    for time in bare.steps(seconds, turn):
        assert bare.memory["mode"] == contact.CONTACT
        forces.append(-bare.wrench()[:3] @ -outward(first + speed * time))
    for quarter in np.split(np.array(forces), 4):
        assert np.mean(quarter) == pytest.approx(newtons, abs=2.5 * tolerance(newtons))
    assert np.mean(forces) == pytest.approx(newtons, abs=tolerance(newtons))


def test_before_contact_the_tool_approaches_at_3_cm_per_second_whatever_the_goal_says() -> None:
    bare = over_plane()
    start_over(bare, above(0.10))
    # the goal lies above the tool
    bare.command(position=above(0.20), force=[0.0, 0.0, -8.0])
    heights = [bare.position[2] for _ in bare.steps(2.0)]
    assert bare.memory["mode"] == contact.APPROACH
    speed = -np.gradient(heights, bare.model.opt.timestep)
    assert np.median(speed[250:]) == pytest.approx(contact.GUARDED_SPEED, rel=0.05)
    assert speed.max() < 1.2 * contact.GUARDED_SPEED
    bare.run(3.0)
    assert bare.memory["mode"] == contact.CONTACT


@pytest.mark.parametrize("newtons", [1.0, 8.0, 18.0])
@pytest.mark.parametrize("away", [0.0, 0.2])
def test_a_tool_that_brakes_in_empty_air_feels_no_contact(newtons: float, away: float) -> None:
    bare = over_plane()
    start_over(bare, above(0.10))
    bare.command(position=above(0.10 + away))
    bare.run(0.3)
    assert away == 0.0 or bare.memory["tool_velocity"][2] > 0.3
    bare.command(force=[0.0, 0.0, -newtons])
    speeds = []
    for _ in bare.steps(2.0):
        assert bare.memory["mode"] == contact.APPROACH
        speeds.append(-bare.memory["tool_velocity"][2])
    assert max(speeds) < 1.2 * contact.GUARDED_SPEED


def test_a_border_of_the_workspace_does_not_end_a_slanted_press_at_it() -> None:
    bare = over_plane(layout=replace(LAYOUT, workspace_high=np.array([CENTRE[0], 0.5, 0.6])))
    start_over(bare, above(0.02))
    d = np.array([0.05, 0.0, -1.0]) / np.hypot(0.05, 1.0)
    bare.command(position=CENTRE, force=8.0 * d)
    bare.run(3.0)
    assert bare.memory["mode"] == contact.CONTACT
    assert mean_force(bare, 1.0) @ d == pytest.approx(8.0, abs=tolerance(8.0))


@pytest.mark.parametrize("newtons", [5.0, 10.0, 15.0])
def test_the_first_touch_does_not_overshoot_far(newtons: float) -> None:
    bare = over_plane()
    start_over(bare, above(0.03))
    bare.command(force=[0.0, 0.0, -newtons])
    bare.wrench()
    peak = max(bare.wrench()[2] for _ in bare.steps(3.0))
    # what arrives at 3 cm/s weighs about 3 kg and is still position controlled for 20 ms
    assert peak < newtons + 4.0


def test_a_guarded_touch_does_not_sink_in() -> None:
    bare = over_plane()
    start_over(bare, above(0.02))
    bare.command(force=[0.0, 0.0, -10.0])
    lowest = min(bare.position[2] for _ in bare.steps(3.0))
    assert lowest > TOP - 0.004


def test_in_contact_the_reference_follows_the_tool() -> None:
    bare = over_plane()
    start_over(bare, above(0.01))
    bare.command(position=above(0.30), force=[0.0, 0.0, -8.0])
    bare.run(2.0)
    assert bare.memory["mode"] == contact.CONTACT
    assert bare.memory["position"][2] == pytest.approx(bare.position[2], abs=1e-3)


def test_when_the_force_ends_the_reference_resumes_from_where_the_tool_is() -> None:
    bare = over_plane()
    start_over(bare, above(0.02))
    bare.command(position=above(-0.02), force=[0.0, 0.0, -10.0])
    bare.run(2.0)
    bare.command(position=bare.position + UP * 0.05, force=[0.0, 0.0, 0.0])
    before = bare.position
    speeds, lowest = [], before[2]
    for _ in bare.steps(2.0):
        assert bare.memory["mode"] == contact.FREE
        speeds.append(np.linalg.norm(bare.memory["velocity"][:3]))
        lowest = min(lowest, bare.position[2])
    assert lowest > before[2] - 1e-3
    assert max(speeds) < 0.15
    assert bare.position[2] == pytest.approx(before[2] + 0.05, abs=1.5e-3)
    assert np.linalg.norm(bare.position[:2] - before[:2]) < 1.5e-3


def test_a_force_that_turns_by_more_than_30_degrees_in_one_step_is_approached_anew() -> None:
    bare = over_plane()
    start_over(bare, above(0.02))
    bare.command(force=[0.0, 0.0, -8.0])
    bare.run(2.0)
    assert bare.memory["mode"] == contact.CONTACT
    a = np.radians(45.0)
    bare.command(force=8.0 * np.array([0.0, np.sin(a), -np.cos(a)]))
    bare.run(0.002)
    assert bare.memory["mode"] == contact.APPROACH
    assert bare.memory["force_integral"] == 0.0


def test_a_tool_that_breaks_loose_is_seen_to_move() -> None:
    spec = pen_spec()
    lid = spec.worldbody.add_body(name="lid", pos=CENTRE)
    lid.add_joint(name="lid", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0, 0, 1], frictionloss=100.0, range=[-0.08, 0])
    lid.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.005], pos=[0, 0, -0.005], mass=0.2)
    bare = BareRobot(spec, "pen")
    start_over(bare, above(0.02))
    bare.command(force=[0.0, 0.0, -10.0])
    bare.run(2.0)
    assert bare.memory["mode"] == contact.CONTACT
    height = bare.position[2]
    bare.model.dof_frictionloss[bare.model.joint("lid").dofadr[0]] = 4.0
    bare.run(0.5)
    assert bare.position[2] < height - 0.02
    assert bare.memory["position"][2] == pytest.approx(bare.position[2], abs=2e-3)


def test_pressed_tools_keep_their_orientation() -> None:
    bare = over_plane()
    start_over(bare, above(0.02))
    bare.command(force=[0.0, 0.0, -15.0])
    bare.run(3.0)
    relative = quaternion.multiply(bare.quaternion, quaternion.conjugate(wam.TOOL_DOWN))
    assert np.linalg.norm(quaternion.to_rotation_vector(relative)) < np.radians(0.5)
