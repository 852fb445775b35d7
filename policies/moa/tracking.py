"""The least-squares problem behind MoA (thesis 4.2): activations whose trajectory is nearest to the demonstrations.

Unknown are z (N_S, P), P = F (1 + d), see `attractors`. A group of demonstrations that share interpolation weights W (N, N_S)
contributes |Gamma (G W z) - Y|^2: G maps interpolated activations to attractor goals, step by step where frames move, Gamma is
the filter of `response`, and Y = y - lambda x_2 - mu x_1 (4.14). With a factor 2 in both H and f (4.15, 4.25, 4.28 corrected)
the quadratic form is J - sum Y^2.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from policies.moa.attractors import split
from policies.moa.response import Response
from policies.moa.support_points import Interpolation

Array = NDArray[np.float64]


class Group(NamedTuple):
    """Demonstrations that share interpolation weights, their coordinates stacked to D = M d columns."""

    weights: Interpolation
    matrices: Array
    """(1, D, P) where all frames stand still, else (N, D, P): interpolated z to attractor goals."""
    targets: Array
    """(N, D) what the forced response should be; the first two rows do not count."""
    response: Response

    def predicted(self, z: Array) -> Array:
        """Forced response (N, D)."""
        mixed = self.weights.interpolated(z)
        if len(self.matrices) == 1:
            return self.response.forced(mixed @ self.matrices[0].T)
        return self.response.forced((self.matrices @ mixed[..., None])[..., 0])

    def pulled_back(self, residual: Array) -> Array:
        """The adjoint of `predicted`, (N_S, P)."""
        forces = self.response.forced_transposed(residual)
        if len(self.matrices) == 1:
            return self.weights.transposed(forces @ self.matrices[0])
        return self.weights.transposed((forces[:, None] @ self.matrices)[:, 0])

    def residual(self, z: Array) -> Array:
        """Predicted minus wanted (N, D); 0 in the first two rows."""
        difference = self.predicted(z) - self.targets
        difference[:2] = 0.0
        return difference


class Gap(NamedTuple):
    """How far a feasible point may be from the minimum."""

    absolute: float
    """sum_s (g_s . z_s - min over the feasible set of g_s . z) >= cost - minimum: a rigorous bound for a convex cost."""
    relative: float
    """The same over the cost, or over 1e-9 of sum Y^2 where that is larger."""


FLOOR = 1e-9


@dataclass(frozen=True)
class TrackingProblem:
    """Minimise sum over groups of |residual|^2 + <preference, alpha> + switching/2 |alpha_{s+1} - alpha_s|^2."""

    groups: tuple[Group, ...]
    n_frames: int
    preference: Array | None = None
    """(N_S, F) linear cost of frame activations, or none."""
    switching: float = 0.0
    """Cost of changing frames from one support point to the next."""

    @property
    def n_support(self) -> int:
        """N_S."""
        return int(self.groups[0].weights.n_support)

    @property
    def n_parameters(self) -> int:
        """P = F (1 + d) per support point."""
        return self.groups[0].matrices.shape[2]

    @property
    def n_dimensions(self) -> int:
        """d."""
        return self.n_parameters // self.n_frames - 1

    @property
    def n_points(self) -> int:
        """Points that are tracked, summed over demonstrations and steps."""
        return sum((len(group.targets) - 2) * group.targets.shape[1] for group in self.groups) // self.n_dimensions

    @cached_property
    def scale(self) -> float:
        """sum Y^2: the cost of predicting nothing."""
        return float(sum((group.targets[2:] ** 2).sum() for group in self.groups))

    def error(self, z: Array) -> float:
        """J = sum of squared tracking errors (4.12), (4.29)."""
        return float(sum((group.residual(z) ** 2).sum() for group in self.groups))

    def cost_and_gradient(self, z: Array) -> tuple[float, Array]:
        """The whole cost and its gradient (N_S, P)."""
        residuals = [group.residual(z) for group in self.groups]
        cost = float(sum((residual**2).sum() for residual in residuals))
        pulled = [group.pulled_back(residual) for group, residual in zip(self.groups, residuals, strict=True)]
        gradient = 2.0 * np.sum(pulled, axis=0)
        alpha = z[:, : self.n_frames]
        if self.preference is not None:
            cost += float((self.preference * alpha).sum())
            gradient[:, : self.n_frames] += self.preference
        if self.switching:
            change = self.switching * np.diff(alpha, axis=0)
            cost += 0.5 * float((change**2).sum()) / self.switching
            gradient[:-1, : self.n_frames] -= change
            gradient[1:, : self.n_frames] += change
        return cost, gradient

    def gap(self, z: Array, cost: float, gradient: Array) -> Gap:
        """The certificate at a feasible z, from its cost and gradient."""
        alpha_part, rho_part = split(gradient, self.n_frames)
        reach = alpha_part - np.abs(rho_part).sum(axis=-1)
        absolute = float((gradient * z).sum() - reach.min(axis=1).sum())
        return Gap(absolute, absolute / max(cost, FLOOR * self.scale))

    def with_last(self, z: Array) -> "TrackingProblem":
        """The problem of all support points but the last, whose activations (P,) are given."""
        alone = np.zeros((self.n_support, self.n_parameters))
        alone[-1] = z
        groups = tuple(
            group._replace(weights=group.weights.without_last(), targets=group.targets - group.predicted(alone))
            for group in self.groups
        )
        return TrackingProblem(groups, self.n_frames)

    def uniform(self) -> Array:
        """The middle of the feasible set (N_S, P): all frames alike, every offset 0."""
        z = np.zeros((self.n_support, self.n_parameters))
        z[:, : self.n_frames] = 1.0 / self.n_frames
        return z
