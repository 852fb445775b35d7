"""Letters drawn in one stroke, and the models that draw them again (thesis 4.4.1).

All models get the same drawings, preprocessed and brought to one time, and draw from the first to the last point of a drawing:
MoA and MoA-S have a frame at each, the DMP its start and goal; GMR learns velocities over time and knows the start alone.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfd_gym.alphabet import LETTERS, sample
from lfd_gym.errors import DemonstrationError, InvalidArgumentError
from lfd_gym.experiments.rows import Rows
from lfd_gym.omniglot import read_drawings, single_strokes
from policies.moa.alignment import align
from policies.moa.frames import Frames, resample
from policies.moa.mixture_of_attractors import MixtureOfAttractors
from policies.moa.spatial import SpatialMixtureOfAttractors
from policies.moa.start_and_end import start_and_end
from policies.trajectory_baselines.dynamic_movement_primitives import fit_segments
from policies.trajectory_baselines.gaussian_mixture import fit_mixture

Array = NDArray[np.float64]
Model = Callable[[Array], Array]
"""From a drawing (N, 2), of which it sees the first two and the last point, to a path (N, 2)."""

N_POINTS, DT = 100, 0.02
"""Of a drawing, and between them [s]: two seconds."""
FEWEST = 3
"""Drawings of a character."""
N_SUPPORT, N_GAUSSIANS = 20, 15
"""As in the thesis."""
OWN_DRAWINGS = 10
OWN = f"our own alphabet, each drawn {OWN_DRAWINGS} times at random"
"""What is drawn where no file is given."""


def drawings(data: str | None, alphabet: str) -> dict[str, Array]:
    """Per character the aligned drawings (M, N_POINTS, 2); of our own alphabet where there is no file.

    Raises DemonstrationError where no character has enough of them.
    """
    found = own_drawings() if data is None else single_strokes(read_drawings(data, alphabet), N_POINTS)
    enough = {character: aligned(drawn) for character, drawn in found.items() if len(drawn) >= FEWEST}
    if not enough:
        raise DemonstrationError(f"no character of '{data}', {alphabet}, has {FEWEST} drawings in one stroke")
    return enough


def kept(rows: Rows, name: str, drawn: Array, result: Callable[[Array], dict[str, Any]]) -> dict[str, Any]:
    """The row of one character. Raises InvalidArgumentError for a row of other drawings."""
    facts = {"drawings": len(drawn), "spread": float(np.sqrt((drawn**2).sum(axis=2).mean()))}
    row: dict[str, Any] = rows.kept(name, lambda: facts | result(drawn))
    if row.get("drawings") != facts["drawings"] or not np.isclose(row.get("spread", 0.0), facts["spread"], rtol=1e-3):
        raise InvalidArgumentError(f"the row '{name}' is of other drawings; choose another --out, or remove it")
    return row


def own_drawings() -> dict[str, list[Array]]:
    """The letters of `lfd_gym.alphabet` that are one stroke, each drawn ten times: slanted, stretched, bent."""
    rng, result = np.random.default_rng(0), {}
    for letter, strokes in LETTERS.items():
        if len(strokes) == 1:
            points = sample(np.array(strokes[0]), 1.0 / N_POINTS)
            at = np.linspace(0, len(points) - 1, N_POINTS)
            shape = 30.0 * (resample(points, at) - points.mean(axis=0))
            result[letter] = [_varied(shape, rng) for _ in range(OWN_DRAWINGS)]
    return result


def _varied(shape: Array, rng: np.random.Generator) -> Array:
    phase = np.linspace(0.0, 2.0 * np.pi, len(shape))[:, None]
    bend = sum(rng.normal(0.0, 1.0, 2) * np.sin(k * phase / 2.0 + rng.uniform(0, np.pi)) for k in (1, 2, 3))
    return np.asarray(shape @ (np.eye(2) + rng.normal(0.0, 0.1, (2, 2))) + bend)


def aligned(drawn: Sequence[Array]) -> Array:
    """Drawings (M, N, 2) in the time of one of them."""
    warps = align(drawn, [start_and_end(x) for x in drawn])
    return np.array([resample(x, index) for x, index in zip(drawn, warps, strict=True)])


def moa(shown: Array) -> Model:
    """The Mixture of Attractors, without a second stage as in the thesis."""
    model = MixtureOfAttractors(N_SUPPORT, dt=DT, aligned=True, second_stage=False)
    model.fit(list(shown), [start_and_end(x) for x in shown])
    return lambda x: model.predict(start_and_end(x), x[0], x[1])


def moa_s(shown: Array) -> Model:
    """Activated by the position instead of the time."""
    model = SpatialMixtureOfAttractors(N_SUPPORT, dt=DT).fit(list(shown), [start_and_end(x) for x in shown])
    return lambda x: model.predict(start_and_end(x), x[0], len(x), x[1])


def dmp(shown: Array, goal_scaling: bool = True) -> Model:
    """Of (4.3), in the frame of the end point, so that every drawing has its own goal."""
    local = (shown - shown[:, -1:])[:, :, None]
    whole = np.array([0, shown.shape[1]]), np.array([0])
    model = fit_segments(local, *whole, N_POINTS // N_SUPPORT, goal_scaling, DT)
    return lambda x: model.path(Frames.at(x[-1:]), x[0])


def dmp_unscaled(shown: Array) -> Model:
    """Its forcing term does not depend on start and goal."""
    return dmp(shown, goal_scaling=False)


def gmr(shown: Array) -> Model:
    """p(t, v) conditioned on the time, and integrated."""
    velocity = np.gradient(shown, DT, axis=1)[:, :, None]
    model = fit_mixture(velocity, N_GAUSSIANS, 1e-6, slice(None), 100)
    wanted = model.path(Frames.world(2), np.zeros(2))
    return lambda x: x[0] + np.vstack([np.zeros(2), np.cumsum(0.5 * (wanted[1:] + wanted[:-1]) * DT, axis=0)])


MODELS: dict[str, Callable[[Array], Model]] = {
    "MoA": moa,
    "DMP": dmp,
    "DMP, no goal scaling": dmp_unscaled,
    "GMR": gmr,
    "MoA-S": moa_s,
}
