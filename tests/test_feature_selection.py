"""Features are chosen for what they tell, not for accidents of a few demonstrations."""

import numpy as np
import pytest

from policies.feature_selection import telling_event, telling_features

N_NOISE = 12


def grasps(seed: int, counts: dict[str, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Decisions as in thesis 2.5.3: posture decides three ways, and of the lying ones the medium length another."""
    rng = np.random.default_rng(seed)
    rows, classes = [], []
    for name, n in counts.items():
        for _ in range(n):
            length = {"medium": 0.5}.get(name, rng.choice([0.0, 1.0] if name == "lying" else [0.0, 0.5, 1.0]))
            posture = {"standing": 0.0, "upside down": 1.0}.get(name, 0.5)
            noise = 0.5 + 0.03 * rng.standard_normal(N_NOISE)
            rows.append([*noise, length, posture + 0.005 * rng.standard_normal()])
            classes.append(list(counts).index(name))
    return np.array(rows), np.array(classes), np.arange(len(rows))


LENGTH, POSTURE = N_NOISE, N_NOISE + 1


@pytest.mark.parametrize("seed", range(10))
def test_the_telling_features_are_found_and_each_class_needs_its_own(seed):
    units, classes, groups = grasps(seed, {"standing": 5, "upside down": 4, "lying": 6, "medium": 2})
    needed = telling_features(units, classes, groups, [range(units.shape[1])])
    assert needed[0] == needed[1] == [POSTURE]
    assert needed[2] == needed[3] == [POSTURE, LENGTH]


def test_one_demonstration_of_a_class_is_enough():
    units, classes, groups = grasps(3, {"standing": 4, "lying": 6, "medium": 1})
    needed = telling_features(units, classes, groups, [range(units.shape[1])])
    assert needed[2] == [POSTURE, LENGTH]


def test_later_stages_add_only_what_is_missing():
    units, classes, groups = grasps(0, {"standing": 4, "upside down": 4})
    doubled = np.hstack([units, units[:, [POSTURE]]])
    needed = telling_features(doubled, classes, groups, [range(POSTURE + 1), [POSTURE + 1]])
    assert needed == {0: [POSTURE], 1: [POSTURE]}
    hidden = telling_features(doubled, classes, groups, [range(POSTURE), [POSTURE + 1]])
    assert all(POSTURE + 1 in features for features in hidden.values())


def test_passages_of_one_demonstration_do_not_confirm_each_other():
    """Three retries in one setup agree in everything; only what another demonstration confirms counts in their favour."""
    rng = np.random.default_rng(0)
    accident = np.r_[rng.uniform(size=6), 0.5, 0.5, 0.5]
    telling = np.r_[np.zeros(6), 1.0, 1.0, 1.0]
    units, classes = np.stack([accident, telling], axis=1), np.r_[np.zeros(6), np.ones(3)].astype(int)
    groups = np.r_[np.arange(6), 6, 6, 6]
    assert telling_features(units, classes, groups, [[0, 1]]) == {0: [1], 1: [1]}


def lift(rng: np.random.Generator, slips: bool, pinch: bool = False, n: int = 30) -> np.ndarray:
    """Torques of two fingers, and a feature that wanders."""
    torque = np.full(n, 0.7) + 0.02 * rng.standard_normal(n)
    torque[20 if slips else n :] = 0.1
    second = np.full(n, 0.12) if pinch else torque
    return np.stack([torque, second, np.clip(np.cumsum(0.1 * rng.standard_normal(n)) + 0.5, 0, 1)], axis=1)


@pytest.mark.parametrize("seed", range(10))
def test_an_event_is_what_changed_and_only_then(seed):
    """A wandering feature may end anywhere in the only slip; elsewhere in the graph it wandered as far without one."""
    rng = np.random.default_rng(seed)
    others, alike = [[lift(rng, slips=False) for _ in range(n)] for n in (4, 12)]
    event = telling_event([lift(rng, slips=True)], others, alike, range(3))
    assert event is not None
    assert event.feature in (0, 1)
    assert event.side == -1.0
    assert 0.1 < event.border < 0.7
    slip = lift(rng, slips=True)
    assert event.onset(slip) == 20
    assert event.onset(slip[:20]) == 19


def test_nothing_happened_where_nothing_changed():
    rng = np.random.default_rng(0)
    calm = [lift(rng, slips=False) for _ in range(8)]
    assert telling_event(calm[:2], calm[2:], [], [0, 1]) is None


def test_what_was_always_so_is_no_event():
    """A pinch leaves one finger slack: that tells it from other grasps, not that something slipped."""
    rng = np.random.default_rng(0)
    pinches, others = [lift(rng, True, pinch=True)], [lift(rng, False) for _ in range(5)]
    event = telling_event(pinches, others, [], [0, 1])
    assert event is not None
    assert event.feature == 0
