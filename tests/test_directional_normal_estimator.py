"""The Directional Normal Distribution keeps scikit-learn's conventions, as far as they apply to points with velocities."""

from collections.abc import Callable

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.utils import estimator_checks as checks

from policies.decomposition.directional_normal import DirectionalNormal

CHECKS = (
    checks.check_estimator_cloneable,
    checks.check_estimator_repr,
    checks.check_get_params_invariance,
    checks.check_set_params,
    checks.check_no_attributes_set_in_init,
    checks.check_parameters_default_constructible,
)
"""Those that fit nothing: the others call `fit(X, y)`, where ours needs a velocity for every point."""


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_parameters_keep_the_conventions(check: Callable[[str, DirectionalNormal], None]) -> None:
    check("DirectionalNormal", DirectionalNormal())


def test_a_clone_learns_the_same_and_fitting_changes_no_argument() -> None:
    rng = np.random.default_rng(0)
    x, v = rng.normal(size=(2, 30, 3))
    kept = x.copy(), v.copy()
    first = DirectionalNormal(floor=1e-3).fit(x, v)
    second = clone(first).fit(x, v)
    np.testing.assert_array_equal(first.goal_, second.goal_)
    np.testing.assert_array_equal(x, kept[0])
    np.testing.assert_array_equal(v, kept[1])


def test_fitting_twice_forgets_the_first_time() -> None:
    rng = np.random.default_rng(1)
    (x, v), (y, w) = rng.normal(size=(2, 2, 30, 3))
    once = DirectionalNormal().fit(y, w)
    twice = DirectionalNormal().fit(x, v).fit(y, w)
    np.testing.assert_array_equal(once.goal_, twice.goal_)
    assert once.history_ == twice.history_
