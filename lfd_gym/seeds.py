"""Reset seeds and what they are for, in ranges that do not meet: nothing is judged on a setup that it has learned from.

| first | setups |
|---|---|
| `FINAL_SEED` | to 1099: of final figures, and of nothing else |
| `DEVELOPMENT_SEED` | on which settings are chosen, curves are drawn and examples run |
| `TEACHING_SEED` | of demonstrations, see `lfd_gym.recording.reset_seed` |
| `TRAINING_SEED` | of the training of agents, `SEEDS_PER_RUN` for each seed of a training |
| `PRACTICE_SEED` | of fine-tuning, likewise; the upper half of a run's is for its last check |
"""

FINAL_SEED, DEVELOPMENT_SEED = 1000, 100_000
TEACHING_SEED, TRAINING_SEED, PRACTICE_SEED = 2**32, 2**34, 2**35
SEEDS_PER_RUN = 2**24
