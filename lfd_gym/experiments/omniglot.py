"""Handwritten letters drawn again by MoA and other models (thesis 4.4.1, Figure 4.3).

`--set data=FILE` is a file of the Omniglot data set, see `lfd_gym.omniglot`; `--set alphabet=Latin` one of its alphabets.
Without a file the letters of our own alphabet are drawn. In-sample, a model draws what it was trained with; leave-one-out, each
drawing is drawn by a model of all others of its character. "least" is the best that time-varying weights of start and end can
do in-sample (`policies.moa.start_and_end.least_error`); MoA starts with the drawing's own velocity, which they do not know. GMR
is not told where a drawing ends, the DMP not how it starts.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lfd_gym.experiments.figures import save
from lfd_gym.experiments.letters import MODELS, OWN, drawings, kept
from lfd_gym.experiments.rows import Rows, markdown
from lfd_gym.omniglot import HOW_TO_GET
from lfd_gym.progress import track
from lfd_gym.report.figures import STYLE
from policies.moa.start_and_end import least_error
from policies.sequence_graph_drawing import COLOURS

Array = NDArray[np.float64]

QUICK_LETTERS, DRAWN_LETTERS = 2, 3
RESAMPLES = 2000


def run(out: Path, quick: bool, jobs: int, data: str | None = None, alphabet: str = "Latin") -> str:
    """Fit every model to every character, in-sample and leave-one-out."""
    rows, letters = Rows(out, quick, jobs), drawings(data, alphabet)
    letters = dict(list(letters.items())[: QUICK_LETTERS if quick else None])
    name = "own" if data is None else alphabet
    results = [
        kept(rows, f"{name}-{letter}", drawn, _errors)
        for letter, drawn in track(letters.items(), len(letters), "letters")
    ]
    most = sorted(letters, key=lambda letter: -len(letters[letter]))[:DRAWN_LETTERS]
    _draw(rows.folder / "omniglot.png", {letter: letters[letter] for letter in most})
    count = f"{len(letters)} characters, {sum(map(len, letters.values()))} drawings in one stroke"
    source = f"{OWN} (for the data set: {HOW_TO_GET}, then --set data=FILE)" if data is None else alphabet
    return (
        f"{source}: {count}. Mean squared error; differences are paired by character, with 95 % intervals.\n\n"
        + _table(results)
    )


def _errors(drawn: Array) -> dict[str, Any]:
    """Mean squared errors of one character, drawings (M, N, 2)."""
    inside, outside = {}, {}
    for name, fit in MODELS.items():
        inside[name] = _mean_error(fit(drawn), drawn)
        others = [np.delete(drawn, i, axis=0) for i in range(len(drawn))]
        outside[name] = float(np.mean([_mean_error(fit(o), drawn[i : i + 1]) for i, o in enumerate(others)]))
    return {"in-sample": inside, "leave-one-out": outside, "least": float(least_error(list(drawn)).mean())}


def _mean_error(model: Any, drawn: Array) -> float:
    return float(np.mean([((model(x) - x) ** 2).sum(axis=1).mean() for x in drawn]))


def _table(results: Sequence[Mapping[str, Any]]) -> str:
    table = []
    for name in MODELS:
        cells = [name]
        for kind in ("in-sample", "leave-one-out"):
            own, best = (np.array([result[kind][model] for result in results]) for model in (name, "MoA"))
            compared = ["", ""] if name == "MoA" else [_difference(own - best), f"{np.median(own / best):.2f}"]
            cells += [f"{own.mean():.2f}", *compared]
        table.append(cells)
    least = np.mean([result["least"] for result in results])
    moa = np.mean([result["in-sample"]["MoA"] for result in results])
    table.append(["least", f"{least:.2f}", f"MoA is {100.0 * (moa / least - 1.0):.1f} % above", "", "", "", ""])
    compared = ["minus MoA", "over MoA's, median"]
    return markdown(["model", "in-sample", *compared, "leave-one-out", *compared], table)


def _difference(differences: Array) -> str:
    """Mean over the characters, with the interval of the bootstrap."""
    rng = np.random.default_rng(0)
    draws = rng.choice(differences, (RESAMPLES, len(differences))).mean(axis=1)
    low, high = np.quantile(draws, [0.025, 0.975])
    return f"{differences.mean():.2f} [{low:.2f}, {high:.2f}]"


def _draw(path: Path, letters: Mapping[str, Array]) -> None:
    """Drawings and what the models make of them; the mean squared error over time below."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(2.6 * len(letters), 4.4), layout="constrained")
        grid = figure.subplots(2, len(letters), squeeze=False, height_ratios=(3, 2))
    for (upper, lower), (letter, drawn) in zip(grid.T, letters.items(), strict=True):
        for x in drawn:
            upper.plot(*x.T, color="0.8", linewidth=0.8)
        for i, (name, fit) in enumerate(MODELS.items()):
            model = fit(drawn)
            paths = np.array([model(x) for x in drawn])
            upper.plot(*paths.mean(axis=0).T, color=COLOURS[i], label=name)
            lower.plot(((paths - drawn) ** 2).sum(axis=2).mean(axis=0), color=COLOURS[i])
        lower.set_yscale("log")
        lower.set_ylim(bottom=1.0)
        upper.set_title(letter, fontsize=9)
        upper.set_aspect("equal")
        upper.set(xticks=[], yticks=[])
        lower.set_xlabel("time step")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), fontsize=8, ncols=len(MODELS), loc="outside lower center")
    grid[1, 0].set_ylabel("mean squared error")
    save(figure, path)
