"""Draws a network from above with the name of every edge beside it, for people who choose the edges of a path.

Each name stands on the right of its edge's lanes, with an arrow in the driving direction. Computes nothing that is not
drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from vve_sumo.errors import ConfigError
from vve_sumo.geometry import Box, overlap
from vve_sumo.plotting.page import INK, PAPER, POINTS_PER_INCH, QUIET, ROAD, STYLE
from vve_sumo.values import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LARGEST, SMALLEST = 6.5, 2.8  #: letters of edges' names [point]
STREET_LETTERS: Final = 7.0  #: of streets' names [point]
LETTER_WIDTH: Final = 0.64  #: of a letter, over its size: a little more than the font's digits
LINE_HEIGHT: Final = 1.15  #: of a line of text, over its letters' size
FITTING: Final = 8.0  #: percentile of the edges' lengths at which a name of SMALLEST letters still fits
WIDEST, NARROWEST = 44.0, 8.0  #: of the picture's longer side [inch]
DOTS_PER_INCH: Final = 200
LANE_WIDTH: Final = 3.2  #: drawn [m]
BORDER: Final = 0.3  #: around the network [inch]
#: places along an edge where its name is tried, over its length, and how many lines farther out
ALONG: Final = (0.5, 0.4, 0.6, 0.3, 0.7, 0.2, 0.8)
OUTWARD: Final = (0, 1, 2, 3)
AROUND: Final = 60.0  #: drawn around the streets that are asked for [m]
FORMATS: Final = (".png", ".svg", ".pdf")


class DrawnEdge(NamedTuple):
    """An edge as it is drawn."""

    name: str  #: SUMO's
    street: str  #: name of its street; empty for none
    shape: Floats  #: middle of its lanes, in driving direction (n, 2), map [m]
    lanes: int
    drivable: bool  #: whether cars may drive on it


class _Label(NamedTuple):
    text: str
    x: float  #: middle of the text, map [m]
    y: float
    angle: float  #: of the text, upright [rad]
    size: float  #: of its letters [point]
    foot: tuple[float, float]  #: the edge's place that it belongs to, map [m]
    away: bool  #: whether it stands so far from the edge that a line leads there


def draw(edges: Sequence[DrawnEdge], file: Path, title: str) -> list[str]:
    """Write the picture, a .png, .svg or .pdf file; return the names of edges that there was no room for.

    Raises ConfigError for another file, a folder that is not there, and where there is no edge.
    """
    if file.suffix.lower() not in FORMATS:
        raise ConfigError(f"--out: expected the name of a {', '.join(FORMATS)} file, got {file}")
    if not file.parent.is_dir():
        raise ConfigError(f"--out: expected an existing folder, got {file.parent}")
    if not edges:
        raise ConfigError("nothing to draw: no edge")
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    points = np.concatenate([edge.shape for edge in edges])
    low, span = points.min(axis=0), np.ptp(points, axis=0)
    scale = _scale(edges, float(span.max()))
    labels, unnamed = _labels(edges, scale)
    wide, high = (max(scale * float(length), 1.0) + 2.0 * BORDER for length in span)
    with mpl.rc_context({**STYLE, "svg.fonttype": "none"}):
        figure = Figure(figsize=(wide, high + BORDER), dpi=DOTS_PER_INCH)
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, high / (high + BORDER)))
        _edges(axes, edges, scale)
        _streets(axes, edges)
        _texts(axes, labels)
        middle = low + 0.5 * span
        axes.set_xlim(middle[0] - 0.5 * wide / scale, middle[0] + 0.5 * wide / scale)
        axes.set_ylim(middle[1] - 0.5 * high / scale, middle[1] + 0.5 * high / scale)
        axes.set_axis_off()
        figure.text(BORDER / wide, 1.0 - 0.8 * BORDER / (high + BORDER), title, fontsize=11, fontweight="bold")
        figure.savefig(file, facecolor=PAPER)
    return unnamed


def around_street(edges: Sequence[DrawnEdge], street: str) -> list[DrawnEdge]:
    """Return the edges in the box around those whose street's name contains a text, AROUND [m] wider; none for none."""
    named = [edge.shape for edge in edges if street.lower() in edge.street.lower()]
    if not named:
        return []
    low, high = np.concatenate(named).min(axis=0) - AROUND, np.concatenate(named).max(axis=0) + AROUND
    return [edge for edge in edges if ((edge.shape >= low) & (edge.shape <= high)).all()]


def _scale(edges: Sequence[DrawnEdge], span: float) -> float:
    """Return how many inches a metre of the network is drawn with."""
    needed = [
        SMALLEST * LETTER_WIDTH * (len(edge.name) + 2) / POINTS_PER_INCH / max(_length(edge.shape), 1.0)
        for edge in edges
    ]
    wanted = float(np.percentile(needed, 100.0 - FITTING))
    return min(max(wanted, NARROWEST / max(span, 1.0)), WIDEST / max(span, 1.0))


def _length(shape: Floats) -> float:
    return float(np.sqrt((np.diff(shape, axis=0) ** 2).sum(axis=1)).sum())


