"""The folder of a training: who holds it, what its log remembers, and which setups its seed is worth."""

from pathlib import Path

import pytest

from lfd_gym.errors import InvalidArgumentError
from lfd_gym.seeds import DEVELOPMENT_SEED, MOST_RUNS, PRACTICE_SEED, SEEDS_PER_RUN, TEACHING_SEED, TRAINING_SEED

pytest.importorskip("stable_baselines3", reason="the rl extra is not installed")

from policies.reinforcement.checkpoint import TrainingFolder, held
from policies.reinforcement.training import Schedule, train


def test_a_folder_is_trained_in_by_one_process_at_a_time(tmp_path: Path) -> None:
    with (
        held(tmp_path / "t"),
        pytest.raises(InvalidArgumentError, match="is being trained in by another process"),
        held(tmp_path / "t"),
    ):
        pass
    with (
        held(tmp_path / "t"),
        pytest.raises(InvalidArgumentError, match="is being trained in by another process"),
    ):
        train("sac", "move-object", Schedule(32), tmp_path / "t")
    with held(tmp_path / "t"):
        assert (tmp_path / "t").is_dir()


def test_what_was_logged_of_a_lost_agent_is_forgotten(tmp_path: Path) -> None:
    log = TrainingFolder(tmp_path, {})
    for decisions in (16, 64, 80):
        log.append({"decisions": decisions})
    log.go_on(64)
    assert [row["decisions"] for row in log.rows()] == [16, 64]


def test_trainings_have_setups_of_their_own(tmp_path: Path) -> None:
    assert DEVELOPMENT_SEED < TEACHING_SEED < TRAINING_SEED - 2**32
    assert TRAINING_SEED + SEEDS_PER_RUN * MOST_RUNS <= PRACTICE_SEED
    with pytest.raises(InvalidArgumentError, match="seed 1024; possible: 0 to 1023"):
        train("sac", "move-object", Schedule(32), tmp_path / "t", seed=MOST_RUNS)
    assert not (tmp_path / "t").exists()


def test_a_folder_without_a_checkpoint_belongs_to_nobody(tmp_path: Path) -> None:
    TrainingFolder(tmp_path, {"seed": 0})
    TrainingFolder(tmp_path, {"seed": 1})
    (tmp_path / "checkpoint-000000064").mkdir()
    with pytest.raises(InvalidArgumentError, match="checkpoints of another training"):
        TrainingFolder(tmp_path, {"seed": 0})
