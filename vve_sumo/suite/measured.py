"""What a drive's record says of how the test was driven: the approach, the cut-in, and the braking asked for.

Reads records of drives; judges nothing.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from vve_sumo.drive.resolved_scenario import read_resolved, recorded_model
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.record.reader import read_table
from vve_sumo.suite.row import CutIn, SuiteRow
from vve_sumo.values import Floats, Vehicle

BRAKING = 0.15 * GRAVITY  #: the car brakes when it decelerates by more [m/s2]; FMVSS 127, S4 [P]

MOVING = 0.5  #: slower, brakes hold the car rather than slow it [m/s]
#: columns of the ego's truth and of an actor's row
EGO = ("x_m", "y_m", "heading_rad", "speed_mps")


class RowMeasurement(NamedTuple):
    """What was found; None for what the row does not ask for, and where its target never entered."""

    approach: tuple[float, float] | None = None  #: least and greatest speed of it [m/s]
    ttc: float | None = None  #: time to collision of a cut-in [s]
    demand: float | None = None  #: the most asked of the service brakes, as a deceleration of the declared car [m/s2]


def measure(row: SuiteRow, record: Path) -> RowMeasurement:
    """Return what the record of a row's drive says."""
    if row.approach is None:
        return RowMeasurement()
    ticks, actors = read_table(record, "ticks"), read_table(record, "actors")
    seen = actors.filter(pc.equal(actors["actor"], row.approach.target))
    if not seen.num_rows:
        return RowMeasurement()
    entry = int(seen["tick"][0].as_py()) - int(ticks["tick"][0].as_py())
    if entry >= ticks.num_rows:  # what the street held after the last tick: nothing was driven with it
        return RowMeasurement()
    car = recorded_model(read_resolved(record)).vehicle
    cut, ttc = (None, None) if row.cut_in is None else _cut_in(row.cut_in, ticks, seen, car)
    return RowMeasurement(_speeds(ticks, entry, cut), ttc, _demand(ticks, entry, car) if row.demand > 0.0 else None)


def _demand(ticks: pa.Table, entry: int, car: Vehicle) -> float:
    """Return the most torque asked of the service brakes after the entry, over the declared mass and wheels [m/s2]."""
    torque, speed = (ticks[name].to_numpy()[entry:] for name in ("brake_torque_nm", "true_speed_mps"))
    return float(torque[speed > MOVING].max(initial=0.0)) / (car.mass * car.wheel_radius)


def _speeds(ticks: pa.Table, entry: int, cut: int | None) -> tuple[float, float]:
    """Least and greatest speed from the tick of the entry to the braking, the contact or the cut-in."""
    speed = ticks["true_speed_mps"].to_numpy()
    over = ticks["emergency"].to_numpy() | (ticks["true_acceleration_mps2"].to_numpy() < -BRAKING)
    over |= pc.not_equal(ticks["contacts"], "").to_numpy()
    if cut is not None:
        over[cut] = True
    ends = np.flatnonzero(over[entry:])
    approach = speed[entry : entry + max(int(ends[0]), 1)] if len(ends) else speed[entry:]
    return float(approach.min()), float(approach.max())


def _cut_in(wanted: CutIn, ticks: pa.Table, seen: pa.Table, car: Vehicle) -> tuple[int | None, float | None]:
    """Return the tick at which the target's near side has come over the lane's edge, and the time to collision."""
    at = seen["tick"].to_numpy() - int(ticks["tick"][0].as_py())
    known = at < ticks.num_rows
    rows, at = seen.filter(pa.array(known)), at[known]
    back, side, closing = _from_ego(rows, {name: ticks[f"true_{name}"].to_numpy()[at] for name in EGO})
    inside = np.flatnonzero(side + ticks["lateral_deviation_m"].to_numpy()[at] < wanted.lane_edge)
    if not len(inside):
        return None, None
    first = int(inside[0])
    if not closing[first] > 0.0:
        return int(at[first]), math.inf
    return int(at[first]), float((back[first] - car.rear_axle_to_bumper) / closing[first])


def _from_ego(rows: pa.Table, ego: dict[str, Floats]) -> tuple[Floats, Floats, Floats]:
    """Return how far ahead of the ego's rear axle the boxes' hindmost corners are, how far to the left their rightmost
    ones [m], and how fast the ego closes in [m/s].
    """
    x, y, heading, speed = (rows[name].to_numpy() for name in EGO)
    dx, dy = x - ego["x_m"], y - ego["y_m"]
    cos, sin = np.cos(ego["heading_rad"]), np.sin(ego["heading_rad"])
    turned = heading - ego["heading_rad"]
    along, across = np.abs(np.cos(turned)), np.abs(np.sin(turned))
    length, width = (0.5 * rows[name].to_numpy() for name in ("length_m", "width_m"))
    ahead = dx * cos + dy * sin - length * along - width * across
    left = dy * cos - dx * sin - length * across - width * along
    return ahead, left, ego["speed_mps"] - speed * np.cos(turned)
