"""Training of agents: resumable, with checkpoints, a log, and evaluation on development seeds meanwhile."""

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import joblib
import numpy as np
from gymnasium.wrappers import TimeLimit, TransformReward
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from lfd_gym.demonstration import Demonstration, check_same_environment, taught_seeds
from lfd_gym.errors import DemonstrationError, InvalidArgumentError
from lfd_gym.evaluation import evaluate
from lfd_gym.progress import track
from lfd_gym.registry import environment_id, make
from lfd_gym.seeds import DEVELOPMENT_SEED, SEEDS_PER_RUN, TRAINING_SEED, check_run
from lfd_gym.view import View
from lfd_gym.wrappers import RLView, SeededEpisodes
from policies.reinforcement.agent_skill import AgentSkill
from policies.reinforcement.agents import actor_network, load_agent, make_agent
from policies.reinforcement.checkpoint import TrainingFolder, held, undamaged
from policies.reinforcement.demonstrated_decisions import check_observed, transitions
from policies.reinforcement.demonstrated_starts import DemonstratedStarts
from policies.reinforcement.growth import Growth
from policies.reinforcement.settings import DECIDED, TrainingSettings, checked_kwargs, method
from policies.reinforcement.simulation_clock import SimulationClock
from policies.skill import Skill

CHUNK = 1000
"""Decisions between two movements of the progress bar, about."""


@dataclass(frozen=True)
class Schedule:
    """How long a training lasts and what happens meanwhile.

    Nothing of it changes what is learned, but that a learning rate that is annealed falls towards the last decision.
    """

    decisions: int
    """In all; rounded up to whole rollouts."""
    checkpoint_every: int = 25_000
    """Decisions between two checkpoints."""
    evaluate_every: int = 10_000
    """Decisions between two evaluations; 0 for none."""
    evaluation_episodes: int = 20
    episodes: int = 0
    """Stop as soon as so many were begun; 0 for never."""
    progress: bool = False
    """A bar on a terminal."""


@dataclass(frozen=True)
class Task:
    """What `run` trains: how the environments are made, and what becomes of an agent."""

    settings: TrainingSettings
    env: Callable[[], gymnasium.Env]
    """An environment of flat observations and decisions; the agent is paid its reward's `Growth`."""
    export: Callable[[Any, Mapping[str, Any]], Skill]
    """The skill that an agent is, from the agent and facts for its metadata."""
    prepare: Callable[[Any], None]
    """What is done once to an agent that was made or loaded."""
    env_id: str
    env_kwargs: Mapping[str, Any]
    """Of the native environment in which the skill is evaluated."""
    seed: int
    make: Callable[[VecEnv], Any]
    """An untrained agent."""
    load: Callable[[str, VecEnv], Any]
    """The agent of a checkpoint."""


def train(
    name: str,
    env_id: str,
    schedule: Schedule,
    folder: Path,
    seed: int = 0,
    demonstrations: Sequence[Demonstration] = (),
    env_kwargs: Mapping[str, Any] | None = None,
) -> Skill:
    """Train a method of `policies.reinforcement.settings` from where `folder` left off, and return the skill.

    Raises UnknownNameError for an unknown method, and InvalidArgumentError for arguments that the method decides, for
    demonstrations that are missing or not wanted, and where the folder holds another training. Raises DemonstrationError for
    demonstrations of another environment, and for what the agent would have seen in them if it is missing or not finite.
    """
    settings, env_kwargs, env_id = method(name), checked_kwargs(env_kwargs or {}), environment_id(env_id)
    if settings.demonstrations != bool(demonstrations):
        needs = "needs demonstrations: --demos FILE" if settings.demonstrations else "takes no demonstrations"
        raise InvalidArgumentError(f"method '{name}' {needs}")
    if demonstrations and check_same_environment(demonstrations) != env_id.rpartition(":")[2]:
        raise DemonstrationError(f"the demonstrations are of {demonstrations[0].env_id}, not of {env_id}")
    for demonstration in demonstrations:
        given = {name: value for name, value in demonstration.env_kwargs.items() if name not in DECIDED}
        if given != json.loads(json.dumps(env_kwargs)):
            raise DemonstrationError(f"the demonstrations were given with the arguments {given}, not with {env_kwargs}")
    seeds = taught_seeds(demonstrations)
    env = partial(viewed, env_id, settings, env_kwargs, demonstrations)
    example = env()
    view = View.of(example)
    check_observed(demonstrations, view)
    learns = (settings.discount, settings.reward_scale, settings.n_steps)
    shown = transitions(demonstrations, example, *learns) if demonstrations else None
    example.close()

    def export(agent: Any, facts: Mapping[str, Any]) -> Skill:
        metadata = {"learner": name, "demonstrations": len(demonstrations), **facts}
        native = env_id.rpartition(":")[2]
        return AgentSkill(actor_network(agent), view, env_id=native, taught_seeds=seeds, metadata=metadata)

    def prepare(agent: Any) -> None:
        if shown is not None:
            agent.replay_buffer.demonstrations = shown

    contents = [(dict(demonstration.observations), demonstration.actions) for demonstration in demonstrations]
    identity = {"method": name, "demonstrations": list(seeds), "contents": joblib.hash(contents)}
    task = Task(
        settings, env, export, prepare, env_id, env_kwargs, seed,
        partial(make_agent, settings), partial(load_agent, settings),
    )  # fmt: skip
    return run(task, schedule, folder, identity)


