"""Time, memory and certified gap of the MoA problem over its size, of our solver and of generic ones (thesis 4.2, 4.3).

The number of variables of (4.26) is n = N_S F 2^d: activations at N_S support points of the corners of F boxes. Letters are
planar (n = 160), whiteboard demonstrations spatial. Every measurement runs in a process of its own, which is stopped at a time
limit; the time is the least of some repetitions, the memory what the process grew by.
"""

import multiprocessing
import resource
import time
from pathlib import Path
from typing import Any, NamedTuple

import qpsolvers

from lfd_gym.action import ActionLayout
from lfd_gym.experiments.learning import demonstrations
from lfd_gym.experiments.letters import DT, N_SUPPORT, drawings
from lfd_gym.experiments.rows import Rows, markdown
from lfd_gym.experiments.writing import ENV_ID, N_DEMONSTRATIONS, paths
from policies.moa.frames import Frames
from policies.moa.generic_solver import solve_generic
from policies.moa.interior_point import solve
from policies.moa.mixture_of_attractors import MixtureOfAttractors
from policies.moa.setting import Setting

SIZES = {160: N_SUPPORT, 480: 20, 1800: 75, 3600: 150, 7200: 300}
"""n -> support points."""
LIMIT, REPETITIONS = 120.0, 5
"""[s] for a process; and solutions of our solver, of which the fastest counts."""
OURS = "structured"


class Measured(NamedTuple):
    """One solver on one problem."""

    variables: int
    seconds: float
    megabytes: float
    relative_gap: float
    error: float
    """J (4.29)."""


def run(out: Path, quick: bool, jobs: int) -> str:
    """Measure every solver on every size."""
    rows, table = Rows(out, quick, jobs), []
    sizes = [160, 480] if quick else list(SIZES)
    for n in sizes:
        ours: dict[str, Any] = {}
        for solver in (OURS, *qpsolvers.available_solvers):

            def measured(n: int = n, solver: str = solver) -> dict[str, Any] | None:
                return _in_process(setting(n), solver, LIMIT)

            row = rows.kept(f"{solver}-{n}", measured)
            ours = ours or row
            if row is None:
                table.append([str(n), solver, f"over {LIMIT:.0f} s", "", "", ""])
                continue
            error = "" if solver == OURS else f"{row['error'] / ours['error'] - 1.0:+.1e}"
            cells = [f"{1000 * row['seconds']:.1f}", f"{row['megabytes']:.0f}", f"{row['relative_gap']:.1e}", error]
            table.append([str(row["variables"]), solver, *cells])
    return markdown(["variables", "solver", "time [ms]", "memory [MB]", "relative gap", "J over ours"], table)


def setting(n: int) -> Setting:
    """The problem of n variables: a letter of our own alphabet, or the whiteboard demonstrations of teaching seed 0."""
    if n == 160:
        drawn = next(iter(drawings(None, "").values()))
        model = MixtureOfAttractors(SIZES[n], dt=DT, aligned=True)
        return model.setting(list(drawn), [Frames.at(x[[0, -1]]) for x in drawn])
    shown = demonstrations(ENV_ID, N_DEMONSTRATIONS, 0)
    layout = ActionLayout.from_dict(shown[0].action_layout)
    return MixtureOfAttractors(SIZES[n], layout.alpha, layout.beta, shown[0].dt).setting(*paths(shown))


def measure(given: Setting, solver: str) -> Measured:
    """Solve once or several times in this process."""
    problem = given.problem()
    solution = solve(setting(160).problem())  # compiles
    before, times = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, []
    for _ in range(REPETITIONS if solver == OURS else 1):
        start = time.perf_counter()
        solution = solve(problem) if solver == OURS else solve_generic(problem, given.attractors, solver)
        times.append(time.perf_counter() - start)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
    variables = problem.n_support * given.attractors.corner_matrix().shape[1]
    return Measured(variables, min(times), grown, solution.relative_gap, solution.error)


def _in_process(given: Setting, solver: str, limit: float) -> dict[str, Any] | None:
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(sender, given, solver))
    process.start()
    try:
        found: Measured | None = receiver.recv() if receiver.poll(limit) else None
    finally:
        process.terminate()
        process.join()
    return None if found is None else found._asdict()


def _send(sender: Any, given: Setting, solver: str) -> None:
    sender.send(measure(given, solver))
