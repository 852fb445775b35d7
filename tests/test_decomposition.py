"""Decomposition: planted primitives are found again, skills need no labels, bad input is named."""

import dataclasses

import numpy as np
import pytest
from kinematic_world import solve, teach
from scipy.stats import invgamma
from sklearn.metrics import adjusted_rand_score

from lfd_gym import quaternion
from lfd_gym.demonstration import Demonstration
from lfd_gym.errors import DemonstrationError
from lfd_gym.evaluation import describe
from policies import decomposition_learner
from policies.decomposition.bayesian import decompose
from policies.decomposition.changes import Visit, _carried, _places, changes, together
from policies.decomposition.checks import DecompositionWarning
from policies.decomposition.evidence import LOG_APART, Evidence, Statistics
from policies.decomposition.labelling import Labels, Row, absorbed, agreeing, labelled
from policies.decomposition.objective import Objective
from policies.decomposition.observed import observe
from policies.decomposition.result import Decomposition
from policies.decomposition.task_spaces import TaskSpace, entity_segments
from policies.decomposition_learner import DecompositionLearner


@pytest.fixture(scope="module")
def shown() -> list[Demonstration]:
    return [teach(seed) for seed in (3, 4, 5)]


@pytest.fixture(scope="module")
def found(shown: list[Demonstration]) -> Decomposition:
    return decompose(shown)


@pytest.fixture(scope="module")
def learned(shown: list[Demonstration]) -> DecompositionLearner:
    return DecompositionLearner().fit(shown)


def planted(n_demonstrations: int, rng: np.random.Generator) -> tuple[list[Demonstration], list[int]]:
    """Reaches to four goals, of two objects and the world, in an order of their own; and which goal each segment went to."""
    goals = [("lid", [0.0, 0.0, 0.05]), ("bin", [0.1, 0.0, 0.2]), ("lid", [0.0, 0.15, 0.1]), ("world", [0.3, 0.1, 0.4])]
    template, result, truth = teach(1, noise=0.0), [], []
    for _ in range(n_demonstrations):
        frames = {
            name: np.r_[
                rng.uniform(-0.3, 0.3, 2),
                0.0,
                quaternion.from_rotation_vector(np.array([0.0, 0.0, rng.uniform(-2, 2)])),
            ]
            for name in ("lid", "bin")
        } | {"world": np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])}
        path = [np.tile([0.0, 0.0, 0.6], (3, 1))]
        for k in (0, 1, 2, 3, 1):
            frame, offset = frames[goals[k][0]], np.array(goals[k][1])
            goal = frame[:3] + quaternion.rotate(frame[3:], offset) + 0.004 * rng.standard_normal(3)
            s = np.linspace(0.0, 1.0, 60)
            start = path[-1][-1]
            path += [start + np.outer(s**3 * (10 - 15 * s + 6 * s**2), goal - start), np.tile(goal, (25, 1))]
            truth.append(k)
        position = np.concatenate(path)
        n = len(position)
        seen = {
            "tool_position": position,
            "tool_quaternion": np.tile([0.0, 0.0, 1.0, 0.0], (n, 1)),
            "wrench": np.zeros((n, 6)),
            "frame_lid": np.tile(frames["lid"], (n, 1)),
            "frame_bin": np.tile(frames["bin"], (n, 1)),
        }
        fresh = {"rewards": np.zeros(n - 1), "labels": np.zeros(n - 1, dtype=int), "states": np.zeros((n, 1))}
        actions = np.zeros((n - 1, template.actions.shape[1]))
        result.append(dataclasses.replace(template, observations=seen, actions=actions, **fresh))
    return result, truth


def test_planted_primitives_are_found_with_their_frames() -> None:
    demonstrations, truth = planted(4, np.random.default_rng(0))
    position = decompose(demonstrations).entities["position"]
    assert adjusted_rand_score(truth, position.assignment) == 1.0
    by_goal = {truth[i]: position.primitives[k] for i, k in enumerate(position.assignment)}
    assert [by_goal[k].space.frame for k in range(4)] == ["lid", "bin", "lid", "world"]
    assert min(by_goal[k].confidence for k in range(4)) > 0.95
    np.testing.assert_allclose(by_goal[0].goal, [0.0, 0.0, 0.05], atol=3 * 0.004 / np.sqrt(4))


