"""The sequence graph skill in a world without physics: it learns, generalises, remembers and refuses."""

import dataclasses
import json
import pickle
from functools import partial

import numpy as np
import pytest
from kinematic_world import CARRY, CLOSE, DT, PRIMITIVES, REACH, LidWorld, solve, teach

from lfd_gym import quaternion
from lfd_gym.errors import DemonstrationError, InvalidArgumentError, SkillFileError, UnknownNameError
from policies import LEARNERS, load_skill
from policies.primitive_attractor import Goals, command
from policies.sequence_graph import global_graph
from policies.sequence_graph_learner import SequenceGraphLearner
from policies.sequence_graph_skill import Memory, SequenceGraphSkill
from policies.skill import SCHEMA
from policies.task_space import CARTESIAN, CYLINDRICAL
from policies.transitions import CLASSIFIERS


@pytest.fixture(scope="module")
def taught():
    return [teach(seed) for seed in (1000, 1001, 1002)]


@pytest.fixture(scope="module")
def skill(taught):
    return SequenceGraphLearner().fit(taught).skill_


def same_skill(a, b) -> bool:
    (values, arrays), (other_values, other_arrays) = a.to_arrays(), b.to_arrays()
    return values == other_values and all(np.array_equal(arrays[name], other_arrays[name]) for name in arrays)


def changed(demonstration, **fields):
    return dataclasses.replace(demonstration, **fields)


@pytest.mark.parametrize("classifier", ["svm", "lr"])
def test_skill_learned_from_three_demonstrations_solves_unseen_setups(taught, classifier):
    skill = SequenceGraphLearner(classifier=classifier).fit(taught).skill_
    assert sum(solve(skill, seed)[0] for seed in range(5)) >= 4


def test_repetitions_follow_the_world_not_the_demonstrations(skill):
    strokes = {solve(skill, seed)[1].count(2) for seed in (0, 1, 2, 3)}
    assert len(strokes) >= 2


def test_one_demonstration_is_enough_in_a_simple_world():
    skill = SequenceGraphLearner().fit([teach(1009)]).skill_
    assert sum(solve(skill, seed)[0] for seed in range(4)) >= 3


def test_a_grip_that_creeps_with_what_it_holds_is_not_waited_for_for_ever(skill):
    """Where the hand is to stay beside a lid that it holds, an error of a millimetre moves and turns both on and on."""
    world = LidWorld()
    seen = world.reset(0)
    action, state = skill.predict(seen)
    while skill.active(state)[0] != CLOSE:
        seen = world.step(action)
        action, state = skill.predict(seen, state)
    creep, turn, waited = np.array([0.0, 0.01 * DT, 0.0]), quaternion.from_rotation_vector(np.array([0.0, 0.0, DT])), 0
    while skill.active(state)[0] == CLOSE and waited < 500:
        off, held = seen["tool_position"] - seen["frame_lid"][:3], quaternion.multiply(turn, seen["frame_lid"][3:])
        place = seen["frame_lid"][:3] + creep
        seen = {
            **seen,
            "tool_position": place + quaternion.rotate(turn, off),
            "tool_quaternion": quaternion.multiply(turn, seen["tool_quaternion"]),
            "frame_lid": np.r_[place, held],
        }
        _, state = skill.predict(seen, state)
        waited += 1
    assert 0.5 < waited * DT < 4.0


def test_goals_that_are_far_apart_are_waited_for_all_the_same(taught):
    """A demonstrator who drops the lid 8 cm from where the others did waits to be there, and not for a grip alone."""
    offsets = np.array([[0.08, 0.0, 0.0], [-0.04, 0.07, 0.0], [-0.04, -0.07, 0.0]])
    rows = list(PRIMITIVES)
    rows[CARRY] = rows[CARRY]._replace(hand=rows[CARRY].hand._replace(axes=("position",) * 4))
    careless = []
    for demonstration, offset in zip(taught, offsets, strict=True):
        seen = {name: values.copy() for name, values in demonstration.observations.items()}
        seen["frame_bin"][:, :3] += offset
        carried = np.flatnonzero(demonstration.labels == CARRY)
        seen["hand_position"][carried, 1:] -= np.linspace(0.6, -0.6, len(carried)).clip(0.0)[:, None]
        careless.append(changed(demonstration, observations=seen, primitives=tuple(rows)))
    skill = SequenceGraphLearner(outliers="keep").fit(careless).skill_
    carries = [node for node, label in zip(skill.nodes, skill.graph.labels, strict=True) if label == CARRY]
    assert all("position" in node.feature_names for node in carries)
    assert sum(solve(skill, seed)[0] for seed in range(5)) >= 4


