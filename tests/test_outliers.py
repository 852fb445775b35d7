"""Outlier demonstrations: none among a noisy human's, and every planted one is found and named."""

import dataclasses
import warnings
from collections.abc import Iterator

import numpy as np
import pytest
from kinematic_world import CARRY, CLOSE, REACH, TURN_BACK, TWIST, teach

from lfd_gym.demonstration import Demonstration
from lfd_gym.errors import DemonstrationError, UnknownNameError
from lfd_gym.recording import record
from lfd_gym.registry import environment_id, look_up
from policies.outliers import find_outliers
from policies.sequence_graph import segments
from policies.sequence_graph_learner import ForceWarning, OutlierWarning, SequenceGraphLearner
from scripted_teachers import TEACHERS
from scripted_teachers.box_flipping import BoxFlippingTeacher
from scripted_teachers.move_object import MoveObjectTeacher
from scripted_teachers.teacher import Movement


@pytest.fixture(scope="module")
def usual() -> list[Demonstration]:
    return [teach(seed) for seed in range(5)]


def shifted(demonstration: Demonstration, label: int, offset: np.ndarray, rows: str = "tool_position") -> Demonstration:
    """The same, but measured elsewhere while one primitive was active and when it ended."""
    observations = {name: array.copy() for name, array in demonstration.observations.items()}
    for part in segments(demonstration.labels):
        if part.label == label:
            observations[rows][part.start + 1 : part.stop + 1] += offset
    return dataclasses.replace(demonstration, observations=observations)


def relabelled(demonstration: Demonstration, labels: np.ndarray) -> Demonstration:
    return dataclasses.replace(demonstration, labels=labels)


def pressing(demonstration: Demonstration, factor: float) -> Demonstration:
    wrench = factor * demonstration.observations["wrench"]
    return dataclasses.replace(demonstration, observations={**demonstration.observations, "wrench": wrench})


def pausing(demonstration: Demonstration, label: int, steps: int) -> Demonstration:
    """The same, but with a rest at the end of one primitive."""
    last = next(part.stop for part in segments(demonstration.labels) if part.label == label) - 1
    repeats = np.ones(len(demonstration), dtype=int)
    repeats[last] += steps
    seen = np.append(repeats, 1)
    return dataclasses.replace(
        demonstration,
        observations={name: np.repeat(rows, seen, axis=0) for name, rows in demonstration.observations.items()},
        **{name: np.repeat(getattr(demonstration, name), repeats, axis=0) for name in ("actions", "rewards", "labels")},
        states=np.repeat(demonstration.states, seen, axis=0),
    )


def test_usual_demonstrations_have_no_outlier(usual):
    for n in (1, 2, 3, 5):
        assert find_outliers(usual[:n]) == []


@pytest.mark.parametrize("n", [3, 5])
@pytest.mark.parametrize("index", [0, 2])
def test_planted_outlier_is_the_only_one_that_is_named(usual, n, index):
    first = usual[index]
    skipped = np.where(first.labels == TURN_BACK, CARRY, first.labels)
    for planted, reason in [
        (shifted(first, REACH, np.array([0.0, 0.08, 0.0])), "the position of 'reach' ends"),
        (shifted(first, CLOSE, np.array([0.0, 0.0, 0.9, 0.0]), "hand_position"), "the hand of 'close' ends"),
        (pressing(first, 3.0), "'twist' presses with 24 N, with the others 8 N"),
        (pausing(first, CLOSE, 1000), "'close' takes 2"),
        (relabelled(first, skipped), "after 'release' comes 'carry', with the others 'turn back'"),
    ]:
        demonstrations = [*usual[:index], planted, *usual[index + 1 : n]]
        outliers = find_outliers(demonstrations)
        assert [outlier.index for outlier in outliers] == [index]
        assert any(text.startswith(reason) for text in outliers[0].reasons), outliers
        assert str(outliers[0]).startswith(f"demonstration {index} is unlike the others: ")


