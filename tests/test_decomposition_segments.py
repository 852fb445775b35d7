"""Segments of demonstrations: cuts, and how segments look in task spaces."""

import dataclasses
import itertools

import numpy as np
import pytest
from kinematic_world import PRIMITIVES, teach

from lfd_gym import quaternion
from lfd_gym.demonstration import Demonstration
from policies.decomposition.observed import CARRIED_PENALTY, observe
from policies.decomposition.segmentation import ENTITIES, Segment, segment, smooth
from policies.decomposition.task_spaces import (
    DIRECTION,
    end_samples,
    entity_segments,
    nearest_rotation,
    pressing,
    widest_gap,
)

TURN, SHIFT = quaternion.from_rotation_vector(np.array([0.0, 0.0, 1.1])), np.array([0.1, -0.2, 0.05])


@pytest.fixture(scope="module")
def shown() -> list[Demonstration]:
    return [teach(seed) for seed in (1, 2)]


def moved(demonstration: Demonstration) -> Demonstration:
    """The same demonstration in a turned and shifted world."""
    seen = dict(demonstration.observations)
    for name in ("tool_position", "frame_lid", "frame_bin"):
        rows = seen[name].copy()
        rows[:, :3] = [SHIFT + quaternion.rotate(TURN, row[:3]) for row in seen[name]]
        if name != "tool_position":
            rows[:, 3:] = [quaternion.multiply(TURN, row[3:]) for row in seen[name]]
        seen[name] = rows
    seen["tool_quaternion"] = np.array([quaternion.multiply(TURN, row) for row in seen["tool_quaternion"]])
    wrench = seen["wrench"].copy()
    wrench[:, :3] = [quaternion.rotate(TURN, row[:3]) for row in wrench]
    seen["wrench"] = wrench
    return dataclasses.replace(demonstration, observations=seen)


@pytest.mark.parametrize("entity", ["position", "hand"])
def test_segments_end_at_rest_at_every_control_rate(shown: list[Demonstration], entity: str) -> None:
    """Those of every fifth sample."""
    data = entity_segments(shown, entity)
    for part, (view, *_) in zip(data.segments, data.views, strict=True):
        own, coarse = end_samples(5.0 * shown[part.demonstration].dt), view.samples[::-5][::-1]
        assert np.linalg.norm(coarse[-own:].mean(axis=0) - view.end) < 0.005


@pytest.mark.parametrize("entity", ENTITIES)
def test_every_sample_lies_in_one_segment(shown: list[Demonstration], entity: str) -> None:
    parts = segment(shown, entity)
    for m, demonstration in enumerate(shown):
        own = [part for part in parts if part.demonstration == m]
        assert [own[0].start, own[-1].stop] == [0, len(demonstration)]
        assert all(a.stop == b.start and a.start < a.stop for a, b in itertools.pairwise(own))


@pytest.mark.parametrize(
    ("entity", "moves"), [("orientation", ["reach", "twist", "turn back"]), ("hand", ["close", "release"])]
)
def test_a_segment_begins_where_the_teacher_moves_the_entity(
    shown: list[Demonstration], entity: str, moves: list[str]
) -> None:
    for m, demonstration in enumerate(shown):
        cuts = np.array([part.start for part in segment(shown, entity) if part.demonstration == m])
        begins = np.flatnonzero(np.diff(demonstration.labels, prepend=-1))
        taught = [at for at in begins if PRIMITIVES[demonstration.labels[at]].name in moves]
        assert all(np.abs(cuts - at).min() <= 15 for at in taught)
        assert all(np.abs(begins - at).min() <= 15 for at in cuts)


def test_contacts_cut_a_rest(shown: list[Demonstration]) -> None:
    """The tool rests on the lid while it pulls: a segment begins with the pull and with its end."""
    pressed = [np.linalg.norm(view[0].force_level) for view in entity_segments(shown, "position").views]
    moves = [part.moves for part in segment(shown, "position")]
    assert any(level > 1.0 and not motion for level, motion in zip(pressed, moves, strict=True))
    assert any(level < 0.1 and not motion for level, motion in zip(pressed, moves, strict=True))


def test_where_the_angle_of_an_object_begins_does_not_matter(shown: list[Demonstration]) -> None:
    def ends(angle: float) -> np.ndarray:
        turn = quaternion.from_rotation_vector(np.array([0.0, 0.0, angle]))
        seen = [dict(d.observations) for d in shown]
        for rows in seen:
            poses = rows["frame_lid"].copy()
            poses[:, 3:] = [quaternion.canonical(quaternion.multiply(pose[3:], turn)) for pose in poses]
            rows["frame_lid"] = poses
        data = entity_segments(
            [dataclasses.replace(d, observations=rows) for d, rows in zip(shown, seen, strict=True)], "position"
        )
        f = next(i for i, space in enumerate(data.spaces) if space.frame == "lid" and space.space == "cylindrical")
        return np.array([view[f].end for view in data.views])

    for angle in np.arange(-3.0, 3.1, 0.5):
        np.testing.assert_allclose(np.diff(ends(angle), axis=0), np.diff(ends(0.0), axis=0), atol=1e-9)


