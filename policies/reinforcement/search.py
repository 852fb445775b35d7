"""Search without derivatives for parameters that score more: CMA-ES, and the gradient of the same smoothed score."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import cma
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Score = Callable[[Sequence[Array], int], Array]
"""Scores (n,) of n candidates (d,) in a generation; candidates of one generation meet the same setups."""


class Found(NamedTuple):
    """What a search found."""

    x: Array
    """(d,) the middle of the last generation."""
    history: list[float]
    """Mean score of every generation."""


def cma_es(score: Score, size: int, generations: Iterable[int], population: int, sigma: float, seed: int) -> Found:
    """Covariance matrix adaptation (Hansen 2016) from zero, with `cma`; sigma is the first standard deviation.

    A generation whose scores are all equal teaches nothing: the ranks that it would be given are arbitrary.
    """
    options: dict[str, Any] = {"popsize": population, "seed": seed + 1, "verbose": -9}
    strategy = cma.CMAEvolutionStrategy(np.zeros(size), sigma, options)
    history = []
    for generation in generations:
        candidates = strategy.ask()
        scores = score(candidates, generation)
        history.append(float(np.mean(scores)))
        if np.ptp(scores) > 0.0:
            strategy.tell(candidates, (-scores).tolist())
    return Found(np.asarray(strategy.result.xfavorite, dtype=np.float64), history)


def smoothed_gradient(
    score: Score, size: int, generations: Iterable[int], population: int, sigma: float, seed: int, rate: float = 0.3
) -> Found:
    """Ascent along the score function's gradient of E[f(x + sigma e)], from pairs of opposite e (Salimans et al. 2017).

    g = 1 / (n sigma) sum_i (f(x + sigma e_i) - f(x - sigma e_i)) / (2 s) e_i with n = population / 2 and s the standard
    deviation of all scores, which makes the step independent of their scale; x moves by `rate` sigma^2 sqrt(d) g.
    """
    rng, x, history = np.random.default_rng(seed), np.zeros(size), []
    for generation in generations:
        noise = rng.normal(size=(max(population // 2, 1), size))
        scores = score([*(x + sigma * noise), *(x - sigma * noise)], generation)
        history.append(float(np.mean(scores)))
        spread = float(np.std(scores))
        if spread > 0.0:
            up, down = np.split(scores, 2)
            gradient = ((up - down) / (2.0 * spread)) @ noise / (len(noise) * sigma)
            x = x + rate * sigma**2 * gradient * np.sqrt(size)
    return Found(x, history)
