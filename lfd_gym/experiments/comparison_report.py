"""What a comparison shows: its table with paired tests, and learning curves."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.evaluation import Z_95, wilson_interval
from lfd_gym.experiments.figures import curve, panels, save
from lfd_gym.experiments.rows import markdown, success
from lfd_gym.registry import kebab_case
from lfd_gym.report.figures import GOAL
from lfd_gym.versions import versions
from policies.sequence_graph_drawing import COLOURS

Row = Mapping[str, Any]
SCHEMA = "lfd_gym.comparison/1"
MARKS = "sod^v<>p*X"
"""Of methods, hollow, so that none hides another."""


class Paired(NamedTuple):
    """A method against another one on the same setups."""

    difference: float
    """Of the success rates."""
    low: float
    high: float
    """95 % interval over setups, of these trained policies."""
    p: float
    """Of no difference: both methods' results exchanged at random, setup by setup."""


def paired(one: NDArray[np.float64], other: NDArray[np.float64], seed: int = 0, resamples: int = 9999) -> Paired:
    """Compare success rates (N,) on N setups, each the mean over training seeds.

    The interval is that of the mean of N differences and two more setups, on which half a time either one is better (Agresti
    and Min 2005): without them it would be too narrow where hardly a setup differs. The test flips signs, all 2^N of them if
    there are few.
    """
    from scipy.stats import permutation_test

    d = one - other
    mean, n = float(d.mean()), len(d) + 2
    middle = float(d.sum()) / n
    half = Z_95 * math.sqrt(((float(d @ d) + 1.0) / n - middle**2) / n)
    low, high = max(middle - half, -1.0), min(middle + half, 1.0)
    if len(d) < 2 or not d.any():
        return Paired(mean, low, high, 1.0)
    test = permutation_test(
        (d,), _mean, permutation_type="samples", vectorized=True, n_resamples=resamples, rng=np.random.default_rng(seed)
    )
    return Paired(mean, low, high, float(test.pvalue))


def by_setup(rows: Sequence[Row]) -> NDArray[np.float64]:
    """Success rate (N,) on every setup over the rows of one method."""
    return np.mean([[float(e["success"]) for e in row["report"]["episodes"]] for row in rows], axis=0)


def grouped(rows: Sequence[Row]) -> dict[str, dict[str, list[Row]]]:
    """Rows by task and method, in their order."""
    tasks: dict[str, dict[str, list[Row]]] = {}
    for row in rows:
        tasks.setdefault(row["job"]["env_id"], {}).setdefault(row["job"]["method"], []).append(row)
    return tasks


def table(rows: Sequence[Row]) -> str:
    """One line per task and method; the first method of a task is what its others are tested against."""
    lines = []
    for env_id, methods in grouped(rows).items():
        first, reference = next(iter(methods.items()))
        for method, own in methods.items():
            versus = "" if method == first else _points(paired(by_setup(own), by_setup(reference)))
            rates = [f"{100 * row['report']['success_rate']:.0f}" for row in own]
            facts = [_mean_fact(own, name) for name in ("demonstrations", "simulated_hours", "decisions", "updates")]
            shown = [f"{facts[0]:.0f}", f"{facts[1]:.3g}", f"{facts[2]:.0f}", f"{facts[3]:.0f}"]
            lines.append(
                [
                    kebab_case(env_id), method, success([row["report"] for row in own]), ", ".join(rates), versus, *shown,
                    f"{_mean_fact(own, 'seconds') / 60.0:.3g}", str(len(own[0]["report"]["episodes"])),
                ]
            )  # fmt: skip
    header = [
        "task", "method", "success % of these", "per seed", "minus the first method, points, p uncorrected",
        "demonstrations", "simulated h", "decisions", "updates", "wall-clock min", "setups",
    ]  # fmt: skip
    return markdown(header, lines)


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """The comparison as JSON values: per task and method what the table says."""
    methods = []
    for env_id, by_method in grouped(rows).items():
        reference = by_setup(next(iter(by_method.values())))
        for method, own in by_method.items():
            rates = by_setup(own)
            facts = {name: _mean_fact(own, name) for name in own[0]["facts"]}
            methods.append(
                {
                    "env_id": env_id, "method": method, "seeds": [row["job"]["seed"] for row in own],
                    "evaluation_seeds": [e["seed"] for e in own[0]["report"]["episodes"]],
                    "success_rate": float(rates.mean()), "wilson": list(wilson_interval(float(rates.sum()), len(rates))),
                    "per_seed": [row["report"]["success_rate"] for row in own], **facts,
                    "minus_first": paired(rates, reference)._asdict(),
                }
            )  # fmt: skip
    return {"schema": SCHEMA, "methods": methods, "versions": versions()}


