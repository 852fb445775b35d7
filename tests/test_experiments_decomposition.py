"""The experiments of chapter 3, quickly."""

import json
from pathlib import Path

from lfd_gym.experiments import decomposition


def test_a_flip_is_learned_without_labels(tmp_path: Path) -> None:
    table = decomposition.flipping(tmp_path, quick=True, jobs=1)
    assert "obstacle_edge" in table
    assert (tmp_path / "quick" / "decomposition.png").stat().st_size > 10_000
    episodes = json.loads((tmp_path / "quick" / "5-commanded-0.json").read_text())
    assert episodes
    assert all(episode["success"] for episode in episodes)
