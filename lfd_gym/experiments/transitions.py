"""How well skills make their transitions: the comparison behind both halves of Figure 2.12 (thesis 2.5.2).

Three demonstrations of LightBulb train a skill from each one, each pair, and all of them. Every transition of every skill is
judged by the noise-free teacher in its shadow (`lfd_gym.experiments.shadow`).
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lfd_gym.evaluation import wilson_interval
from lfd_gym.experiments.figures import Estimate, bar_place, bars, panels, save
from lfd_gym.experiments.learning import demonstrations, learned_from
from lfd_gym.experiments.rows import Rows, markdown, rate
from lfd_gym.experiments.shadow import judge
from lfd_gym.report.figures import GOAL
from scripted_teachers.light_bulb import LightBulbTeacher

Array = NDArray[np.float64]

TASK = "lfd_gym/LightBulb-v0"
SETUPS, TEACHING_SEEDS, DEMONSTRATIONS = 20, (0, 1, 2), 3
SIZES = (1, 2, 3)
TRAINING_SETS = tuple(s for n in SIZES for s in itertools.combinations(range(DEMONSTRATIONS), n))
RESAMPLES = 2000
"""Of the bootstrap."""


class Judged(NamedTuple):
    """What the judge saw of one kind of skill."""

    sizes: NDArray[np.int64]
    """(S,) number of demonstrations of each skill."""
    right: Array
    """(S, E, T) how often each skill made each transition right in each setup."""
    due: Array
    """(S, E, T) how often it was due."""
    success: Array
    """(S, E) whether it solved the task alone."""

    def of_size(self, n: int) -> "Judged":
        """The skills from n demonstrations."""
        return Judged(*(array[self.sizes == n] for array in self))


def compare(rows: Rows, name: str, kinds: Mapping[str, Mapping[str, Any]], orders: Sequence[tuple[str, str]]) -> str:
    """Judge several kinds of skill on the same demonstrations and setups.

    Args:
        rows: where they are kept.
        name: of the figure.
        kinds: name -> arguments of the learner.
        orders: pairs of kinds, the one that the thesis found better first.
    """
    seeds = TEACHING_SEEDS[:1] if rows.quick else TEACHING_SEEDS
    skills = {kind: _judged_skills(rows, parameters, seeds) for kind, parameters in kinds.items()}
    pairs = sorted(
        {(b, a) for of in skills.values() for s in of for e in s["episodes"] for b, a, _ in e["transitions"]}
    )
    judged = {kind: _arrays(of, pairs) for kind, of in skills.items()}
    _draw(rows, name, judged)
    return "\n\n".join(
        [
            "Success of a transition, and of the whole task without help, in percent, with 95 % intervals (bootstrap over "
            "skills and setups; Wilson for the whole task):",
            _overview(judged),
            "Each transition, skills from three demonstrations; in percent:",
            _details(judged, pairs),
            "Differences in percentage points over all training sets, same demonstrations and setups:",
            _differences(judged, orders),
        ]
    )


def _judged_skills(rows: Rows, parameters: Mapping[str, Any], seeds: Sequence[int]) -> list[dict[str, Any]]:
    skills = []
    for seed, chosen in itertools.product(seeds, TRAINING_SETS):

        def skill(seed: int = seed, chosen: tuple[int, ...] = chosen) -> Any:
            shown = demonstrations(TASK, DEMONSTRATIONS, seed)
            return learned_from([shown[i] for i in chosen], **parameters)

        name = "-".join([*map(str, parameters.values()), str(seed), "".join(map(str, chosen))])
        skills.append({"size": len(chosen), "episodes": rows.observed(name, TASK, skill, judge, SETUPS)})
    return skills


def _arrays(skills: Sequence[Mapping[str, Any]], pairs: Sequence[tuple[int, int]]) -> Judged:
    n_setups = len(skills[0]["episodes"])
    right, due = np.zeros((2, len(skills), n_setups, len(pairs)))
    success = np.zeros((len(skills), n_setups))
    for s, skill in enumerate(skills):
        for e, episode in enumerate(skill["episodes"]):
            success[s, e] = episode["success"]
            for before, after, well in episode["transitions"]:
                due[s, e, pairs.index((before, after))] += 1
                right[s, e, pairs.index((before, after))] += well
    return Judged(np.array([skill["size"] for skill in skills]), right, due, success)


def per_transition(judged: Judged) -> Array:
    """(T,) share of right ones of each transition; NaN where it was never due."""
    with np.errstate(invalid="ignore"):
        return np.asarray(judged.right.sum(axis=(0, 1)) / judged.due.sum(axis=(0, 1)))


def resampled(judged: Judged) -> tuple[Array, Array]:
    """Mean success over the transitions, and success of the whole task, of `RESAMPLES` draws of skills, and of setups for each.

    Equal shapes are drawn alike, so that differences between kinds of skill are paired.
    """
    rng = np.random.default_rng(0)
    n_skills, n_setups, _ = judged.right.shape
    transitions, whole = np.empty((2, RESAMPLES))
    for i in range(RESAMPLES):
        drawn = rng.integers(n_skills, size=(n_skills, 1)), rng.integers(n_setups, size=(n_skills, n_setups))
        sample = Judged(judged.sizes, judged.right[drawn], judged.due[drawn], judged.success[drawn])
        transitions[i], whole[i] = np.nanmean(per_transition(sample)), sample.success.mean()
    return transitions, whole


def _overview(judged: Mapping[str, Judged]) -> str:
    rows = []
    for (kind, of), n in itertools.product(judged.items(), SIZES):
        share, chosen = per_transition(of.of_size(n)), of.of_size(n)
        low, mean, high = np.nanmin(share), np.nanmean(share), np.nanmax(share)
        estimate = Estimate(float(mean), *_interval(resampled(chosen)[0]))
        shown = [str(n), str(len(chosen.sizes)), f"{100 * low:.1f}", str(estimate), f"{100 * high:.1f}"]
        rows.append([kind, *shown, rate(chosen.success.sum(), chosen.success.size)])
    header = ["skill", "demonstrations", "skills", "worst transition", "mean", "best transition", "whole task"]
    return markdown(header, rows)


def _details(judged: Mapping[str, Judged], pairs: Sequence[tuple[int, int]]) -> str:
    names = [p.name for p in LightBulbTeacher.primitives]
    shares = [per_transition(of.of_size(DEMONSTRATIONS)) for of in judged.values()]
    rows = [
        [f"{names[a]} → {names[b]}", *(f"{100 * share[t]:.1f}" for share in shares)] for t, (a, b) in enumerate(pairs)
    ]
    return markdown(["transition", *judged], rows)


def _differences(judged: Mapping[str, Judged], orders: Sequence[tuple[str, str]]) -> str:
    rows = []
    for better, worse in orders:
        one, other = judged[better], judged[worse]
        values = (
            np.nanmean(per_transition(one)) - np.nanmean(per_transition(other)),
            (one.success - other.success).mean(),
        )
        cells = []
        for value, a, b in zip(values, resampled(one), resampled(other), strict=True):
            low, high = _interval(a - b)
            found = "reproduced" if low > 0 else "reversed" if high < 0 else "not told apart"
            cells.append(f"{Estimate(float(value), low, high)}, {found}")
        rows.append([f"{better} > {worse}", *cells])
    return markdown(["order in the thesis", "mean over the transitions", "whole task"], rows)


def _interval(draws: Array) -> tuple[float, float]:
    low, high = np.quantile(draws, [0.025, 0.975])
    return float(low), float(high)


def _draw(rows: Rows, name: str, judged: Mapping[str, Judged]) -> None:
    transitions: dict[str, list[Estimate]] = {kind: [] for kind in judged}
    whole: dict[str, list[Estimate]] = {kind: [] for kind in judged}
    figure, (left, right) = panels(2)
    for (i, (kind, of)), (j, n) in itertools.product(enumerate(judged.items()), enumerate(SIZES)):
        chosen = of.of_size(n)
        share = per_transition(chosen)
        transitions[kind].append(Estimate(float(np.nanmean(share)), *_interval(resampled(chosen)[0])))
        solved, tried = int(chosen.success.sum()), chosen.success.size
        whole[kind].append(Estimate(solved / tried, *wilson_interval(solved, tried)))
        extremes = 100.0 * np.array([np.nanmin(share), np.nanmax(share)])
        left.plot(np.full(2, bar_place(j, i, len(judged))), extremes, "_", color=GOAL, markersize=9)
    bars(left, [str(n) for n in SIZES], transitions)
    bars(right, [str(n) for n in SIZES], whole)
    left.set_ylabel("success of a transition [%]")
    left.set_title("mean over the transitions; marks: the worst and the best one", fontsize=9)
    right.set_ylabel("success of the whole task [%]")
    for axes in (left, right):
        axes.set_xlabel("demonstrations")
    right.legend(fontsize=8, loc="lower right")
    save(figure, rows.out / f"{name}.png")
