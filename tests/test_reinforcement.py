"""Agents on the RL view: what demonstrations become, training that survives a kill, skills that need no torch."""

import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lfd_gym import cli
from lfd_gym.demonstration import Demonstration, save_demonstrations
from lfd_gym.errors import DemonstrationError, InvalidArgumentError, UnknownNameError
from lfd_gym.recording import record
from lfd_gym.registry import make
from lfd_gym.view import View
from lfd_gym.wrappers import RLView
from policies import load_skill
from policies.reinforcement.demonstrated_decisions import decisions, flat_observations, moving, transitions, view_of
from policies.reinforcement.demonstrated_starts import DemonstratedStarts
from policies.reinforcement.growth import Growth
from policies.reinforcement.settings import METHODS
from scripted_teachers.move_object import MoveObjectTeacher

ENV_ID = "lfd_gym/MoveObject-v0"
DENSE = {"reward_type": "dense", "terminate_on_success": False}


@pytest.fixture(scope="module")
def taught() -> list[Demonstration]:
    return record(ENV_ID, MoveObjectTeacher(noise=1.0), n=2, seed=11).demonstrations


@pytest.fixture
def training(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The module, with methods small enough to train here."""
    pytest.importorskip("stable_baselines3", reason="the rl extra is not installed")
    from policies.reinforcement import agents, training

    monkeypatch.setattr(agents, "WIDTH", 16)
    small = {"sac": {"learning_starts": 20, "batch_size": 16, "buffer_size": 500, "gradient_steps": 1}, "ppo": {}}
    for name, settings in METHODS.items():
        kwargs = {**settings.hyperparameters, **small[settings.algorithm]}
        if settings.algorithm == "ppo":
            kwargs |= {"batch_size": 16, "n_epochs": 1}
        rollout, n_envs = (32, 2) if settings.algorithm == "ppo" else (8, 1)
        monkeypatch.setitem(METHODS, name, replace(settings, hyperparameters=kwargs, rollout=rollout, n_envs=n_envs))
    return training


def test_what_an_agent_would_have_decided_solves_the_task_again(taught: Sequence[Demonstration]) -> None:
    env = make(ENV_ID)
    for demonstration in taught:
        view = view_of(demonstration)
        assert view == View.of(env)
        shown = decisions(demonstration, view)
        seen, _ = env.reset(seed=demonstration.seed["reset"])
        error, info = 0.0, {}
        for t in range(len(demonstration)):
            seen, _, _, _, info = env.step(view.native_action(shown[t - t % view.repeats], seen))
            error = max(
                error, float(np.abs(seen["tool_position"] - demonstration.observations["tool_position"][t + 1]).max())
            )
        assert info["is_success"]
        assert error < 0.02


def test_transitions_pay_what_the_environment_pays(taught: Sequence[Demonstration]) -> None:
    """Played again in the RL view, the decisions earn what the transitions say, until the task is solved."""
    view_env = Growth(RLView(make(ENV_ID, **DENSE)))
    shown = transitions(taught[:1], view_env, discount=0.99, reward_scale=0.5)
    view_env.reset(seed=taught[0].seed["reset"])
    first = view_env.unwrapped.reward()
    earned = np.array([0.5 * view_env.step(decision)[1] for decision in shown.decisions[:-1]])
    assert np.abs(earned - shown.rewards[:-1]).max() < 0.04
    assert np.abs(np.cumsum(earned - shown.rewards[:-1])).max() < 0.04
    assert shown.rewards.sum() == pytest.approx(0.5 * (1.0 - first), abs=1e-3)
    assert shown.ended.tolist() == [0.0] * (len(shown.ended) - 1) + [1.0]
    flat = flat_observations(taught[0], view_of(taught[0]))
    assert np.array_equal(shown.observations[1], flat[5])
    assert np.array_equal(shown.next_observations[:-1], shown.observations[1:])


def test_growth_is_the_same_task(taught: Sequence[Demonstration]) -> None:
    """Its discounted sum is (1 - gamma) times that of the reward, less what the first state is worth."""
    gamma, paid, plain = 0.9, [], []
    grown, env = Growth(RLView(make(ENV_ID, **DENSE))), RLView(make(ENV_ID, **DENSE))
    for one in (grown, env):
        one.reset(seed=taught[0].seed["reset"])
    first = env.unwrapped.reward()
    for action in decisions(taught[0], env.view)[::5]:
        paid.append(grown.step(action)[1])
        plain.append(env.step(action)[1])
    powers, left = gamma ** np.arange(len(plain)), gamma ** len(plain) * plain[-1]
    assert np.std(plain) > 0.1
    assert powers @ paid == pytest.approx((1 - gamma) * (powers @ plain) - first + left, abs=1e-9)


def test_pauses_of_a_teacher_are_found(taught: Sequence[Demonstration]) -> None:
    """What is left out moves nothing; without it a demonstration starts and ends in the same places."""
    demonstration = taught[0]
    moves = moving(demonstration, view_of(demonstration))
    tool = demonstration.observations["tool_position"]
    later = np.minimum(np.arange(len(moves)) + 5, len(moves))
    assert 0.2 < (~moves).mean() < 0.8
    assert np.abs(tool[later] - tool[:-1])[~moves].max() <= 1e-3
    kept = tool[:-1][moves]
    assert np.linalg.norm(np.diff(kept, axis=0), axis=1).max() < 0.02
    assert np.abs(kept[-1] - tool[-1]).max() < 0.02


def test_longer_transitions_sum_what_single_ones_pay(taught: Sequence[Demonstration]) -> None:
    """A value that is the sum of all that follows is the same through transitions of any length."""
    env = RLView(make(ENV_ID, **DENSE))
    single, longer = (transitions(taught[:1], env, 0.9, 1.0, n_steps) for n_steps in (1, 4))
    worth = np.zeros(len(single.rewards) + 1)
    for i in reversed(range(len(single.rewards))):
        worth[i] = single.rewards[i] + 0.9 * worth[i + 1]
    after = np.minimum(np.arange(len(worth) - 1) + 4, len(worth) - 1)
    assert np.allclose(longer.rewards + longer.discounts * (1.0 - longer.ended) * worth[after], worth[:-1], rtol=1e-5)
    assert np.array_equal(longer.next_observations, single.next_observations[after - 1])
    assert longer.ended.sum() == 4


def test_episodes_begin_where_they_were_demonstrated(taught: Sequence[Demonstration]) -> None:
    for share in (0.0, 1.0):
        view_env = RLView(DemonstratedStarts(make(ENV_ID, **DENSE), taught, share))
        seen = np.concatenate([flat_observations(demonstration, view_env.view) for demonstration in taught])
        begun = [view_env.reset(seed=100000 + i)[0] for i in range(4)]
        assert [bool((seen == flat).all(axis=1).any()) for flat in begun] == [share == 1.0] * 4
        assert np.array_equal(view_env.reset(seed=100000)[0], begun[0])
        assert np.isfinite(view_env.step(np.zeros(5))[0]).all()


def test_the_outside_hand_lets_go_where_an_episode_begins() -> None:
    shown = record(ENV_ID, MoveObjectTeacher(noise=0.0, mode="kinesthetic"), n=1, seed=11).demonstrations
    view_env, ends = RLView(DemonstratedStarts(make(ENV_ID, **DENSE), shown, 1.0)), []
    for way in (1.0, -1.0):
        view_env.reset(seed=100000)
        for _ in range(5):
            view_env.step(np.array([way, 0.0, 0.0, 0.0, -1.0]))
        ends.append(view_env.unwrapped.data.site("hand/tool").xpos[0])
    assert ends[0] > ends[1] + 0.05


def test_a_share_of_a_batch_is_demonstrated(taught: Sequence[Demonstration]) -> None:
    pytest.importorskip("stable_baselines3", reason="the rl extra is not installed")
    from policies.reinforcement.demonstration_sac import DemonstrationBuffer

    env = RLView(make(ENV_ID, **DENSE))
    buffer = DemonstrationBuffer(10, env.observation_space, env.action_space)
    nothing = np.zeros((1, *env.observation_space.shape)), np.zeros((1, *env.action_space.shape))
    buffer.add(nothing[0], nothing[0], nothing[1], np.array([-7.0]), np.array([False]), [{}])
    assert (buffer.sample(8).rewards == -7.0).all()
    buffer.demonstrations = transitions(taught, env, 0.99, 1.0)
    batch = buffer.sample(9)
    assert (batch.rewards[:5] == -7.0).all()
    assert (batch.rewards[5:] > -1.0).all()
    assert {len(part) for part in batch} == {9}
    assert DemonstrationBuffer(10, env.observation_space, env.action_space, share=0.25).demonstrated(16) == 0
    buffer.share = 0.25
    assert buffer.demonstrated(16) == 4


def test_the_actor_is_pulled_to_what_was_demonstrated(taught: Sequence[Demonstration]) -> None:
    """With a strong pull and demonstrations that alone pay, it decides as it was shown; without it does not yet."""
    pytest.importorskip("stable_baselines3", reason="the rl extra is not installed")
    from stable_baselines3.common.utils import set_random_seed
    from stable_baselines3.common.vec_env import DummyVecEnv

    from policies.reinforcement.agents import make_agent

    env, errors = RLView(make(ENV_ID, **DENSE)), []
    shown = transitions(taught, env, 0.9, 1.0)
    nothing = np.zeros((1, *env.observation_space.shape)), np.zeros((1, *env.action_space.shape))
    for cloning in (0.0, 100.0):
        set_random_seed(0)
        agent = make_agent(replace(METHODS["sac-demos"], cloning=cloning), DummyVecEnv([lambda: env]))
        agent.replay_buffer.add(*nothing[:1], *nothing, np.array([-1.0]), np.array([True]), [{}])
        agent.replay_buffer.demonstrations = shown
        agent.train(200, 64)
        made = agent.predict(shown.observations, deterministic=True)[0]
        errors.append(np.square(made - shown.decisions).mean())
    assert errors[1] < 0.5 * errors[0]


def test_a_residual_rests_and_waits_for_its_critics() -> None:
    """Where rest is worth most it stays at rest, however it began; and before the critics have learned it stays as it is."""
    pytest.importorskip("stable_baselines3", reason="the rl extra is not installed")
    from stable_baselines3.common.utils import set_random_seed
    from stable_baselines3.common.vec_env import DummyVecEnv

    from policies.reinforcement.agents import make_agent

    env, rng, moved = RLView(make(ENV_ID, **DENSE)), np.random.default_rng(0), {}
    seen = rng.normal(size=(200, *env.observation_space.shape)).astype(np.float32)
    for resting, first in ((0.0, 0), (100.0, 0), (0.0, 300)):
        set_random_seed(0)
        agent = make_agent(replace(METHODS["sac"], resting=resting, critic_first=first), DummyVecEnv([lambda: env]))
        for row in seen:
            decision = rng.uniform(-1.0, 1.0, env.action_space.shape) * (rng.uniform() < 0.5)
            paid = np.array([1.0 - np.abs(decision).max()])
            agent.replay_buffer.add(row[None], row[None], decision[None], paid, np.array([True]), [{}])
        before = agent.predict(seen, deterministic=True)[0]
        agent.train(200, 64)
        after = agent.predict(seen, deterministic=True)[0]
        moved[resting, first] = np.square(after).mean(), np.square(after - before).max()
    assert moved[100.0, 0][0] < 0.5 * moved[0.0, 0][0]
    assert moved[0.0, 300][1] == 0.0
    assert moved[0.0, 0][1] > 0.0


@pytest.mark.parametrize("name", ["sac", "ppo"])
def test_pauses_change_nothing_of_what_is_learned(name: str, training: Any, tmp_path: Path) -> None:
    """Not even where the learning rate falls."""
    skills = [
        training.train(name, ENV_ID, training.Schedule(96, every, evaluate_every=0), tmp_path / str(every), seed=3)
        for every in (0, 32)
    ]
    one, other = (skill.to_arrays()[1] for skill in skills)
    assert all(np.array_equal(one[key], other[key]) for key in one)
    assert METHODS["sac"].annealing > 0.0


def test_updates_are_steps_of_the_optimiser(training: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import torch

    steps = []
    monkeypatch.setattr(torch.optim.Adam, "step", lambda self, closure=None: steps.append(self))
    skill = training.train("ppo", ENV_ID, training.Schedule(64, evaluate_every=0), tmp_path / "ppo", seed=3)
    assert skill.metadata["updates"] == len(steps) == 2 * 32 // 16
    steps.clear()
    skill = training.train("sac", ENV_ID, training.Schedule(64, evaluate_every=0), tmp_path / "sac", seed=3)
    assert skill.metadata["updates"] == len(steps) / 3 > 0


@pytest.mark.parametrize("name", ["sac-demos", "ppo"])
def test_a_killed_training_goes_on_to_the_same_number_of_decisions(
    name: str, training: Any, taught: Sequence[Demonstration], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = taught if METHODS[name].demonstrations else ()
    schedule = training.Schedule(190, checkpoint_every=64, evaluate_every=64, evaluation_episodes=1)

    def train() -> Any:
        return training.train(name, ENV_ID, schedule, tmp_path / "t", seed=3, demonstrations=shown)

    whole, reset, started = training.TrainingFolder.write, training.SeededEpisodes.reset, []

    def counted(self: Any, **kwargs: Any) -> Any:
        started.append(self.next_seed)
        return reset(self, **kwargs)

    monkeypatch.setattr(training.SeededEpisodes, "reset", counted)

    def kill(self: Any, agent: Any, state: Any) -> None:
        if state["decisions"] > 64:
            raise KeyboardInterrupt
        whole(self, agent, state)

    monkeypatch.setattr(training.TrainingFolder, "write", kill)
    with pytest.raises(KeyboardInterrupt):
        train()
    assert [path.name for path in (tmp_path / "t").glob("checkpoint-*")] == ["checkpoint-000000064"]
    before_the_checkpoint, sizes = set(started[: METHODS[name].n_envs]), []
    started.clear()

    def seen(self: Any, agent: Any, state: Any) -> None:
        buffer = getattr(agent, "replay_buffer", None)
        if state["decisions"] == 192:
            sizes.append(None if buffer is None else buffer.size())
        if buffer is not None:
            n = state["decisions"] - 1
            goes_on = np.all(buffer.next_observations[:n] == buffer.observations[1 : n + 1], axis=-1)
            assert np.all(goes_on | (buffer.dones[:n] + buffer.timeouts[:n] > 0))
            assert not np.all(goes_on)
        whole(self, agent, state)

    monkeypatch.setattr(training.TrainingFolder, "write", seen)
    skill = train()
    assert skill.metadata["decisions"] == 192
    assert not set(started) & before_the_checkpoint
    assert sizes in ([192], [None])
    log = [json.loads(line) for line in (tmp_path / "t" / "log.jsonl").read_text().splitlines()]
    assert [row["decisions"] for row in log] == [64, 128, 192]
    assert log[-1]["simulated_hours"] == pytest.approx(19.2 / 3600, abs=1e-4)
    assert train().metadata == skill.metadata
    with pytest.raises(InvalidArgumentError, match="another training"):
        training.train(name, ENV_ID, schedule, tmp_path / "t", seed=4, demonstrations=shown)
    with pytest.raises(InvalidArgumentError, match="192 decisions|another training"):
        training.train(name, ENV_ID, training.Schedule(64), tmp_path / "t", seed=3, demonstrations=shown)


def test_a_damaged_checkpoint_is_named(training: Any, tmp_path: Path) -> None:
    schedule = training.Schedule(64, checkpoint_every=64, evaluate_every=0)

    def train() -> Any:
        return training.train("sac", ENV_ID, schedule, tmp_path / "t", seed=3)

    skill = train()
    (checkpoint,) = (tmp_path / "t").glob("checkpoint-*")
    for name in ("state.json", "agent.zip", "replay_buffer.pkl"):
        file, whole = checkpoint / name, (checkpoint / name).read_bytes()
        for damaged in (b"", b"{}", whole[: len(whole) // 2]):
            file.write_bytes(damaged)
            with pytest.raises(InvalidArgumentError, match=f"'{checkpoint}' cannot be read; if it is damaged"):
                train()
        file.write_bytes(whole)
    assert train().metadata == skill.metadata
    shutil.rmtree(checkpoint)
    assert train().metadata["decisions"] == 64
    log = training.TrainingFolder(tmp_path / "log", {})
    log.append({"decisions": 64})
    log.log.write_text(log.log.read_text()[:-5])
    with pytest.raises(InvalidArgumentError, match=f"'{log.log}' is damaged; remove it"):
        log.append({"decisions": 128})


def test_the_learning_rate_falls_at_the_end(training: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rates: list[float] = []

    def seen(self: Any, agent: Any, state: Any) -> None:
        optimizers = (agent.actor.optimizer, agent.critic.optimizer, agent.ent_coef_optimizer)
        found = {group["lr"] for optimizer in optimizers for group in optimizer.param_groups}
        rates.extend(found)

    monkeypatch.setattr(training.TrainingFolder, "write", seen)
    training.train("sac", ENV_ID, training.Schedule(160, checkpoint_every=16, evaluate_every=0), tmp_path / "t")
    assert rates == pytest.approx([1e-3] * 7 + [2e-3 / 3, 1e-3 / 3, 0.0])
    assert METHODS["ppo"].learning_rate(1.0) == METHODS["ppo"].learning_rate(0.0)


@pytest.mark.parametrize("name", ["sac", "ppo"])
def test_a_skill_does_what_its_agent_does(name: str, training: Any, tmp_path: Path) -> None:
    """The exported network, through its file, in the native environment, acts as the agent in the RL view."""
    agents: list[Any] = []
    network = training.actor_network
    training.actor_network = lambda agent: agents.append(agent) or network(agent)
    try:
        schedule = training.Schedule(64, checkpoint_every=0, evaluate_every=0)
        training.train(name, ENV_ID, schedule, tmp_path / "t").save(tmp_path / "skill.npz")
    finally:
        training.actor_network = network
    skill, state = load_skill(tmp_path / "skill.npz"), None
    view_env, native = RLView(make(ENV_ID, **DENSE)), make(ENV_ID, terminate_on_success=False)
    flat, seen = view_env.reset(seed=100000)[0], native.reset(seed=100000)[0]
    for k in range(5):
        flat = view_env.step(agents[-1].predict(flat, deterministic=True)[0])[0]
        for i in range(5):
            action, state = skill.predict(seen, state=state, episode_start=np.array([k == i == 0]))
            seen = native.step(action)[0]
        assert np.allclose(skill.view.flatten(seen), flat, atol=1e-4)


def test_methods_and_demonstrations_have_to_fit(training: Any, taught: Sequence[Demonstration], tmp_path: Path) -> None:
    schedule = training.Schedule(10)
    with pytest.raises(InvalidArgumentError, match="needs demonstrations: --demos"):
        training.train("sac-demos", ENV_ID, schedule, tmp_path / "t")
    with pytest.raises(InvalidArgumentError, match="takes no demonstrations"):
        training.train("sac", ENV_ID, schedule, tmp_path / "t", demonstrations=taught)
    with pytest.raises(UnknownNameError, match="sac-demos"):
        training.train("sac-demo", ENV_ID, schedule, tmp_path / "t")
    with pytest.raises(DemonstrationError, match="not of lfd_gym/LightBulb-v0"):
        training.train("sac-demos", "light-bulb", schedule, tmp_path / "t", demonstrations=taught)
    assert not (tmp_path / "t").exists()


def test_agents_refuse_demonstrations_that_do_not_show_what_they_would_see(
    training: Any, taught: Sequence[Demonstration], tmp_path: Path
) -> None:
    first = taught[0]
    nan = np.full_like(first.observations["tool_position"], np.nan)
    without = [{k: v for k, v in first.observations.items() if k != name} for name in ("frame_object", "wrench")]
    for observations, message in [
        ({**first.observations, "tool_position": nan}, "'tool_position' of demonstration 1 is not finite"),
        (without[0], "demonstration 1 has no observation 'frame_object'"),
        (without[1], "demonstration 1 has no observation 'wrench'"),
    ]:
        shown = [taught[1], replace(first, observations=observations)]
        with pytest.raises(DemonstrationError, match=message):
            training.train("sac-demos", ENV_ID, training.Schedule(10), tmp_path / "t", demonstrations=shown)
    assert not (tmp_path / "t").exists()


def test_agents_learn_from_demonstrations_without_a_seed(
    training: Any, taught: Sequence[Demonstration], tmp_path: Path
) -> None:
    shown, schedule = [replace(taught[0], seed={}), taught[1]], training.Schedule(8, 0, evaluate_every=0)
    skill = training.train("sac-demos", ENV_ID, schedule, tmp_path / "t", demonstrations=shown)
    assert skill.taught_seeds == (taught[1].seed["reset"],)
    assert skill.metadata["demonstrations"] == 2


def test_cloning_learns_what_was_shown(taught: Sequence[Demonstration], tmp_path: Path, capsys: Any) -> None:
    pytest.importorskip("torch", reason="the rl extra is not installed")
    save_demonstrations(tmp_path / "demos.h5", taught)
    for name in ("bc", "bc-chunks"):
        out = tmp_path / f"{name}.npz"
        small = ["--set", "updates=400", "--set", "width=64"]
        assert cli.main(["learn", name, str(tmp_path / "demos.h5"), "--out", str(out), *small]) == 0
        skill = load_skill(out)
        moves = moving(taught[0], skill.view)
        seen = flat_observations(taught[0], skill.view)[:-1][moves]
        shown = decisions(taught[0], skill.view)[moves]
        error = np.abs(skill.network(seen)[:, : shown.shape[1]] - shown).mean()
        assert error < 0.35 * np.abs(shown - shown.mean(axis=0)).mean()


def run(program: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)


def test_policies_and_environments_import_no_torch() -> None:
    done = run(
        "import sys, policies, lfd_gym, gymnasium; gymnasium.make('lfd_gym/MoveObject-v0')\n"
        "import policies.reinforcement.agent_skill\n"
        "print(sorted({'torch', 'stable_baselines3', 'sb3_contrib', 'cma'} & set(sys.modules)))"
    )
    assert done.stdout == "[]\n", done.stderr


@pytest.mark.parametrize(
    ("command", "missing"),
    [("train sac move-object --steps 8", "stable_baselines3"), ("learn bc NONE.h5", "torch")],
)
def test_a_missing_extra_is_named_in_one_line(command: str, missing: str, tmp_path: Path) -> None:
    arguments = [*command.split(), "--out", str(tmp_path / "skill.npz")]
    done = run(
        "import sys\nfor name in ('torch', 'stable_baselines3', 'sb3_contrib', 'cma'): sys.modules[name] = None\n"
        f"from lfd_gym import cli\nsys.exit(cli.main({arguments!r}))"
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "pip install 'lfd-gym[rl]'" in done.stderr
    assert missing in done.stderr