def _labels(edges: Iterable[DrawnEdge], scale: float) -> tuple[list[_Label], list[str]]:
    """Return the edges' names where they do not overlap, the longest edges' first, and the names without a place."""
    placed: list[_Label] = []
    taken: dict[tuple[int, int], list[Box]] = {}
    unnamed = []
    cell = LARGEST * LETTER_WIDTH * 20 / POINTS_PER_INCH / scale
    for edge in sorted(edges, key=lambda edge: (-_length(edge.shape), edge.name)):
        for label in _candidates(edge, scale):
            box = _box(label, scale)
            i, j = int(box.x // cell), int(box.y // cell)
            near = [one for a in (-1, 0, 1) for b in (-1, 0, 1) for one in taken.get((i + a, j + b), ())]
            if not any(overlap(box, one) for one in near):
                taken.setdefault((i, j), []).append(box)
                placed.append(label)
                break
        else:
            unnamed.append(edge.name)
    return placed, sorted(unnamed)


def _candidates(edge: DrawnEdge, scale: float) -> Iterable[_Label]:
    """Yield the places where an edge's name may stand, the best first."""
    length = _length(edge.shape)
    letters = len(edge.name) + 2
    fitting = length * scale * POINTS_PER_INCH / (LETTER_WIDTH * letters)
    for size in dict.fromkeys((min(max(fitting, SMALLEST), LARGEST), SMALLEST)):
        half = 0.5 * letters * LETTER_WIDTH * size / POINTS_PER_INCH / scale
        line = LINE_HEIGHT * size / POINTS_PER_INCH / scale
        for outward in OUTWARD:
            for share in ALONG:
                (x, y), heading = _place(edge.shape, share * length, half)
                right = 0.5 * LANE_WIDTH * edge.lanes + (0.6 + outward) * line
                at = x + right * math.sin(heading), y - right * math.cos(heading)
                turned = math.cos(heading) < -1e-9
                text = f"← {edge.name}" if turned else f"{edge.name} →"
                angle = heading + math.pi if turned else heading
                yield _Label(text, *at, angle, size, (x, y), outward > 0)


def _place(shape: Floats, at: float, half: float) -> tuple[tuple[float, float], float]:
    """Return a place along a line [m] and the direction of the line around it."""
    spans = np.sqrt((np.diff(shape, axis=0) ** 2).sum(axis=1))
    s = np.concatenate(([0.0], np.cumsum(spans)))
    x, y = ([float(np.interp(at_s, s, shape[:, axis])) for at_s in (at, at - half, at + half)] for axis in (0, 1))
    return (x[0], y[0]), math.atan2(y[2] - y[1], x[2] - x[1])


def _box(label: _Label, scale: float) -> Box:
    """Return the ground that a label covers."""
    metre = label.size / POINTS_PER_INCH / scale
    long = len(label.text) * LETTER_WIDTH * metre
    return Box(label.x, label.y, label.angle, long, LINE_HEIGHT * metre)


def _edges(axes: Axes, edges: Sequence[DrawnEdge], scale: float) -> None:
    from matplotlib.collections import LineCollection

    wide = [LANE_WIDTH * edge.lanes * scale * POINTS_PER_INCH for edge in edges]
    colours = [ROAD if edge.drivable else "#f0f0ee" for edge in edges]
    axes.add_collection(LineCollection([edge.shape for edge in edges], linewidths=wide, colors=colours, zorder=1))
    for end in (0, -1):
        ends = np.array([edge.shape[end] for edge in edges])
        axes.plot(*ends.T, ".", color=QUIET, markersize=1.2, zorder=2)


def _streets(axes: Axes, edges: Sequence[DrawnEdge]) -> None:
    """Write each street's name once, on the longest of its edges."""
    longest: dict[str, DrawnEdge] = {}
    for edge in edges:
        if edge.street and _length(edge.shape) > _length(longest.get(edge.street, edge).shape) - 1e-9:
            longest[edge.street] = edge
    for street, edge in longest.items():
        (x, y), heading = _place(edge.shape, 0.5 * _length(edge.shape), 0.25 * _length(edge.shape))
        angle = heading + math.pi if math.cos(heading) < -1e-9 else heading
        axes.text(
            x,
            y,
            street,
            fontsize=STREET_LETTERS,
            color="#0072b2",
            rotation=math.degrees(angle),
            rotation_mode="anchor",
            ha="center",
            va="center",
            alpha=0.55,
            zorder=3,
        )


def _texts(axes: Axes, labels: Sequence[_Label]) -> None:
    for label in labels:
        if label.away:
            axes.plot(
                (label.x, label.foot[0]), (label.y, label.foot[1]), color=QUIET, linewidth=0.25, zorder=3, alpha=0.7
            )
        axes.text(
            label.x,
            label.y,
            label.text,
            fontsize=label.size,
            color=INK,
            rotation=math.degrees(label.angle),
            rotation_mode="anchor",
            ha="center",
            va="center",
            zorder=4,
        )