def test_no_goal_is_a_trap(taught):
    """Without patience every decision at a goal must be to leave it."""
    skill = SequenceGraphLearner(patience=None).fit(taught).skill_
    assert all(solve(skill, seed)[0] for seed in range(2))


def test_yielding_world_is_the_only_condition_of_its_exit(skill, taught):
    twist = next(node for node, label in enumerate(skill.graph.labels) if PRIMITIVES[label].name == "twist")
    node = skill.nodes[twist]
    carry = int(np.argmax([skill.graph.labels[t] == CARRY for t in node.targets]))
    yielded, turned = (node.feature_names.index(name) for name in ("world yielded along z", "orientation"))
    for angle in np.linspace(0, 1, 11):
        features = np.zeros(len(node.feature_names))
        features[turned], features[yielded] = angle, 1.0
        assert int(np.argmax(node.decision.scores(features))) == carry
        features[yielded] = 0.0
        assert int(np.argmax(node.decision.scores(features))) != carry


def test_goals_and_forces_are_those_of_the_teacher(skill):
    reach = skill.primitives.goal[REACH]
    assert reach[:3] == pytest.approx([0, 0, 0.05], abs=0.012)
    assert skill.primitives.force[2] == pytest.approx([0, 0, 8.0], abs=0.1)
    assert (skill.primitives.grip[1, 1:] > 0).all()
    assert (skill.primitives.grip[REACH] == 0).all()


def test_fit_reads_only_what_it_may(taught, skill):
    blind = [
        changed(
            d,
            actions=np.full_like(d.actions, np.nan),
            states=np.full_like(d.states, np.nan),
            setup={},
            observations={
                name: np.full_like(rows, np.nan) if name.startswith("reference_") else rows
                for name, rows in d.observations.items()
            },
        )
        for d in taught
    ]
    assert same_skill(SequenceGraphLearner().fit(blind).skill_, skill)


def test_fit_is_repeatable_and_returns_the_learner(taught, skill):
    learner = SequenceGraphLearner()
    assert learner.fit(taught) is learner
    assert same_skill(learner.fit(taught).skill_, skill)
    assert SequenceGraphLearner(**learner.get_params()).get_params() == learner.get_params()


def test_turned_and_moved_scene_is_solved_by_the_same_actions_in_its_frame(skill):
    """The skill sees the lid only through its frame: a lid elsewhere changes where, not what."""
    world = LidWorld()
    for seed in range(3):
        observation = world.reset(seed)
        _, state = skill.predict(observation)
        goal = Memory(*state).position[0]
        turned = quaternion.rotate(world.lid[3:], skill.primitives.goal[REACH, :3])
        assert goal - world.lid[:3] == pytest.approx(turned)


@pytest.mark.parametrize("space", [CARTESIAN, CYLINDRICAL])
@pytest.mark.parametrize("label", range(len(PRIMITIVES)))
@pytest.mark.parametrize("felt", [0.0, 1.0])
def test_turning_and_moving_all_that_is_seen_turns_and_moves_what_is_asked_of_the_robot(skill, space, label, felt):
    """Also where the scene tilts: goals, pull and force stand in their frames."""
    rng = np.random.default_rng(label)
    primitives, frames = skill.primitives, np.array([random_pose(rng) for _ in skill.primitives.table.frames])
    force = primitives.force + [1.0, 2.0, 0.0] * primitives.force.any(axis=1, keepdims=True)
    primitives = primitives._replace(
        force=force, table=primitives.table._replace(space=np.full_like(primitives.table.space, space))
    )
    seen, last = np.r_[random_pose(rng), np.ones(4)], random_pose(rng)
    before = Goals(last[:3], last[3:], np.zeros(4), last[:3] + 0.01, np.array(0.1))
    pose = random_pose(rng)
    turn = partial(quaternion.rotate, pose[3:])

    def turned(poses):
        return np.array([np.r_[pose[:3] + turn(p[:3]), quaternion.multiply(pose[3:], p[3:])] for p in poses])

    there = Goals(*np.split(turned([last])[0], [3]), before.hand, pose[:3] + turn(before.pull), before.pace)
    _, pressed = command(primitives, label, seen, frames, before, {"wrench": np.zeros(6)}, DT)
    wrench = np.r_[-felt * pressed, np.zeros(3)]
    goals, _ = command(primitives, label, seen, frames, before, {"wrench": wrench}, DT)
    turned_goals, turned_pressed = command(
        primitives, label, np.r_[turned([seen[:7]])[0], seen[7:]], turned(frames), there,
        {"wrench": np.r_[turn(wrench[:3]), np.zeros(3)]}, DT,
    )  # fmt: skip
    assert turned_goals.position == pytest.approx(pose[:3] + turn(goals.position))
    assert abs(turned_goals.quaternion @ quaternion.multiply(pose[3:], goals.quaternion)) == pytest.approx(1.0)
    assert turned_goals.pull == pytest.approx(pose[:3] + turn(goals.pull))
    assert turned_pressed == pytest.approx(turn(pressed))
    assert bool(pressed.any()) == (PRIMITIVES[label].name == "twist")