def test_learner_names_an_outlier_and_leaves_it_out_if_asked(usual):
    odd = shifted(usual[0], REACH, np.array([0.0, 0.08, 0.0]))
    shown = [odd, *usual[1:4]]
    without = SequenceGraphLearner(outliers="keep").fit(usual[1:4]).skill_
    with pytest.warns(OutlierWarning, match="demonstration 0 is unlike the others.* is left out"):
        dropped = SequenceGraphLearner(outliers="drop").fit(shown).skill_
    assert np.array_equal(dropped.primitives.goal, without.primitives.goal)
    assert dropped.taught_seeds == without.taught_seeds
    with pytest.warns(OutlierWarning, match="is used all the same"):
        kept = SequenceGraphLearner().fit(shown).skill_
    assert not np.array_equal(kept.primitives.goal, without.primitives.goal)
    away = np.array([0.0, 0.3, 0.0])
    odd = [shifted(usual[0], REACH, away), shifted(usual[1], CARRY, away), shifted(usual[2], CARRY, -away)]
    with pytest.warns(OutlierWarning), pytest.raises(DemonstrationError, match="every demonstration is an outlier"):
        SequenceGraphLearner(outliers="drop").fit(odd)
    with pytest.raises(UnknownNameError, match="outliers"):
        SequenceGraphLearner(outliers="hide").fit(shown)


def test_turned_scene_has_the_same_outliers(usual):
    """A goal is where its frame is: the lid may stand anywhere, only the hand's place in its frame counts."""
    far = shifted(usual[1], REACH, np.array([0.3, 0.0, 0.0]))
    observations = {**far.observations, "frame_lid": far.observations["frame_lid"].copy()}
    for part in segments(far.labels):
        if part.label == REACH:
            observations["frame_lid"][part.start + 1 : part.stop + 1, :3] += [0.3, 0.0, 0.0]
    assert [outlier.index for outlier in find_outliers([usual[0], far, usual[2]])] == [1]
    followed = dataclasses.replace(far, observations=observations)
    assert find_outliers([usual[0], followed, usual[2]]) == []


def test_primitive_that_presses_may_end_anywhere(usual):
    assert find_outliers([usual[0], shifted(usual[1], TWIST, np.array([0.0, 0.0, 0.2])), usual[2]]) == []


def test_others_that_differ_among_themselves_say_nothing_about_the_order(usual):
    skipped = relabelled(usual[0], np.where(usual[0].labels == TURN_BACK, CARRY, usual[0].labels))
    other = relabelled(usual[1], np.where(usual[1].labels == TURN_BACK, CLOSE, usual[1].labels))
    for demonstrations, known in (([skipped, *usual[2:4]], True), ([skipped, other, usual[2]], False)):
        reasons = [reason for outlier in find_outliers(demonstrations) for reason in outlier.reasons]
        assert any(reason.startswith("after 'release' comes 'carry'") for reason in reasons) == known


def test_recording_may_stop_in_the_middle_of_its_last_primitive(usual):
    """It stops when the task is solved, here with the hand still closed."""
    first = usual[0]
    n = segments(first.labels)[-1].start + 3
    arrays = {name: getattr(first, name)[:n] for name in ("actions", "rewards", "labels")}
    observations = {name: rows[: n + 1] for name, rows in first.observations.items()}
    cut = dataclasses.replace(first, observations=observations, states=first.states[: n + 1], **arrays)
    assert cut.observations["hand_position"][-1, 1] > 1.0
    assert find_outliers([cut, *usual[1:3]]) == []


def test_another_way_with_primitives_of_its_own_is_no_outlier(usual):
    """Only an unusual order of what the others do, too, speaks against a demonstration."""
    own = np.where(usual[1].labels == CLOSE, TWIST, usual[1].labels)
    others = [relabelled(d, np.where(d.labels == TWIST, CLOSE, d.labels)) for d in usual]
    assert find_outliers([others[0], relabelled(usual[1], own), others[2]]) == []


def test_different_outliers_are_all_found_whatever_the_order(usual):
    planted = [pressing(usual[0], 3.0), *usual[1:4], shifted(usual[4], REACH, np.array([0.15, 0.0, 0.0]))]
    assert [outlier.index for outlier in find_outliers(planted)] == [0, 4]
    found = find_outliers(planted[::-1])
    assert [outlier.index for outlier in found] == [0, 4]
    assert "'reach'" in found[0].reasons[0]


