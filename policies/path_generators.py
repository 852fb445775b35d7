"""Paths for new scenes, from plain arrays: what a skill keeps of the model that its path was learned with.

A generator draws `path(frames, first)`, (N, d), in a scene with F frames at rest, from a first point (d,). Estimators that
fit generators are the Mixture of Attractors and the methods it is compared with, see `policies.trajectory_baselines`.
"""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from policies.moa.frames import Frames
from policies.moa.mixture_of_attractors import MixtureOfAttractors
from policies.moa.response import Response

Array = NDArray[np.float64]


class Generator(Protocol):
    """A NamedTuple of arrays that draws paths."""

    def path(self, frames: Frames, first: Array) -> Array:
        """The path (N, d)."""
        ...

    def _asdict(self) -> dict[str, Array]: ...


class AttractorPath(NamedTuple):
    """A Mixture of Attractors: goals sum_f alpha_f p_f + R_f q_f, followed by the attractor (4.9)."""

    activations: Array
    """alpha (N, F) of the frames."""
    places: Array
    """q (N, F, d)."""
    response: Array
    """c1, c2, c3 of (4.11)."""

    @classmethod
    def of(cls, model: MixtureOfAttractors) -> "AttractorPath":
        """What a fitted model draws."""
        response = np.array(Response.of_attractor(model.alpha, model.beta, model.dt))
        return cls(*model.activations(), response)

    def path(self, frames: Frames, first: Array) -> Array:
        """From rest at the first point."""
        goals = frames.origins * self.activations[..., None] + (frames.axes @ self.places[..., None])[..., 0]
        return Response(*self.response).simulate(goals.sum(axis=1), first, first)
