"""Named observations as features (thesis 2.5.3)."""

import dataclasses

import numpy as np
import pytest
from slipping_world import ABOVE, BEGIN, BESIDE, CLOSE, LIFT, solve, teach

from lfd_gym.errors import UnknownNameError
from policies.named_observations import named_observations
from policies.sequence_graph_learner import SequenceGraphLearner

SHOWN = [
    {
        "tool_position": np.random.default_rng(0).normal(size=(5, 3)),
        "reference_position": np.full((5, 3), np.nan),
        "frame_box": np.zeros((5, 7)),
        "joint_position": np.ones((5, 7)),
        "cylinder": np.array([[0.08, 0.0, 1.0]] * 2 + [[0.24, 3.0, 1.0]] * 3),
        "hand_torque": np.linspace(-1.0, 1.0, 10).reshape(5, 2),
    },
    {
        "cylinder": np.array([[0.16, 1.5, 1.0]]),
        "hand_torque": np.array([[3.0, 0.0]]),
    },
]


def test_everything_measured_that_is_no_pose_and_varies_is_a_feature():
    named = named_observations(SHOWN, None)
    assert [named.name(i) for i in range(len(named.keys))] == [
        "cylinder[0]",
        "cylinder[1]",
        "hand_torque[0]",
        "hand_torque[1]",
    ]


def test_features_span_the_demonstrated_range_and_end_there():
    named = named_observations(SHOWN, ("hand_torque", "cylinder"))
    rows = np.concatenate([named.scaled(observations) for observations in SHOWN])
    assert rows.min(axis=0) == pytest.approx(0.0)
    assert rows.max(axis=0) == pytest.approx(1.0)
    far = {"cylinder": np.array([0.5, -1.0, 1.0]), "hand_torque": np.array([1.0, 99.0])}
    assert named.scaled(far) == pytest.approx([(1.0 + 1.0) / (3.0 + 1.0), 1.0, 1.0, 0.0])


def test_some_components_are_the_same_columns():
    named = named_observations(SHOWN, None)
    some = named.only([3, 0])
    assert some.scaled(SHOWN[0]) == pytest.approx(named.scaled(SHOWN[0])[:, [3, 0]])
    assert named.only([]).scaled(SHOWN[0]).size == 0


@pytest.mark.parametrize("name", ["colour", "tool_position", "frame_box", "reference_position"])
def test_unknown_names_and_poses_are_refused(name):
    with pytest.raises(
        UnknownNameError, match=f"no observation for features '{name}'.*possible: cylinder, hand_torque"
    ):
        named_observations(SHOWN, (name,))


def test_what_kind_of_object_lies_there_decides_how_to_begin():
    def at_once(demonstration):
        begun = int(np.argmax(demonstration.labels != BEGIN))
        parts = {name: getattr(demonstration, name)[begun:] for name in ("actions", "rewards", "labels", "states")}
        seen = {name: rows[begun:] for name, rows in demonstration.observations.items()}
        return dataclasses.replace(demonstration, observations=seen, **parts)

    shown = [at_once(teach(seed, tall)) for seed, tall in ((0, False), (1, True), (2, False), (3, True))]
    skill = SequenceGraphLearner().fit(shown).skill_
    for seed in range(10, 16):
        for tall in (False, True):
            assert solve(skill, seed, tall) == (True, [BESIDE if tall else ABOVE, CLOSE, LIFT])
