"""A second stage that picks one minimiser where there are many.

Where demonstrations do not tell frames apart (one or two of them, or alike setups) very different activations track them
equally well: at a cost equal to nine digits the error on a new setup differs tenfold. Among all activations that track nearly
as well as the best, this stage takes those of least

    R = sum_s sum_f c_sf alpha_sf + switching/2 sum_s |alpha_{s+1} - alpha_s|^2,

c_sf the distance of the demonstrated points to the origin of frame f around support point s: what happens near an object is
relative to it. R is linear up to its second part, so its minimisers lie in corners: few frames at a time, and few switches.
"""

import numpy as np
from numpy.typing import NDArray

from policies.moa.interior_point import Solution, solve
from policies.moa.support_points import Interpolation
from policies.moa.tracking import TrackingProblem

Array = NDArray[np.float64]

FACTOR = 8.0
"""From one weight of R to the next."""
LOOSE = 1e-4
"""Relative gap while the weight is searched."""
SATURATED = 1e-3
"""R within this fraction of its least value cannot fall any more."""


def nearness(local: list[Array], weights: Interpolation) -> Array:
    """c_sf (N_S, F), in units of the trajectory times steps, from aligned points in every frame, each (N, F, d)."""
    return weights.transposed(np.mean([np.linalg.norm(points, axis=2) for points in local], axis=0))


def break_tie(
    problem: TrackingProblem,
    first: Solution,
    preference: Array,
    switching: float,
    allowed_error: float,
    tolerance: float,
) -> Solution:
    """The solution of least R among those whose tracking error J is at most `allowed_error`.

    J + w R is minimised for growing weights w, each start warm, and the last w that keeps to the bound is taken. The first,
    w_0 = (allowed - J*) / R(first), always does: J(w) - J* <= w (R(first) - R(w)). The switching cost is in units of the mean
    preference.

    The returned cost and gap are those of J + w R.
    """
    scale = float(preference.mean())

    def weighted(weight: float) -> TrackingProblem:
        return TrackingProblem(problem.groups, problem.n_frames, weight * preference, weight * scale * switching)

    def criterion(solution: Solution) -> float:
        return weighted(1.0).cost_and_gradient(solution.z)[0] - solution.error

    least = float(preference.min(axis=1).sum())
    weight = (allowed_error - first.error) / criterion(first)
    best, last = first, first
    while weight > 0.0:
        last = solve(weighted(weight), LOOSE, start=last.z)
        if last.error > allowed_error:
            break
        best, reached = last, weight
        if criterion(last) <= (1.0 + SATURATED) * least:
            break
        weight *= FACTOR
    return best if best is first else solve(weighted(reached), tolerance, start=best.z)
