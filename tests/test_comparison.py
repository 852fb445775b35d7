"""Comparisons: rows are made once, other comparisons are told apart, and the statistics are those of planted numbers."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lfd_gym import cli
from lfd_gym.errors import InvalidArgumentError, LfdGymError, UnknownNameError
from lfd_gym.experiments import comparison
from lfd_gym.experiments.comparison import Comparison, compare
from lfd_gym.experiments.comparison_report import by_setup, learning_curve, paired, summary, table
from lfd_gym.experiments.rows import Rows

ENV_ID = "lfd_gym/MoveObject-v0"


def row(method: str, seed: int, successes: list[int], curve: Any = ()) -> dict[str, Any]:
    episodes = [{"seed": 1000 + i, "success": bool(s)} for i, s in enumerate(successes)]
    facts = {"demonstrations": 3, "updates": 7, "decisions": 10 * seed, "simulated_hours": 0.5, "seconds": 60.0}
    report = {"episodes": episodes, "success_rate": float(np.mean(successes))}
    return {
        "job": {"env_id": ENV_ID, "method": method, "seed": seed},
        "facts": facts,
        "curve": list(curve),
        "report": report,
    }


def test_a_pair_that_never_differs_and_one_that_always_does() -> None:
    rng = np.random.default_rng(0)
    one = rng.integers(0, 2, 50).astype(float)
    assert paired(one, one)[0] == 0.0
    assert paired(one, one).low == -paired(one, one).high < 0.0
    assert paired(one, one).p == 1.0
    clear = paired(np.ones(12), np.zeros(12))
    assert clear.difference == 1.0
    assert 0.6 < clear.low < clear.high == 1.0
    assert clear.p == pytest.approx(2 / 2**12, rel=1e-6)


def test_the_paired_interval_covers_a_planted_difference() -> None:
    """Hard setups are hard for both: the interval is far narrower than one that forgets which setup is which."""
    rng, covered, widths = np.random.default_rng(1), 0, []
    for _ in range(200):
        ease = rng.uniform(size=(100, 1))
        draws = rng.uniform(size=(100, 3))
        one, other = (draws < 0.9 * ease + 0.1).mean(axis=1), (draws < 0.9 * ease).mean(axis=1)
        result = paired(one, other, resamples=9)
        covered += result.low <= 0.1 <= result.high
        widths.append(result.high - result.low)
    assert covered >= 180
    assert np.mean(widths) < 0.1


@pytest.mark.parametrize(("n", "rate"), [(100, 0.01), (100, 0.03), (500, 0.005)])
def test_the_paired_interval_covers_rare_differences(n: int, rate: float) -> None:
    """Where one of the two is never better and hardly a setup differs, it still covers in 95 % of the cases."""
    rng = np.random.default_rng(2)
    results = [paired(np.zeros(n), (rng.random(n) < rate).astype(float), resamples=9) for _ in range(400)]
    assert sum(result.low <= -rate <= result.high for result in results) >= 370


def test_the_table_says_what_the_rows_say() -> None:
    rows = [row("sequence-graph", s, [1, 1, 1, 0]) for s in range(2)] + [row("bc", s, [0, s, 0, 0]) for s in range(2)]
    assert by_setup(rows[2:]).tolist() == [0.0, 0.5, 0.0, 0.0]
    lines = table(rows).splitlines()
    assert "move-object | sequence-graph | 75 [30, 95] | 75, 75 |  | 3 | 0.5 | 5 | 7 | 1 | 4" in lines[2]
    assert "| bc | 12 [1, 60] | 0, 25 | -62 [" in lines[3]
    described = summary(rows)["methods"]
    assert [m["method"] for m in described] == ["sequence-graph", "bc"]
    assert described[1]["minus_first"]["difference"] == -0.625
    json.dumps(described)


def test_a_learning_curve_has_the_evaluations_after_equally_many_decisions() -> None:
    """Trainings that were looked at more often, or earlier, are not averaged with others at another time."""

    def point(decisions: int, successes: int) -> dict[str, float]:
        return {"decisions": decisions, "successes": successes, "episodes": 20, "simulated_hours": decisions / 1000.0}

    often = row("ppo", 0, [1], [point(100, 0), point(200, 2), point(300, 4), point(400, 6)])
    seldom = row("ppo", 1, [1], [point(200, 10), point(400, 20)])
    x, successes, episodes = learning_curve([often, seldom], "simulated_hours")
    assert x == pytest.approx([0.3, 0.5])  # 0.1 h were shown before the training
    assert successes.tolist() == [6, 13]
    assert episodes.tolist() == [20, 20]


def test_jobs_are_those_of_the_issue() -> None:
    pytest.importorskip("stable_baselines3", reason="the rl extra is not installed")
    jobs = {job.name: job for job in Comparison([ENV_ID, "lfd_gym/LightBulb-v0"]).jobs()}
    assert jobs["move-object-ppo-2"].decisions == 3_000_000
    assert jobs["move-object-sac-sparse-0"].decisions == 300_000
    assert jobs["move-object-sac-demos-0"].decisions == 750_000
    assert jobs["light-bulb-ppo-0"].decisions == 100_000
    assert jobs["light-bulb-sac-demos-1"].demonstrations == 3
    assert jobs["light-bulb-ppo-1"].demonstrations == jobs["light-bulb-random-0"].demonstrations == 0
    assert jobs["light-bulb-decomposition-0"].demonstrations == 9
    assert jobs["move-object-decomposition-0"].demonstrations == 3
    assert "light-bulb-random-1" not in jobs
    assert "light-bulb-sac-0" not in jobs


def test_rows_that_are_there_make_a_table_and_say_what_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(comparison, "_perform", lambda rows, job: pytest.fail(f"{job.name} was run"))
    asked = Comparison([ENV_ID], ("teacher", "random", "sequence-graph"), range(2), episodes=2)
    with pytest.raises(InvalidArgumentError, match="none of the 4 rows"):
        compare(asked, tmp_path, finished=True)
    rows = Rows(tmp_path)
    for job in asked.jobs()[1:3]:
        rows.write(job.name, {**row(job.method, job.seed, [1, 0]), "job": comparison._asked(rows, job)})
    lines = compare(asked, tmp_path, finished=True).splitlines()
    assert [line.split(" | ")[1] for line in lines[2:4]] == ["random", "sequence-graph"]
    assert lines[-1] == "2 of 4 jobs have not been run."
    described = json.loads((tmp_path / "comparison.json").read_text())
    assert described["missing"] == ["move-object-teacher-0", "move-object-sequence-graph-1"]


def test_a_killed_comparison_repeats_no_finished_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    performed: list[str] = []

    def perform(rows: Rows, job: comparison.Job) -> dict[str, Any]:
        if job.method == "random" and len(performed) < 2:
            raise KeyboardInterrupt
        performed.append(job.name)
        return {**row(job.method, job.seed, [1, 0]), "job": comparison._asked(rows, job)}

    monkeypatch.setattr(comparison, "_perform", perform)
    asked = Comparison([ENV_ID], ("teacher", "random", "sequence-graph"), range(1), episodes=2)
    with pytest.raises(KeyboardInterrupt):
        compare(asked, tmp_path)
    assert performed == ["move-object-teacher-0"]
    performed.append("")
    first = compare(asked, tmp_path)
    assert performed[2:] == ["move-object-random-0", "move-object-sequence-graph-0"]
    assert compare(asked, tmp_path) == first
    assert len(performed) == 4
    with pytest.raises(InvalidArgumentError, match="choose another --out"):
        compare(Comparison([ENV_ID], ("teacher", "moa"), range(1), episodes=3), tmp_path)
    assert len(performed) == 4
    with pytest.raises(UnknownNameError, match="loky"):
        compare(Comparison([ENV_ID], ("moa",), range(1), episodes=2, backend="lokey"), tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InvalidArgumentError, match="cluster"):
        compare(Comparison([ENV_ID], ("teacher",), range(1), episodes=2, backend="ray"), tmp_path)
    assert [job.name for job in Comparison([ENV_ID] * 2, ("teacher",) * 2).jobs()] == ["move-object-teacher-0"]


def test_a_failed_job_fails_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def perform(rows: Rows, job: comparison.Job) -> dict[str, Any]:
        if job.method == "teacher":
            raise ValueError("no power")
        return {**row(job.method, job.seed, [1, 0]), "job": comparison._asked(rows, job)}

    monkeypatch.setattr(comparison, "_perform", perform)
    with pytest.raises(LfdGymError, match="1 of 2 jobs failed.*: move-object-teacher-0: ValueError: no power"):
        compare(Comparison([ENV_ID], ("teacher", "random"), episodes=2), tmp_path)
    assert (tmp_path / "move-object-random-0.json").exists()
    with pytest.raises(UnknownNameError, match="sequence-graph"):
        compare(Comparison([ENV_ID], ("sequence-graf",)), tmp_path)


def test_compare_from_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    """Everything in earnest, on the smallest settings: a skill, a training, random actions."""
    pytest.importorskip("stable_baselines3", reason="the rl extra is not installed")
    monkeypatch.setattr("lfd_gym.experiments.rows.QUICK_EPISODES", 1)
    methods = [text for name in ("sequence-graph", "sac-demos", "random") for text in ("--method", name)]
    arguments = ["compare", "--env", "move-object", *methods, "--seeds", "1", "--demos", "2", "--quick"]
    assert cli.main([*arguments, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert [line.split(" | ")[1] for line in printed.splitlines()[2:]] == ["sequence-graph", "sac-demos", "random"]
    assert (tmp_path / "quick" / "table.md").read_text() == printed
    assert (tmp_path / "quick" / "move-object.png").read_bytes()[:4] == b"\x89PNG"
    trained = json.loads((tmp_path / "quick" / "move-object-sac-demos-0.json").read_text())
    assert trained["facts"]["decisions"] == comparison.QUICK_DECISIONS
    assert [point["decisions"] for point in trained["curve"]] == [comparison.QUICK_DECISIONS]
    assert trained["facts"]["demonstrations"] == 2
    assert json.loads((tmp_path / "quick" / "comparison.json").read_text())["schema"] == "lfd_gym.comparison/1"
