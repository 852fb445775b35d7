"""Two frames, two demonstrations, one sequence of activations (thesis 4.3, Figure 4.2).

Both movements begin at one place of the first frame, pass a target in it and end at a target in the second one. No single frame
explains both; the optimum changes frames where their precision (the inverse of the variance over the demonstrations) does.
"""

from pathlib import Path

import numpy as np

from lfd_gym.experiments.figures import panels, save
from lfd_gym.experiments.rows import Rows, markdown
from policies.moa.frames import Frames
from policies.moa.mixture_of_attractors import MixtureOfAttractors
from policies.sequence_graph_drawing import COLOURS

N_STEPS, DT, N_SUPPORT = 150, 0.02, 15
PHASES = {"at the first target": slice(50, 70), "at the second target": slice(130, 150)}
FAR = 1e-9


def scene(angle: float, place: tuple[float, float]) -> tuple[np.ndarray, Frames]:
    """A demonstration (N, 2) [m] with its second frame turned by an angle [rad] at a place [m]."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    frames = Frames(np.array([[0.0, 0.0], place]), np.array([np.eye(2), turn]))
    corners = np.array([[0.0, 0.0], [0.2, 0.1], np.array(place) + turn @ [0.05, 0.1]])
    rest = np.tile(corners[1], (20, 1))
    return np.vstack([_reach(corners[0], corners[1], 50), rest, _reach(corners[1], corners[2], 80)]), frames


def _reach(start: np.ndarray, end: np.ndarray, n: int) -> np.ndarray:
    s = np.minimum(np.linspace(0.0, 1.25, n), 1.0)[:, None]
    return start + (end - start) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def run(out: Path, quick: bool, jobs: int) -> str:
    """Fit, and compare activations with precisions."""
    del jobs
    scenes = [scene(0.3, (0.5, 0.2)), scene(-0.8, (0.45, -0.2))]
    model = MixtureOfAttractors(N_SUPPORT, dt=DT, aligned=True)
    model.fit([points for points, _ in scenes], [frames for _, frames in scenes])
    local = np.array([frames.local(points) for points, frames in scenes])
    precision = 1.0 / (local.var(axis=0).sum(axis=2) + FAR)
    share = precision / precision.sum(axis=1, keepdims=True)
    figure, (left, right) = panels(2)
    for i, (x, frame) in enumerate(scenes):
        left.plot(*x.T, color=COLOURS[i], label=f"demonstration {i + 1}")
        left.plot(*model.predict(frame, x[0], x[1]).T, "k--", linewidth=0.8, label=None if i else "MoA")
        left.plot(*frame.origins.T, "x", color=COLOURS[i], label=f"its frames {i + 1}")
    left.set(aspect="equal", xlabel="x", ylabel="y")
    left.legend(fontsize=8)
    time = DT * np.arange(N_STEPS)
    for f in range(2):
        right.plot(time, model.frame_activations_[:, f], color=COLOURS[f], label=f"activation of frame {f + 1}")
        right.plot(time, share[:, f], ":", color=COLOURS[f], label=f"share of precision, frame {f + 1}")
    right.set_xlabel("time [s]")
    right.legend(fontsize=7)
    save(figure, Rows(out, quick).folder / "toy.png")
    error = 1000.0 * np.sqrt(np.mean([(r**2).sum(axis=1).mean() for r in model.residuals_]))
    both = np.hstack([model.frame_activations_, share])
    table = [[name, *(f"{value:.2f}" for value in both[at].mean(axis=0))] for name, at in PHASES.items()]
    header = ["phase", "activation of frame 1", "of frame 2", "share of precision, frame 1", "frame 2"]
    return markdown(header, table) + f"\n\nRoot mean square error {error:.1f} mm, J_sparsity {model.sparsity_:.2f}."
