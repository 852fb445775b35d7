"""Tasks decomposed without labels: primitives found, and skills made of them (thesis 3.5; Tables 3.1-3.3, Figures 3.7-3.13).

Every task is taught as in the thesis: five demonstrations of the flip, three of the stack, three setups three times each of the
light bulb. Learned from neither labels nor primitive tables.
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lfd_gym.demonstration import Demonstration
from lfd_gym.experiments.decomposition_figures import draw
from lfd_gym.experiments.learning import teacher
from lfd_gym.experiments.rows import Rows, markdown, success
from lfd_gym.recording import record
from lfd_gym.rollout import rollout
from policies.decomposition.result import Decomposition
from policies.decomposition.task_spaces import TaskSpace
from policies.decomposition_learner import DecompositionLearner

STACK = ("frame_box_yellow", "frame_box_green", "frame_box_red", "frame_box_blue")


class Taught(NamedTuple):
    """How a task is taught."""

    demonstrations: int
    repeat: int
    """Demonstrations per setup."""
    mode: str
    seeds: range
    """Teaching seeds."""
    noise: float = 1.0
    """Of the teacher."""

    def name(self, seed: int) -> str:
        """Of the row of one teaching seed."""
        noisy = f"-noise-{self.noise:g}" if self.noise != 1.0 else ""
        return f"{self.demonstrations}-{self.mode}{noisy}-{seed}"


class Attempt(NamedTuple):
    """One episode of a skill."""

    seed: int
    success: bool
    missed: str
    """The first part of the task that was not reached."""
    seconds: float
    placement: float
    """Largest horizontal distance between two boxes that should stand on each other at the end [m]; 0 without boxes."""


FLIPPING = (
    Taught(5, 1, "commanded", range(3)),
    Taught(1, 1, "commanded", range(1)),
    Taught(2, 1, "commanded", range(1)),
    Taught(5, 1, "commanded", range(3), 2.0),
)
STACKING = (
    Taught(3, 1, "commanded", range(3)),
    Taught(1, 1, "commanded", range(1)),
    Taught(2, 1, "commanded", range(1)),
    Taught(3, 1, "commanded", range(3), 2.0),
)
LIGHT_BULB = (
    Taught(9, 3, "commanded", range(3)),
    Taught(9, 3, "kinesthetic", range(1)),
    Taught(1, 1, "commanded", range(1)),
    Taught(2, 1, "commanded", range(1)),
    Taught(9, 3, "commanded", range(3), 2.0),
)


def flipping(out: Path, quick: bool, jobs: int) -> str:
    """BoxFlipping (Table 3.1, Figure 3.7)."""
    return _run("lfd_gym/BoxFlipping-v0", FLIPPING, Rows(out, quick, jobs))


def stacking(out: Path, quick: bool, jobs: int) -> str:
    """BoxStacking (Figures 3.9, 3.10)."""
    return _run("lfd_gym/BoxStacking-v0", STACKING, Rows(out, quick, jobs))


def light_bulb(out: Path, quick: bool, jobs: int) -> str:
    """LightBulb (Tables 3.2, 3.3, Figures 3.12, 3.13)."""
    return _run("lfd_gym/LightBulb-v0", LIGHT_BULB, Rows(out, quick, jobs))


def attempt(env: Any, policy: Any, seed: int) -> Attempt:
    """One episode."""
    steps, reached = 0, dict[str, bool]()
    step = None
    for step in rollout(env, policy, seed):
        steps += 1
        for name, value in step.info.items():
            if name.startswith("subtask/"):
                reached[name.removeprefix("subtask/")] = reached.get(name.removeprefix("subtask/"), False) or bool(
                    value
                )
    assert step is not None
    solved = bool(step.info["is_success"])
    missed = "" if solved else next((name for name, value in reached.items() if not value), "the end")
    last, placement = step.next_observation, 0.0
    if STACK[0] in last:
        placement = max(float(np.linalg.norm(last[a][:2] - last[b][:2])) for a, b in itertools.pairwise(STACK))
    return Attempt(seed, solved, missed, steps * float(env.unwrapped.dt), placement)


def _run(env_id: str, cases: Sequence[Taught], rows: Rows) -> str:
    table, found = [], ""
    for case in cases[: 1 if rows.quick else None]:
        kept = []
        for seed in case.seeds[: 1 if rows.quick else None]:

            @functools.lru_cache(maxsize=1)
            def learner(case: Taught = case, seed: int = seed) -> DecompositionLearner:
                return DecompositionLearner().fit(_shown(env_id, case, seed))

            name = case.name(seed)
            primitives = rows.kept(f"primitives-{name}", _primitives(learner))
            kept.append(rows.observed(name, env_id, _skill(learner), attempt, 100))
            if not found:
                found = markdown(tuple(primitives[0]), [[str(v) for v in row.values()] for row in primitives])
                figure = rows.folder / "decomposition.png"
                if not figure.exists():
                    draw(_shown(env_id, case, seed)[0], learner().decomposition_, figure)
        table.append(_summary(case, kept))
    header = (
        "demonstrations",
        "teaching",
        "noise",
        "mean %",
        "worst %",
        "% per teaching seed",
        "placement [mm]",
        "missed",
    )
    return f"{markdown(header, table)}\n\n{found}"


def _summary(case: Taught, kept: Sequence[Sequence[dict[str, Any]]]) -> list[str]:
    rates = [100.0 * float(np.mean([row["success"] for row in rows])) for rows in kept]
    each = ", ".join(success([{"episodes": rows}]) for rows in kept)
    placed = [1000.0 * row["placement"] for rows in kept for row in rows if row["success"]]
    missed = sorted({row["missed"] for rows in kept for row in rows} - {""})
    counts = ", ".join(f"{part} {sum(row['missed'] == part for rows in kept for row in rows)}" for part in missed)
    placement = f"{np.median(placed):.1f}" if placed and max(placed) > 0.0 else "-"
    taught = [str(case.demonstrations), case.mode, f"{case.noise:g}"]
    return [*taught, f"{np.mean(rates):.1f}", f"{min(rates):.0f}", each, placement, counts]


def _primitives(learner: Callable[[], DecompositionLearner]) -> Callable[[], Any]:
    return lambda: described(learner().decomposition_)


def _skill(learner: Callable[[], DecompositionLearner]) -> Callable[[], Any]:
    return lambda: learner().skill_


@functools.lru_cache(maxsize=1)
def _shown(env_id: str, case: Taught, seed: int) -> Sequence[Demonstration]:
    taught = teacher(env_id, case.noise, case.mode)
    return tuple(record(env_id, taught, case.demonstrations, seed, repeat=case.repeat).demonstrations)


def described(found: Decomposition) -> list[dict[str, str]]:
    """One row per primitive: frame, confidence, goal and what is controlled by force."""
    rows = []
    for entity, part in found.entities.items():
        for k, primitive in enumerate(part.primitives):
            force = ", ".join(
                f"{axis} {value:.1f} N"
                for axis, value, mode in zip(_axes(primitive.space), primitive.force, primitive.axes[:3], strict=False)
                if mode == "force"
            )
            goal = "" if entity == "orientation" else " ".join(f"{value:.3f}" for value in primitive.goal)
            rows.append(
                {
                    "primitive": f"{entity} {k + 1}",
                    "segments": str(int((part.assignment == k).sum())),
                    "frame": primitive.space.frame,
                    "space": primitive.space.space,
                    "confidence": f"{100.0 * primitive.confidence:.1f} %",
                    "held": ", ".join(
                        axis for axis, mode in zip("xyz", primitive.axes, strict=False) if mode == "hold"
                    ),
                    "force": force,
                    "goal": goal,
                }
            )
    return rows


def _axes(space: TaskSpace) -> tuple[str, str, str]:
    return ("radius", "angle", "axis") if space.space == "cylindrical" else ("x", "y", "z")
