"""Baseline: task-parameterised Gaussian mixture (Calinon et al. 2012, as in thesis 3.5.2).

Every component is a Gaussian of position and velocity in each task frame; a point belongs to a component by the product over
the frames. With diagonal covariances that is a mixture over the frames' coordinates side by side; the number of components is
chosen by BIC. A component's frame is the one in which its position is most certain.
"""

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture

from lfd_gym.demonstration import Demonstration
from policies.decomposition.extraction import extract
from policies.decomposition.hidden_markov import of_least_bic
from policies.decomposition.result import COMPLETE, Decomposition, EntityDecomposition
from policies.decomposition.runs import from_runs, steps_of
from policies.decomposition.segmentation import entities
from policies.decomposition.task_spaces import TaskSpace, coordinates

Array = NDArray[np.float64]

PERIOD = 0.2
"""Between points [s]."""
TIME_SCALE = 1.0
"""[s]: velocities count as the way in this time."""
MOST, PATIENCE, RESTARTS = 40, 4, 2
"""Components at most; BIC has not improved so many times in a row; starts of EM."""
FLOOR = {"position": 0.02, "orientation": 0.1, "hand": 0.1}
"""Least standard deviation [m], entries of a rotation matrix, [rad] (`results/decomposition-trials`)."""
ALIKE = 10.0
"""Points that BIC counts as one: points of one movement are not independent."""


def decompose_by_tp_gmm(demonstrations: Sequence[Demonstration], seed: int = 0) -> Decomposition:
    """Every entity."""
    return Decomposition(
        {entity: _entity(demonstrations, entity, seed) for entity in entities(demonstrations)}, "tp-gmm"
    )


def _entity(demonstrations: Sequence[Demonstration], entity: str, seed: int) -> EntityDecomposition:
    frames = sorted(n.removeprefix("frame_") for n in demonstrations[0].observations if n.startswith("frame_"))
    kind = {"position": "cartesian", "orientation": "rotation", "hand": "joints"}[entity]
    spaces = [TaskSpace(frame, kind) for frame in ("world", *(frames if entity != "hand" else []))]
    rows, counts = [], []
    for demonstration in demonstrations:
        at, dt = steps_of(demonstration, PERIOD), float(demonstration.dt)
        blocks = []
        for space in spaces:
            x, _ = coordinates(demonstration, entity, space)
            blocks.append(np.hstack([x[at], TIME_SCALE * np.gradient(x, dt, axis=0)[at]]))
        rows.append(np.hstack(blocks))
        counts.append(len(at))
    model = _fit(np.concatenate(rows), FLOOR[entity] ** 2, seed)
    data, labels = from_runs(demonstrations, entity, [model.predict(own) for own in rows], PERIOD)
    used, assignment = np.unique(labels, return_inverse=True)
    certainty = _certainty(model.covariances_[used], len(spaces))
    posteriors = np.zeros((len(used), len(data.spaces)))
    posteriors[:, : len(spaces)] = certainty
    kinds = np.full(len(assignment), COMPLETE)
    return EntityDecomposition(data, extract(data, assignment, kinds, list(posteriors)), assignment, kinds)


def _fit(rows: Array, floor: float, seed: int) -> GaussianMixture:
    def fit(k: int) -> tuple[GaussianMixture, float]:
        model = GaussianMixture(k, covariance_type="diag", reg_covar=floor, n_init=RESTARTS, random_state=seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            model.fit(rows)
        n, n_parameters = len(rows) / ALIKE, k * (2 * rows.shape[1] + 1) - 1
        return model, -2.0 * n * float(model.score(rows)) + n_parameters * float(np.log(n))

    return of_least_bic(fit, min(MOST, len(rows)), PATIENCE)


def _certainty(variances: Array, n_spaces: int) -> Array:
    """(K, F) how precise the positions are in every frame, relative to each other: |S|^(-1/2), normalised."""
    blocks = variances.reshape(len(variances), n_spaces, 2, -1)
    log = -0.5 * np.log(blocks[:, :, 0]).sum(axis=2)
    weights = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