def test_scatter_of_the_others_decides_once_there_are_many():
    """A sloppy teacher's 6 cm are usual, a precise one's 4.5 cm are not."""
    many = [teach(seed, noise=0.0) for seed in range(12)]
    rng = np.random.default_rng(0)
    sloppy = [shifted(d, REACH, 0.03 * rng.standard_normal(3)) for d in many[1:]]
    assert find_outliers([shifted(many[0], REACH, np.array([0.06, 0.0, 0.0])), *sloppy]) == []
    precise = find_outliers([shifted(many[0], REACH, np.array([0.045, 0.0, 0.0])), *many[1:]])
    assert [outlier.index for outlier in precise] == [0]


def test_a_press_without_force_is_an_outlier_and_warned_of_where_nobody_presses(usual):
    (outlier,) = find_outliers([usual[0], pressing(usual[1], 0.0), usual[2]])
    assert outlier.index == 1
    assert outlier.reasons == ("'twist' presses with 0.1 N, with the others 8 N",)
    without = [pressing(demonstration, 0.0) for demonstration in usual[:3]]
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        assert find_outliers(without) == []
        with pytest.warns(
            ForceWarning, match="'twist' shall press along z, but its demonstrations show no force there"
        ):
            SequenceGraphLearner().fit(without)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ForceWarning)
        SequenceGraphLearner().fit(usual[:3])


def test_only_what_was_measured_is_read(usual):
    planted = [usual[0], pressing(usual[1], 3.0), usual[2]]
    blind = [
        dataclasses.replace(d, actions=np.full_like(d.actions, np.nan), states=np.full_like(d.states, np.nan), setup={})
        for d in planted
    ]
    assert find_outliers(blind) == find_outliers(planted)


def test_demonstrations_of_several_tasks_are_refused(usual):
    with pytest.raises(DemonstrationError, match="2 environments"):
        find_outliers([*usual[:2], dataclasses.replace(usual[2], env_id="test/Other-v0")])


@pytest.mark.parametrize(
    ("task", "seed"),
    [
        *(("move-object", seed) for seed in range(5)),
        *(pytest.param("light-bulb", seed, marks=pytest.mark.slow) for seed in range(5)),
        pytest.param("box-stacking", 0, marks=pytest.mark.slow),
    ],
)
def test_no_demonstration_of_a_noisy_human_is_an_outlier(task: str, seed: int):
    teacher = look_up(TEACHERS, "teacher for", environment_id(task))(noise=1.0)
    assert find_outliers(record(task, teacher, 3, seed).demonstrations) == []


class Wandering(MoveObjectTeacher):
    """Approaches the object, goes back to the initial position, and approaches it again."""

    def script(self) -> Iterator[Movement]:
        first, approach, *rest = super().script()
        yield from (first, approach, first, approach, *rest)


class LiftingHigher(MoveObjectTeacher):
    """Lifts the object by 8 cm more."""

    def script(self) -> Iterator[Movement]:
        for movement in super().script():
            goal = movement.position
            if self.primitives[movement.label].name == "lift" and goal is not None:
                movement = dataclasses.replace(movement, position=lambda o, goal=goal: goal(o) + np.array([0, 0, 0.08]))
            yield movement


@pytest.mark.parametrize(
    ("teacher", "reason"),
    [(Wandering, "after 'approach object' comes 'approach initial'"), (LiftingHigher, "the position of 'lift' ends")],
)
def test_teacher_who_does_something_else_once_is_caught(teacher: type[MoveObjectTeacher], reason: str):
    for seed in range(2):
        usual = record("move-object", MoveObjectTeacher(noise=1.0), 2, seed).demonstrations
        odd = record("move-object", teacher(noise=0.0), 1, seed + 100).demonstrations
        outliers = find_outliers([usual[0], *odd, usual[1]])
        assert [outlier.index for outlier in outliers] == [1]
        assert outliers[0].reasons[0].startswith(reason)


@pytest.mark.slow
def test_teacher_who_presses_with_thrice_the_force_is_caught():
    usual = record("box-flipping", BoxFlippingTeacher(noise=1.0, press=5.0), 2, 0).demonstrations
    odd = record("box-flipping", BoxFlippingTeacher(noise=1.0, press=15.0), 1, 100).demonstrations
    (outlier,) = find_outliers([*usual, *odd])
    assert outlier.index == 2
    assert outlier.reasons[0].startswith("'flip box' presses with 1")
