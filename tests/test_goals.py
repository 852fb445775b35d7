"""Attractor goals (thesis 2.2) against an independent convex solver, the closed cases and every erratum."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from policies.goals import (
    attractor_goal,
    attractor_goals,
    best_compromise,
    end_weights,
    fit_line,
    goal_cost,
    normalised_time,
)


def test_goal_minimises_the_cost_like_a_one_dimensional_convex_solver():
    rng = np.random.default_rng(0)
    for _ in range(500):
        n = rng.integers(1, 8)
        ends, sides = rng.normal(size=n), rng.integers(-1, 2, size=n)
        goal = best_compromise(ends, sides)
        oracle = minimize_scalar(
            lambda x, u=ends, s=sides: float(goal_cost(x, u, s)),
            bounds=(-6, 6),
            method="bounded",
            options={"xatol": 1e-10},
        )
        assert float(goal_cost(goal, ends, sides)) <= oracle.fun + 1e-12
        if oracle.fun > 1e-9 and (sides == 0).any():
            assert goal == pytest.approx(oracle.x, abs=1e-5)


def test_goal_is_an_argmin_not_a_minimum():
    assert best_compromise([2.0, 4.0], [0, 0]) == pytest.approx(3.0)  # (2.11) printed as min would give the cost 2


def test_converging_segments_meet_in_the_middle_of_the_free_interval():
    assert best_compromise([1.0, 2.0], [1, -1]) == pytest.approx(1.5)


def test_one_segment_gives_its_own_end():
    assert all(best_compromise([0.7], [side]) == pytest.approx(0.7) for side in (-1, 0, 1))


@pytest.mark.parametrize(("side", "goal"), [(1, 3.0), (-1, -2.0)])
def test_segments_that_agree_in_direction_choose_the_extreme_end(side, goal):
    assert best_compromise([0.5, 3.0, -2.0, 1.0], [side] * 4) == pytest.approx(goal)


def test_unsorted_ends_do_not_matter():
    ends, sides = np.array([3.0, -1.0, 0.5, 2.0]), np.array([0, 1, -1, 1])
    order = [2, 0, 3, 1]
    assert best_compromise(ends, sides) == pytest.approx(best_compromise(ends[order], sides[order]))


def test_goal_moves_and_turns_with_the_data():
    rng = np.random.default_rng(1)
    segments = [np.cumsum(rng.normal(0.1, 0.2, size=rng.integers(5, 30))) for _ in range(4)]
    for time in ("squared", "arclength", "real"):
        goal = attractor_goal(segments, time)
        assert attractor_goal([x + 5 for x in segments], time) == pytest.approx(goal + 5)
        assert attractor_goal([-x for x in segments], time) == pytest.approx(-goal)


def test_weights_are_normalised_squares():
    w = end_weights(4)
    assert w.sum() == pytest.approx(1)
    assert w[3] / w[0] == pytest.approx(16)


def test_line_solves_the_weighted_normal_equations():
    rng = np.random.default_rng(2)
    x = np.cumsum(rng.normal(size=20))
    for time in ("squared", "arclength", "real"):
        t, w, line = normalised_time(x, time), end_weights(20), fit_line(x, time)
        A = np.einsum("n,ni,nj->ij", w, np.c_[t, np.ones(20)], np.c_[t, np.ones(20)])
        slope, intercept = np.linalg.solve(A, np.einsum("n,n,ni->i", w, x, np.c_[t, np.ones(20)]))
        assert (line.slope, line.intercept) == pytest.approx((slope, intercept))
        assert line.end == pytest.approx(slope * t[-1] + intercept)


def test_arclength_slopes_are_one_and_printed_slopes_depend_on_the_step():
    for n in (10, 40):
        x = np.linspace(0, -1, n)
        assert fit_line(x, "arclength").slope == pytest.approx(-1)
        assert fit_line(x, "squared").slope == pytest.approx(-(n - 1))  # (2.4) as printed does not normalise velocity


def test_constant_segment_has_no_slope_and_no_nan():
    for time in ("squared", "arclength", "real"):
        line = fit_line(np.full(15, 0.3), time)
        assert (line.slope, line.end, line.travel) == pytest.approx((0, 0.3, 0), abs=1e-12)
    assert attractor_goal([np.full(5, 0.3), np.full(7, 0.5)]) == pytest.approx(0.4)


def test_dead_band_keeps_a_resting_segment_from_picking_a_side():
    rng = np.random.default_rng(3)
    resting = [0.5 + 1e-4 * rng.normal(size=50), 0.52 + 1e-4 * rng.normal(size=50)]
    assert attractor_goal(resting, "squared", dead_band=0.005) == pytest.approx(0.51, abs=2e-4)
    outcomes = set()
    for _ in range(20):  # without it the answer is one end or the other, by chance
        segments = [m + 1e-4 * rng.normal(size=50) for m in (0.5, 0.52)]
        outcomes.add(round(attractor_goal(segments, "real"), 2))
    assert len(outcomes) > 1


def test_a_movement_stopped_early_does_not_pull_the_goal_back():
    def movement(start, goal, until):
        return goal + (start - goal) * np.exp(-np.linspace(0, 6, 200)[: int(200 * until)])

    complete = [movement(0.0, 1.0, 1), movement(0.1, 1.0, 1)]
    for time in ("squared", "arclength"):
        goal = attractor_goal([*complete, movement(-0.1, 1.0, 0.3)], time, dead_band=0.005)
        assert goal == pytest.approx(1.0, abs=0.02)


def test_goals_are_learned_per_dimension():
    rng = np.random.default_rng(4)
    segments = [np.cumsum(rng.normal(size=(n, 3)), axis=0) for n in (10, 20)]
    goals = attractor_goals(segments, "arclength")
    assert goals == pytest.approx([attractor_goal([x[:, i] for x in segments], "arclength") for i in range(3)])


def test_unknown_time_and_empty_segments_are_refused():
    with pytest.raises(ValueError, match="possible: squared, arclength, real"):
        normalised_time([0, 1], "cubic")
    with pytest.raises(ValueError, match="non-empty"):
        fit_line([])


def test_a_segment_that_rests_shows_its_goal_and_one_that_does_not_only_its_direction():
    """Goals that scatter around 1 are averaged where they were reached; the rule of the thesis takes the farthest."""
    rng = np.random.default_rng(0)
    ends = 1.0 + 0.01 * rng.standard_normal(20)
    reached = [np.r_[np.linspace(0.0, end, 50), np.full(10, end)] for end in ends]
    assert attractor_goal(reached, "arclength", 0.005) == pytest.approx(ends.max(), abs=1e-3)
    assert attractor_goal(reached, "arclength", 0.005, rest=(5, 0.002)) == pytest.approx(ends.mean(), abs=2e-3)
    stopped = [*reached, np.linspace(0.0, 0.5, 30)]
    assert attractor_goal(stopped, "arclength", 0.005, rest=(5, 0.002)) == pytest.approx(ends.mean(), abs=2e-3)
    assert attractor_goal([np.linspace(0.0, 0.5, 30)], "arclength", rest=(5, 0.002)) == pytest.approx(0.5, abs=1e-3)
