"""The parameter space of a steering law: for which gains its poles lie where they shall, speed by speed.

Draws planes of gains that were computed elsewhere; computes nothing that is not drawn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from vve_sumo.plotting.page import ALARM, EGO, EGO_PALE, INK, PAPER, QUIET
from vve_sumo.plotting.style import WIDTH, name, page, plain
from vve_sumo.values import Floats

#: panels in a row, and at most
IN_A_ROW, MOST = 3, 9
#: what of an axis is shown beyond the good gains
ROOM: Final = 1.35


class GainsPlane(NamedTuple):
    """What is drawn of the plane of gains at one speed."""

    speed: float  #: [m/s]
    proportional: Floats  #: of the grid's columns [rad/m]
    derivative: Floats  #: of the grid's rows [rad s/m]
    good: Any  #: whether the gains are good, a row for each derivative gain
    boundaries: Sequence[tuple[bool, Floats]]  #: whether of a real pole, and gains (n, 2) with a pole on the edge
    driven: tuple[float, float]  #: gains of the law that drives
    driven_is_good: bool
    central: tuple[float, float] | None  #: gains farthest from the edge of the good ones


def parameter_space(title: str, planes: Sequence[GainsPlane]) -> Figure:
    """Draw the planes of gains over speed: good gains, the boundaries in closed form, the gains that drive.

    Of more speeds than there are panels some between the least and the greatest are drawn.
    """
    shown = [planes[at] for at in sorted({round(at) for at in np.linspace(0, len(planes) - 1, min(len(planes), MOST))})]
    rows = math.ceil(len(shown) / IN_A_ROW)
    with page(WIDTH, 1.2 + 2.5 * rows) as figure:
        name(figure, title)
        panels = figure.subplots(rows, IN_A_ROW, squeeze=False)
        for axes, plane in zip(panels.flat, shown, strict=False):
            _draw(axes, plane)
        for axes in panels.flat[len(shown) :]:
            axes.set_visible(False)
        for axes in panels[:, 0]:
            axes.set_ylabel("kd [rad s/m]")
        for axes in panels[(len(shown) - 1) // IN_A_ROW]:
            axes.set_xlabel("kp [rad/m]")
        figure.legend(handles=_legend(), loc="outside lower left", ncols=2)
        return figure


def _draw(axes: Axes, plane: GainsPlane) -> None:
    plain(axes)
    axes.set_title(f"{plane.speed:.1f} m/s")
    kp, kd = plane.proportional, plane.derivative
    axes.contourf(kp, kd, plane.good.astype(float), levels=(0.5, 1.5), colors=[EGO_PALE], alpha=0.55)
    for real, gains in plane.boundaries:
        axes.plot(*gains.T, color=QUIET, linewidth=1.0 if not real else 1.6, linestyle="-" if not real else "--")
    if plane.central is not None:
        axes.plot(*plane.central, "o", color=EGO, markersize=6.0, markerfacecolor=PAPER, markeredgewidth=1.6)
    axes.plot(*plane.driven, "D" if plane.driven_is_good else "X", color=INK if plane.driven_is_good else ALARM)
    axes.set(xlim=(0.0, _end(plane, 0)), ylim=(0.0, _end(plane, 1)))
    axes.locator_params(axis="x", nbins=3)
    axes.locator_params(axis="y", nbins=4)


def _end(plane: GainsPlane, axis: int) -> float:
    """Return where an axis ends: beyond the good gains and those that drive."""
    gains, whole = (plane.proportional, plane.derivative)[axis], plane.good.any(axis=axis)
    good = float(gains[whole].max()) if whole.any() else 0.0
    return min(float(gains[-1]), ROOM * max(good, plane.driven[axis])) or float(gains[-1])


def _legend() -> list[Any]:
    dot: dict[str, Any] = {"linestyle": "", "markersize": 6.0}
    return [
        Patch(color=EGO_PALE, alpha=0.55, label="good at every mass and delay"),
        Line2D([], [], color=QUIET, linewidth=1.0, label="complex root boundary"),
        Line2D([], [], color=QUIET, linestyle="--", label="real root boundary"),
        Line2D([], [], marker="D", color=INK, label="gains that drive", **dot),
        Line2D([], [], marker="X", color=ALARM, label="gains that drive: outside", **dot),
        Line2D([], [], marker="o", color=EGO, markerfacecolor=PAPER, label="central gains: the schedule", **dot),
    ]
