"""The report as one self-contained HTML page."""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from lfd_gym.evaluation import Episode, EvaluationReport
from lfd_gym.recording import Recording
from lfd_gym.registry import kebab_case

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 1080px; margin: 2rem auto; padding: 0 1rem; color: #222 }
h1 { margin-bottom: .2rem } h2 { margin-top: 2.2rem } img, video { max-width: 100%; height: auto }
table { border-collapse: collapse } td, th { padding: .25rem .9rem; border-bottom: 1px solid #ddd; text-align: right }
td:first-child, th:first-child { text-align: left } .rate { font-size: 1.5rem }
.note { background: #fff4d6; padding: .5rem 1rem }
figure { margin: 1.5rem 0 } figcaption { color: #555 } code { background: #f3f3f3; padding: 0 .3rem }
"""


def page(
    recording: Recording,
    evaluation: EvaluationReport,
    figures: Mapping[str, bytes],
    seed: int,
    notes: Sequence[str],
) -> str:
    """The whole page; figures are embedded, the video lies beside it."""
    task = kebab_case(evaluation.env_id)
    low, high = evaluation.wilson
    n = len(evaluation.episodes)
    first, last = evaluation.episodes[0].seed, evaluation.episodes[-1].seed
    failed = [episode for episode in evaluation.episodes if not episode.success]
    shown = len(recording.demonstrations)
    discarded = f" ({len(recording.discarded)} failed attempts were not shown to it)" if recording.discarded else ""
    parts = [
        f"<h1>{escape(task.replace('-', ' ').capitalize())}, learned from {shown} demonstrations</h1>",
        f"<p>A simulated Barrett WAM was shown the task {shown} times by a noisy scripted teacher{discarded}, learned "
        "attractor goals, a sequence graph and transition classifiers, and then met setups that it had never seen.</p>",
        f"<p class=rate><b>{evaluation.successes} of {n}</b> unseen setups solved: {evaluation.success_rate:.1%}, "
        f"95 % Wilson interval {low:.1%} to {high:.1%} (seeds {first} to {last})</p>",
        *(f"<p class=note>{escape(note)}</p>" for note in notes),
        "" if notes or not _has_strip(figures) else "<video src='video.mp4' controls loop muted></video>",
        *(_figure(caption, data) for caption, data in figures.items()),
        "<h2>Failures</h2>",
        _episodes(failed) if failed else "<p>None.</p>",
        "<h2>Demonstrations</h2>",
        _demonstrations(recording),
        "<h2>All episodes</h2>",
        _episodes(evaluation.episodes),
        "<h2>Versions</h2>",
        _table(("package", "version"), evaluation.versions.items()),
        f"<p>See it again: <code>lfd-gym render skill.npz {task} --seed {seed} --out again.mp4</code></p>",
    ]
    head = f"<meta charset=utf-8><title>lfd_gym: {escape(task)}</title><style>{STYLE}</style>"
    body = "\n".join(part for part in parts if part)
    return f"<!doctype html><html lang=en>{head}\n{body}\n</html>\n"


def _has_strip(figures: Mapping[str, bytes]) -> bool:
    return any(caption.startswith("One reproduction") for caption in figures)


def _figure(caption: str, data: bytes) -> str:
    encoded = base64.b64encode(data).decode()
    alt = escape(caption, quote=True)
    return f"<figure><img alt='{alt}' src='data:image/png;base64,{encoded}'><figcaption>{alt}</figcaption></figure>"


def _episodes(episodes: Sequence[Episode]) -> str:
    names = list(dict.fromkeys(name for episode in episodes for name in episode.subtasks))
    rows = [
        (e.seed, "yes" if e.success else "no", f"{e.seconds:.1f}", *_marks(e, names), e.error or "") for e in episodes
    ]
    return _table(("seed", "success", "seconds", *(name.replace("_", " ") for name in names), "error"), rows)


def _marks(episode: Episode, names: Sequence[str]) -> list[str]:
    return ["yes" if episode.subtasks.get(name, False) else "no" for name in names]


def _demonstrations(recording: Recording) -> str:
    rows = []
    for demonstration in recording.demonstrations:
        labels = [int(label) for label in demonstration.labels]
        order = [b for a, b in zip([-1, *labels], labels, strict=False) if b != a and b >= 0]
        sequence = ", ".join(demonstration.primitives[label].name.replace("_", " ") for label in order)
        rows.append((demonstration.seed["index"], f"{demonstration.duration:.1f}", sequence))
    return _table(("index", "seconds", "primitives"), rows)


def _table(head: Sequence[str], rows: Any) -> str:
    cells = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(value))}</td>" for value in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{body}</table>"
