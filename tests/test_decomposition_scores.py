"""Scores of decompositions on planted answers, and the experiment that makes the table."""

from pathlib import Path

import numpy as np
import pytest
from kinematic_world import PRIMITIVES, TWIST, teach

from lfd_gym.demonstration import Demonstration
from lfd_gym.experiments import decomposition_methods
from lfd_gym.experiments.decomposition_scores import Score, planted, score
from policies.decomposition.extraction import extract
from policies.decomposition.result import COMPLETE, Decomposition, EntityDecomposition
from policies.decomposition.task_spaces import entity_segments


@pytest.fixture(scope="module")
def shown() -> list[Demonstration]:
    return [teach(seed) for seed in (1, 2, 3)]


def answer(shown: list[Demonstration], frame: str = "", force: bool = True, merged: bool = False) -> Decomposition:
    """The teacher's own table as a decomposition; frame: another one for all positions; merged: one primitive for all."""
    found = {}
    for entity in ("position", "orientation", "hand"):
        data = entity_segments(shown, entity)
        labels = []
        for part in data.segments:
            own = planted(shown[part.demonstration], entity)[part.start : part.stop]
            known = own[own >= 0]
            labels.append(int(np.bincount(known).argmax()) if len(known) else (labels[-1] if labels else 0))
        rows = np.unique(labels)
        assignment = np.zeros(len(labels), dtype=int) if merged else np.searchsorted(rows, labels)
        kinds, posteriors = np.full(len(labels), COMPLETE), []
        for row in rows[: 1 if merged else None]:
            control = getattr(PRIMITIVES[row], entity)
            wanted = (frame or control.frame) if entity == "position" else control.frame
            posteriors.append(np.array([float(s.frame == wanted and s.space == control.space) for s in data.spaces]))
        primitives = [
            primitive._replace(
                axes=tuple(
                    "position" if axis == "force" and not force else axis
                    for axis in getattr(PRIMITIVES[row], entity).axes
                )
            )
            for primitive, row in zip(extract(data, assignment, kinds, posteriors), rows, strict=False)
        ]
        found[entity] = EntityDecomposition(data, tuple(primitives), assignment, kinds)
    return Decomposition(found, "planted")


def test_the_teachers_own_table_is_right(shown: list[Demonstration]) -> None:
    result = score(shown, answer(shown))
    for own in result.entities.values():
        assert own.found == own.planted
        assert own.rand == pytest.approx(1.0)
        assert own.frame > 0.95
        assert own.space > 0.95
    assert result.forces
    assert result.forces_time > 0.9


def test_a_frame_that_moves_otherwise_is_wrong(shown: list[Demonstration]) -> None:
    assert score(shown, answer(shown, frame="world")).entities["position"].frame < 0.1


def test_frames_that_stand_alike_in_all_demonstrations_are_equal(shown: list[Demonstration]) -> None:
    """One demonstration, several visits: what did not move cannot be told from the world."""
    assert score(shown[:1], answer(shown[:1], frame="world")).entities["position"].frame == pytest.approx(1.0)


def test_a_missing_force_is_wrong_and_so_are_merged_primitives(shown: list[Demonstration]) -> None:
    without: Score = score(shown, answer(shown, force=False))
    assert not without.forces
    twisting = np.mean([np.mean(d.labels == TWIST) for d in shown])
    assert without.forces_time < 1.0 - 0.5 * twisting
    assert score(shown, answer(shown, merged=True)).entities["position"].rand == pytest.approx(0.0, abs=1e-9)


def test_what_is_held_is_not_planted(shown: list[Demonstration]) -> None:
    held = [i for i, row in enumerate(PRIMITIVES) if set(row.position.axes) == {"hold"}]
    for demonstration in shown:
        own = planted(demonstration, "position")
        np.testing.assert_array_equal(own == -1, np.isin(demonstration.labels, held))


def test_the_experiment_makes_its_table_and_figure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = [teach(seed) for seed in (1, 2)]
    monkeypatch.setattr(decomposition_methods, "shown", lambda env_id, mode, seed: made)
    monkeypatch.setattr(decomposition_methods, "TEACHING", {"lfd_gym/LightBulb-v0": (2, 1)})
    monkeypatch.setattr(decomposition_methods, "MODES", ("commanded",))
    fast = {name: decomposition_methods.METHODS[name] for name in ("bayesian", "tp-gmm")}
    monkeypatch.setattr(decomposition_methods, "METHODS", fast)
    table = decomposition_methods.run(tmp_path, quick=True, jobs=1)
    assert table.count("light-bulb") == len(fast)
    assert len(list((tmp_path / "quick").glob("*-10.json"))) == len(fast)
    assert (tmp_path / "quick" / "decomposition-methods.png").read_bytes().startswith(b"\x89PNG")
