"""A sequence graph as a picture: nodes in the colour of their primitive, cycles as curved arrows (thesis Figure 2.11)."""

import math
import textwrap
from collections.abc import Sequence
from typing import NamedTuple

import networkx
import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path
from numpy.typing import NDArray

from policies.sequence_graph import START, SequenceGraph

Array = NDArray[np.float64]

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#B8A900", "#999999")
"""Okabe and Ito's, which colour-blind readers can tell apart; primitives beyond the eighth begin anew."""
SIZE = np.array([1.25, 0.62])
"""Width and height of a node [inch]."""
COLUMN, ROW, LINE = 1.85, 1.0, 1.7
"""From one column to the next, one node of a column to the next, and one line to the next [inch]."""
CLEARANCE, PER_COLUMN = 0.22, 0.1
"""How far a curved arrow keeps from the nodes that it passes, and how much more per column [inch]."""
LETTERS = 15
"""In a line of a node's name."""


class _Layout(NamedTuple):
    """Where the nodes stand."""

    place: Array
    """(n_nodes, 2) centres [inch]."""
    layer: NDArray[np.int64]
    """(n_nodes,)."""
    line: NDArray[np.int64]
    """(n_nodes,)."""


def draw_sequence_graph(graph: SequenceGraph, names: Sequence[str] | None = None, columns: int = 10) -> Figure:
    """The graph in the order in which its nodes can be reached, from left to right; edges say how often they were shown.

    Longer arrows curve above the nodes between and those back below them, if no node of their own columns is in the way.
    Dotted ones were never shown. A graph of more than `columns` columns goes on in further lines, every second one from
    right to left. names[label] is a primitive's name.
    """
    layout = _layout(graph, columns)
    curves = {edge: _curve(graph, layout, *edge) for edge in graph.transitions}
    points = np.concatenate([layout.place - SIZE, layout.place + SIZE])
    middles = np.array([_at(curve, 0.5) for curve in curves.values()])
    low = np.minimum(points.min(axis=0), middles.min(axis=0) - 0.3)
    high = np.maximum(points.max(axis=0), middles.max(axis=0) + 0.3)
    figure = Figure(figsize=tuple(high - low), dpi=130)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.axis("off")
    for centre, label, name in zip(layout.place, graph.labels, graph.node_names(names), strict=True):
        style = f"round,pad=0,rounding_size={0.31 if label == START else 0.12}"
        box = FancyBboxPatch(tuple(centre - SIZE / 2), float(SIZE[0]), float(SIZE[1]), boxstyle=style)
        box.set(facecolor=_pale(label), edgecolor="#444444", zorder=2)
        axes.add_patch(box)
        text = "\n".join(textwrap.wrap(name.replace("_", " "), LETTERS))
        axes.text(centre[0], centre[1], text, ha="center", va="center", fontsize=8, zorder=3)
    for edge, curve in curves.items():
        shown = len(graph.transitions[edge])
        arrow = FancyArrowPatch(
            path=Path(curve, [Path.MOVETO, *[Path.CURVE4] * 3]), arrowstyle="-|>", mutation_scale=13
        )
        arrow.set(color="#555555", linestyle="-" if shown else ":", zorder=1)
        axes.add_patch(arrow)
        if shown:
            paper = {"facecolor": "#FFFFFF", "edgecolor": "none", "pad": 0.8}
            x, y = _at(curve, 0.45)
            axes.text(x, y, str(shown), ha="center", va="center", fontsize=8, bbox=paper, zorder=1.5)
    return figure


def _pale(label: int) -> Array:
    """The colour of a primitive, mixed with white so that text is readable on it; the start is white."""
    colour = "#FFFFFF" if label == START else COLOURS[label % len(COLOURS)]
    return 1.0 - 0.45 * (1.0 - np.array(to_rgb(colour)))


