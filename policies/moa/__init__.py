"""Mixture of Attractors: movements of any shape, relative to several frames, by one convex problem (thesis chapter 4)."""

from policies.moa.alignment import align
from policies.moa.estimator import MixtureOfAttractors, sparsity
from policies.moa.frames import Frames

__all__ = ["Frames", "MixtureOfAttractors", "align", "sparsity"]