def random_pose(rng):
    return np.r_[rng.uniform(-0.5, 0.5, 3), quaternion.from_rotation_vector(rng.uniform(-1.5, 1.5, 3))]


def test_held_entities_keep_their_last_goal_and_released_force_axes_the_measured_place(skill):
    observation = LidWorld().reset(0)
    observation = {name: value for name, value in observation.items() if not name.startswith("reference_")}
    twist = next(node for node, label in enumerate(skill.graph.labels) if label == 2)
    state = skill.start(1)
    _, state = skill.predict(observation, state)
    memory = Memory(*state)._replace(node=np.array([twist]))
    observation["tool_position"] = observation["frame_lid"][:3] + np.array([0.0, 0.0, 0.053])
    _, after = skill.predict(observation, tuple(memory))
    assert Memory(*after).position[0, 2] == pytest.approx(observation["tool_position"][2])
    hold = next(node for node, label in enumerate(skill.graph.labels) if PRIMITIVES[label].name == "turn back")
    _, held = skill.predict(observation, tuple(Memory(*after)._replace(node=np.array([hold]))))
    assert Memory(*held).position == pytest.approx(Memory(*after).position)


def test_vectorised_prediction_equals_single_predictions(skill):
    worlds = [LidWorld() for _ in range(3)]
    seen = [world.reset(seed) for seed, world in enumerate(worlds)]
    single, batch = [None] * 3, None
    for step in range(60):
        start = np.array([step == 0, step == 30, step == 0])
        stacked = {name: np.stack([o[name] for o in seen]) for name in seen[0]}
        actions, batch = skill.predict(stacked, batch, start)
        assert actions.shape == (3, 13)
        for i, world in enumerate(worlds):
            action, single[i] = skill.predict(seen[i], single[i], start[i : i + 1])
            assert np.array_equal(action, actions[i])
            seen[i] = world.step(action)
    assert [len(array) for array in batch] == [3] * len(batch)
    assert skill.active(batch).shape == (3,)


def test_skill_survives_its_file_and_pickling(skill, tmp_path):
    skill.save(tmp_path / "skill")
    skill.save(tmp_path / "again")
    assert (tmp_path / "skill").read_bytes() == (tmp_path / "again").read_bytes()
    for other in (load_skill(tmp_path / "skill"), pickle.loads(pickle.dumps(skill))):
        assert same_skill(skill, other)
        assert (other.env_id, other.taught_seeds, other.metadata) == (skill.env_id, skill.taught_seeds, skill.metadata)
        assert solve(other, 1) == solve(skill, 1)


class UnlistedSkill(SequenceGraphSkill):
    """Its kind has no row in `policies.SKILLS`."""

    kind = "unlisted"


def test_a_skill_that_nothing_could_read_is_not_written(skill, tmp_path):
    facts = {"env_id": skill.env_id, "taught_seeds": (), "metadata": {}}
    unlisted = UnlistedSkill.from_arrays(*skill.to_arrays(), **facts)
    with pytest.raises(SkillFileError, match='no row "unlisted": "test_sequence_graph_skill:UnlistedSkill"'):
        unlisted.save(tmp_path / "skill.npz")
    assert list(tmp_path.iterdir()) == []


