"""Attractor goals from a few, possibly incomplete movements (thesis 2.2).

A movement that was stopped early still points at its goal. Every segment is approximated by a line over normalised time
(2.4)-(2.7); the goal of the segment is expected on the line's future (2.8), and the goal of the primitive is the best
compromise between the expected goals of all segments (2.9)-(2.14). Every dimension is learned on its own.
"""

import itertools
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

NormalisedTime = Literal["squared", "arclength", "real"]
TIMES: tuple[str, ...] = ("squared", "arclength", "real")


class SegmentLine(NamedTuple):
    """What a segment says about the goal: r(t) = slope t + intercept (2.5), seen from its end."""

    slope: float
    """alpha of (2.5), in units of x per unit of normalised time."""
    intercept: float
    """beta of (2.5), in units of x."""
    end: float
    """u = r(t_N) of (2.8), in units of x: the goal is expected here or further on in the direction of the slope."""
    travel: float
    """alpha (t_N - t_1), in units of x: how far, and to which side, the line goes within the segment."""


def normalised_time(x: ArrayLike, time: NormalisedTime = "squared") -> NDArray[np.float64]:
    """Time t (N,) at which the samples x (N,) of one dimension count, starting at 0 (2.4).

    "squared" is printed in (2.4): t_i = t_{i-1} + (x_i - x_{i-1})^2, which does not normalise velocity (the slope
    becomes 1 / step). "arclength" takes |x_i - x_{i-1}|: a monotone segment has a slope of exactly +1 or -1, and a
    rest takes no time. "real" counts samples (t_i = i): best where noise makes a resting dimension seem to move.
    """
    x = np.asarray(x, dtype=np.float64)
    if time == "real":
        return np.arange(len(x), dtype=np.float64)
    step = np.diff(x)
    if time == "squared":
        step = step**2
    elif time == "arclength":
        step = np.abs(step)
    else:
        raise ValueError(f"unknown time {time!r}; possible: {', '.join(TIMES)}")
    return np.concatenate([[0.0], np.cumsum(step)])


def end_weights(n: int) -> NDArray[np.float64]:
    """Weights w_i = i^2 / sum_j j^2 (n,) of (2.6), corrected: the sum runs over i^2, not over the weights themselves.

    They stress the end of a segment, whose start is still shaped by the movement before.
    """
    w = np.arange(1, n + 1, dtype=np.float64) ** 2
    return w / w.sum()


def fit_line(x: ArrayLike, time: NormalisedTime = "squared") -> SegmentLine:
    """Weighted least squares line through one segment x (N,), N >= 1 (2.5)-(2.8).

    Centred form of (2.7). For a constant segment A of (2.7) is singular (in "squared" and "arclength" time all t_i are
    equal): the slope is 0 and the intercept the weighted mean.
    """
    x = np.asarray(x, dtype=np.float64)
    if x.ndim != 1 or len(x) == 0:
        raise ValueError(f"a segment is a non-empty vector, not an array of shape {x.shape}")
    t, w = normalised_time(x, time), end_weights(len(x))
    t_mean, x_mean = w @ t, w @ x
    spread = w @ (t - t_mean) ** 2
    if spread <= 1e-24 * t[-1] ** 2:
        return SegmentLine(0.0, float(x_mean), float(x_mean), 0.0)
    slope = (w @ ((t - t_mean) * (x - x_mean))) / spread
    intercept = x_mean - slope * t_mean
    return SegmentLine(float(slope), float(intercept), float(slope * t[-1] + intercept), float(slope * t[-1]))


def segment_distance(x: ArrayLike, end: float, side: int) -> NDArray[np.float64]:
    """Distance d_m(x) of (2.9): 0 where x lies on the future of the segment, else |x - u_m|.

    side is the sign of the segment's slope, 0 inside the dead band (then every deviation counts).
    """
    x = np.asarray(x, dtype=np.float64)
    return np.where(side * (x - end) > 0, 0.0, np.abs(x - end))


