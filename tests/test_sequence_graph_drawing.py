"""The drawing of a sequence graph is complete and readable."""

import io
import itertools

import numpy as np
import pytest
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from policies.sequence_graph import GRAPHS, SequenceGraph, global_graph, local_graph
from policies.sequence_graph_drawing import draw_sequence_graph

NAMES = ("approach initial", "approach_bulb", "close hand", "unscrew", "open hand", "rotate wrist back", "approach box")
CYCLE = [2, 3, 4, 5]
BULB = [[0, 1, *CYCLE * n, 2, 3, 0, 6, 4, 0] for n in (2, 3, 1)]
"""Labels of three demonstrations of a task with a cycle."""


def boxes_of(figure) -> list[FancyBboxPatch]:
    return [patch for patch in figure.axes[0].patches if isinstance(patch, FancyBboxPatch)]


def arrows_of(figure) -> list[np.ndarray]:
    """Points (n, 2) along every arrow, its head left out."""
    figure.canvas.draw()
    arrows = [patch for patch in figure.axes[0].patches if isinstance(patch, FancyArrowPatch)]
    return [arrow.get_path().interpolated(1).to_polygons(closed_only=False)[0] for arrow in arrows]


def texts_of(figure) -> list[str]:
    return [" ".join(text.get_text().split()) for text in figure.axes[0].texts]


def inside(points: np.ndarray, box: FancyBboxPatch, margin: float = 0.0) -> np.ndarray:
    low, size = np.array([box.get_x(), box.get_y()]) - margin, np.array([box.get_width(), box.get_height()])
    high = low + size + 2 * margin
    return ((points > low) & (points < high)).all(axis=1)


@pytest.mark.parametrize("construct", GRAPHS.values())
def test_every_node_and_every_shown_transition_is_named(construct):
    graph: SequenceGraph = construct(BULB)
    figure = draw_sequence_graph(graph, NAMES)
    counts = [str(len(points)) for points in graph.transitions.values() if points]
    names = [name.replace("_", " ") for name in graph.node_names(NAMES)]
    assert sorted(texts_of(figure)) == sorted([*names, *counts])
    assert len(boxes_of(figure)) == graph.n_nodes
    assert len(arrows_of(figure)) == len(graph.transitions)
    assert "start" in texts_of(figure)


@pytest.mark.parametrize("construct", GRAPHS.values())
@pytest.mark.parametrize("columns", [3, 10])
def test_nodes_lie_apart_and_everything_within_the_figure(construct, columns):
    figure = draw_sequence_graph(construct(BULB), NAMES, columns)
    axes = figure.axes[0]
    corners = [
        np.array([[b.get_x(), b.get_y()], [b.get_x() + b.get_width(), b.get_y() + b.get_height()]])
        for b in boxes_of(figure)
    ]
    for a, b in itertools.combinations(corners, 2):
        assert (np.maximum(a[0], b[0]) - np.minimum(a[1], b[1])).max() > 0.2
    for points in (*corners, *arrows_of(figure)):
        assert (points >= [axes.get_xlim()[0], axes.get_ylim()[0]]).all()
        assert (points <= [axes.get_xlim()[1], axes.get_ylim()[1]]).all()
    assert figure.get_size_inches() == pytest.approx([np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())])


@pytest.mark.parametrize("construct", [global_graph, local_graph])
def test_no_arrow_runs_behind_a_node_that_it_does_not_connect(construct):
    graph = construct(BULB)
    figure = draw_sequence_graph(graph, NAMES)
    boxes = boxes_of(figure)
    for (a, b), points in zip(graph.transitions, arrows_of(figure), strict=True):
        assert inside(points, boxes[a], 0.1).any()
        assert inside(points, boxes[b], 0.1).any()
        assert not any(inside(points, box).any() for i, box in enumerate(boxes) if i not in (a, b))


def test_cycle_returns_on_a_curve_below_and_all_else_runs_straight_to_the_right():
    graph = global_graph(BULB)
    figure = draw_sequence_graph(graph, NAMES)
    back = [edge for edge in graph.transitions if edge[0] > edge[1]]
    assert [graph.labels[node] for node in back[0]] == [5, 2]
    assert len(back) == 1
    floor = min(box.get_y() for box in boxes_of(figure))
    for edge, points in zip(graph.transitions, arrows_of(figure), strict=True):
        if edge in back:
            assert points[:, 1].min() < floor
        else:
            ends = points[[0, -1]]
            assert ends[1, 0] > ends[0, 0]
            along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
            assert np.abs((points - ends[0]) @ [-along[1], along[0]]).max() < 1e-6


def test_same_primitive_has_the_same_colour_and_the_start_is_white():
    graph = global_graph(BULB)
    colours = [box.get_facecolor() for box in boxes_of(draw_sequence_graph(graph, NAMES))]
    assert colours[0] == (1.0, 1.0, 1.0, 1.0)
    for (a, colour_a), (b, colour_b) in itertools.combinations(zip(graph.labels, colours, strict=True), 2):
        assert (colour_a == colour_b) == (a == b)


def test_transitions_that_were_never_shown_are_dotted():
    graph = GRAPHS["fully-connected"](BULB)
    figure = draw_sequence_graph(graph, NAMES)
    arrows = [patch for patch in figure.axes[0].patches if isinstance(patch, FancyArrowPatch)]
    assert [arrow.get_linestyle() == ":" for arrow in arrows] == [not points for points in graph.transitions.values()]


def test_long_graph_goes_on_in_further_lines():
    figure = draw_sequence_graph(global_graph([list(range(24))]), columns=10)
    assert len({round(box.get_y(), 3) for box in boxes_of(figure)}) == 3
    assert figure.get_size_inches()[0] < 20


def test_equal_graphs_give_equal_pictures():
    pictures = []
    for _ in range(2):
        buffer = io.BytesIO()
        draw_sequence_graph(global_graph(BULB), NAMES).savefig(buffer, format="png", metadata={"Software": None})
        pictures.append(buffer.getvalue())
    assert pictures[0] == pictures[1]
    assert len(pictures[0]) > 10000
