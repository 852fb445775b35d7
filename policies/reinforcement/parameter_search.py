"""Fine-tuning by `cma` and `es-gradient`: practice of a skill's few parameters, without gradients of the simulation."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfd_gym.progress import track
from policies.reinforcement import search
from policies.reinforcement.practice import Practice, Practised, identity, practise, scores
from policies.reinforcement.search_log import SearchLog
from policies.reinforcement.skill_parameters import parameters_of

Array = NDArray[np.float64]

SETUPS = 4
"""Setups that every candidate does."""
SIGMA = 1.0
"""First standard deviation, in the units of `skill_parameters`."""


def by_cma(practice: Practice) -> Practised:
    """CMA-ES."""
    return _search(practice, search.cma_es)


def by_gradient(practice: Practice) -> Practised:
    """The gradient of the smoothed score, as evolution strategies estimate it."""
    return _search(practice, search.smoothed_gradient)


def _search(practice: Practice, method: Callable[..., search.Found]) -> Practised:
    """Search for parameters; candidates of a generation do the same setups, every generation others."""
    parameters = parameters_of(practice.skill)
    population = min(4 + int(3 * np.log(parameters.size)) // 2 * 2, max(2, practice.episodes // SETUPS // 2 * 2))
    generations = max(1, practice.episodes // (population * SETUPS))
    first = practice.first_seed
    bar = track(range(generations), generations, "generations", practice.progress)
    job = {
        **identity(practice.skill), "method": method.__name__, "env_id": practice.env_id, "env_kwargs": practice.env_kwargs,
        "seed": practice.seed, "setups": SETUPS,
    }  # fmt: skip
    log = SearchLog(practice.folder / "search.json", job)

    def score(candidates: Sequence[Array], generation: int) -> Array:
        def practised() -> dict[str, Any]:
            since = time.monotonic()
            seeds = range(first + SETUPS * generation, first + SETUPS * (generation + 1))
            skills = [parameters.applied(np.asarray(x)) for x in candidates]
            episodes = practise(skills, practice.env_id, practice.env_kwargs, seeds, practice.jobs)
            return {
                "scores": scores(episodes).tolist(),
                "simulated_seconds": sum(episode.seconds for row in episodes for episode in row),
                "seconds": time.monotonic() - since,
            }

        return log.scored(generation, candidates, practised)

    found = method(score, parameters.size, bar, population, SIGMA, practice.seed)
    rows = log.generations[:generations]
    facts = {
        "episodes": generations * population * SETUPS,
        "updates": generations,
        "simulated_hours": sum(row["simulated_seconds"] for row in rows) / 3600.0,
        "seconds": sum(row["seconds"] for row in rows),
        "history": [round(value, 4) for value in found.history],
    }
    return parameters.applied(found.x), facts
