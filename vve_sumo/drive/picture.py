"""Draws `drive.png` from a record: the street from above and the drive over time.

Reads the record's tables and the street's lanes; computes nothing that is not drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa

from vve_sumo.drive.figures import Ahead
from vve_sumo.path import Path
from vve_sumo.values import Floats, Vehicle

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK, EGO, ACTOR, AGAIN, ROAD = "#1b1b1b", "#0072b2", "#d55e00", "#009e73", "#d9d9d6"
#: metres of street shown around the ego's trace
MARGIN = 25.0
#: half of the side of the closer view around the stop [m]
CLOSE_UP = 22.0


@dataclass(frozen=True, slots=True)
class Sheet:
    """Everything that the picture shows."""

    title: str
    subtitle: str
    ticks: pa.Table
    actors: pa.Table
    seen: Ahead
    path: Path
    vehicle: Vehicle
    lanes: Sequence[tuple[Floats, float]]  #: centre line (n x 2) [m] and width [m] of each lane


def trace(ticks: pa.Table) -> tuple[Floats, Floats, Floats]:
    """Return x, y and heading of the rear axle: true where known, else estimated."""
    prefix = "true_" if np.isfinite(ticks["true_x_m"].to_numpy()).any() else ""
    x, y, heading = (ticks[f"{prefix}{name}"].to_numpy() for name in ("x_m", "y_m", "heading_rad"))
    return x, y, heading


def bounds(ticks: pa.Table) -> tuple[float, float, float, float]:
    """Return least x, least y, greatest x and greatest y of what the picture shows of the street [m]."""
    x, y, _ = trace(ticks)
    x, y = x[np.isfinite(x)], y[np.isfinite(y)]
    if len(x) == 0:
        return (0.0, 0.0, 1.0, 1.0)
    return (
        float(x.min()) - MARGIN,
        float(y.min()) - MARGIN,
        float(x.max()) + MARGIN,
        float(y.max()) + MARGIN,
    )


def _box(x: float, y: float, heading: float, length: float, width: float) -> Floats:
    cos, sin = np.cos(heading), np.sin(heading)
    along = np.array([1.0, 1.0, -1.0, -1.0]) * length / 2.0
    left = np.array([1.0, -1.0, -1.0, 1.0]) * width / 2.0
    return np.column_stack((x + along * cos - left * sin, y + along * sin + left * cos))


def _ego_box(sheet: Sheet, row: int) -> Floats:
    x, y, heading = (float(column[row]) for column in trace(sheet.ticks))
    ahead = sheet.vehicle.rear_axle_to_bumper - sheet.vehicle.length / 2.0
    return _box(
        x + ahead * np.cos(heading), y + ahead * np.sin(heading), heading, sheet.vehicle.length, sheet.vehicle.width
    )


def _street(axes: Axes, sheet: Sheet, limits: tuple[float, float, float, float]) -> None:
    from matplotlib.collections import PolyCollection

    roads = [_ribbon(line, width) for line, width in sheet.lanes if len(line) > 1]
    axes.add_collection(PolyCollection(roads, facecolor=ROAD, edgecolor="white", linewidth=0.6, zorder=1))
    stations = np.arange(0.0, sheet.path.length, 2.0)
    points = np.array([sheet.path.at(float(s))[:2] for s in stations])
    axes.plot(points[:, 0], points[:, 1], color=INK, linewidth=0.8, linestyle=(0, (4, 3)), zorder=2, label="path")
    x, y, _ = trace(sheet.ticks)
    axes.plot(x, y, color=EGO, linewidth=2.0, zorder=3, label="ego, rear axle")
    last = sheet.actors["tick"].to_numpy() == int(sheet.ticks["tick"][-1].as_py())
    names = ("x_m", "y_m", "heading_rad", "length_m", "width_m")
    boxes = np.column_stack([sheet.actors[name].to_numpy()[last] for name in names])
    for row, actor in zip(boxes, np.array(sheet.actors["actor"].to_pylist(), object)[last], strict=True):
        colour = ACTOR if actor == sheet.seen.actor[-1] else "#8c8c8c"
        axes.fill(*_box(*row).T, facecolor=colour, edgecolor=INK, linewidth=0.5, zorder=4)
    axes.fill(*_ego_box(sheet, -1).T, facecolor=EGO, edgecolor=INK, linewidth=0.5, zorder=5)
    axes.set(xlim=(limits[0], limits[2]), ylim=(limits[1], limits[3]), xlabel="map x [m]", ylabel="map y [m]")
    axes.set_aspect("equal", adjustable="box", anchor="NW")


def _ribbon(line: Floats, width: float) -> Floats:
    step = np.gradient(line, axis=0)
    size = np.hypot(step[:, 0], step[:, 1])
    size[size == 0.0] = 1.0
    normal = np.column_stack((-step[:, 1] / size, step[:, 0] / size)) * width / 2.0
    return np.vstack((line + normal, (line - normal)[::-1]))


def _over_time(axes: Sequence[Axes], sheet: Sheet) -> None:
    ticks, time = sheet.ticks, sheet.ticks["time_s"].to_numpy()
    prefix = "true_" if np.isfinite(ticks["true_x_m"].to_numpy()).any() else ""
    speed, gap, braking = axes
    speed.plot(time, ticks[f"{prefix}speed_mps"].to_numpy(), color=EGO)
    speed.set_ylabel("speed [m/s]")
    gap.plot(time, sheet.seen.gap, color=ACTOR)
    gap.set_ylabel("gap [m]")
    if np.isfinite(sheet.seen.gap[-1]):
        gap.annotate(
            f"{sheet.seen.gap[-1]:.2f} m",
            (time[-1], sheet.seen.gap[-1]),
            xytext=(-4, 8),
            textcoords="offset points",
            ha="right",
        )
    braking.plot(time, ticks[f"{prefix}acceleration_mps2"].to_numpy(), color=EGO, label="acceleration")
    braking.plot(
        time,
        ticks["granted_acceleration_mps2"].to_numpy(),
        color=AGAIN,
        linewidth=1.0,
        linestyle=(0, (5, 2)),
        label="granted by the gateway",
    )
    braking.set_ylabel("acceleration [m/s²]")
    braking.legend(loc="lower left", frameon=False, fontsize=8)
    braking.set_xlabel("drive time [s]")
    emergency = ticks["emergency"].to_numpy(zero_copy_only=False)
    for each in axes:
        each.fill_between(
            time, 0, 1, where=emergency, transform=each.get_xaxis_transform(), color=ACTOR, alpha=0.15, linewidth=0
        )
        each.grid(alpha=0.3, linewidth=0.5)
        each.set_xlim(time[0], time[-1])


def draw(sheet: Sheet, file: FilePath) -> None:
    """Write the picture of a drive as a PNG file."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context({"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": INK}):
        figure = Figure(figsize=(13.0, 8.0), dpi=120, layout="constrained")
        FigureCanvasAgg(figure)
        grid = figure.add_gridspec(3, 5)
        whole, close = figure.add_subplot(grid[0:2, 0:3]), figure.add_subplot(grid[2, 0:3])
        _street(whole, sheet, bounds(sheet.ticks))
        whole.legend(loc="best", frameon=False, fontsize=8)
        whole.set_title("the street from above", loc="left")
        x, y, _ = trace(sheet.ticks)
        centre_x, centre_y = (float(x[-1]), float(y[-1])) if np.isfinite(x[-1]) else (0.0, 0.0)
        _street(
            close,
            sheet,
            (centre_x - 2 * CLOSE_UP, centre_y - CLOSE_UP / 2, centre_x + 2 * CLOSE_UP, centre_y + CLOSE_UP / 2),
        )
        close.set_title("where it ended", loc="left")
        first = figure.add_subplot(grid[0, 3:5])
        time_axes = [first, *(figure.add_subplot(grid[row, 3:5], sharex=first) for row in (1, 2))]
        _over_time(time_axes, sheet)
        figure.suptitle(f"{sheet.title}\n{sheet.subtitle}", ha="left", x=0.01, fontsize=11)
        figure.savefig(file)
