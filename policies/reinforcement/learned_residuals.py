"""Fine-tuning by reinforcement learning: residuals on a graph's decisions and on any skill's actions, zero to begin with."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from lfd_gym.errors import InvalidArgumentError
from lfd_gym.view import DECISION_TIME, View
from policies.reinforcement.agents import actor_network, load_agent, make_agent
from policies.reinforcement.graph_agent import load_graph_agent, make_graph_agent, residual_network
from policies.reinforcement.practice import Practice, Practised, identity
from policies.reinforcement.refined_graph import GraphDecisions, RefinedGraphSkill
from policies.reinforcement.residual import ResidualSkill, ResidualView
from policies.reinforcement.settings import GRAPH_PPO, RESIDUAL_SAC, TrainingSettings
from policies.reinforcement.training import Schedule, Task, run, timed
from policies.sequence_graph_skill import SequenceGraphSkill
from policies.skill import Skill

QUIET = -3.0
"""Logarithm of the standard deviation with which a residual explores: a millimetre, which keeps no skill from its end."""


def refine_graph(practice: Practice) -> Practised:
    """The sequence graph's decisions, by MaskablePPO."""
    skill = practice.skill
    if not isinstance(skill, SequenceGraphSkill) or skill.kind != SequenceGraphSkill.kind:
        raise InvalidArgumentError(f"'graph-ppo' practises skills of kind 'sequence-graph', not '{skill.kind}'")

    def env() -> Any:
        native = timed(practice.env_id, "dense", practice.env_kwargs, ends=True)
        return GraphDecisions(native, skill)

    def export(agent: Any, facts: Mapping[str, Any]) -> Skill:
        metadata = {**skill.metadata, "training": dict(facts)}
        return RefinedGraphSkill.of(skill, residual_network(agent), metadata)

    make = partial(make_graph_agent, GRAPH_PPO)
    return _trained(practice, GRAPH_PPO, env, export, make, load_graph_agent, 1.0 / skill.dt, GRAPH_PPO.rollout)


def learn_residual(practice: Practice) -> Practised:
    """A residual on the skill's actions, by SAC."""
    skill = practice.skill

    def env() -> Any:
        return ResidualView(timed(practice.env_id, "dense", practice.env_kwargs, ends=True), skill)

    example = env()
    view = View.of(example)
    example.close()

    def export(agent: Any, facts: Mapping[str, Any]) -> Skill:
        metadata = {**skill.metadata, "training": dict(facts)}
        return ResidualSkill(skill, actor_network(agent), view, **(skill.facts | {"metadata": metadata}))

    make = partial(make_agent, RESIDUAL_SAC, quiet=QUIET)
    load_ = partial(load_agent, RESIDUAL_SAC)
    return _trained(practice, RESIDUAL_SAC, env, export, make, load_, 1.0 / DECISION_TIME)


def _trained(
    practice: Practice,
    how: TrainingSettings,
    env: Callable[[], Any],
    export: Callable[[Any, Mapping[str, Any]], Skill],
    make: Callable[[Any], Any],
    load_: Callable[[str, Any], Any],
    decisions_per_second: float,
    checkpoint_every: int = Schedule.checkpoint_every,
) -> Practised:
    """The skill of an agent that has trained for the practice's episodes, with a checkpoint at least every tenth of them.

    Args:
        practice: what is asked.
        how, env, export, make, load_: of the `Task`.
        decisions_per_second: at most.
        checkpoint_every: decisions between two checkpoints, at most.
    """
    example = env()
    most = round(float(example.unwrapped.time_limit) * decisions_per_second * practice.episodes)
    example.close()
    schedule = Schedule(
        most,
        min(most // 10, checkpoint_every),
        evaluate_every=0,
        episodes=practice.episodes,
        progress=practice.progress,
    )
    task = Task(how, env, export, lambda agent: None, practice.env_id, practice.env_kwargs, practice.seed, make, load_)
    after = run(task, schedule, practice.folder, identity(practice.skill))
    facts = dict(after.metadata["training"])
    return after, {
        "episodes": facts["training_episodes"],
        "updates": facts["updates"],
        "simulated_hours": facts["simulated_hours"],
        "seconds": facts["seconds"],
        "decisions": facts["decisions"],
    }
