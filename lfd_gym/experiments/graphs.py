"""Local, global and fully connected sequence graph with logistic regression (thesis 2.5.2, Figure 2.12a)."""

from pathlib import Path

from lfd_gym.experiments.rows import Rows
from lfd_gym.experiments.transitions import compare

KINDS = {graph: {"graph": graph, "classifier": "lr"} for graph in ("global", "local", "fully-connected")}
ORDERS = (("global", "local"), ("local", "fully-connected"), ("global", "fully-connected"))


def run(out: Path, quick: bool, jobs: int) -> str:
    """Judge the transitions of every graph."""
    return compare(Rows(out, quick, jobs), "graphs", KINDS, ORDERS)
