"""Experiments: kept rows, statistics on planted numbers, and every command on its smallest settings."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
import toy
from scipy.integrate import solve_ivp

from lfd_gym.errors import InvalidArgumentError
from lfd_gym.experiments import (
    EXPERIMENTS,
    classifiers,
    finetuning,
    goal_learning,
    graphs,
    grasping,
    judged,
    moa_scaling,
    moa_tasks,
    omniglot,
    one_demonstration,
    perturbations,
    rows,
    sequence_graphs,
    slips,
    start_equals_end,
    subsets,
    transitions,
    writing,
)
from lfd_gym.experiments import toy as toy_experiment
from lfd_gym.experiments.learning import TEACHING
from lfd_gym.experiments.rows import Rows
from lfd_gym.registry import load
from lfd_gym.seeds import DEVELOPMENT_SEED
from policies.transitions import CLASSIFIERS
from scripted_teachers.cylinder_grasp import CLOSE, LIFT

PNG = b"\x89PNG"


class Seen(NamedTuple):
    seed: int
    steps: int


def count_steps(env: Any, policy: Any, seed: int) -> Seen:
    observation, _ = env.reset(seed=seed)
    steps, ended = 0, False
    while not ended and steps < 50:
        action, _ = policy.predict(observation)
        observation, _, ended, _, _ = env.step(action)
        steps += 1
    return Seen(seed, steps)


def count_slowly_at_first(env: Any, policy: Any, seed: int) -> Seen:
    time.sleep(0.5 * (seed == DEVELOPMENT_SEED))
    return count_steps(env, policy, seed)


def test_every_experiment_is_there() -> None:
    assert all(callable(load(path)) for path in EXPERIMENTS.values())


def test_a_row_is_made_once(tmp_path: Path) -> None:
    made: list[int] = []

    def result() -> list[int]:
        made.append(1)
        return [3, 4]

    assert [Rows(tmp_path).kept("row", result) for _ in range(2)] == [[3, 4]] * 2
    assert len(made) == 1


def test_a_row_of_other_setups_is_refused(tmp_path: Path) -> None:
    kept = Rows(tmp_path, quick=True)
    kept.evaluated("row", toy.ENV_ID, toy.PointPolicy)
    for episodes, env_kwargs in ((1, None), (100, {"speed": 2.0})):
        with pytest.raises(InvalidArgumentError, match="of other setups"):
            kept.evaluated("row", toy.ENV_ID, toy.PointPolicy, episodes, env_kwargs)
    (tmp_path / "quick" / "row.json").write_text("{")
    with pytest.raises(InvalidArgumentError, match="is damaged"):
        kept.evaluated("row", toy.ENV_ID, toy.PointPolicy)


def test_a_quick_trial_is_never_taken_for_a_result(tmp_path: Path) -> None:
    assert Rows(tmp_path, quick=True).kept("row", lambda: "trial") == "trial"
    assert Rows(tmp_path).kept("row", lambda: "result") == "result"
    assert Rows(tmp_path, quick=True).seeds(100) == range(100000, 100002)
    assert Rows(tmp_path).seeds(100) == range(1000, 1100)


def test_jobs_change_no_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "QUICK_EPISODES", 12)
    kept = []
    for jobs in (1, 2):
        at = Rows(tmp_path / str(jobs), quick=True, jobs=jobs)
        assert at.evaluated("report", toy.ENV_ID, toy.PointPolicy)["success_rate"] == 1.0
        kept.append(at.observed("seen", toy.ENV_ID, toy.PointPolicy, count_slowly_at_first, 12))
    assert kept[0] == kept[1]
    assert [row["seed"] for row in kept[0]] == list(range(100000, 100012))


def test_what_failed_first() -> None:
    def episode(seed: int, success: bool, **subtasks: bool) -> dict[str, Any]:
        return {"seed": seed, "success": success, "subtasks": subtasks, "error": None}

    report = {
        "episodes": [
            episode(0, True, grasped=True, lifted=True),
            episode(1, False, grasped=True, lifted=False),
            episode(2, False, grasped=True, lifted=False),
            episode(3, False, grasped=False, lifted=False),
            episode(4, False, grasped=True, lifted=True),
        ]
    }
    assert rows.missed(report) == "lifted 2, grasped 1, the end 1"
    assert rows.success([report]) == "20 [4, 62]"


# goal learning


def test_the_toy_moves_as_the_attractor() -> None:
    x, v, goal, alpha = np.array([0.1, 0.0, 0.3]), np.array([0.2, -0.1, 0.0]), np.array([0.5, 0.2, 0.1]), 6.0
    path, speed = goal_learning.attracted(x, v, goal)

    def attractor(_: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[3:], alpha * (alpha / 4.0 * (goal - y[:3]) - y[3:])])

    times = np.arange(100) * goal_learning.DT
    exact = solve_ivp(attractor, (0.0, times[-1]), np.concatenate([x, v]), t_eval=times, rtol=1e-10, atol=1e-12).y.T
    np.testing.assert_allclose(np.hstack([path, speed])[:100], exact, atol=1e-8)


def test_a_goal_that_is_reached_is_found() -> None:
    exact = goal_learning.Condition(threshold=1e-9)
    shown = [goal_learning.demonstration(exact, np.random.default_rng(i)) for i in range(3)]
    for name, within in (("arclength", 0.005), ("mean of the ends", 2e-4), ("last end", 2e-4)):
        assert goal_learning.goal_error(goal_learning.ESTIMATORS[name], shown) < within


def test_a_goal_that_nobody_reached_is_found_from_two_sides() -> None:
    early = goal_learning.OTHERS[goal_learning.EARLY]
    shown = [goal_learning.demonstration(early, np.random.default_rng(i)) for i in range(8)]
    errors = {name: goal_learning.goal_error(e, shown) for name, e in goal_learning.ESTIMATORS.items()}
    assert all(errors[name] < 0.8 * errors["mean of the ends"] for name in ("arclength", "real time"))


def test_goal_learning_makes_its_table_and_figure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(goal_learning, "OTHERS", {goal_learning.EARLY: goal_learning.OTHERS[goal_learning.EARLY]})
    table = goal_learning.run(tmp_path, quick=True, jobs=1)
    first = [float(cell.split(" ±")[0]) for cell in table.splitlines()[4].split("|")[2:-1]]
    assert first[-1] < first[0]
    assert (tmp_path / "quick" / "goal-learning.png").read_bytes().startswith(PNG)


# graphs and classifiers


def plant(folder: Path, share: float, parameters: dict[str, Any], rng: np.random.Generator) -> None:
    """Rows of skills that make each of three transitions, five times an episode, with a planted probability."""
    for chosen in transitions.FEWEST:
        episodes = [
            {
                "seed": seed,
                "success": bool(rng.uniform() < share),
                "helped": 0,
                "transitions": [[k, k + 1, bool(rng.uniform() < share)] for k in range(3) for _ in range(5)],
            }
            for seed in range(20)
        ]
        name = "-".join([*parameters.values(), "0", "".join(map(str, chosen))])
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.json").write_text(json.dumps(episodes))


def test_planted_rates_and_orders_are_found(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    shares = {"global": 0.95, "local": 0.93, "fully-connected": 0.5}
    for graph, share in shares.items():
        plant(tmp_path / "quick", share, graphs.KINDS[graph], rng)
    table = graphs.run(tmp_path, quick=True, jobs=1)
    for graph, share in shares.items():
        cells = next(line for line in table.splitlines() if line.startswith(f"| {graph} | 3")).split("|")
        mean, low, high = (
            float(number) for number in cells[5].replace("[", " ").replace("]", " ").replace(",", " ").split()
        )
        assert low <= 100.0 * share <= high
        assert low < mean < high
        assert high - low < 15.0
    assert [line.count(", shows") for line in table.splitlines()[-3:]] == [0, 2, 2]
    assert (tmp_path / "quick" / "graphs.png").read_bytes().startswith(PNG)


def test_equal_skills_do_not_differ() -> None:
    rng = np.random.default_rng(0)
    due = np.full((4, 20, 3), 5.0)
    right, solved = rng.binomial(5, 0.8, due.shape), rng.uniform(size=(4, 20)) < 0.7
    skills = judged.Judged(np.ones(4, dtype=int), right.astype(float), due, solved.astype(float))
    assert judged.differences(skills, skills) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def test_all_classifiers_are_compared() -> None:
    assert {kind["classifier"] for kind in classifiers.KINDS.values()} == set(CLASSIFIERS)
    assert {kind for pair in classifiers.ORDERS for kind in pair} <= set(classifiers.KINDS)


# slips


class CarriedEnv:
    """A hand that lifts a cylinder which moves in it by a given way; its action is a label."""

    def __init__(self, way: float, touched: bool = True) -> None:
        self.way, self.touched, self.unwrapped = way, touched, self

    def setup(self) -> dict[str, dict[str, Any]]:
        return {"cylinder": {"length": 0.16, "posture": "lying"}}

    def reset(self, seed: int, options: None) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        self.steps = 0
        return self.observe(), {}

    def observe(self) -> dict[str, np.ndarray]:
        tool = np.array([0.6, 0.0, 0.02 * self.steps])
        return {
            "tool_position": tool,
            "frame_cylinder": np.array([*(tool - [0, 0, self.way * self.steps / 10]), 1, 0, 0, 0]),
        }

    def step(self, action: int) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        self.steps += 1
        return self.observe(), 0.0, self.steps == 10, False, {"subtask/grasped": self.touched, "is_success": False}


def lifter(lift: int) -> Any:
    """Closes the hand first, and then performs the primitive `lift`."""

    def predict(observation: dict[str, np.ndarray], state: Any, episode_start: Any, deterministic: bool) -> Any:
        label = CLOSE if state is None else lift
        return label, (np.array([label]),)

    return SimpleNamespace(predict=predict, active=lambda state: state[0])


@pytest.mark.parametrize(
    ("way", "touched", "label", "slipped"),
    [(0.04, True, LIFT, True), (0.01, True, LIFT, False), (0.04, False, LIFT, False), (0.04, True, CLOSE, False)],
)
def test_a_slip_is_a_cylinder_that_moves_in_the_lifting_hand(
    way: float, touched: bool, label: int, slipped: bool
) -> None:
    assert slips.watch_for_slips(CarriedEnv(way, touched), lifter(label), 7).slipped is slipped


def test_recovery_counts_episodes_with_a_slip_only() -> None:
    flags = [(True, True), (True, False), (False, False), (True, True)]
    episodes = [{"slipped": slipped, "success": well, "seed": seed} for seed, (slipped, well) in enumerate(flags)]
    assert slips.recovered(episodes) == "67 [21, 94] of 3"
    assert slips.recovered(episodes * 3) == "67 [21, 94] of 9"  # of three skills on the same setups
    assert slips.recovered(episodes[2:3]) == "none slipped"


# every command, as small as it gets

MOVE_OBJECT, CYLINDER = "lfd_gym/MoveObject-v0", "lfd_gym/CylinderGrasp-v0"
Run = Callable[[Path, bool, int], str]


@pytest.mark.slow  # teaches, learns and performs
@pytest.mark.parametrize(
    ("run", "settings", "lines"),
    [
        (one_demonstration.run, [(one_demonstration, "TASKS", (MOVE_OBJECT,))], ["| move-object | 0 |"]),
        (
            perturbations.run,
            [(perturbations, "TEACHING", {MOVE_OBJECT: 3})],
            ["| move-object | none |", "| move-object | tracking 1 cm, 1 degree |"],
        ),
        (
            sequence_graphs.run,
            [(sequence_graphs, "SEEDS", {MOVE_OBJECT: {"commanded": range(3)}, CYLINDER: {"commanded": range(1)}})],
            ["| move-object | commanded | 3 |", "| cylinder-grasp | commanded | 17 |"],
        ),
        (slips.run, [], ["| weight and friction | all |", "| fingertips slippery for 0.5 s | no slip was shown |"]),
        (grasping.run, [], ["| 1 |", "| 2 |"]),
        (
            graphs.run,
            [(graphs, "KINDS", {"global": graphs.KINDS["global"]}), (graphs, "ORDERS", ())],
            ["| global | 3 | 1 |"],
        ),
        (writing.run, [], ["| teacher |", "| moa | 6 |", "| gmr | 6 |", "| moa, one demonstration | 1 |"]),
        (omniglot.run, [(omniglot, "QUICK_LETTERS", 1)], ["| MoA |", "| least |", "our own alphabet"]),
        (start_equals_end.run, [], ["| MoA |", "| DMP | 0.000 |"]),
        (subsets.run, [], ["| second-stage | 6 | 1 |", "| first-stage | 1 | 2 |"]),
        (toy_experiment.run, [], ["| at the first target | 1.00 | 0.00 |", "| at the second target | 0.00 | 1.00 |"]),
        (moa_scaling.run, [], ["| 160 | structured |", "| 480 | proxqp |"]),
        (moa_tasks.run, [(moa_tasks, "SETUPS", {"lfd_gym/BoxStacking-v0": 1})], ["| box-stacking | 3 | 0 |"]),
    ],
    ids=[
        "one-demonstration",
        "perturbations",
        "sequence-graphs",
        "slips",
        "grasping",
        "graphs",
        "writing",
        "omniglot",
        "start-equals-end",
        "subsets",
        "toy",
        "moa-scaling",
        "moa-tasks",
    ],
)
def test_every_quick_experiment_makes_its_table(
    run: Run, settings: list[Any], lines: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "QUICK_EPISODES", 1)
    for module, name, value in settings:
        monkeypatch.setattr(module, name, value)
    table = run(tmp_path, True, 1)
    assert all(line in table for line in lines)
    assert run(tmp_path, True, 1) == table


@pytest.mark.slow  # teaches, practises and performs
def test_practice_is_compared_with_the_skill_it_started_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cma", reason="the rl extra is not installed")
    monkeypatch.setattr(rows, "QUICK_EPISODES", 1)
    case = finetuning.Case(MOVE_OBJECT, "sequence-graph", 1.0, 1, ("cma",), variant="lr-at-once")
    monkeypatch.setattr(finetuning, "CASES", (case,))
    with pytest.raises(InvalidArgumentError, match="no row begins with 'light-bulb'"):
        finetuning.run(tmp_path, True, 1, only="light-bulb")
    table = finetuning.run(tmp_path, True, 1)
    assert "| move-object | sequence-graph-lr-at-once | 1 | 1 | 0 | cma |" in table
    with monkeypatch.context() as finished:
        finished.setattr(finetuning, "load_skill", lambda path: pytest.fail("a finished row was made again"))
        assert finetuning.run(tmp_path, True, 1) == table
        finished.setattr(finetuning, "QUICK_PRACTICE", 32)
        with pytest.raises(InvalidArgumentError, match="16 episodes of practice"):
            finetuning.run(tmp_path, True, 1)
    after, before = tmp_path / "quick" / f"{case.name}-cma.json", tmp_path / "quick" / f"{case.name}.json"
    after.unlink()
    before.write_text(json.dumps(json.loads(before.read_text()) | {"skill": "another"}))
    with pytest.raises(InvalidArgumentError, match="is of another skill, or says not of which"):
        finetuning.run(tmp_path, True, 1)


def test_the_thesis_taught_as_often() -> None:
    assert [TEACHING[f"lfd_gym/{task}-v0"] for task in ("LightBulb", "BoxFlipping", "CylinderGrasp")] == [3, 5, 17]
