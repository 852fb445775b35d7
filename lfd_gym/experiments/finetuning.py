"""What practice does to a skill: a poor one, which it should repair, and a good one, which it should not spoil.

A case is a task, a learner and its demonstrations. The skill before and each skill after do the same setups, so that the
interval of the difference is a paired one. One row per job on disk: the skill before, and per method the skill after; a
skill that has practised is kept too, so that a run that was killed in the evaluation does not practise again.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from lfd_gym.errors import InvalidArgumentError
from lfd_gym.experiments.classifiers import KINDS
from lfd_gym.experiments.comparison_report import by_setup, paired
from lfd_gym.experiments.learning import teacher
from lfd_gym.experiments.rows import Rows, markdown, success
from lfd_gym.recording import record
from lfd_gym.registry import kebab_case, load, look_up
from policies import LEARNERS, load_skill
from policies.reinforcement import FINETUNERS
from policies.reinforcement.practice import identity

GRAPH = ("cma", "es-gradient", "graph-ppo", "residual-sac")
"""Methods for a sequence graph; the first two search the same parameters."""
PATH = ("cma", "es-gradient", "residual-sac")
"""Methods for a Mixture of Attractors, which decides nothing."""
VARIANTS: Mapping[str, Mapping[str, Any]] = {"": {}, "lr-at-once": KINDS["lr, at once"]}
"""Parameters of learners; "lr-at-once" decides as the thesis does, by logistic regression and without waiting."""
QUICK_PRACTICE = 16


class Case(NamedTuple):
    """A skill that is to practise."""

    env_id: str
    learner: str
    noise: float
    """Of the teacher."""
    shown: int
    """Demonstrations."""
    methods: Sequence[str]
    seed: int = 0
    """Of the demonstrations and of the practice."""
    variant: str = ""
    """Of the learner, of `VARIANTS`."""

    @property
    def name(self) -> str:
        """Of its rows."""
        return f"{kebab_case(self.env_id)}-{self.described}-noise-{self.noise:g}-shown-{self.shown}-{self.seed}"

    @property
    def described(self) -> str:
        """The learner and its variant."""
        return f"{self.learner}-{self.variant}" if self.variant else self.learner


CASES: Sequence[Case] = (
    Case("lfd_gym/Whiteboard-v0", "moa", 3.0, 1, PATH, seed=6),
    Case("lfd_gym/Whiteboard-v0", "moa", 3.0, 1, PATH, seed=9),
    Case("lfd_gym/MoveObject-v0", "sequence-graph", 3.0, 1, GRAPH, seed=1),
    Case("lfd_gym/MoveObject-v0", "sequence-graph", 3.0, 1, GRAPH, seed=5),
    Case("lfd_gym/BoxStacking-v0", "sequence-graph", 3.0, 1, GRAPH, seed=1),
    Case("lfd_gym/LightBulb-v0", "sequence-graph", 3.0, 1, ("graph-ppo",), variant="lr-at-once"),
    Case("lfd_gym/Whiteboard-v0", "moa", 1.0, 3, PATH),
    Case("lfd_gym/MoveObject-v0", "sequence-graph", 1.0, 3, GRAPH),
    Case("lfd_gym/BoxStacking-v0", "sequence-graph", 1.0, 3, GRAPH),
    Case("lfd_gym/LightBulb-v0", "sequence-graph", 1.0, 3, GRAPH),
)
"""Skills from poor demonstrations, then from good ones of the same tasks.