@pytest.mark.parametrize("angles", [[3.1, -3.1, 3.0, 2.9], [0.1, -0.1], [1.0], [-2.0, 2.0, 0.0]])
def test_the_widest_gap_parts_no_neighbours(angles: list[float]) -> None:
    seam = widest_gap(np.array(angles))
    counted = (np.array(angles) - seam) % (2.0 * np.pi)
    assert -2.0 * np.pi < seam <= 0.0
    assert counted.min() == pytest.approx(2.0 * np.pi - counted.max())
    assert np.ptp(counted) == pytest.approx({4: 0.283185, 2: 0.2, 1: 0.0, 3: 4.0}[len(angles)], abs=1e-5)


@pytest.mark.parametrize("entity", ["position", "orientation"])
def test_what_is_seen_in_a_frame_does_not_depend_on_where_the_scene_stands(
    shown: list[Demonstration], entity: str
) -> None:
    here, there = entity_segments(shown, entity), entity_segments([moved(d) for d in shown], entity)
    assert here.segments == there.segments
    for f, space in enumerate(here.spaces):
        if space.frame != "world":
            for a, b in zip(here.views, there.views, strict=True):
                np.testing.assert_allclose(a[f].samples, b[f].samples, atol=1e-9)
                np.testing.assert_allclose(a[f].velocities, b[f].velocities, atol=1e-6)
                np.testing.assert_allclose(a[f].force_level, b[f].force_level, atol=1e-9)


def test_a_circle_about_an_axis_is_straight_in_the_cylindrical_space(shown: list[Demonstration]) -> None:
    seen = dict(shown[0].observations)
    turn = np.pi * np.clip((np.arange(len(seen["tool_position"])) - 50) / 100, 0.0, 1.0)
    seen["tool_position"] = seen["frame_bin"][:, :3] + 0.3 * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    data = entity_segments([dataclasses.replace(shown[0], observations=seen)], "position")
    f = next(i for i, space in enumerate(data.spaces) if (space.frame, space.space) == ("bin", "cylindrical"))
    view = next(seen[f] for seen, part in zip(data.views, data.segments, strict=True) if part.moves)
    np.testing.assert_allclose(view.way, [0.0, 0.3 * np.pi, 0.0], atol=1e-3)
    assert abs(view.log_jacobian) < 1e-3


def test_smoothing_keeps_lines() -> None:
    line = np.outer(np.arange(50.0), [1.0, -2.0])
    np.testing.assert_allclose(smooth(line, 9)[10:40], line[10:40])


def test_pressing_harder_is_pressing_the_same_way() -> None:
    force = np.array([3.0, -4.0, 12.0])
    np.testing.assert_allclose(pressing(force), [1.0, *(DIRECTION * force / 13.0)])
    np.testing.assert_allclose(pressing(0.5 * force), pressing(force))
    assert np.all(pressing(0.1 * force) == 0.0)


def test_the_nearest_rotation_of_a_reflection_is_a_rotation() -> None:
    found = nearest_rotation(np.diag([1.0, 1.0, -0.2]))
    np.testing.assert_allclose(found, np.eye(3), atol=1e-12)


def test_an_angle_about_a_near_axis_is_no_way(shown: list[Demonstration]) -> None:
    """A tool that strays by 8 mm on an object's axis turns about it by radians: it is not carried along by anything."""
    seen = dict(shown[0].observations)
    n = len(seen["tool_position"])
    stray = 0.004 * np.sin(np.clip((np.arange(n) - 60) / 40.0, -1.0, 1.0) * np.pi / 2.0)
    seen["tool_position"] = seen["frame_bin"][:, :3] + np.stack([stray, 0 * stray + 0.0005, 0 * stray + 0.1], axis=1)
    observed = observe(entity_segments([dataclasses.replace(shown[0], observations=seen)], "position"))
    assert (observed.constants.max(axis=1) > -5.0).all()
    cartesian = [i for i, space in enumerate(observed.spaces) if not any(space.held)][:3]
    assert (observed.constants[:, cartesian] > CARRIED_PENALTY).all()


def test_what_slips_in_the_hand_while_it_is_put_down_is_still_carried(shown: list[Demonstration]) -> None:
    """Its own frame would explain where it goes, whatever that is about; left behind, it is a place again."""
    seen = dict(shown[0].observations)
    steps = np.arange(len(seen["tool_position"]))[:, None]
    across, down, away = ([0.2, 0.0, 0.0], 10), ([0.0, 0.0, -0.06], 50), ([0.0, 0.1, 0.0], 90)
    ways = [np.clip((steps - start) / 30.0, 0.0, 1.0) * way for way, start in (across, down, away)]
    seen["tool_position"] = np.array([0.5, 0.0, 0.3]) + sum(ways)
    seen["frame_bin"] = np.tile(seen["frame_bin"][:1], (len(steps), 1))
    seen["frame_bin"][:, :3] = np.array([0.5, 0.0, 0.28]) + ways[0] + 0.8 * ways[1]
    parts = [Segment(0, start, start + 40, start + 31) for _, start in (across, down, away)]
    data = entity_segments([dataclasses.replace(shown[0], observations=seen)], "position", parts)
    f = next(i for i, space in enumerate(data.spaces) if (space.frame, space.space) == ("bin", "cartesian"))
    assert (observe(data).constants[:, f] < 0.5 * CARRIED_PENALTY).tolist() == [True, True, False]
