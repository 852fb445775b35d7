"""The demo's report: what was shown, what was learned, and how well it works on setups never seen."""

import json
from pathlib import Path
from typing import Any

from lfd_gym import rendering
from lfd_gym.errors import RenderingUnavailableError
from lfd_gym.evaluation import EvaluationReport
from lfd_gym.paths import written_whole
from lfd_gym.recording import Recording
from lfd_gym.registry import make
from lfd_gym.report import figures
from lfd_gym.report.page import page
from lfd_gym.report.trace import Trace, trace
from policies.sequence_graph_drawing import draw_sequence_graph

VIDEO = "video.mp4"
STRIP = 6
"""Pictures of the film strip."""


def write_report(
    folder: Path, recording: Recording, skill: Any, evaluation: EvaluationReport, video: bool = True
) -> list[str]:
    """Write index.html, report.json and, if there is OpenGL, video.mp4; returns what the reader should know.

    The video and the plots over time show one episode again, the first solved one (or the first).
    """
    solved = [episode.seed for episode in evaluation.episodes if episode.success]
    seed = solved[0] if solved else evaluation.episodes[0].seed
    reproduction = trace(evaluation.env_id, skill, seed)
    notes = []
    pictures: list[Any] = []
    if video:
        try:
            pictures = _film(folder / VIDEO, evaluation.env_id, skill, seed)
        except RenderingUnavailableError as error:
            notes.append(f"no video: {error}")
    html = page(recording, evaluation, _figures(recording, skill, evaluation, reproduction, pictures), seed, notes)
    data = evaluation.to_dict() | {
        "demonstrations": [dict(demonstration.seed) for demonstration in recording.demonstrations],
        "discarded": recording.discarded,
        "graph": skill.graph.to_dict() if hasattr(skill, "graph") else None,
    }
    with written_whole(folder / "report.json") as temporary:
        temporary.write_text(json.dumps(data, indent=2) + "\n")
    with written_whole(folder / "index.html") as temporary:
        temporary.write_text(html, encoding="utf-8")
    return notes


def _figures(
    recording: Recording, skill: Any, evaluation: EvaluationReport, reproduction: Trace, pictures: list[Any]
) -> dict[str, bytes]:
    """Caption -> PNG, in the order of the page."""
    drawn = {}
    if pictures:
        drawn["One reproduction of the learned skill"] = figures.film_strip(pictures)
    drawn["Success and the parts of the task, with 95 % Wilson intervals"] = figures.success(evaluation)
    if hasattr(skill, "graph"):
        drawn["The learned sequence graph: nodes activate primitives, edges say how often a transition was shown"] = (
            figures.png(draw_sequence_graph(skill.graph, skill.primitive_names))
        )
    drawn["Trajectories of demonstrations and reproduction, and learned goals, in each primitive's own frame"] = (
        figures.goals(recording.demonstrations, reproduction, skill)
    )
    drawn[f"The reproduction with seed {reproduction.seed} over time"] = figures.timeline(reproduction)
    return drawn


def _film(path: Path, env_id: str, skill: Any, seed: int) -> list[Any]:
    """Write the video and return a few of its pictures, evenly spread."""
    rendering.prepare()
    env = make(env_id, render_mode="rgb_array")
    kept: list[Any] = []
    try:
        rendering.write_video(path, _keeping(rendering.frames(env, skill, seed), kept))
    finally:
        env.close()
    return [kept[round(i * (len(kept) - 1) / (STRIP - 1))] for i in range(STRIP)] if kept else []


def _keeping(pictures: Any, kept: list[Any]) -> Any:
    """Pass pictures on and keep every tenth, and the last one."""
    picture = None
    for i, picture in enumerate(pictures):
        if i % 10 == 0:
            kept.append(picture)
        yield picture
    if picture is not None:
        kept.append(picture)
