"""Reset seeds and what they are for, in ranges that do not meet: nothing is judged on a setup that it has learned from.

| first | setups |
|---|---|
| `FINAL_SEED` | and following: of final figures, and of nothing else |
| `DEVELOPMENT_SEED` | on which settings are chosen, curves are drawn and examples run |
| `TEACHING_SEED` | of demonstrations, see `lfd_gym.recording.reset_seed` |
| `TRAINING_SEED` | of agents, also as they fine-tune a skill: `SEEDS_PER_RUN` for each of the seeds 0 to `MOST_RUNS` - 1 |
| `PRACTICE_SEED` | of skills that search for better parameters, likewise; the upper half is for the last check of all |
"""

from lfd_gym.errors import InvalidArgumentError

FINAL_SEED, DEVELOPMENT_SEED = 1000, 100_000
TEACHING_SEED, TRAINING_SEED, PRACTICE_SEED = 2**32, 2**34, 2**35
SEEDS_PER_RUN, MOST_RUNS = 2**24, 2**10


def check_run(seed: int) -> None:
    """Raise InvalidArgumentError for a seed of a training, or a practice, whose setups would not be its own."""
    if not 0 <= seed < MOST_RUNS:
        raise InvalidArgumentError(f"seed {seed}; possible: 0 to {MOST_RUNS - 1}")