def goal_cost(x: ArrayLike, ends: ArrayLike, sides: ArrayLike, weights: ArrayLike = 1.0) -> NDArray[np.float64]:
    """J(x) = sum_m w_m d_m(x)^2 of (2.10): convex, once differentiable, flat where every segment agrees.

    The weights w_m (M,), all 1 in the thesis, tell precise segments from others.
    """
    terms = np.broadcast_arrays(np.atleast_1d(ends), np.atleast_1d(sides), weights)
    return np.sum([w * segment_distance(x, u, s) ** 2 for u, s, w in zip(*terms, strict=True)], axis=0)


def best_compromise(ends: ArrayLike, sides: ArrayLike, weights: ArrayLike = 1.0) -> float:
    """Goal g = argmin_x J(x) in closed form: (2.11) read as an argmin, (2.12)-(2.14).

    ends (M,) are the u_m, sides (M,) in {-1, 0, 1} the signs of the slopes, weights (M,) those of `goal_cost`. Between two
    neighbouring sorted ends the set D of segments with a nonzero distance is constant and J a parabola with its minimum at
    their mean, clipped to the interval; where D is empty the centre of the interval is chosen. With M = 1 the goal is u_1;
    if all slopes agree in sign it is the extreme end in that direction.
    """
    ends, sides = np.asarray(ends, dtype=np.float64), np.asarray(sides)
    if ends.ndim != 1 or len(ends) == 0 or ends.shape != sides.shape:
        raise ValueError(f"ends and sides are vectors of one length >= 1, not {ends.shape} and {sides.shape}")
    w = np.broadcast_to(weights, ends.shape)
    knots = np.sort(ends)
    candidates = [knots[0], knots[-1]]
    for low, high in itertools.pairwise(knots):
        middle = 0.5 * (low + high)
        active = sides * (middle - ends) <= 0
        if not active.any():
            return float(middle)
        candidates.append(np.clip(np.average(ends[active], weights=w[active]), low, high))
    costs = goal_cost(np.array(candidates), ends, sides, w)
    return float(candidates[int(np.argmin(costs))])


def attractor_goal(
    segments: Sequence[ArrayLike],
    time: NormalisedTime = "squared",
    dead_band: float = 0.0,
    rest: tuple[int, float] | None = None,
    weights: ArrayLike = 1.0,
) -> float:
    """Attractor goal of one dimension from its M >= 1 segments, each (N_m,), with weights (M,) (thesis 2.2).

    dead_band, in units of x: a line that travels less within its segment points to no side (needed in (2.9), or a
    constant segment would pick a random one). It is compared with |alpha| (t_N - t_1), which has the unit of x in every
    reading of time.

    rest, beyond the thesis: a segment whose last n samples stay within a range r, for rest=(n, r), came to rest at its
    goal and points to no side either. Otherwise all segments that come from one side push the goal to the farthest end of
    all (2.11), which lies the farther off the more demonstrations there are. None: every line points to its side.
    """
    lines = [fit_line(x, time) for x in segments]
    sides = [0 if abs(line.travel) <= dead_band else int(np.sign(line.slope)) for line in lines]
    if rest is not None:
        n, range_ = rest
        sides = [0 if np.ptp(np.asarray(x)[-n:]) <= range_ else side for x, side in zip(segments, sides, strict=True)]
    return best_compromise([line.end for line in lines], sides, weights)


def attractor_goals(
    segments: Sequence[NDArray[np.float64]], time: NormalisedTime = "squared", dead_band: float = 0.0
) -> NDArray[np.float64]:
    """Attractor goal (d,) from segments of shape (N_m, d), every dimension on its own (2.2.1)."""
    n_dimensions = segments[0].shape[1]
    return np.array([attractor_goal([x[:, i] for x in segments], time, dead_band) for i in range(n_dimensions)])