def viewed(
    env_id: str,
    settings: TrainingSettings,
    env_kwargs: Mapping[str, Any],
    demonstrations: Sequence[Demonstration] = (),
) -> gymnasium.Env:
    """The RL view of an environment, as a method trains in it."""
    env = timed(env_id, settings.reward_type, env_kwargs)
    if settings.demonstrated_starts and demonstrations:
        env = DemonstratedStarts(env, demonstrations, settings.demonstrated_starts)
    view = RLView(env)
    return TimeLimit(view, settings.episode) if settings.episode else view


def timed(env_id: str, reward_type: str, env_kwargs: Mapping[str, Any], ends: bool = False) -> gymnasium.Env:
    """The native environment, which counts what is simulated; `ends` says whether success ends an episode."""
    return SimulationClock(make(env_id, reward_type=reward_type, terminate_on_success=ends, **env_kwargs))


def run(task: Task, schedule: Schedule, folder: Path, identity: Mapping[str, Any]) -> Skill:
    """Train until the schedule's end, from the last checkpoint in the folder; `identity` says whose folder it is.

    Raises InvalidArgumentError for a seed that is none of an agent's, and where the folder is of another training or held by
    one, or its last checkpoint is damaged.
    """
    check_run(task.seed)
    with held(folder):
        return _run(task, schedule, TrainingFolder(folder, _job(task, schedule, identity)))


def _run(task: Task, schedule: Schedule, kept: TrainingFolder) -> Skill:
    settings = task.settings
    state = kept.state() or {
        "decisions": 0, "seconds": 0.0, "simulated_seconds": 0.0, "episodes": [0] * settings.n_envs, "updates": 0,
    }  # fmt: skip
    last = settings.rollout * math.ceil(schedule.decisions / settings.rollout)
    if state["decisions"] > last:
        raise InvalidArgumentError(
            f"'{kept.path}' has made {state['decisions']} decisions; ask for as many, or choose another --out"
        )
    kept.go_on(state["decisions"])
    simulated, stride = state["simulated_seconds"], SEEDS_PER_RUN // settings.n_envs
    first = [TRAINING_SEED + SEEDS_PER_RUN * task.seed + i * stride for i in range(settings.n_envs)]
    episodes = [SeededEpisodes(task.env(), a + begun) for a, begun in zip(first, state["episodes"], strict=True)]
    envs = DummyVecEnv([partial(_monitored, env, settings.reward_scale) for env in episodes])
    agent = _agent(task, kept.latest(), envs, (task.seed + state["decisions"]) % 2**32)
    ended = 0 < schedule.episodes <= sum(state["episodes"])
    marks = [] if ended else _marks(state["decisions"], last, settings.rollout, schedule)
    for n in track(marks, len(marks), "training", schedule.progress):
        before, since = int(agent.num_timesteps), time.monotonic()
        agent.lr_schedule = partial(_annealed, settings, n / last)
        agent.learn(n - before, reset_num_timesteps=False)
        state = {
            "decisions": int(agent.num_timesteps),
            "seconds": state["seconds"] + time.monotonic() - since,
            "episodes": [env.next_seed - a for a, env in zip(first, episodes, strict=True)],
            "updates": int(agent._n_updates) * settings.counted_updates,
            "simulated_seconds": simulated + sum(env.get_wrapper_attr("simulated_seconds") for env in episodes),
        }
        ended = n == last or 0 < schedule.episodes <= sum(state["episodes"])
        if _due(before, n, ended, schedule.evaluate_every):
            kept.append(_judged(task, task.export(agent, facts(state)), state, agent, schedule))
        if _due(before, n, ended, schedule.checkpoint_every):
            kept.write(agent, state)
        if ended:
            break
    envs.close()
    return task.export(agent, facts(state))