def _layout(graph: SequenceGraph, columns: int) -> _Layout:
    layers = _layers(graph)
    columns = math.ceil(len(layers) / math.ceil(len(layers) / columns))
    height = LINE + ROW * (max(len(layer) for layer in layers) - 1)
    layout = _Layout(np.zeros((graph.n_nodes, 2)), *np.zeros((2, graph.n_nodes), dtype=np.int64))
    for i, layer in enumerate(layers):
        line, column = divmod(i, columns)
        x = COLUMN * (column if line % 2 == 0 else columns - 1 - column)
        for j, node in enumerate(layer):
            layout.place[node] = x, ROW * (0.5 * (len(layer) - 1) - j) - height * line
            layout.layer[node], layout.line[node] = i, line
    return layout


def _layers(graph: SequenceGraph) -> list[list[int]]:
    """Nodes by their longest way from the start without going back; within a layer beside those that lead there."""
    drawing = graph.to_networkx()
    depth = networkx.single_source_shortest_path_length(drawing, 0)
    forward = networkx.DiGraph()
    forward.add_nodes_from(drawing)
    forward.add_edges_from((a, b) for a, b in drawing.edges if depth[b] > depth[a])
    rank: dict[int, float] = {}
    layers = []
    for generation in networkx.topological_generations(forward):
        before = {node: [rank[a] for a in forward.predecessors(node)] or [0.0] for node in generation}
        layer = sorted(generation, key=lambda node: (float(np.mean(before[node])), node))
        rank |= {node: j - 0.5 * (len(layer) - 1) for j, node in enumerate(layer)}
        layers.append(layer)
    return layers


def _curve(graph: SequenceGraph, layout: _Layout, a: int, b: int) -> Array:
    """Control points (4, 2) of an arrow from node a to node b, a cubic Bezier curve."""
    start, stop = layout.place[a], layout.place[b]
    columns = int(layout.layer[b] - layout.layer[a])
    if columns == 0:
        return _beside(start, stop)
    answers = columns == -1 and (b, a) in graph.transitions
    if (abs(columns) == 1 and not answers) or layout.line[a] != layout.line[b]:
        start, stop = _border(start, stop), _border(stop, start)
        return np.array([start, (2 * start + stop) / 3, (start + 2 * stop) / 3, stop])
    side = 1.0 if columns > 1 else -1.0
    if not (_is_free(layout, a, side) and _is_free(layout, b, side)) and _is_free(layout, a, -side):
        side = -side
    first, last = sorted((layout.layer[a], layout.layer[b]))
    passed = (layout.layer >= first) & (layout.layer <= last)
    top = (side * layout.place[passed, 1]).max() + SIZE[1] / 2 + CLEARANCE + PER_COLUMN * abs(columns)
    border = np.array([0.0, side * SIZE[1] / 2])
    start, stop = start + border, stop + border
    height = (side * top - 0.125 * (start[1] + stop[1])) / 0.75  # so that its middle is at the top
    return np.array([start, [start[0], height], [stop[0], height], stop])


def _is_free(layout: _Layout, node: int, side: float) -> bool:
    """Whether a node is the last of its column, above (side 1) or below (-1)."""
    column = layout.place[layout.layer == layout.layer[node], 1]
    return bool((side * (column - layout.place[node, 1]) <= 0.0).all())


def _beside(start: Array, stop: Array) -> Array:
    """An arrow within a column: upwards on its right, downwards on its left."""
    side = np.sign(stop[1] - start[1])
    aside = np.array([side * SIZE[0] / 2, 0.0])
    off = np.array([side * (0.25 + 0.15 * abs(stop[1] - start[1])), 0.0])
    return np.array([start + aside, start + aside + off, stop + aside + off, stop + aside])


def _border(centre: Array, towards: Array) -> Array:
    """Where the line from a node's centre to another one leaves the node."""
    along = towards - centre
    return centre + along * min(0.5 * SIZE / np.maximum(np.abs(along), 1e-9))


def _at(curve: Array, t: float) -> Array:
    """Point (2,) of a curve at t in [0, 1]."""
    point: Array = np.array([(1 - t) ** 3, 3 * (1 - t) ** 2 * t, 3 * (1 - t) * t**2, t**3]) @ curve
    return point
