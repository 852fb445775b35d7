"""The classifiers that decide transitions, each with the global sequence graph (thesis 2.5.2, Figure 2.12b)."""

from pathlib import Path

from lfd_gym.experiments.rows import Rows
from lfd_gym.experiments.transitions import compare

KINDS = {name: {"graph": "global", "classifier": name} for name in ("lr", "gmm", "klr", "svm", "ivm")}
ORDERS = (("svm", "lr"), ("ivm", "lr"), ("svm", "gmm"), ("ivm", "gmm"))
"""The thesis found the kernel methods slightly better: 97.6 % against 92.9 % of LR."""


def run(out: Path, quick: bool, jobs: int) -> str:
    """Judge the transitions of every classifier."""
    return compare(Rows(out, quick, jobs), "classifiers", KINDS, ORDERS)
