"""Words on boards that stand where they never stood before: MoA and what it is compared with (Figures 4.5 and 4.6).

GMR knows no board, only the world; it is there to show what the frames are for.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from lfd_gym.alphabet import sample, strokes
from lfd_gym.demonstration import Demonstration
from lfd_gym.experiments.figures import save
from lfd_gym.experiments.learning import demonstrations, teacher
from lfd_gym.experiments.rows import Rows, markdown, solved
from lfd_gym.ink import HALF_SIZE, SPACING
from lfd_gym.registry import load
from lfd_gym.report.figures import GOAL, STYLE
from lfd_gym.rollout import TeacherPolicy, rollout
from lfd_gym.seeds import DEVELOPMENT_SEED, FINAL_SEED
from policies import LEARNERS
from policies.moa.frames import Frames
from policies.task_data import WORLD

ENV_ID = "lfd_gym/Whiteboard-v0"
METHODS = ("moa", "tp-gmm", "var-dmp", "gmr")
N_DEMONSTRATIONS = 6
TEACHING_SEEDS = range(3)
EPISODES, EPISODES_OF_ONE = 100, 50
STAGES = {"one demonstration": True, "one demonstration, no second stage": False}
"""Skills from a single demonstration, with and without the criterion that picks one of many equal solutions."""
PICTURED = (FINAL_SEED, DEVELOPMENT_SEED)
"""Episodes whose ink is kept for the figure."""
PALE = "#c9d7e6"


class Written(NamedTuple):
    """What one episode left on the boards."""

    seed: int
    success: bool
    coverage: float
    precision: float
    distance: float | None
    """Median distance of the ink to the nearest wanted stroke [m]; None without ink."""
    boards: tuple[tuple[str, list[list[float]]], ...]
    """Per board its word, and of the first episode the places of the ink [m]."""


def run(out: Path, quick: bool, jobs: int) -> str:
    """Learn from six noise-1 demonstrations of each teaching seed; write on 100 boards. The teacher is shown for comparison."""
    rows, seeds = Rows(out, quick, jobs), TEACHING_SEEDS[: 1 if quick else None]
    shown = rows.observed("teacher", ENV_ID, lambda: TeacherPolicy(teacher(ENV_ID, 1.0)), write, EPISODES)
    pictures, table = {"teacher": shown[0]["boards"]}, [["teacher", "", *_cells([shown]), ""]]
    for method in METHODS:
        written = [_written(rows, method, seed, N_DEMONSTRATIONS, EPISODES) for seed in seeds]
        pictures[method] = written[0][0]["boards"]
        table.append(
            [method, str(N_DEMONSTRATIONS), *_cells(written), _sparsity(rows, method, seeds, N_DEMONSTRATIONS)]
        )
    for name, second_stage in STAGES.items():
        settings = {"second_stage": second_stage}
        written = [_written(rows, "moa", seed, 1, EPISODES_OF_ONE, **settings) for seed in seeds]
        table.append([f"moa, {name}", "1", *_cells(written), _sparsity(rows, "moa", seeds, 1, **settings)])
    _draw(rows.folder / "writing.png", pictures)
    header = ["method", "demonstrations", "success %", "of each teaching seed", "coverage %", "precision %"]
    return markdown([*header, "ink to stroke [mm]", "J_sparsity"], table)


def paths(shown: Sequence[Demonstration]) -> tuple[list[Any], list[Frames]]:
    """What the skill's path is learned from: tool points (N_m, 3), and the frames of the world and the boards."""
    frames = ["frame_board_1", "frame_board_2"]
    poses = [np.array([WORLD, *(one.observations[name][0] for name in frames)]) for one in shown]
    return [one.observations["tool_position"] for one in shown], [Frames.of_poses(pose) for pose in poses]


def _name(method: str, seed: int, n: int, **settings: Any) -> str:
    return "-".join([method, str(seed), str(n), *(f"{key}-{value}" for key, value in settings.items())])


