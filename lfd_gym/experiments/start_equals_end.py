"""Letters that are to end where they begin (thesis 4.4.1, Figure 4.4).

The forcing term of a DMP is scaled by the way from start to goal (4.3): without a way there is no movement. MoA merely puts
both frames in one place. A letter's size is the root mean square distance of its points from their mean.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from lfd_gym.experiments.figures import save
from lfd_gym.experiments.letters import MODELS, OWN, drawings, kept
from lfd_gym.experiments.rows import Rows, markdown
from lfd_gym.report.figures import STYLE
from policies.sequence_graph_drawing import COLOURS

NAMES = ("MoA", "DMP", "DMP, no goal scaling")
DRAWN, QUICK_LETTERS = 3, 2


def run(out: Path, quick: bool, jobs: int, data: str | None = None, alphabet: str = "Latin") -> str:
    """Draw every letter from its start to its start."""
    rows, letters = Rows(out, quick, jobs), drawings(data, alphabet)
    letters = dict(list(letters.items())[: QUICK_LETTERS if quick else None])
    source = "own" if data is None else alphabet

    def sizes(drawn: np.ndarray) -> dict[str, float]:
        shown = float(np.mean([_size(x) for x in drawn]))
        return {name: _size(_closed(drawn, name)) / shown for name in NAMES}

    found = {letter: kept(rows, f"{source}-{letter}", drawn, sizes) for letter, drawn in letters.items()}
    _draw(rows.folder / "start-equals-end.png", dict(list(letters.items())[:DRAWN]))
    table = []
    for name in NAMES:
        values = np.array([row[name] for row in found.values()])
        table.append([name, *(f"{value:.3f}" for value in (np.median(values), values.min(), values.max()))])
    header = ["model", "size over demonstrated size, median", "least", "largest"]
    return f"{len(found)} letters, {OWN if data is None else alphabet}.\n\n{markdown(header, table)}"


def _closed(drawn: np.ndarray, name: str) -> np.ndarray:
    """The path (N, 2) of a model that was told to end where the drawings begin on average."""
    wanted = drawn.mean(axis=0)
    wanted[1:] = wanted[0]
    return MODELS[name](drawn)(wanted)


def _size(x: np.ndarray) -> float:
    return float(np.sqrt(((x - x.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _draw(path: Path, letters: dict[str, np.ndarray]) -> None:
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(3.0 * len(letters), 3.2), layout="constrained")
        axes = figure.subplots(1, len(letters), squeeze=False)[0]
    for panel, (letter, drawn) in zip(axes, letters.items(), strict=True):
        for x in drawn:
            panel.plot(*x.T, color="0.85", linewidth=0.8)
        for i, name in enumerate(NAMES):
            panel.plot(*_closed(drawn, name).T, color=COLOURS[i], label=name, marker="o", markersize=4, markevery=[-1])
        panel.set(xticks=[], yticks=[], title=letter)
        panel.set_aspect("equal")
    figure.legend(*axes[0].get_legend_handles_labels(), fontsize=8, ncols=len(NAMES), loc="outside lower center")
    save(figure, path)
