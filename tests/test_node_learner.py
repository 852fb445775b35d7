"""What is doubtful about a node is said, with its name and those of its exits."""

import warnings

import numpy as np
import pytest

from policies.features import Feature
from policies.node_learner import NodeLearner, TransitionWarning
from policies.passages import END
from policies.task_data import N_COORDINATES
from policies.transition_data import NodeData

NAMES = ("start", "reach", "grasp", "push")
FEATURES = tuple(Feature(name, 0, np.zeros(N_COORDINATES), 0.0) for name in ("position", "hand"))


def data(places: dict[int, float], **changes) -> NodeData:
    """Samples of every class around (place, 0.5); class 0 is to stay, 1 to grasp, 2 to push, 3 to end."""
    rng = np.random.default_rng(0)
    samples = [[place, 0.5] + 0.02 * rng.standard_normal((40, 2)) for place in places.values()]
    classes = np.repeat(list(places), 40)
    exits = (2, 3, END) if 3 in places else (2, 3)
    rests = {2: 4, 3: 0, END: 0}
    facts = NodeData(
        FEATURES, exits, np.concatenate(samples), classes, np.ones(len(classes)), rests, {}, taken_by(*exits)
    )
    return facts._replace(**changes)


def taken_by(*exits: int, **few: int) -> dict[int, frozenset[int]]:
    """Every exit by four demonstrations, named ones by fewer."""
    return {e: frozenset(range(few.get(NAMES[e], 4))) for e in exits}


def warned(data: NodeData) -> list[str]:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        learner().learn(1, data, stillness=10)
    assert all(w.category is TransitionWarning for w in caught)
    return [str(w.message) for w in caught]


def learner(**changes) -> NodeLearner:
    plain = NodeLearner("svm", {"C": 10.0, "kernel": "rbf"}, 1.0, 1.0, 0.02, NAMES)
    return plain._replace(**changes)


def test_what_is_clear_is_not_worth_a_word():
    assert warned(data({0: 1.0, 1: 0.0, 2: 0.5}, goal_states={2: np.array([0.0, 0.5])})) == []


def test_exits_that_nothing_tells_apart_are_named():
    (message,) = {
        text.replace("'grasp' for 'push'", "'push' for 'grasp'") for text in warned(data({0: 1.0, 1: 0.0, 2: 0.0}))
    }
    assert message == "node 'reach' takes 'push' for 'grasp': no feature that was observed tells them apart"


def test_of_exits_that_nothing_tells_apart_a_rare_one_is_left_out():
    alike = data({0: 1.0, 1: 0.0, 2: 0.0})
    assert warned(alike._replace(taken_by=taken_by(2, 3, push=1))) == [
        "node 'reach': no feature that was observed tells its exits apart; 'push' is left out, for most demonstrations went on"
        " to 'grasp'"
    ]
    for kept, left_out, few in ((2, 3, {"push": 1}), (3, 2, {"grasp": 1})):
        with pytest.warns(TransitionWarning, match="left out"):
            node = learner().learn(1, alike._replace(taken_by=taken_by(2, 3, **few)), stillness=10)
        assert node.targets.tolist() == [1, kept]
        assert left_out not in node.targets
        assert np.argmax(node.decision.scores(np.array([0.0, 0.5]))) == 1
        assert np.argmax(node.decision.scores(np.array([1.0, 0.5]))) == 0


def test_a_rare_exit_that_a_feature_tells_stays():
    shown = data({0: 1.0, 1: 0.0, 2: 0.5}, taken_by=taken_by(2, 3, push=1))
    assert learner().learn(1, shown, stillness=10).targets.tolist() == [1, 2, 3]


def test_a_transition_that_one_demonstration_showed_is_named():
    (message,) = warned(data({0: 1.0, 1: 0.0, 3: 0.5}, taken_by={2: frozenset({0, 1}), END: frozenset({2})}))
    assert message == "at node 'reach' only one demonstration went on to the end"


def test_a_goal_that_is_a_trap_is_named():
    (message,) = warned(data({0: 1.0, 1: 0.5}, goal_states={2: np.array([1.0, 0.5])}))
    assert message == "node 'reach' cannot tell its goal, where 'grasp' follows, from the way there"


def test_dwell_is_the_demonstrated_rest_and_patience_the_demonstrated_stillness():
    shown = data({0: 1.0, 1: 0.0, 2: 0.5})
    node = learner(dwell=2.0, patience=3.0).learn(1, shown, stillness=10)
    assert node.dwell == pytest.approx([0.0, 2.0 * 4 * 0.02, 0.0])
    assert node.targets.tolist() == [1, 2, 3]
    assert node.patience == pytest.approx(3.0 * 10 * 0.02 + 0.5)
    assert learner(patience=None).learn(1, shown, stillness=10).patience == np.inf
    assert learner().learn(1, data({0: 1.0, 1: 0.0, 3: 0.5}), stillness=10).patience == np.inf
    assert learner(dwell=0.0).learn(1, shown, stillness=10).dwell.tolist() == [0.0, 0.0, 0.0]
