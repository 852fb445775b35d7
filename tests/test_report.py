"""The demo's report says what was measured: its headline, its bars, its goals and its bands."""

from typing import Any

import numpy as np
import pytest
from kinematic_world import DT, PRIMITIVES, REACH, TWIST, teach
from scipy.spatial.transform import Rotation

from lfd_gym.demonstration import EntityControl
from lfd_gym.evaluation import Episode, EvaluationReport
from lfd_gym.recording import Recording
from lfd_gym.report import figures
from lfd_gym.report.page import page
from lfd_gym.report.trace import Trace, position_in_frame, turn_in_frame
from policies.sequence_graph import segments
from policies.sequence_graph_learner import SequenceGraphLearner

EVALUATION = EvaluationReport(
    "lfd_gym/MoveObject-v0",
    {},
    "a skill",
    tuple(Episode(7 + i, i == 0, {"grasped": i < 3}, 50, 1.0, 0.0, "burnt" if i == 3 else None) for i in range(4)),
    {"numpy": "2.0"},
)


@pytest.fixture(autouse=True)
def drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(figures, "png", lambda figure: figure)


def trace() -> Trace:
    demonstration = teach(5)
    observations = {name: rows[:-1] for name, rows in demonstration.observations.items()}
    names = tuple(primitive.name for primitive in PRIMITIVES)
    return Trace(5, observations, demonstration.labels, names, DT, True)


def test_the_page_counts_and_names_what_failed() -> None:
    text = page(Recording([teach(0), teach(1)], [2]), EVALUATION, {"A figure": b"png"}, 7, ["no video: <none>"])
    assert "learned from 2 demonstrations" in text
    assert "1 failed attempts were not shown" in text
    assert "<b>1 of 4</b> unseen setups solved: 25.0%, 95 % Wilson interval 4.6% to 69.9% (seeds 7 to 10)" in text
    assert "no video: &lt;none&gt;" in text
    failures = text.partition("<h2>Failures</h2>")[2].partition("<h2>")[0]
    assert [f"<td>{seed}</td><td>no</td>" in failures for seed in range(7, 11)] == [False, True, True, True]
    assert "<td>burnt</td>" in failures
    assert "reach, close, twist" in text


def test_bars_are_shares_of_all_setups() -> None:
    axes = figures.success(EVALUATION).axes[0]  # type: ignore[attr-defined]
    assert [bar.get_width() for bar in axes.patches] == [0.75, 0.25]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["grasped", "success"]


def test_learned_goals_lie_where_the_demonstrations_end() -> None:
    shown = [teach(seed, 0.0) for seed in range(3)]
    skill = SequenceGraphLearner().fit(shown).skill_
    columns: Any = np.array(figures.goals(shown, trace(), skill).axes).reshape(5, -1)  # type: ignore[attr-defined]
    for axes in columns[:, REACH]:
        lines = [line for line in axes.lines if line.get_linestyle() == "-"]
        (goal,) = (line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == "--")
        assert len(lines) == 4
        assert [line.get_ydata()[-1] for line in lines[:3]] == pytest.approx([goal] * 3, abs=0.01)
    assert not [line for line in columns[2, TWIST].lines if line.get_linestyle() == "--"], "a force has no goal"


def test_bands_begin_and_end_with_the_primitives() -> None:
    shown = trace()
    axes = figures.timeline(shown).axes[0]  # type: ignore[attr-defined]
    bands = [(band.get_x(), band.get_x() + band.get_width()) for band in axes.patches]
    assert np.array(bands) == pytest.approx(np.array([(s.start * DT, s.stop * DT) for s in segments(shown.labels)]))
    assert np.array_equal(axes.lines[0].get_ydata(), shown.observations["tool_position"][:, 2])


@pytest.mark.parametrize("space", ["cartesian", "cylindrical"])
def test_what_happens_in_a_frame_does_not_depend_on_where_it_is(space: str) -> None:
    rng = np.random.default_rng(0)
    tool, frame, turn = (Rotation.random(4, rng=rng) for _ in range(3))
    turn = turn[0]
    position, origin, shift = rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), rng.normal(size=3)

    def seen(turn: Rotation, shift: np.ndarray) -> dict[str, np.ndarray]:
        quaternion = (turn * frame).as_quat(scalar_first=True)
        return {
            "tool_position": turn.apply(position) + shift,
            "tool_quaternion": (turn * tool).as_quat(scalar_first=True),
            "frame_box": np.hstack([turn.apply(origin) + shift, quaternion]),
        }

    control, mean = EntityControl(0, "box", space, ("position",) * 3), np.array([0.0, 1.0, 0.0, 0.0])
    here, there = seen(Rotation.identity(), np.zeros(3)), seen(turn, shift)
    np.testing.assert_allclose(position_in_frame(there, control), position_in_frame(here, control), atol=1e-12)
    np.testing.assert_allclose(turn_in_frame(there, control, mean), turn_in_frame(here, control, mean), atol=1e-12)
    height = np.einsum("ij,ij->i", position - origin, frame.as_matrix()[:, :, 2])
    np.testing.assert_allclose(position_in_frame(here, control)[:, 2], height)