def test_one_segment_alone_says_nothing_about_its_rigid_frame() -> None:
    demonstrations, _ = planted(1, np.random.default_rng(1))
    observed = observe(entity_segments(demonstrations, "position"))
    plain = [f for f, s in enumerate(observed.spaces) if not any(s.held)][:3]
    log = Evidence(observed, (0.5, 0.15)).spaces(Evidence(observed, (0.5, 0.15)).single)
    np.testing.assert_allclose(log[:, plain], log[:, plain[:1]] * np.ones(3), atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_what_one_demonstration_showed_is_about_what_is_near(seed: int) -> None:
    demonstrations, _ = planted(1, np.random.default_rng(seed))
    seen, position = demonstrations[0].observations, decompose(demonstrations).entities["position"]
    chosen = []
    for part, k in zip(position.data.segments, position.assignment, strict=True):
        place = seen["tool_position"][part.stop]
        away = {name: np.linalg.norm(place - seen[f"frame_{name}"][0, :3]) for name in ("lid", "bin")} | {"world": 0.5}
        nearest, second = sorted(away, key=lambda name: away[name])[:2]
        if away[second] - away[nearest] > 0.02:
            chosen.append(position.primitives[k].space.frame == nearest)
    assert all(chosen)
    assert len(chosen) >= 3


def test_evidence_of_a_pair_is_its_marginal_likelihood() -> None:
    """Two ends in one dimension more, goal and variance integrated out numerically."""
    demonstrations, _ = planted(2, np.random.default_rng(2))
    observed = observe(entity_segments(demonstrations, "position"))
    evidence = Evidence(observed, (0.5, 0.15))
    pair = evidence.single.at([0]).plus(evidence.single.at([5]))
    v = np.exp(np.linspace(np.log(1e-3), np.log(1e4), 4001))
    group, f = observed.groups[0], 0
    a, b = group.shape, group.shape * 0.5**2
    square = float(((observed.ends[0, f, :3] - observed.ends[5, f, :3]) ** 2).sum())
    density = invgamma(a, scale=b).pdf(v) * (2 * np.pi * v) ** -1.5 * 2**-1.5 * np.exp(-0.25 * square / v)
    wanted = np.log(np.trapezoid(density, v))
    a, b = observed.groups[1].shape, observed.groups[1].shape * 0.15**2
    square = float(((observed.ends[0, f, 3:] - observed.ends[5, f, 3:]) ** 2).sum())
    density = invgamma(a, scale=b).pdf(v) * (2 * np.pi * v) ** -2.0 * 2**-2.0 * np.exp(-0.25 * square / v)
    wanted += np.log(np.trapezoid(density, v)) - observed.log_volume[f]
    got = evidence.spaces(pair)[0, f] - pair.constants[0, f] - np.log(observed.prior[f])
    assert got == pytest.approx(wanted, abs=2e-3)


def test_every_member_that_hints_contradict_counts_until_the_primitive_is_about_something_else() -> None:
    demonstrations, _ = planted(4, np.random.default_rng(3))
    data = entity_segments(demonstrations, "orientation")
    hints = np.zeros((len(data.segments), len(data.spaces)))
    hints[:, 1] = 1.0
    plain, hinted = (Evidence(observe(data, h), (0.5,)) for h in (None, hints))
    gained = {}
    for n in (1, 2, len(data.segments)):
        members = [Statistics(*(array[:n].sum(axis=0) for array in e.single)) for e in (plain, hinted)]
        gained[n] = hinted.spaces(members[1]) - plain.spaces(members[0])
        assert gained[n][1] == pytest.approx(0.0, abs=1e-6)
    assert gained[2][0] == pytest.approx(2.0 * gained[1][0], abs=1e-3)
    assert LOG_APART <= gained[len(data.segments)][0] < gained[2][0] < -5.0


def test_the_order_of_primitives_is_that_of_an_urn() -> None:
    """Every step is drawn in proportion to one plus how often it was made before."""
    demonstrations, _ = planted(4, np.random.default_rng(4))
    observed = observe(entity_segments(demonstrations, "position"))
    objective = Objective(observed, Evidence(observed, (0.5, 0.15)))
    rng = np.random.default_rng(5)
    for n in (1, 2, 5):
        z = np.r_[np.arange(n), rng.integers(n, size=len(observed.following) - n)]
        made: dict[tuple[int, int], int] = {}
        wanted, before = 0.0, n
        for i, k in enumerate(z):
            steps = [(before, int(k))] if k != before else []
            steps += [(int(k), n)] if observed.following[i] < 0 else []
            for a, b in steps:
                drawn = sum(count for (other, _), count in made.items() if other == a)
                wanted += np.log((1 + made.get((a, b), 0)) / (n + drawn))
                made[a, b] = made.get((a, b), 0) + 1
            before = n if observed.following[i] < 0 else int(k)
        assert objective.order(z) == pytest.approx(wanted, abs=1e-9)


def test_a_frame_that_is_carried_along_fits_by_itself(found: Decomposition, shown: list[Demonstration]) -> None:
    part, tool = found.entities["orientation"], np.asarray(shown[0].observations["tool_position"])
    assert {primitive.space.frame for primitive in part.primitives} == {"world"}
    about_lid = part.primitives[0]._replace(space=TaskSpace("lid", "rotation"))
    part = part._replace(primitives=(about_lid, *part.primitives[1:]))
    names = {n for n in shown[0].observations if n.startswith("frame_")}
    held = np.hstack([tool, np.tile([1.0, 0.0, 0.0, 0.0], (len(tool), 1))])
    held_all = dataclasses.replace(shown[0], observations={**shown[0].observations, **dict.fromkeys(names, held)})
    start, stop = 0, int(np.argmax(np.linalg.norm(tool - tool[0], axis=1)))
    in_object = np.array([primitive.space.frame != "world" for primitive in part.primitives])
    visit = Visit(0, start, stop, 0)
    assert (_carried(_places(held_all, part), part, visit) == in_object).all()
    assert not _carried(_places(shown[0], part), part, visit).any()


def test_a_rare_label_gives_way_to_the_one_that_is_common_at_its_place() -> None:
    rows = [Row((k, 0), ("position",)) for k in range(3)] + [Row((1, 1), ("position", "orientation"))]
    usual, rare, other = np.array([0, 0, 1, 1, 2]), np.array([0, 0, 3, 3, 2]), np.array([0, 3, 3, 0, 2])
    got = absorbed([usual, usual, usual, rare, other], rows)
    np.testing.assert_array_equal(got, [usual, usual, usual, usual, other])
    np.testing.assert_array_equal(absorbed([usual, usual, rare], rows)[2], rare)


def test_rare_labels_in_a_row_give_way_together() -> None:
    rows = [Row((k, 0), ("position",)) for k in range(4)] + [Row((k, 1), ("position",)) for k in (1, 2, 3)]
    usual, rare, elsewhere = np.array([0, 1, 1, 2, 3]), np.array([0, 4, 4, 5, 3]), np.array([0, 4, 4, 6, 3])
    got = absorbed([usual, usual, usual, rare, elsewhere], rows)
    np.testing.assert_array_equal(got, [usual, usual, usual, usual, elsewhere])


def test_demonstrations_that_go_their_own_way_are_left_out_where_most_agree() -> None:
    again, once, own = np.array([0, 1, 0, 1, 2, 2]), np.array([0, 0, 1, 1, 2, 2]), np.array([0, 1, 3, 3, 2, 2])
    skips = np.array([0, 0, 0, 2, 2, 2])
    assert agreeing([again, once, again, own, skips]) == [0, 1, 2]
    assert agreeing([again, again, once]) == [0, 1, 2]
    assert agreeing([again, own, again]) == [0, 1, 2]
    assert agreeing([again, again, own, own]) == [0, 1, 2, 3]
    assert agreeing([again]) == [0]


def test_the_skill_is_learned_from_demonstrations_that_agree(
    shown: list[Demonstration], monkeypatch: pytest.MonkeyPatch
) -> None:
    def garbled(demonstrations: list[Demonstration], found: Decomposition) -> Labels:
        labels, primitives = labelled(demonstrations, found)
        return Labels([*labels[:-1], labels[-1][::-1].copy()], primitives)

    monkeypatch.setattr(decomposition_learner, "labelled", garbled)
    four = [*shown, teach(6)]
    with pytest.warns(DecompositionWarning, match=r"without demonstrations \[3\]"):
        skill = DecompositionLearner().fit(four).skill_
    assert len(skill.taught_seeds) == len(four)
    assert sum(solve(skill, seed)[0] for seed in range(4)) >= 3


def test_a_skill_says_how_its_primitives_were_found(shown: list[Demonstration]) -> None:
    for method in ("bayesian", "end-point-hmm"):
        skill = DecompositionLearner(method=method).fit(shown).skill_
        assert describe(skill) == f"SequenceGraphSkill (decomposition, {method}, sequence-graph, global, rbf svm)"
        assert skill.metadata["parameters"]["method"] == method


def test_frames_that_are_a_guess_are_named(shown: list[Demonstration]) -> None:
    with pytest.warns(DecompositionWarning, match=r"do not tell the frame of position \d+ \(\w+, \d+%\)"):
        DecompositionLearner().fit(shown[:1])


def test_what_presses_is_found(found: Decomposition) -> None:
    pressing = [p for p in found.entities["position"].primitives if "force" in p.axes]
    assert len(pressing) == 1
    assert pressing[0].axes[2] == "force"
    assert pressing[0].force[2] == pytest.approx(8.0, abs=1.0)
    assert pressing[0].space.frame == "lid"


def test_changes_are_grouped_without_losing_one(shown: list[Demonstration], found: Decomposition) -> None:
    for own in changes(shown, found):
        groups = together(own)
        assert [change for group in groups for change in group] == own
        steps = [group[0].step for group in groups]
        assert steps == sorted(set(steps))


def test_every_step_has_a_label_and_labels_name_what_is_found(shown: list[Demonstration], found: Decomposition) -> None:
    labels, primitives = labelled(shown, found)
    assert [len(own) for own in labels] == [len(demonstration) for demonstration in shown]
    assert {int(k) for own in labels for k in own} == set(range(len(primitives)))


def test_a_skill_without_labels_solves_unseen_setups(learned: DecompositionLearner) -> None:
    assert sum(solve(learned.skill_, seed)[0] for seed in range(100, 110)) >= 9


def test_labels_and_the_primitive_table_are_not_read(shown: list[Demonstration], learned: DecompositionLearner) -> None:
    other = [
        dataclasses.replace(
            demonstration,
            labels=np.zeros(len(demonstration), dtype=int),
            primitives=demonstration.primitives[:1],
            actions=np.full_like(demonstration.actions, np.nan),
            states=np.full_like(demonstration.states, np.nan),
        )
        for demonstration in shown
    ]
    blind = DecompositionLearner().fit(other).skill_
    first, again = learned.skill_.to_arrays()[1], blind.to_arrays()[1]
    assert first.keys() == again.keys()
    assert all(np.array_equal(first[name], again[name]) for name in first)


def changed(demonstration: Demonstration, **observations: np.ndarray) -> Demonstration:
    return dataclasses.replace(demonstration, observations=dict(demonstration.observations) | observations)


def test_a_still_arm_is_named(shown: list[Demonstration]) -> None:
    names = ("tool_position", "tool_quaternion", "hand_position")
    still = {name: np.repeat(shown[0].observations[name][:1], len(shown[0]) + 1, axis=0) for name in names}
    with pytest.raises(DemonstrationError, match="nothing moves in demonstration 0"):
        DecompositionLearner().fit([changed(shown[0], **still, wrench=np.zeros((len(shown[0]) + 1, 6)))])


def test_an_offset_of_the_force_sensor_is_named(shown: list[Demonstration]) -> None:
    with pytest.raises(DemonstrationError, match="zero the force sensor"):
        DecompositionLearner().fit([changed(shown[0], wrench=shown[0].observations["wrench"] + 5.0)])


def test_a_missing_wrench_is_warned_of(shown: list[Demonstration]) -> None:
    without = [
        dataclasses.replace(d, observations={k: v for k, v in d.observations.items() if k != "wrench"}) for d in shown
    ]
    with pytest.warns(DecompositionWarning, match="record the wrench"):
        DecompositionLearner().fit(without)


def test_a_demonstration_without_a_pause_is_named(shown: list[Demonstration]) -> None:
    n = len(shown[0]) + 1
    turn = 0.02 * np.arange(n)
    circle = np.stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), np.full(n, 0.3)], axis=1)
    seen = {
        name: np.repeat(shown[0].observations[name][:1], n, axis=0) for name in ("tool_quaternion", "hand_position")
    }
    with (
        pytest.warns(DecompositionWarning, match="without a pause"),
        pytest.raises(DemonstrationError, match="pause where a movement ends"),
    ):
        DecompositionLearner().fit([changed(shown[0], tool_position=circle, wrench=np.zeros((n, 6)), **seen)])
