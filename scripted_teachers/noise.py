"""How a human teacher varies, as one scale.

| what | noise 1 | contact-critical movements |
|---|---|---|
| goal position | 1 cm standard deviation per axis | 2.5 mm: a human looks closely when grasping |
| goal orientation | 3 degrees standard deviation per axis | 1 degree |
| speed | x 0.6-1.5, log-uniform | the same |
| path | bowed sideways by up to 10 % of its length | the same |
| pause after a movement | 0.2-1.0 s | the same |
| stopped early | one movement in ten, after 85-95 % of its time | never |
| pull | 5-15 N | |
| thresholds that end a movement | +- 20 % | the same |

The scale multiplies every spread: noise 0 is clean, noise 2 doubles (a pull stays at least 3 N, a pause at least 0.1 s, a
threshold at least a fifth).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GOAL_POSITION, STEADY_POSITION = 0.010, 0.0025
GOAL_ROTATION, STEADY_ROTATION = np.radians(3.0), np.radians(1.0)
SLOWEST, FASTEST = 0.6, 1.5
BOW = 0.10
PAUSE, PAUSE_SPREAD, SHORTEST_PAUSE = 0.6, 0.4, 0.1
EARLY_PROBABILITY, EARLY_LEAST, EARLY_MOST = 0.1, 0.05, 0.15
PULL, PULL_SPREAD, WEAKEST_PULL = 10.0, 5.0, 3.0
THRESHOLD_SPREAD, LOWEST_THRESHOLD = 0.2, 0.2
MOST = 10.0
"""Largest scale; a goal is then off by 10 cm."""


class Variation(NamedTuple):
    """What one movement does differently from the clean one."""

    position: Array
    """Offset of the goal, shape (3,) [m]."""
    rotation: Array
    """Rotation vector that turns the goal, shape (3,) [rad]."""
    speed: float
    """Factor on the speed."""
    bow: Array
    """Sideways displacement in the middle of the path over its length, shape (3,)."""
    pause: float
    """Rest after the movement [s]."""
    completeness: float
    """Fraction of the time of the path after which it ends; 1 unless stopped early."""
    threshold: float
    """Factor on the thresholds that end the movement."""


def vary(rng: np.random.Generator, noise: float, steady: bool) -> Variation:
    """Draw the variation of one movement; the number of draws does not depend on the arguments."""
    position, rotation = rng.standard_normal(3), rng.standard_normal(3)
    speed, bow, pause, stop, remains, threshold = rng.uniform(size=6)
    sideways = rng.standard_normal(3)
    early = not steady and stop < EARLY_PROBABILITY * noise
    return Variation(
        position=position * noise * (STEADY_POSITION if steady else GOAL_POSITION),
        rotation=rotation * noise * (STEADY_ROTATION if steady else GOAL_ROTATION),
        speed=float(SLOWEST * (FASTEST / SLOWEST) ** speed) ** noise,
        bow=sideways / np.linalg.norm(sideways) * BOW * noise * bow,
        pause=max(PAUSE + PAUSE_SPREAD * noise * (2.0 * pause - 1.0), SHORTEST_PAUSE),
        completeness=1.0 - (EARLY_LEAST + (EARLY_MOST - EARLY_LEAST) * remains) if early else 1.0,
        threshold=max(1.0 + THRESHOLD_SPREAD * noise * (2.0 * threshold - 1.0), LOWEST_THRESHOLD),
    )


def pull(rng: np.random.Generator, noise: float, limit: float) -> float:
    """A pull [N] between its weakest and the force limit."""
    return float(np.clip(PULL + PULL_SPREAD * noise * rng.uniform(-1.0, 1.0), WEAKEST_PULL, limit))
