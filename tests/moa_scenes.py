"""Scenes with a planted Mixture of Attractors: random frames, boxes and activations, and what they draw."""

import numpy as np

from policies.moa.attractors import BoxAttractors, join
from policies.moa.frames import Frames
from policies.moa.response import Response
from policies.moa.setting import Setting
from policies.moa.support_points import interpolation

ALPHA, DT = 40.0, 0.02


def turn(rng, d):
    """A random rotation matrix."""
    q, r = np.linalg.qr(rng.normal(size=(d, d)))
    q = q * np.sign(np.diag(r))
    q[:, 0] *= np.linalg.det(q)
    return q


def random_frames(rng, n_frames, d, n_steps=None):
    """Frames within +-0.3 m at any turn; with n_steps they drift by about 10 cm."""
    origins = rng.uniform(-0.3, 0.3, (n_frames, d))
    axes = np.array([turn(rng, d) for _ in range(n_frames)])
    if n_steps is None:
        return Frames(origins, axes)
    drift = np.linspace(0.0, 0.1, n_steps)[:, None, None] * rng.normal(size=(n_frames, d))
    return Frames(origins + drift, np.tile(axes, (n_steps, 1, 1, 1)))


def planted_activations(rng, n_support, n_frames, d):
    """One frame after the other, and a wandering goal within its box."""
    alpha = np.zeros((n_support, n_frames))
    alpha[np.arange(n_support), np.arange(n_support) * n_frames // n_support] = 1.0
    walk = np.clip(np.cumsum(rng.normal(0.0, 0.3, (n_support, n_frames, d)), axis=0), -0.8, 0.8)
    return join(alpha, alpha[..., None] * walk)


def planted(rng, n_demonstrations=6, n_support=12, n_frames=3, d=2, n_steps=120, moving=False, noise=0.0):
    """Attractors, planted z, and demonstrations (points, frames) that the planted model draws, plus a smooth error [m]."""
    half = rng.uniform(0.1, 0.3, (n_frames, d))
    attractors = BoxAttractors(-half, half)
    z = planted_activations(rng, n_support, n_frames, d)
    frames = [random_frames(rng, n_frames, d, n_steps if moving else None) for _ in range(n_demonstrations)]
    points = [draw(z, attractors, frame, n_steps) for frame in frames]
    t = np.linspace(0.0, 1.0, n_steps)[:, None]
    points = [
        x + noise * np.sin(2 * np.pi * (rng.integers(1, 6, d) * t + rng.uniform(size=d))) * min(1.0, 1e9 * noise)
        for x in points
    ]
    return attractors, z, points, frames


def draw(z, attractors, frames, n_steps):
    """The trajectory of activations z in a scene, from rest at the first goal."""
    mixed = interpolation(n_steps, len(z), 0.1).interpolated(z)
    goals = (attractors.goal_matrix(frames) @ mixed[..., None])[..., 0]
    return Response.of_attractor(ALPHA, None, DT).simulate(goals, goals[0], goals[0])


def setting(attractors, points, frames, n_support):
    """Aligned demonstrations with given attractors."""
    weights = interpolation(len(points[0]), n_support, 0.1)
    warps = [np.arange(len(x), dtype=float) for x in points]
    return Setting(points, frames, attractors, weights, Response.of_attractor(ALPHA, None, DT), warps)


def random_feasible(rng, n_support, n_frames, d):
    """Feasible z, inside and on the boundary."""
    alpha = rng.dirichlet(np.full(n_frames, 0.5), n_support)
    return join(alpha, alpha[..., None] * np.clip(rng.normal(0.0, 0.8, (n_support, n_frames, d)), -1.0, 1.0))