def test_damaged_and_foreign_files_are_refused(skill, tmp_path):
    with pytest.raises(SkillFileError, match="no skill at"):
        load_skill(tmp_path / "missing")
    skill.save(tmp_path / "skill")
    whole = (tmp_path / "skill").read_bytes()
    (tmp_path / "cut").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text").write_text("not a skill")
    np.savez(tmp_path / "other.npz", header=np.array('{"schema": "other"}'))
    np.savez(tmp_path / "pickled.npz", header=np.array([{}], dtype=object))
    np.save(tmp_path / "array.npy", np.zeros(3))
    np.savez(tmp_path / "kinds.npz", header=np.array(json.dumps({"schema": SCHEMA, "kind": ["moa"]})))
    for name in ("cut", "text", "other.npz", "pickled.npz", "array.npy", "kinds.npz"):
        with pytest.raises(SkillFileError) as error:
            load_skill(tmp_path / name)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("node1_feature_primitives", 50), ("node1_feature_columns", 10**8), ("node1_targets", -3), ("position_frame", 9),
        ("goal", None), ("modes", None), ("node1_gains", None), ("node1_decision_support", None),
    ],
)  # fmt: skip
def test_files_whose_parts_do_not_fit_are_refused(skill, tmp_path, name, value):
    skill.save(tmp_path / "skill.npz")
    with np.load(tmp_path / "skill.npz") as file:
        arrays = {key: file[key] for key in file.files}
    arrays[name] = arrays[name][..., :-1] if value is None else np.full_like(arrays[name], value)
    np.savez(tmp_path / "changed.npz", **arrays)
    with pytest.raises(SkillFileError, match="damaged"):
        load_skill(tmp_path / "changed.npz")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(taught, value):
    skill = SequenceGraphLearner(observations=("hand_position",), feature="primitive").fit(taught).skill_
    values, arrays = skill.to_arrays()
    facts = {"env_id": skill.env_id, "taught_seeds": (), "metadata": {}}
    floats = [name for name, array in arrays.items() if array.dtype.kind == "f" and array.size]
    assert {"goal", "observed_low", "node1_gains", "node1_dwell", "node1_decision_support"} <= set(floats)
    for name in floats:
        broken = arrays[name].copy()
        broken.flat[-1] = value
        with pytest.raises(ValueError, match="does not fit the rest"):
            SequenceGraphSkill.from_arrays(values, arrays | {name: broken}, **facts)


@pytest.mark.parametrize("patience", [np.nan, -1.0, "1.0"])
def test_a_patience_that_is_none_is_refused(skill, patience):
    values, arrays = skill.to_arrays()
    nodes = [node | {"patience": patience} for node in values["nodes"]]
    facts = {"env_id": skill.env_id, "taught_seeds": (), "metadata": {}}
    with pytest.raises(ValueError, match="'patience' does not fit"):
        SequenceGraphSkill.from_arrays(values | {"nodes": nodes}, arrays, **facts)


def test_an_environment_that_is_no_id_is_refused(skill, tmp_path):
    skill.save(tmp_path / "skill.npz")
    with np.load(tmp_path / "skill.npz") as file:
        arrays = {key: file[key] for key in file.files}
    header = json.loads(str(arrays["header"]))
    header["facts"]["env_id"] = 5
    np.savez(tmp_path / "changed.npz", **(arrays | {"header": np.array(json.dumps(header))}))
    with pytest.raises(SkillFileError, match="damaged"):
        load_skill(tmp_path / "changed.npz")


@pytest.mark.parametrize("classifier", ["lr", "klr", "svm", "gmm"])
def test_a_decision_is_kept_and_every_array_of_it_has_the_size_of_the_others(skill, classifier):
    at = max(range(len(skill.nodes)), key=lambda i: len(skill.nodes[i].targets))
    node, rng = skill.nodes[at], np.random.default_rng(0)
    classes = np.repeat(np.arange(len(node.targets)), 20)
    features = rng.uniform(size=(len(classes), len(node.sides))) + 0.3 * classes[:, None]
    _, decision = CLASSIFIERS[classifier](features, classes, np.ones(len(classes)), C=1.0)
    nodes = [*skill.nodes[:at], node._replace(decision=decision), *skill.nodes[at + 1 :]]
    facts = {"env_id": skill.env_id, "taught_seeds": (), "metadata": {}}
    values, arrays = SequenceGraphSkill(
        skill.graph, skill.primitives, nodes, skill.named, skill.layout, skill.dt, **facts
    ).to_arrays()
    again = SequenceGraphSkill.from_arrays(values, arrays, **facts).nodes[at].decision
    assert type(again) is type(decision)
    for name, array in decision._asdict().items():
        np.testing.assert_array_equal(getattr(again, name), array)
    assert len(node.targets) >= 3
    for name in decision._fields:
        key = f"node{at}_decision_{name}"
        wrong = [arrays[key][..., None], *(np.repeat(arrays[key], 2, axis) for axis in range(arrays[key].ndim))]
        wrong += [arrays[key][::-1]] if name in ("pairs", "starts") else []
        for array in wrong:
            with pytest.raises(ValueError, match="does not fit the rest"):
                SequenceGraphSkill.from_arrays(values, arrays | {key: array}, **facts)


