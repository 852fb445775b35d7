"""How well planted attractor goals are found again (thesis 2.5.1, Figure 2.8).

The toy is the thesis's: a state machine moves an object with attractors to predefined goals, the thresholds at which it goes
on and the goals themselves are noisy, and after each of eight demonstrations all goals are learned from what was shown so far.
The error is (2.15), the mean over the primitives of the L1 norm of the goals' errors. Beside it stand the three readings of
normalised time, two naive estimators, and what Figure 2.8 does not vary: movements that stop early, sensor noise, rests.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.evaluation import Z_95
from lfd_gym.experiments.figures import curve, panels, save
from lfd_gym.experiments.rows import Rows, markdown
from policies.goals import attractor_goals
from policies.movement_primitives import DEAD_BAND

Array = NDArray[np.float64]

RUNS, DEMONSTRATIONS = 20, 8
ALPHA, DT = 6.0, 0.02
"""The attractor's gain [1/s], critically damped: two seconds for 30 cm, a human's speed; time between samples [s]."""
GOALS = np.array([[0.58, 0.0, 0.28], [0.0, 0.0, 0.012], [0.0, 0.0, 0.059], [0.58, 0.0, 0.28]])
"""Of the primitives that move (Table 2.1): initial position, A, B, final position; in the frames world, object, target, world
[m]. Those that hold have none."""
AREA_LOW, AREA_HIGH = np.array([0.48, -0.25, 0.03]), np.array([0.73, 0.25, 0.03])
"""Where object and target are [m]."""
HOME = np.array([0.5, 0.1, 0.4])


class Condition(NamedTuple):
    """How the toy demonstrates."""

    scatter: float = 0.0
    """sigma, standard deviation of the goals per axis and demonstration [m]."""
    threshold: float = 0.01
    """Distance from the goal at which it goes on [m]; a third of it is the standard deviation."""
    sensor: float = 0.0
    """Standard deviation of the measured position per axis [m]."""
    rest: float = 0.0
    """How long it rests at the end of a movement [s]."""


SIGMAS = {f"sigma {1000 * s:g} mm": Condition(scatter=s) for s in (0.005, 0.01, 0.02)}
OTHERS = {
    "stops 1 cm before its goal": Condition(),
    "stops 3 cm before its goal": Condition(threshold=0.03),
    "stops 10 cm before its goal": Condition(threshold=0.10),
    "stops 3 cm before its goal, sigma 10 mm": Condition(threshold=0.03, scatter=0.01),
    "sensor noise 1 mm": Condition(sensor=0.001),
    "sensor noise 1 mm, stops 3 cm before its goal": Condition(threshold=0.03, sensor=0.001),
    "sensor noise 1 mm, stops 3 cm before its goal, rests 0.6 s": Condition(threshold=0.03, sensor=0.001, rest=0.6),
}
Estimator = Callable[[Sequence[Array]], Array]
ESTIMATORS: dict[str, Estimator] = {
    "squared time (2.4)": lambda segments: attractor_goals(segments, "squared", DEAD_BAND[0, 0]),
    "arclength": lambda segments: attractor_goals(segments, "arclength", DEAD_BAND[0, 0]),
    "real time": lambda segments: attractor_goals(segments, "real", DEAD_BAND[0, 0]),
    "mean of the ends": lambda segments: np.mean([x[-1] for x in segments], axis=0),
    "last end": lambda segments: segments[-1][-1],
}
PRINTED, EARLY = "squared time (2.4)", "stops 3 cm before its goal"
SHOWN = (1, 3, 8)
"""Numbers of demonstrations in the second table."""


def run(out: Path, quick: bool, jobs: int) -> str:
    """Errors over the number of demonstrations for three sigma, and of all estimators under all conditions."""
    rows, errors = Rows(out, quick, jobs), {}
    for name, condition in {**SIGMAS, **OTHERS}.items():

        def result(condition: Condition = condition) -> list[dict[str, list[float]]]:
            return [goal_errors(condition, i) for i in range(3 if quick else RUNS)]

        row = rows.kept(name.replace(",", "").replace(" ", "-"), result)
        errors[name] = {estimator: 1000.0 * np.array([e[estimator] for e in row]) for estimator in ESTIMATORS}
    _draw(errors, rows.folder / "goal-learning.png")
    return _table(errors)


def demonstration(condition: Condition, rng: np.random.Generator) -> list[Array]:
    """One demonstration: per primitive the measured positions (N, 3) in its frame [m]."""
    places = rng.uniform(AREA_LOW, AREA_HIGH, (2, 3))
    origins = np.array([np.zeros(3), places[0], places[1], np.zeros(3)])
    x, v = HOME + 0.05 * rng.standard_normal(3), np.zeros(3)
    segments = []
    for origin, planted in zip(origins, GOALS, strict=True):
        goal = origin + planted + condition.scatter * rng.standard_normal(3)
        threshold = abs(condition.threshold * (1.0 + rng.standard_normal() / 3.0))
        path, speed = attracted(x, v, goal)
        outside = np.linalg.norm(path - goal, axis=1) > max(threshold, 1e-4)
        stop = int(np.argmin(outside)) if not outside.all() else len(path) - 1
        x, v = path[stop], speed[stop]
        shown = path[: stop + 1]
        if condition.rest:
            shown, v = np.concatenate([shown, np.tile(x, (round(condition.rest / DT), 1))]), np.zeros(3)
        segments.append(shown + condition.sensor * rng.standard_normal(shown.shape) - origin)
    return segments


def attracted(x: Array, v: Array, goal: Array) -> tuple[Array, Array]:
    """Positions and velocities (N, 3) of the critically damped attractor (2.1) over 10 s, in closed form."""
    rate, t = 0.5 * ALPHA, np.arange(0.0, 10.0, DT)[:, None]
    slope = v + rate * (x - goal)
    decay = np.exp(-rate * t)
    return goal + (x - goal + slope * t) * decay, (v - rate * slope * t) * decay


def goal_errors(condition: Condition, i: int) -> dict[str, list[float]]:
    """Estimator -> error (2.15) [m] after each demonstration of run i."""
    rng = np.random.default_rng([i, *(round(1e6 * value) for value in condition)])
    shown = [demonstration(condition, rng) for _ in range(DEMONSTRATIONS)]
    counts = range(1, DEMONSTRATIONS + 1)
    return {name: [goal_error(estimate, shown[:n]) for n in counts] for name, estimate in ESTIMATORS.items()}


def goal_error(estimate: Estimator, shown: Sequence[Sequence[Array]]) -> float:
    """e of (2.15) [m] of goals learned from demonstrations."""
    learned = [estimate([segments[k] for segments in shown]) for k in range(len(GOALS))]
    return float(np.abs(np.array(learned) - GOALS).sum(axis=1).mean())


def _draw(errors: Mapping[str, Mapping[str, Array]], path: Path) -> None:
    figure, (left, right) = panels(2)
    counts = np.arange(1, DEMONSTRATIONS + 1)
    for i, name in enumerate(SIGMAS):
        mean, spread = errors[name][PRINTED].mean(axis=0), errors[name][PRINTED].std(axis=0, ddof=1)
        curve(left, counts, mean, mean - spread, mean + spread, i, name)
    left.set_title("Figure 2.8: hull of one standard deviation", fontsize=9)
    for i, (estimator, e) in enumerate(errors[EARLY].items()):
        half = _half_interval(e)
        curve(right, counts, e.mean(axis=0), e.mean(axis=0) - half, e.mean(axis=0) + half, i, estimator)
    right.set_title(f"{EARLY}: 95 % interval of the mean", fontsize=9)
    for axes in (left, right):
        axes.set_xlabel("demonstrations")
        axes.set_ylabel("goal error (2.15) [mm]")
        axes.set_ylim(0.0, 1.4 * axes.get_ylim()[1])
        axes.legend(fontsize=8, ncols=2, loc="upper center")
    save(figure, path)


def _table(errors: Mapping[str, Mapping[str, Array]]) -> str:
    first = [
        [name, *(f"{e.mean():.1f} ± {e.std(ddof=1):.1f}" for e in errors[name][PRINTED].T)]  # over the runs
        for name in SIGMAS
    ]
    second = []
    for name, n in itertools.product(errors, SHOWN):
        means = [(e[:, n - 1].mean(), _half_interval(e)[n - 1]) for e in errors[name].values()]
        second.append([name, str(n), *(f"{m:.1f} [{m - half:.1f}, {m + half:.1f}]" for m, half in means)])
    n_runs = len(errors[EARLY][PRINTED])
    return "\n\n".join(
        [
            f"Error (2.15) in mm, mean ± standard deviation of {n_runs} runs, {PRINTED}, over the number of demonstrations:",
            markdown(["", *(str(n) for n in range(1, DEMONSTRATIONS + 1))], first),
            f"Error (2.15) in mm, mean of {n_runs} runs with its 95 % interval:",
            markdown(["condition", "demonstrations", *ESTIMATORS], second),
        ]
    )


def _half_interval(e: Array) -> Array:
    """Half the 95 % interval of the mean over the runs (R, N)."""
    return np.asarray(Z_95 * e.std(axis=0, ddof=1) / np.sqrt(len(e)))
