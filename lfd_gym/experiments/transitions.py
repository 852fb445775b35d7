"""How well skills make their transitions: the comparison behind both halves of Figure 2.12 (thesis 2.5.2).

Three demonstrations of LightBulb train a skill from each one, each pair, and all of them. Every transition of every skill is
judged by the noise-free teacher in its shadow (`lfd_gym.experiments.shadow`).
"""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lfd_gym.experiments.figures import Estimate, bar_place, bars, panels, save
from lfd_gym.experiments.judged import Judged, Summary, differences, judged, summary
from lfd_gym.experiments.learning import demonstrations, learned_from
from lfd_gym.experiments.rows import Rows, markdown
from lfd_gym.experiments.shadow import judge
from lfd_gym.report.figures import GOAL
from scripted_teachers.light_bulb import LightBulbTeacher

TASK = "lfd_gym/LightBulb-v0"
SETUPS, TEACHING_SEEDS, DEMONSTRATIONS = 20, (0, 1, 2), 3
SIZES = (1, 2, 3)
TRAINING_SETS = tuple(s for n in SIZES for s in itertools.combinations(range(DEMONSTRATIONS), n))
FEWEST = tuple(tuple(range(n)) for n in SIZES)


def compare(rows: Rows, name: str, kinds: Mapping[str, Mapping[str, Any]], orders: Sequence[tuple[str, str]]) -> str:
    """Judge several kinds of skill on the same demonstrations and setups.

    Args:
        rows: where they are kept.
        name: of the figure.
        kinds: name -> arguments of the learner.
        orders: pairs of kinds, the one that the thesis found better first.
    """
    skills = {kind: _judged_skills(rows, parameters) for kind, parameters in kinds.items()}
    pairs = sorted(
        {(b, a) for of in skills.values() for s in of for e in s["episodes"] for b, a, _ in e["transitions"]}
    )
    found = {kind: judged(of, pairs) for kind, of in skills.items()}
    summaries = {kind: [summary(of.of_size(n)) for n in SIZES] for kind, of in found.items()}
    _draw(rows.folder / f"{name}.png", summaries)
    return "\n\n".join(
        [
            "Success of a transition, and of the whole task without help, in percent, with 95 % intervals (bootstrap over "
            "skills and setups; Wilson for the whole task):",
            _overview(found, summaries),
            "Each transition, skills from three demonstrations; in percent:",
            _details(found, pairs),
            "Differences in percentage points over all training sets, same demonstrations and setups:",
            _differences(found, orders),
        ]
    )


def _judged_skills(rows: Rows, parameters: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One skill for every training set of every teaching seed; of the first seed, one of each size, in a quick trial."""
    seeds, sets = (TEACHING_SEEDS[:1], FEWEST) if rows.quick else (TEACHING_SEEDS, TRAINING_SETS)
    skills = []
    for seed, chosen in itertools.product(seeds, sets):

        def skill(seed: int = seed, chosen: tuple[int, ...] = chosen) -> Any:
            shown = demonstrations(TASK, DEMONSTRATIONS, seed)
            return learned_from([shown[i] for i in chosen], **parameters)

        settings = [value if isinstance(value, str) else f"{key}-{value}" for key, value in parameters.items()]
        name = "-".join([*settings, str(seed), "".join(map(str, chosen))])
        skills.append({"size": len(chosen), "episodes": rows.observed(name, TASK, skill, judge, SETUPS)})
    return skills


def _overview(found: Mapping[str, Judged], summaries: Mapping[str, Sequence[Summary]]) -> str:
    rows = []
    for kind, of in summaries.items():
        for n, (worst, mean, best, whole) in zip(SIZES, of, strict=True):
            skills = np.count_nonzero(found[kind].sizes == n)
            rows.append([kind, str(n), str(skills), f"{100 * worst:.1f}", str(mean), f"{100 * best:.1f}", str(whole)])
    header = ["skill", "demonstrations", "skills", "worst transition", "mean", "best transition", "whole task"]
    return markdown(header, rows)


def _details(found: Mapping[str, Judged], pairs: Sequence[tuple[int, int]]) -> str:
    names = [p.name for p in LightBulbTeacher.primitives]
    shares = np.transpose([of.of_size(DEMONSTRATIONS).shares() for of in found.values()])
    rows = [
        [f"{names[a]} → {names[b]}", *(f"{100 * s:.1f}" for s in share)]
        for (a, b), share in zip(pairs, shares, strict=True)
    ]
    return markdown(["transition", *found], rows)


def _differences(found: Mapping[str, Judged], orders: Sequence[tuple[str, str]]) -> str:
    rows = []
    for better, worse in orders:
        estimates = differences(found[better], found[worse])
        rows.append([f"{better} > {worse}", *(f"{e}, {_verdict(e)}" for e in estimates)])
    return markdown(["order", "mean over the transitions", "whole task"], rows)


def _verdict(difference: Estimate) -> str:
    return "shows" if difference.low > 0 else "is reversed" if difference.high < 0 else "is not told apart"


def _draw(path: Path, summaries: Mapping[str, Sequence[Summary]]) -> None:
    figure, (left, right) = panels(2)
    sizes = [str(n) for n in SIZES]
    bars(left, sizes, {kind: [s.mean for s in of] for kind, of in summaries.items()})
    bars(right, sizes, {kind: [s.whole for s in of] for kind, of in summaries.items()})
    for i, of in enumerate(summaries.values()):
        x = bar_place(np.arange(len(SIZES)), i, len(summaries))
        for extreme in ([s.worst for s in of], [s.best for s in of]):
            left.plot(x, 100.0 * np.array(extreme), "_", color=GOAL, markersize=9)
    left.set_title("mean over the transitions; marks: the worst and the best one", fontsize=9)
    left.set_ylabel("success of a transition [%]")
    right.set_ylabel("success of the whole task [%]")
    for axes in (left, right):
        axes.set_xlabel("demonstrations")
    figure.legend(*right.get_legend_handles_labels(), fontsize=8, ncols=len(summaries), loc="outside lower center")
    save(figure, path)