def facts(state: Mapping[str, Any]) -> dict[str, Any]:
    """What a skill's metadata and the log say about the training so far."""
    return {
        "decisions": state["decisions"],
        "updates": state["updates"],
        "simulated_hours": round(state["simulated_seconds"] / 3600.0, 4),
        "seconds": round(state["seconds"], 1),
        "training_episodes": sum(state["episodes"]),
    }


def _job(task: Task, schedule: Schedule, identity: Mapping[str, Any]) -> dict[str, Any]:
    """Whose folder it is: what may not differ where a training goes on."""
    settings = json.loads(json.dumps(asdict(task.settings)))
    job = {
        **identity,
        "env_id": task.env_id,
        "env_kwargs": dict(task.env_kwargs),
        "seed": task.seed,
        "settings": settings,
    }
    return job | ({"decisions": schedule.decisions} if task.settings.annealing else {})


def _agent(task: Task, checkpoint: Path | None, envs: VecEnv, seed: int) -> Any:
    """A new agent, or that of a checkpoint, whose random numbers come from this seed."""
    set_random_seed(seed)
    if checkpoint is None:
        agent = task.make(envs)
    else:
        with undamaged(checkpoint):
            agent = task.load(str(checkpoint / "agent.zip"), envs)
            if hasattr(agent, "load_replay_buffer"):
                agent.load_replay_buffer(checkpoint / "replay_buffer.pkl")
                agent.replay_buffer.interrupt()
    agent.action_space.seed(seed)
    agent.set_logger(Logger(None, []))
    task.prepare(agent)
    return agent


def _marks(done: int, last: int, rollout: int, schedule: Schedule) -> list[int]:
    """Decisions after which the training pauses for a moment, whole rollouts."""
    step = rollout * max(1, round(CHUNK / rollout))
    for every in (schedule.evaluate_every, schedule.checkpoint_every):
        step = min(step, rollout * math.ceil(every / rollout)) if every else step
    return [min(n, last) for n in range(done + step, last + step, step)]


def _due(before: int, now: int, ended: bool, every: int) -> bool:
    """Whether a multiple of `every` was passed, or the end reached; never for 0."""
    return every > 0 and (ended or now // every > before // every)


def _judged(task: Task, skill: Skill, state: Mapping[str, Any], agent: Any, schedule: Schedule) -> dict[str, Any]:
    report = evaluate(task.env_id, skill, schedule.evaluation_episodes, DEVELOPMENT_SEED, env_kwargs=task.env_kwargs)
    subtasks = report.episodes[0].subtasks
    recent = [float(episode["r"]) for episode in agent.ep_info_buffer or ()]
    return {
        **facts(state),
        "successes": report.successes,
        "episodes": len(report.episodes),
        "subtasks": {name: sum(e.subtasks.get(name, False) for e in report.episodes) for name in subtasks},
        "training_return": round(float(np.mean(recent)), 4) if recent else None,
    }


def _monitored(env: gymnasium.Env, reward_scale: float) -> gymnasium.Env:
    env = Growth(env)
    if reward_scale != 1.0:
        env = TransformReward(env, partial(_scaled, reward_scale))
    return Monitor(env)


def _annealed(settings: TrainingSettings, share: float, remaining: float) -> float:
    """The learning rate, of what remains of the decisions up to a pause that comes after a share of all of them."""
    return settings.learning_rate((1.0 - remaining) * share)


def _scaled(scale: float, reward: Any) -> float:
    return scale * float(reward)