def learning_curve(rows: Sequence[Row], key: str) -> tuple[NDArray[np.float64], ...]:
    """Of the evaluations that every training had after as many decisions: the fact `key`, successes and setups.

    They are means over the trainings, which are evaluated on the same setups. What was shown before counts too. Empty where
    there is no such evaluation.
    """
    if not all(row["curve"] for row in rows):
        return np.empty(0), np.empty(0), np.empty(0)
    by_decisions = [{point["decisions"]: point for point in row["curve"]} for row in rows]
    common = sorted(set.intersection(*(set(points) for points in by_decisions)))
    before = [row["facts"][key] - row["curve"][-1][key] for row in rows]
    x = [np.mean([b + points[n][key] for points, b in zip(by_decisions, before, strict=True)]) for n in common]
    counts = (
        [np.mean([points[n][name] for points in by_decisions]) for n in common] for name in ("successes", "episodes")
    )
    return tuple(np.array(values, dtype=np.float64) for values in (x, *counts))


def draw(rows: Sequence[Row], folder: Path) -> None:
    """`<task>.png`: success over simulated hours and over wall-clock.

    A curve, with its 95 % interval over setups, is of the 20 development setups that a training looks at, the mean of all
    trainings of a method; a point is one trained policy on the setups of the comparison, and a dashed line a policy that was
    not taught.
    """
    for env_id, methods in grouped(rows).items():
        figure, axes = panels(2, width=6.5)
        taught = [method for method, own in methods.items() if own[0]["facts"]["simulated_hours"] > 0.0]
        untaught = [method for method in methods if method not in taught]
        for panel, (key, label) in zip(
            axes, (("simulated_hours", "simulated hours"), ("seconds", "wall-clock [s]")), strict=True
        ):
            for i, method in enumerate(taught):
                own, colour = methods[method], i % len(COLOURS)
                x, successes, n = learning_curve(own, key)
                if len(x):
                    intervals = [wilson_interval(s, int(m)) for s, m in zip(successes, n, strict=True)]
                    low, high = 100.0 * np.transpose(intervals)
                    curve(panel, x, 100.0 * successes / n, low, high, colour, f"{method}, while it trained")
                spent = [row["facts"][key] for row in own]
                rates = [100.0 * row["report"]["success_rate"] for row in own]
                mark = MARKS[i % len(MARKS)]
                panel.plot(spent, rates, mark, color=COLOURS[colour], mfc="none", ms=7, mew=1.4, label=method)
            for i, method in enumerate(untaught):
                rate = 100.0 * by_setup(methods[method]).mean()
                panel.axhline(rate, linestyle=("--", ":")[i % 2], color=GOAL, linewidth=1.2, label=method)
            panel.set_xscale("log")
            panel.set_xlabel(label)
            panel.set_ylim(-2.0, 102.0)
        axes[0].set_ylabel("success [%]")
        axes[0].set_title(kebab_case(env_id), fontsize=9)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right upper", fontsize=7)
        save(figure, folder / f"{kebab_case(env_id)}.png")


def _mean_fact(rows: Sequence[Row], name: str) -> float:
    return float(np.mean([row["facts"][name] for row in rows]))


def _points(result: Paired) -> str:
    difference, low, high = (round(100 * value) for value in result[:3])
    return f"{difference:+d} [{low:+d}, {high:+d}], p = {result.p:.2g}"


def _mean(differences: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    return np.asarray(np.mean(differences, axis=axis))
