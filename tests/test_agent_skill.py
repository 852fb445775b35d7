"""Files of agents and residuals: what does not fit is refused when it is loaded, not in the episode."""

import itertools
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lfd_gym import cli_names
from lfd_gym.errors import DemonstrationError, InvalidArgumentError, SkillFileError
from lfd_gym.recording import record
from lfd_gym.registry import make
from lfd_gym.view import View
from policies import load_skill
from policies.moa_learner import MoALearner
from policies.reinforcement.agent_skill import AgentSkill
from policies.reinforcement.network import Network
from policies.reinforcement.residual import ResidualSkill
from policies.skill import Skill
from scripted_teachers.move_object import MoveObjectTeacher

FACTS: dict[str, Any] = {"env_id": "lfd_gym/MoveObject-v0", "taught_seeds": (1,), "metadata": {}}


def network(n_inputs: int, n_outputs: int) -> Network:
    """Two layers of small random weights."""
    rng, sizes = np.random.default_rng(0), (n_inputs, 8, n_outputs)
    weights = tuple(0.1 * rng.standard_normal((m, n)) for n, m in itertools.pairwise(sizes))
    biases = tuple(np.zeros(m) for m in sizes[1:])
    return Network(weights, biases, np.zeros(n_inputs), np.ones(n_inputs), "relu", "tanh")


@pytest.fixture(scope="module")
def agent() -> AgentSkill:
    view = View.of(make("move-object"))
    return AgentSkill(network(view.size, 3 * len(view.controls)), view, executed=2, **FACTS)


@pytest.fixture(scope="module")
def residual(agent: AgentSkill) -> ResidualSkill:
    taught = record("move-object", MoveObjectTeacher(noise=0.0), n=1, seed=0).demonstrations
    base, view = MoALearner().fit(taught).skill_, agent.view
    return ResidualSkill(base, network(view.size + view.layout.size, len(view.controls)), view, **FACTS)


def changed(skill: Skill, path: Path, change: Callable[[dict[str, Any], dict[str, np.ndarray]], None]) -> Path:
    """The file of a skill with other values in its header or arrays."""
    skill.save(path)
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    header = json.loads(str(arrays["header"]))
    change(header["values"], arrays)
    np.savez(path, **{**arrays, "header": np.array(json.dumps(header))})
    return path


def test_a_view_knows_how_much_it_sees() -> None:
    for name in ("move-object", "light-bulb", "whiteboard"):
        env = make(name)
        view, (seen, _) = View.of(env), env.reset(seed=100000)
        assert view.flatten({key: seen[key] for key in view.observations}).shape == (view.size,)


def test_agents_and_residuals_survive_their_files(agent: AgentSkill, residual: ResidualSkill, tmp_path: Path) -> None:
    seen, _ = make("move-object").reset(seed=100000)
    for skill in (agent, residual):
        skill.save(tmp_path / "skill.npz")
        np.testing.assert_array_equal(load_skill(tmp_path / "skill.npz").predict(seen)[0], skill.predict(seen)[0])


CHANGES: dict[str, Callable[[dict[str, Any], dict[str, np.ndarray]], None]] = {
    "no weights": lambda values, arrays: arrays.pop("network_weight1"),
    "other weights": lambda values, arrays: arrays.update(network_weight1=arrays["network_weight1"][:, :-1]),
    "NaN": lambda values, arrays: arrays["network_bias0"].fill(np.nan),
    "no scale": lambda values, arrays: arrays["network_scale"].fill(0.0),
    "no time": lambda values, arrays: values["view"].update(dt=0.0),
    "other time": lambda values, arrays: values["view"].update(dt=0.03),
    "fewer controls": lambda values, arrays: values["view"].update(controls=["x", "y"]),
    "no controls": lambda values, arrays: values["view"].update(controls=[]),
    "fewer frames": lambda values, arrays: values["view"].update(frames=["object"]),
}


@pytest.mark.parametrize("name", CHANGES)
def test_networks_and_views_that_do_not_fit_are_refused(
    name: str, agent: AgentSkill, residual: ResidualSkill, tmp_path: Path
) -> None:
    for skill in (agent, residual):
        with pytest.raises(SkillFileError, match="damaged"):
            load_skill(changed(skill, tmp_path / "skill.npz", CHANGES[name]))


@pytest.mark.parametrize("executed", [0, 4, "a", None])
def test_no_more_is_executed_than_is_decided(executed: Any, agent: AgentSkill, tmp_path: Path) -> None:
    with pytest.raises(SkillFileError, match="damaged"):
        load_skill(changed(agent, tmp_path / "skill.npz", lambda values, arrays: values.update(executed=executed)))


def test_cloning_says_what_it_misses_and_passes_over_what_does_not_move() -> None:
    pytest.importorskip("torch", reason="the rl extra is not installed")
    from dataclasses import replace

    from policies.reinforcement.behaviour_cloning import BehaviourCloning

    (shown,) = record("move-object", MoveObjectTeacher(noise=0.0), n=1, seed=0).demonstrations
    for missing in ("tool_velocity", "hand_torque", "frame_target"):
        less = {name: values for name, values in shown.observations.items() if name != missing}
        with pytest.raises(DemonstrationError, match=missing):
            BehaviourCloning(updates=1).fit([replace(shown, observations=less)])
    still = {name: np.repeat(values[:1], len(values), axis=0) for name, values in shown.observations.items()}
    cloned = [
        BehaviourCloning(updates=2, width=8).fit(taught)
        for taught in ([shown, replace(shown, observations=still)], [shown])
    ]
    assert cloned[0].losses_ == cloned[1].losses_


def test_cloning_refuses_impossible_arguments_with_what_is_possible() -> None:
    pytest.importorskip("torch", reason="the rl extra is not installed")
    from policies.reinforcement.behaviour_cloning import BehaviourCloning

    taught = record("move-object", MoveObjectTeacher(noise=0.0), n=1, seed=0).demonstrations
    for name, value, possible in [
        ("seed", "abc", "a whole number from 0 on"),
        ("seed", -1, "a whole number from 0 on"),
        ("skips_pauses", 3, "True, False"),
    ]:
        with pytest.raises(InvalidArgumentError, match=f"{name} is {value!r}; possible: {possible}"):
            BehaviourCloning(updates=1, **{name: value}).fit(taught)


def test_cloning_of_chunks_has_the_same_parameters_and_can_be_cloned() -> None:
    pytest.importorskip("torch", reason="the rl extra is not installed")
    from sklearn.base import clone

    from policies.reinforcement.behaviour_cloning import BehaviourCloning, ChunkedBehaviourCloning

    chunked = clone(ChunkedBehaviourCloning(width=8).set_params(executed=2))
    given = {"width": 8, "loss": "absolute", "chunk": 8, "executed": 2}
    assert chunked.get_params() == {**BehaviourCloning().get_params(), **given}
    with pytest.raises(InvalidArgumentError, match="did you mean 'updates'"):
        cli_names.learner("bc-chunks", {"update": 3})