A noise-3 demonstration that succeeds often teaches a good skill. The seed of each is the first whose skill solved less than
half of the first development setups, 100000 and following, when its rows were made: Whiteboard's 6 solved none of 10 (0, 1
and 5 solved all; as 2, 3 and 4 the teacher wrote no two words in ten attempts) and the next, 9, solved 2, MoveObject's 1
solved 3 of 10 and the next, 5, solved 4, BoxStacking's 1 none of 5. LightBulb's 0 to 6 solved 5 of 5, so that what is
repaired there decides at once: with it seed 0 solved none of 8.
"""


def run(out: Path, quick: bool, jobs: int, setups: int = 500, episodes: int = 400, only: str = "") -> str:
    """Make the rows whose names begin with `only`, and the table of all rows that are there.

    Args:
        out: folder of the rows.
        quick: two setups and the shortest practice.
        jobs: processes.
        setups: of the evaluation.
        episodes: of a practice.
        only: such as "whiteboard-moa-noise-3"; all rows if empty.

    Raises InvalidArgumentError, before anything is practised, where no row begins so, or one that is needed was made with
    other numbers or of another skill.
    """
    rows, table = Rows(out, quick, jobs), []
    practised = QUICK_PRACTICE if quick else episodes
    asked = [(case, method, f"{case.name}-{method}") for case in CASES for method in case.methods]
    if not any(name.startswith(only) for *_, name in asked):
        raise InvalidArgumentError(f"no row begins with '{only}'; there are {', '.join(name for *_, name in asked)}")
    for case, method, name in asked:
        if name.startswith(only):
            _check(rows, case.name, setups)
            _check(rows, name, setups, practised)
            look_up(FINETUNERS, "method", method)
    for case, method, name in asked:
        if name.startswith(only) and not rows.exists(name):
            _before(rows, case, setups)
            _after(rows, case, method, setups, practised)
        if rows.exists(name):
            before, after = (rows.kept(row, dict) for row in (case.name, name))
            table.append([*_described(case), method, *_cells(before, after)])
    header = [
        "task", "learner", "noise", "demonstrations", "teaching seed", "method", "episodes", "simulated h", "kept",
        "before %", "after %", "difference, points", "setups",
    ]  # fmt: skip
    return markdown(header, table)


def _before(rows: Rows, case: Case, setups: int) -> None:
    """The skill as it was learned, and its row. Raises InvalidArgumentError for a row of another one."""
    path = _skill(rows, case.name)
    if not path.exists():
        shown = record(case.env_id, teacher(case.env_id, case.noise), case.shown, case.seed).demonstrations
        path.parent.mkdir(parents=True, exist_ok=True)
        load(LEARNERS[case.learner])(**VARIANTS[case.variant]).fit(shown).skill_.save(path)
    skill = load_skill(path)
    contents = identity(skill)["contents"]
    row = rows.kept(case.name, lambda: {"skill": contents, "report": rows.report(case.env_id, skill, setups)})
    if row.get("skill") != contents:
        raise InvalidArgumentError(
            f"the row '{case.name}' is of another skill, or says not of which; choose another --out, or remove it and the rows "
            "of its practice"
        )


def _after(rows: Rows, case: Case, method: str, setups: int, episodes: int) -> None:
    """Practise, and the row of what came of it."""
    finetune, name = load("policies.reinforcement.finetuning:finetune"), f"{case.name}-{method}"
    path = _skill(rows, f"{name}-{episodes}")

    def row() -> dict[str, Any]:
        if not path.exists():
            skill = load_skill(_skill(rows, case.name))
            folder = rows.folder / "practice" / name
            finetune(method, skill, case.env_id, episodes, folder, seed=case.seed, jobs=rows.jobs).save(path)
        facts = dict(load_skill(path).metadata["finetuned"])
        return {"asked": episodes, "facts": facts, "report": rows.report(case.env_id, load_skill(path), setups)}

    rows.kept(name, row)


def _skill(rows: Rows, name: str) -> Path:
    return rows.folder / "skills" / f"{name}.npz"


def _check(rows: Rows, name: str, setups: int, episodes: int | None = None) -> None:
    """Raise InvalidArgumentError if a row is there and was made with other numbers."""
    if not rows.exists(name):
        return
    row = rows.kept(name, dict)
    made, asked = (len(row["report"]["episodes"]), row.get("asked")), (len(rows.seeds(setups)), episodes)
    if made != asked:
        practice = "" if episodes is None else f" and {made[1]} episodes of practice"
        raise InvalidArgumentError(
            f"the row '{name}' was made with {made[0]} setups{practice}; ask for the same with --set, or choose another --out"
        )


def _described(case: Case) -> list[str]:
    return [kebab_case(case.env_id), case.described, f"{case.noise:g}", str(case.shown), str(case.seed)]


def _cells(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    facts, result = after["facts"], paired(by_setup([after]), by_setup([before]))
    difference = f"{100 * result.difference:+.1f} [{100 * result.low:+.1f}, {100 * result.high:+.1f}]"
    return [
        str(facts["episodes"]), f"{facts['simulated_hours']:.2g}", "yes" if facts["kept"] else "no",
        success([before["report"]]), success([after["report"]]), difference, str(len(after["report"]["episodes"])),
    ]  # fmt: skip