def _learner(method: str, seed: int, n: int, **settings: Any) -> Any:
    return load(LEARNERS[method])(**settings).fit(demonstrations(ENV_ID, N_DEMONSTRATIONS, seed)[:n])


def _written(rows: Rows, method: str, seed: int, n: int, episodes: int, **settings: Any) -> list[dict[str, Any]]:
    def skill() -> Any:
        return _learner(method, seed, n, **settings).skill_

    return rows.observed(_name(method, seed, n, **settings), ENV_ID, skill, write, episodes)


def _sparsity(rows: Rows, method: str, seeds: Sequence[int], n: int, **settings: Any) -> str:
    """J_sparsity (4.32) of the mixtures of every teaching seed; other methods have none."""
    if method != "moa":
        return ""
    values = [
        rows.kept(
            f"{_name(method, seed, n, **settings)}-sparsity",
            lambda seed=seed: _learner(method, seed, n, **settings).model_.sparsity_,  # type: ignore[misc]
        )
        for seed in seeds
    ]
    return ", ".join(f"{value:.2f}" for value in values)


def write(env: Any, policy: Any, seed: int) -> Written:
    """One episode: its success and figures, and the distance from every inked cell to the nearest wanted stroke."""
    info: dict[str, Any] = {}
    for step in rollout(env, policy, seed):
        info = step.info
    world = env.unwrapped
    measures = world.measures()
    off = np.concatenate(
        [distances(board.points(), word) for board, word in zip(world.boards, world.words, strict=True)]
    )
    return Written(
        seed,
        bool(info["is_success"]),
        measures["coverage"],
        measures["precision"],
        float(np.median(off)) if off.size else None,
        tuple(
            (word, board.points().round(4).tolist() if seed in PICTURED else [])
            for board, word in zip(world.boards, world.words, strict=True)
        ),
    )


def distances(points: np.ndarray, word: str) -> np.ndarray:
    """Of points (n, 2) of a board to the nearest point of a word's strokes (n,) [m]."""
    wanted = np.concatenate([sample(stroke, SPACING) for stroke in strokes(word)])
    return np.asarray(np.linalg.norm(points[:, None] - wanted, axis=2).min(axis=1))


def _cells(written: Sequence[Sequence[dict[str, Any]]]) -> list[str]:
    episodes = [episode for rows in written for episode in rows]
    each = [sum(episode["success"] for episode in rows) for rows in written]
    inked = [1000.0 * episode["distance"] for episode in episodes if episode["distance"] is not None]
    return [
        solved(episodes),
        ", ".join(f"{100.0 * count / len(written[0]):.0f}" for count in each),
        *(f"{100.0 * np.mean([episode[name] for episode in episodes]):.1f}" for name in ("coverage", "precision")),
        f"{np.median(inked):.1f}" if inked else "no ink",
    ]


def _draw(path: Path, pictures: dict[str, Sequence[tuple[str, Sequence[Sequence[float]]]]]) -> None:
    """The boards of the first setup: a column for every method, taught by the first seed, the wanted strokes pale."""
    n_boards = len(next(iter(pictures.values())))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(2.6 * len(pictures), 1.9 * n_boards), layout="constrained")
        grid = figure.subplots(n_boards, len(pictures), squeeze=False)
    for column, (method, boards) in zip(grid.T, pictures.items(), strict=True):
        column[0].set_title(method, fontsize=9)
        for axes, (word, points) in zip(column, boards, strict=True):
            for stroke in strokes(word):
                axes.plot(*np.transpose(stroke), color=PALE, linewidth=6, solid_capstyle="round")
            if points:
                axes.plot(*np.transpose(points), ".", color=GOAL, markersize=2)
            axes.set(xlim=(-HALF_SIZE[0], HALF_SIZE[0]), ylim=(-HALF_SIZE[1], HALF_SIZE[1]), xticks=[], yticks=[])
            axes.set_aspect("equal")
    figure.suptitle(f"one setup, skills of teaching seed {TEACHING_SEEDS[0]}", fontsize=9)
    save(figure, path)
