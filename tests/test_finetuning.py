"""Fine-tuning: it starts exactly from the skill it is given, finds what was planted, and keeps nothing that does worse."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lfd_gym import cli
from lfd_gym.errors import InvalidArgumentError
from lfd_gym.recording import record
from lfd_gym.registry import make
from lfd_gym.rollout import rollout
from lfd_gym.view import View
from policies import load_skill
from policies.decisions import KernelDecision, LinearDecision, MixtureDecision, VotingDecision
from policies.moa.frames import Frames
from policies.path_generators import AttractorPath
from policies.reinforcement import FINETUNERS, finetuning, refined_graph, settings, skill_parameters
from policies.reinforcement.growth import Growth
from policies.reinforcement.practice import Episode, Practice, identity, practise, scores
from policies.reinforcement.residual import PRESS, SHIFT, adjusted
from policies.sequence_graph_learner import SequenceGraphLearner
from policies.sequence_graph_skill import SequenceGraphSkill
from scripted_teachers.move_object import MoveObjectTeacher

ENV_ID, SEED = "lfd_gym/MoveObject-v0", 100000


@pytest.fixture(scope="module")
def skill() -> SequenceGraphSkill:
    demonstrations = record(ENV_ID, MoveObjectTeacher(noise=1.0), n=2, seed=12).demonstrations
    return SequenceGraphLearner().fit(demonstrations).skill_


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The methods with agents, untrained or hardly trained."""
    for package in ("stable_baselines3", "sb3_contrib"):
        pytest.importorskip(package, reason="the rl extra is not installed")
    from dataclasses import replace

    from policies.reinforcement import agents, learned_residuals

    monkeypatch.setattr(agents, "WIDTH", 16)
    graph = {**settings.GRAPH_PPO.hyperparameters, "batch_size": 16, "n_epochs": 1}
    sac = {**settings.RESIDUAL_SAC.hyperparameters, "batch_size": 16, "learning_starts": 20, "buffer_size": 500}
    sac |= {"gradient_steps": 1}
    monkeypatch.setattr(
        learned_residuals, "GRAPH_PPO", replace(settings.GRAPH_PPO, n_envs=1, rollout=64, hyperparameters=graph)
    )
    monkeypatch.setattr(learned_residuals, "RESIDUAL_SAC", replace(settings.RESIDUAL_SAC, hyperparameters=sac))
    return learned_residuals


def actions(policy: Any) -> np.ndarray:
    return np.array([step.action for step in rollout(make(ENV_ID), policy, SEED)])


@pytest.mark.parametrize("method", ["refine_graph", "learn_residual"])
def test_before_the_first_update_nothing_has_changed(
    method: str, small: Any, skill: SequenceGraphSkill, tmp_path: Path
) -> None:
    after, facts = getattr(small, method)(Practice(skill, ENV_ID, {}, 0, tmp_path / "t"))
    assert facts["updates"] == 0
    assert type(after) is not type(skill)
    assert np.array_equal(actions(after), actions(skill))
    after.save(tmp_path / "skill.npz")
    assert np.array_equal(actions(load_skill(tmp_path / "skill.npz")), actions(skill))


def test_a_skill_from_its_file_is_the_one_that_practised(skill: SequenceGraphSkill, tmp_path: Path) -> None:
    skill.save(tmp_path / "skill.npz")
    loaded = load_skill(tmp_path / "skill.npz")
    assert identity(loaded) == identity(skill)