@pytest.mark.parametrize("dt", [0.0, -0.02, np.inf, "0.02", None])
def test_a_control_step_that_is_none_is_refused(skill, dt):
    values, arrays = skill.to_arrays()
    with pytest.raises(ValueError, match="'dt' does not fit"):
        SequenceGraphSkill.from_arrays(values | {"dt": dt}, arrays, env_id=skill.env_id, taught_seeds=(), metadata={})


def test_parameters_may_be_numpys(taught, tmp_path):
    SequenceGraphLearner(C=np.arange(3)[2]).fit(taught).skill_.save(tmp_path / "skill.npz")
    assert load_skill(tmp_path / "skill.npz").metadata["parameters"]["C"] == 2


def test_nothing_is_waited_for_before_the_first_primitive(taught):
    skill = SequenceGraphLearner(graph="fully-connected").fit(taught).skill_
    assert not skill.nodes[0].dwell.any()
    assert any(node.dwell.any() for node in skill.nodes)


def test_demonstrations_that_cannot_be_learned_from_are_refused_in_one_line(taught):
    first = taught[0]
    constant, gap = np.zeros_like(first.labels), first.labels.copy()
    gap[5] = -1
    observations = dict(first.observations)
    nan = {**observations, "tool_position": np.full_like(observations["tool_position"], np.nan)}
    del observations["frame_bin"]
    for bad, message in [
        ([], "missing"),
        ([first, changed(taught[1], env_id="test/Other-v0")], "2 environments"),
        ([first, changed(taught[1], dt=0.1)], "time step"),
        ([first, changed(taught[1], action_layout={**first.action_layout, "alpha": 1.0})], "action layout"),
        ([first, changed(taught[1], labels=np.zeros_like(taught[1].labels))], "demonstration 1 shows no transition"),
        ([changed(first, labels=constant)], "'reach' is its only primitive"),
        ([changed(first, labels=gap)], "without a label, the first is step 5"),
        ([changed(first, observations=observations)], "frame 'bin'"),
        ([changed(first, observations=nan)], "not finite"),
    ]:
        with pytest.raises(DemonstrationError, match=message) as error:
            SequenceGraphLearner().fit(bad)
        assert "\n" not in str(error.value)


def test_impossible_arguments_are_refused_with_what_is_possible(taught):
    with pytest.raises(UnknownNameError, match="possible: global, local, fully-connected"):
        SequenceGraphLearner(graph="globl").fit(taught)
    for name, values in {"C": (0.0,), "dwell": (-1.0,), "patience": (-1.0,)}.items():
        for value in (*values, np.inf, np.nan, "1", True):
            with pytest.raises(InvalidArgumentError, match=f"{name} is {value!r}; possible: a number "):
                SequenceGraphLearner(**{name: value}).fit(taught)
    with pytest.raises(InvalidArgumentError, match="fold is 'maybe'; possible: True, False"):
        SequenceGraphLearner(fold="maybe").fit(taught)
    with pytest.raises(InvalidArgumentError, match="observations is 'wrench'; possible: None, a list"):
        SequenceGraphLearner(observations="wrench").fit(taught)


@pytest.mark.parametrize("graph", ["local", "fully-connected"])
@pytest.mark.parametrize("feature", ["entity", "primitive"])
def test_every_graph_and_feature_gives_a_skill(taught, graph, feature):
    skill = SequenceGraphLearner(graph=graph, feature=feature).fit(taught).skill_
    assert np.isfinite(skill.predict(LidWorld().reset(0))[0]).all()


def test_folding_can_be_switched_off(taught):
    labels = [d.labels for d in taught]
    skill = SequenceGraphLearner(fold=False).fit(taught).skill_
    assert skill.graph == global_graph(labels, fold_repetitions=False)
    assert skill.graph.n_nodes > SequenceGraphLearner().fit(taught).skill_.graph.n_nodes


def test_registry_names_the_learner():
    assert LEARNERS["sequence-graph"].endswith(":SequenceGraphLearner")
