"""Time, memory and certified gap of the MoA problem over its size, of our solver and of generic ones (thesis 4.2, 4.3).

The number of variables of (4.26) is n = N_S F 2^d: activations at N_S support points of the corners of F boxes. Letters are
planar (n = 160), whiteboard demonstrations spatial. Every measurement runs in a process of its own, which is stopped at a limit
of CPU time; the time is CPU time, of our solver the mean over repetitions, the memory what the process grew by.
"""

import functools
import math
import multiprocessing
import resource
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import qpsolvers

from lfd_gym.action import ActionLayout
from lfd_gym.errors import LfdGymError
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
LIMIT, REPETITIONS = 120.0, 20
"""CPU time [s] of a solver; and solutions of our solver, whose mean time counts."""
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
    for n in [160, 480] if quick else list(SIZES):
        given = functools.cache(functools.partial(setting, n))
        found = {}
        for solver in (OURS, *qpsolvers.available_solvers):

            def measured(given: Callable[[], Setting] = given, solver: str = solver) -> dict[str, Any]:
                return _in_process(given(), solver)

            found[solver] = rows.kept(f"{solver}-{n}", measured)
        for solver, row in found.items():
            if "failed" in row:
                table.append([str(n), solver, row["failed"], "", "", ""])
                continue
            error = "" if solver == OURS else f"{row['error'] / found[OURS]['error'] - 1.0:+.1e}"
            cells = [f"{1000 * row['seconds']:.1f}", f"{row['megabytes']:.0f}", f"{row['relative_gap']:.1e}", error]
            table.append([str(row["variables"]), solver, *cells])
    return markdown(["variables", "solver", "CPU time [ms]", "memory [MB]", "relative gap", "J over ours"], table)


def setting(n: int) -> Setting:
    """The problem of n variables: a letter of our own alphabet, or the whiteboard demonstrations of teaching seed 0."""
    if n == 160:
        drawn = next(iter(drawings(None, "").values()))
        model = MixtureOfAttractors(SIZES[n], dt=DT, aligned=True)
        return model.setting(list(drawn), [Frames.at(x[[0, -1]]) for x in drawn])
    shown = demonstrations(ENV_ID, N_DEMONSTRATIONS, 0)
    layout = ActionLayout.from_dict(shown[0].action_layout)
    return MixtureOfAttractors(SIZES[n], layout.alpha, layout.beta, shown[0].dt).setting(*paths(shown))


def measure(given: Setting, solver: str, limit: float = LIMIT) -> Measured:
    """Solve once or several times in this process, which ends with SIGXCPU where that takes longer than the limit [s]."""
    problem = given.problem()
    solution = solve(setting(160).problem())  # compiles
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(time.process_time() + limit), resource.RLIM_INFINITY))
    repetitions, start = REPETITIONS if solver == OURS else 1, time.process_time()
    for _ in range(repetitions):
        solution = solve(problem) if solver == OURS else solve_generic(problem, given.attractors, solver)
    seconds = (time.process_time() - start) / repetitions
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
    variables = problem.n_support * given.attractors.corner_matrix().shape[1]
    return Measured(variables, seconds, grown, solution.relative_gap, solution.error)


def _in_process(given: Setting, solver: str) -> dict[str, Any]:
    """What was measured in a process of its own, or why it "failed"."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(sender, given, solver))
    process.start()
    sender.close()
    try:
        found: dict[str, Any] = receiver.recv()
    except EOFError:
        process.join()
        over = process.exitcode == -signal.SIGXCPU
        return {"failed": f"over {LIMIT:.0f} s" if over else f"ended with code {process.exitcode}"}
    process.join()
    return found


def _send(sender: Any, given: Setting, solver: str) -> None:
    try:
        sender.send(measure(given, solver)._asdict())
    except LfdGymError:
        sender.send({"failed": "gave up"})
