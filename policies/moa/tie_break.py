"""A second stage that picks one minimiser where there are many.

Where demonstrations do not tell frames apart (one or two of them, or alike setups) very different activations track them
equally well: at a cost equal to nine digits the error on a new setup differs tenfold. Among all activations that track nearly
as well as the best, this stage takes those of least

    R = sum_s sum_f c_sf alpha_sf + switching/2 sum_s |alpha_{s+1} - alpha_s|^2,

c_sf the distance of the demonstrated points to the origin of frame f around support point s: what happens near an object is
relative to it. R is linear up to its second part, so its minimisers lie in corners: few frames at a time, and few switches.
The world is one of the frames: where its origin lies among the objects and not, as here, in the robot's base, it is taken for
one of them.
"""

import numpy as np
from numpy.typing import NDArray

from policies.moa.interior_point import Solution, solve
from policies.moa.support_points import Interpolation
from policies.moa.tracking import TrackingProblem

Array = NDArray[np.float64]

SLACK = 0.05
"""By what share of the least error solutions count as nearly equal."""
CLOSE = 0.05
"""R is least to within this fraction of itself."""
NOTHING = 1e-6
"""Less than this share of what R was to begin with is nothing left to save."""
FACTOR = 10.0
"""By which the weight of R grows until it is too large."""
RATIO = 2.0
"""Weights are bracketed to this ratio where R does not come close before."""
LOOSE = 1e-4
"""Relative gap of the solutions on the way."""


def excess(n_demonstrations: int, dimension: int) -> float:
    """By what share of the least error that of the true movement exceeds it, p / (M d - p), for the least error fits noise.

    At every step M demonstrations are M d numbers, explained by p = d + 1: a place, and how two frames share in it. A single
    demonstration does not tell its noise: 0.
    """
    parameters = dimension + 1
    further = n_demonstrations * dimension - parameters
    return parameters / further if further > 0 else 0.0


def nearly_equal(n_demonstrations: int, dimension: int) -> float:
    """By what share of the least error a simpler solution may be worse: what noise takes away, `SLACK` at least."""
    return max(SLACK, excess(n_demonstrations, dimension))


def nearness(local: list[Array], weights: Interpolation) -> Array:
    """c_sf (N_S, F), in units of the trajectory times steps, from aligned points in every frame, each (N, F, d)."""
    return weights.transposed(np.mean([np.linalg.norm(points, axis=2) for points in local], axis=0))


def break_tie(
    problem: TrackingProblem,
    first: Solution,
    preference: Array,
    switching: float,
    allowed: float,
    tolerance: float,
) -> Solution:
    """The solution of least R among those whose tracking error J is at most `allowed`, to within the gaps of the solver.

    J + w R is minimised for the weight w of R that uses up what is allowed. The error never exceeds it for
    w_0 = (allowed - J*) / R(first), as J(w) - J* <= w (R(first) - R(w)). And no activations within the allowed error have R
    below R(w) - (allowed - J(w) + gap) / w: where that is close, or R nothing, the search ends. The switching cost is in units
    of the mean preference. The returned cost and gap are those of J + w R.
    """
    per_switch = switching * float(preference.mean())

    def weighted(w: float) -> TrackingProblem:
        return TrackingProblem(problem.groups, problem.n_frames, w * preference, w * per_switch)

    r_first = weighted(1.0).cost_and_gradient(first.z)[0] - first.error
    if r_first == 0.0 or allowed <= first.error:
        return first
    low, high = (allowed - first.error) / r_first, np.inf
    w, guess = FACTOR * low, first.z
    while high > RATIO * low:
        found = solve(weighted(w), LOOSE, start=guess)
        if found.error > allowed:
            high = w
        else:
            low, guess = w, found.z
            weighted_r = found.cost - found.error
            if allowed - found.error + found.gap <= CLOSE * weighted_r or weighted_r <= NOTHING * w * r_first:
                break
        w = FACTOR * low if np.isinf(high) else float(np.sqrt(low * high))
    return solve(weighted(low), tolerance, start=guess)