def test_practice_of_decisions_keeps_a_checkpoint_on_the_way(
    small: Any, skill: SequenceGraphSkill, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from policies.reinforcement.checkpoint import TrainingFolder

    kept: list[int] = []
    monkeypatch.setattr(TrainingFolder, "write", lambda self, agent, state: kept.append(state["decisions"]))
    _, facts = small.refine_graph(Practice(skill, ENV_ID, {}, 3, tmp_path / "t"))
    assert kept[0] < kept[-1] == facts["decisions"]


def test_an_agent_that_has_not_learned_decides_as_the_graph_does(small: Any, skill: SequenceGraphSkill) -> None:
    """Asked at every control step, masked and deterministic, the agent leads the robot where the skill leads it."""
    from stable_baselines3.common.vec_env import DummyVecEnv

    env = Growth(refined_graph.GraphDecisions(make(ENV_ID, reward_type="dense"), skill, hold=1))
    agent = small.make_graph_agent(small.GRAPH_PPO, DummyVecEnv([lambda: env]))
    observation, _ = env.reset(seed=SEED)
    ended, total, nodes = False, env.unwrapped.reward(), set()
    while not ended:
        action, _ = agent.predict(observation, deterministic=True, action_masks=env.get_wrapper_attr("action_masks")())
        observation, reward, terminated, truncated, info = env.step(action)
        ended, total = terminated or truncated, total + reward
        nodes.add(int(np.argmax(observation[: len(skill.nodes)])))
    last = list(rollout(make(ENV_ID, reward_type="dense"), skill, SEED))[-1]
    assert info["is_success"] == last.info["is_success"]
    assert total == pytest.approx(last.reward)
    assert len(nodes) > 3
    tool = env.unwrapped.get_state()[:7]
    world = make(ENV_ID)
    list(rollout(world, skill, SEED))
    assert np.array_equal(world.unwrapped.get_state()[:7], tool)


def test_one_decision_to_leave_a_node_leaves_it(skill: SequenceGraphSkill) -> None:
    """However long the skill waits until it follows what it chose; and to stay is decided anew after a fifth of a second."""
    env = refined_graph.GraphDecisions(make(ENV_ID, reward_type="dense"), skill)
    env.reset(seed=SEED)
    env.step(0)
    for _ in range(2):
        node, time = env._node, env.unwrapped.data.time
        env.step(0)
        assert env._node == node
        assert env.unwrapped.data.time == pytest.approx(time + refined_graph.CLASS_TIME)
        env.step(1)
        assert env._node == skill.nodes[node].targets[1] != node
        assert skill.nodes[node].dwell[1] > refined_graph.CLASS_TIME


def test_the_exported_skill_scores_as_the_agent_and_rules_nothing_out(small: Any, skill: SequenceGraphSkill) -> None:
    import torch
    from stable_baselines3.common.vec_env import DummyVecEnv

    env = refined_graph.GraphDecisions(make(ENV_ID, reward_type="dense"), skill)
    agent = small.make_graph_agent(small.GRAPH_PPO, DummyVecEnv([lambda: env]))
    net = agent.policy.action_net
    torch.manual_seed(0)
    torch.nn.init.normal_(net.last.weight, std=5.0)
    refined = refined_graph.RefinedGraphSkill.of(skill, small.residual_network(agent), {})
    rng, furthest = np.random.default_rng(0), 0.0
    for node in range(len(skill.nodes) - 1):
        decision, n = skill.nodes[node].decision, len(skill.nodes[node].feature_primitives)
        for features in rng.uniform(size=(5, n)):
            log_p = refined_graph.log_probabilities(decision, features)
            x = torch.as_tensor(env.inputs.whole(node, features, log_p))[None]
            scores = refined.scores(node, decision, features)
            logits = net(x)[0].detach().numpy()[: len(log_p)]
            assert scores == pytest.approx(logits, abs=1e-4)
            furthest = max(furthest, np.abs(scores - log_p).max())
    assert 0.9 * refined_graph.BOUND < furthest <= refined_graph.BOUND


def test_nothing_comes_after_the_last_node(small: Any, skill: SequenceGraphSkill) -> None:
    """A task that the graph believes done and that is not fails: it is not cut off in the middle."""
    lost = copy.deepcopy(skill)
    lost.primitives.goal[:, 1] += 0.05
    env = refined_graph.GraphDecisions(make(ENV_ID, reward_type="dense"), lost, hold=1)
    env.reset(seed=SEED)
    terminated = truncated = False
    while not (terminated or truncated):
        decision = lost.nodes[env._node].decision
        _, _, terminated, truncated, info = env.step(0)
    assert decision is None
    assert not info["is_success"]
    assert (terminated, truncated) == (True, False)


def some_decisions(rng: np.random.Generator) -> list[Any]:
    n, support = 3, rng.normal(size=(5, 3))
    pairs = np.array([(0, 1), (0, 2), (1, 2)])
    whitening = np.tile(np.eye(n), (4, 1, 1)) * 3.0
    return [
        LinearDecision(30.0 * rng.normal(size=(4, n)), rng.normal(size=4)),
        KernelDecision(support, np.array(1.0), 9.0 * rng.normal(size=(4, 5)), rng.normal(size=4)),
        VotingDecision(support, np.array(1.0), pairs, rng.normal(size=(3, 5)), rng.normal(size=3), np.full(3, 2.0)),
        MixtureDecision(rng.normal(size=(4, n)), whitening, rng.normal(size=4), np.array([0, 2, 3])),
    ]


def test_log_probabilities_keep_the_order_of_the_scores() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        for decision in some_decisions(rng):
            features = rng.uniform(size=3)
            log_p, frozen = refined_graph.log_probabilities(decision, features), decision.scores(features)
            assert np.array_equal(np.argsort(log_p, kind="stable"), np.argsort(frozen, kind="stable"))
            likely = log_p > -refined_graph.LEAST
            p = np.sort(decision.probabilities(features))
            assert np.exp(np.sort(log_p))[np.sort(likely)] == pytest.approx(p[np.sort(likely)], abs=1e-9)


def test_a_residual_is_bounded_and_zero_leaves_every_bit() -> None:
    view, rng = View.of(make("light-bulb")), np.random.default_rng(0)
    for _ in range(20):
        action = rng.uniform(-1, 1, view.layout.size).astype(np.float32)
        assert np.array_equal(adjusted(view, action, np.zeros(len(view.controls))), action)
        residual = rng.uniform(-3, 3, len(view.controls))
        moved = view.layout.decode(adjusted(view, action, residual)).position - view.layout.decode(action).position
        assert np.abs(moved).max() <= SHIFT + 1e-6
    quiet = np.zeros(view.layout.size, dtype=np.float32)
    assert not view.layout.decode(adjusted(view, quiet, np.ones(len(view.controls)))).force.any()


def test_a_residual_halves_a_force_or_adds_half_of_it_and_ends_none() -> None:
    view = View.of(make("light-bulb"))
    pose = (0.5 * (view.layout.workspace_low + view.layout.workspace_high), view.layout.reference_quaternion)
    for newton in (0.5, 1.5, 5.0, 0.6 * view.layout.force_limit):
        for value in (-1.0, -0.3, 0.4, 1.0):
            force = newton * np.array([0.0, 0.6, 0.8])
            residual = [value if name == "press" else 0.0 for name in view.controls]
            action = adjusted(view, view.layout.encode(*pose, force, np.zeros(4)), residual)
            assert view.layout.decode(action).force == pytest.approx((1.0 + PRESS * value) * force, rel=1e-4)
    most = view.layout.encode(*pose, [0.0, 0.0, view.layout.force_limit], np.zeros(4))
    pressed = adjusted(view, most, [1.0 if name == "press" else 0.0 for name in view.controls])
    assert view.layout.decode(pressed).force[2] == pytest.approx(view.layout.force_limit)


def test_parameters_of_a_graph_start_at_the_skill_and_move_its_goals(skill: SequenceGraphSkill) -> None:
    parameters = skill_parameters.parameters_of(skill)
    same: Any = parameters.applied(np.zeros(parameters.size))
    assert np.array_equal(actions(same), actions(skill))
    moved: Any = parameters.applied(np.ones(parameters.size))
    difference = moved.primitives.goal - skill.primitives.goal
    assert set(np.unique(difference.round(12))) == {0.0, skill_parameters.SHIFT}
    assert (difference[:, 3:] == 0.0).all()
    assert not np.array_equal(actions(moved), actions(skill))


def test_logits_of_a_frame_are_those_of_all_its_attractors() -> None:
    """Against the mixture itself: softmax over attractors, of which each frame owns some, at places of their own."""
    rng = np.random.default_rng(1)
    n, n_frames, each, d = 7, 3, 4, 2
    logits, places = rng.normal(size=(n, n_frames, each)), rng.normal(size=(n_frames, each, d))

    def path(logits: np.ndarray, places: np.ndarray) -> AttractorPath:
        a = np.exp(logits)
        a /= a.sum(axis=(1, 2), keepdims=True)
        return AttractorPath(a.sum(axis=2), np.einsum("nfe,fed->nfd", a, places), np.array([1.2, -0.36, 0.16]))

    added, offsets = rng.normal(size=(n, n_frames - 1)), rng.normal(size=(n_frames, d))
    changed = skill_parameters.shifted(path(logits, places), added, offsets)
    full = logits + np.concatenate([np.zeros((n, 1)), added], axis=1)[..., None]
    expected = path(full, places + offsets[:, None])
    frames = Frames(rng.normal(size=(n_frames, d)), np.tile(np.eye(d), (n_frames, 1, 1)))
    assert np.allclose(changed.path(frames, np.zeros(d)), expected.path(frames, np.zeros(d)))
    unchanged = skill_parameters.shifted(path(logits, places), np.zeros((3, 2)), np.zeros((n_frames, d)))
    assert np.allclose(unchanged.places, path(logits, places).places, atol=1e-15)


@pytest.mark.parametrize("name", ["cma_es", "smoothed_gradient"])
def test_a_search_finds_a_planted_optimum(name: str) -> None:
    pytest.importorskip("cma", reason="the rl extra is not installed")
    from policies.reinforcement import search

    planted = np.array([1.0, -0.5, 2.0, 0.0, 0.3])

    def score(candidates: Any, generation: int) -> np.ndarray:
        return -np.array([np.sum((x - planted) ** 2) for x in candidates])

    found = getattr(search, name)(score, 5, range(60), 12, 0.5, 0)
    assert np.linalg.norm(found.x - planted) < 0.25 * np.linalg.norm(planted)
    assert found.history[-1] > found.history[0]
    again = getattr(search, name)(score, 5, range(60), 12, 0.5, 0)
    assert np.array_equal(found.x, again.x)


@pytest.mark.parametrize("name", ["cma_es", "smoothed_gradient"])
def test_a_search_that_cannot_tell_its_candidates_apart_stays_where_it_is(name: str) -> None:
    pytest.importorskip("cma", reason="the rl extra is not installed")
    from policies.reinforcement import search

    found = getattr(search, name)(lambda candidates, generation: np.ones(len(candidates)), 5, range(20), 8, 1.0, 0)
    assert np.array_equal(found.x, np.zeros(5))


@pytest.mark.parametrize("method", ["by_cma", "by_gradient"])
def test_a_killed_search_goes_on_and_repeats_no_generation(
    method: str, skill: SequenceGraphSkill, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("cma", reason="the rl extra is not installed")
    from policies.reinforcement import parameter_search

    practised: list[int] = []

    def planted(skills: Any, env_id: str, env_kwargs: Any, seeds: Any, jobs: int) -> list[list[Episode]]:
        if len(practised) == killed_after:
            raise KeyboardInterrupt
        practised.append(seeds[0])
        return [[Episode(-float(np.sum((s.primitives.goal - 1.0) ** 2)), 2.0)] * len(seeds) for s in skills]

    monkeypatch.setattr(parameter_search, "practise", planted)
    search, killed_after = getattr(parameter_search, method), -1
    whole, facts = search(Practice(skill, ENV_ID, {}, 400, tmp_path / "whole"))
    generations = practised.copy()
    practised, killed_after = [], 3
    with pytest.raises(KeyboardInterrupt):
        search(Practice(skill, ENV_ID, {}, 400, tmp_path / "killed"))
    killed_after = -1
    resumed, again = search(Practice(skill, ENV_ID, {}, 400, tmp_path / "killed"))
    assert practised == generations
    assert len(generations) > 5
    assert np.array_equal(resumed.primitives.goal, whole.primitives.goal)
    assert not np.array_equal(resumed.primitives.goal, skill.primitives.goal)
    assert {**again, "seconds": 0.0} == {**facts, "seconds": 0.0}
    parameters = skill_parameters.parameters_of(skill)
    other = parameters.applied(np.ones(parameters.size))
    for refused in (
        Practice(other, ENV_ID, {}, 400, tmp_path / "killed"),
        Practice(skill, ENV_ID, {}, 16, tmp_path / "killed"),
    ):
        with pytest.raises(InvalidArgumentError, match="of another search; remove it"):
            search(refused)
    file = tmp_path / "killed" / "search.json"
    for damaged in (file.read_text()[:-20], file.read_text().replace('"scores"', '"score"'), "[]"):
        file.write_text(damaged)
        with pytest.raises(InvalidArgumentError, match="damaged"):
            search(Practice(skill, ENV_ID, {}, 400, tmp_path / "killed"))


def spoil(practice: Practice) -> tuple[Any, dict[str, Any]]:
    parameters = skill_parameters.parameters_of(practice.skill)
    return parameters.applied(np.full(parameters.size, 8.0)), {
        "episodes": 3,
        "updates": 1,
        "simulated_hours": 0.0,
        "seconds": 0.0,
    }


def test_what_does_worse_is_not_kept(
    skill: SequenceGraphSkill, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(FINETUNERS, "spoil", "test_finetuning:spoil")
    after = finetuning.finetune("spoil", skill, ENV_ID, 32, tmp_path / "t")
    facts = after.metadata["finetuned"]
    assert not facts["kept"]
    assert facts["check"][1] < facts["check"][0]
    assert facts["episodes"] == 3 + 2 * 2
    assert np.array_equal(actions(after), actions(skill))


def test_skills_that_cannot_practise_are_refused(skill: SequenceGraphSkill, tmp_path: Path) -> None:
    for arguments, says in (
        (("cma", skill, "light-bulb", 32), "was taught for lfd_gym/MoveObject-v0"),
        (("cma", skill, ENV_ID, 3), "at least 16"),
    ):
        with pytest.raises(InvalidArgumentError, match=says):
            finetuning.finetune(*arguments, tmp_path / "t")
    with pytest.raises(InvalidArgumentError, match="seed 4294967295; possible: 0 to 1023"):
        finetuning.finetune("cma", skill, ENV_ID, 32, tmp_path / "t", seed=2**32 - 1)
    with pytest.raises(InvalidArgumentError, match="control_hz=50"):
        finetuning.finetune("cma", skill, ENV_ID, 32, tmp_path / "t", env_kwargs={"control_hz": 25.0})
    with pytest.raises(InvalidArgumentError, match="'reward_type' is decided by the method"):
        finetuning.finetune("cma", skill, ENV_ID, 32, tmp_path / "t", env_kwargs={"reward_type": "sparse"})


def test_practice_neither_forgets_a_refined_graph_nor_goes_on_with_another_skill(
    small: Any, skill: SequenceGraphSkill, tmp_path: Path
) -> None:
    refined, _ = small.refine_graph(Practice(skill, ENV_ID, {}, 1, tmp_path / "t"))
    with pytest.raises(InvalidArgumentError, match="not 'refined-graph'"):
        small.refine_graph(Practice(refined, ENV_ID, {}, 0, tmp_path / "u"))
    parameters = skill_parameters.parameters_of(skill)
    other = parameters.applied(np.ones(parameters.size))
    with pytest.raises(InvalidArgumentError, match="another training"):
        small.refine_graph(Practice(other, ENV_ID, {}, 1, tmp_path / "t"))


@pytest.mark.parametrize("method", ["cma", "graph-ppo", "residual-sac"])
def test_practice_from_the_command_line(
    method: str,
    small: Any,
    skill: SequenceGraphSkill,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(finetuning, "FEWEST", 4)
    skill.save(tmp_path / "before.npz")
    arguments = [method, str(tmp_path / "before.npz"), ENV_ID, "--episodes", "4", "--out", str(tmp_path / "after.npz")]
    assert cli.main(["finetune", *arguments]) == 0
    after = load_skill(tmp_path / "after.npz")
    facts = after.metadata["finetuned"]
    assert facts["method"] == method
    assert facts["updates"] > 0
    assert facts["simulated_hours"] > 0.0
    assert "episodes, score" in capsys.readouterr().out


def test_a_score_is_one_for_success_and_less_for_progress(skill: SequenceGraphSkill) -> None:
    still: Any = skill_parameters.parameters_of(skill).applied(np.full(skill_parameters.parameters_of(skill).size, 8.0))
    result = scores(practise([skill, still], ENV_ID, {}, [SEED]))
    assert result[0] == 1.0
    assert 0.0 <= result[1] < 0.95
