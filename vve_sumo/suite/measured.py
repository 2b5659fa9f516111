"""Measures how a test was driven, from the record: approach, cut-in, braking demand, distance from bodies and path.

Reads records of drives; judges nothing.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.analysis.string_stability import head_to_tail
from vve_sumo.drive.resolved_scenario import recorded_model
from vve_sumo.geometry import Boxes, distance, vehicle_boxes
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.record.declared import read_resolved
from vve_sumo.record.reader import read_table
from vve_sumo.suite.row import CutIn, RequiredString, SuiteRow
from vve_sumo.values import Floats, Vehicle

BRAKING = 0.15 * GRAVITY  #: the car brakes when it decelerates by more [m/s2]; FMVSS 127, S4 [P]

MOVING = 0.5  #: below this speed the brakes hold the car [m/s]
#: columns of the ego's truth and of an actor's row
EGO = ("x_m", "y_m", "heading_rad", "speed_mps")


class RowMeasurement(NamedTuple):
    """The measured values; None for values that the row does not need, and where its target never entered."""

    approach: tuple[float, float] | None = None  #: least and greatest speed of it [m/s]
    ttc: float | None = None  #: time to collision of a cut-in, as if the car had not braked before it [s]
    demand: float | None = None  #: largest demand on the service brakes, as a deceleration of the declared car [m/s2]
    clearance: float | None = None  #: least distance between the car's body and any actor's [m]
    off_path: float | None = None  #: distance of the true rear axle from the path at the last tick [m]
    head_to_tail: float | None = None  #: a platoon's, by root of the sum of squares; None where it never settles


def measure(row: SuiteRow, record: Path) -> RowMeasurement:
    """Return the measured values of a row's drive."""
    if row.approach is None:
        return RowMeasurement()
    ticks, actors = read_table(record, "ticks"), read_table(record, "actors")
    target_rows = actors.filter(pc.equal(actors["actor"], row.approach.target))
    if not target_rows.num_rows:
        return RowMeasurement()
    entry = int(target_rows["tick"][0].as_py()) - int(ticks["tick"][0].as_py())
    if entry >= ticks.num_rows:  # the target entered after the last tick
        return RowMeasurement()
    car = recorded_model(read_resolved(record)).vehicle
    ends = _ends(ticks, entry)
    cut, ttc = (None, None) if row.cut_in is None else _cut_in(row.cut_in, ticks, target_rows, car, ends)
    approach = _speeds(ticks, entry, ends if cut is None else min(cut, ends))
    demand = _demand(ticks, entry, car) if row.demand > 0.0 else None
    measured = RowMeasurement(approach, ttc, demand)
    if row.evasion is not None:
        measured = measured._replace(clearance=clearance(ticks, actors, car), off_path=_off_path(ticks))
    return measured if row.string is None else measured._replace(head_to_tail=_head_to_tail(row.string, record))


def clearance(ticks: pa.Table, actors: pa.Table, car: Vehicle) -> float:
    """Return the least distance between the car's true rectangle and any actor's at the same tick [m]."""
    at = actors["tick"].to_numpy() - int(ticks["tick"][0].as_py())
    rows = actors.filter(pa.array(at < ticks.num_rows))
    at = at[at < ticks.num_rows]
    own = vehicle_boxes(*_true_motion(ticks, at), car)
    x, y, heading, length, width, speed = (
        rows[name].to_numpy() for name in ("x_m", "y_m", "heading_rad", "length_m", "width_m", "speed_mps")
    )
    return float(distance(own, Boxes(x, y, heading, length, width, speed)).min(initial=math.inf))


def _head_to_tail(required: RequiredString, record: Path) -> float | None:
    passed = head_to_tail(Run(record), required.leader, required.chain, required.speed, required.begin).l2
    return passed if math.isfinite(passed) else None


def _true_motion(ticks: pa.Table, at: NDArray[np.int64]) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the ego's true place, heading and speed at ticks."""
    x, y, heading, speed = (ticks[f"true_{name}"].to_numpy()[at] for name in EGO)
    return x, y, heading, speed


def _off_path(ticks: pa.Table) -> float:
    return abs(float(ticks["lateral_deviation_m"].to_numpy()[-1]))


def _demand(ticks: pa.Table, entry: int, car: Vehicle) -> float:
    """Return the largest demand on the service brakes after the entry, for the declared mass and wheels [m/s2]."""
    torque, speed = (ticks[name].to_numpy()[entry:] for name in ("brake_torque_nm", "true_speed_mps"))
    return float(torque[speed > MOVING].max(initial=0.0)) / (car.mass * car.wheel_radius)


def _ends(ticks: pa.Table, entry: int) -> int:
    """Return the first tick from the entry on at which the car brakes or has a contact, else the number of ticks."""
    over = ticks["emergency"].to_numpy() | (ticks["true_acceleration_mps2"].to_numpy() < -BRAKING)
    over |= pc.not_equal(ticks["contacts"], "").to_numpy()
    ends = np.flatnonzero(over[entry:])
    return entry + int(ends[0]) if len(ends) else ticks.num_rows


def _speeds(ticks: pa.Table, entry: int, end: int) -> tuple[float, float]:
    """Least and greatest speed from the tick of the entry to before the one at which the approach ends."""
    approach = ticks["true_speed_mps"].to_numpy()[entry : max(end, entry + 1)]
    return float(approach.min()), float(approach.max())


def _cut_in(
    required: CutIn, ticks: pa.Table, target_rows: pa.Table, car: Vehicle, brakes: int
) -> tuple[int | None, float | None]:
    """Return the tick at which the target's near side has crossed the lane's edge, and the time to collision then.

    The time measures the target's motion, not the car's reaction: for a car that has braked since the tick `brakes`,
    constant speed and heading are assumed. The crossing is interpolated between two ticks.
    """
    at = target_rows["tick"].to_numpy() - int(ticks["tick"][0].as_py())
    known = at < ticks.num_rows
    rows, at = target_rows.filter(pa.array(known)), at[known]
    _, side, _ = _from_ego(rows, {name: ticks[f"true_{name}"].to_numpy()[at] for name in EGO})
    beyond = side + ticks["lateral_deviation_m"].to_numpy()[at] - required.lane_edge
    inside = np.flatnonzero(beyond < 0.0)
    if not len(inside):
        return None, None
    first = int(inside[0])
    back, _, closing = _from_ego(rows, {name: values[at] for name, values in _unbraked(ticks, brakes).items()})
    last = max(first - 1, 0)
    share = 1.0 if last == first else float(beyond[last] / (beyond[last] - beyond[first]))
    rear, pace = (float((1.0 - share) * values[last] + share * values[first]) for values in (back, closing))
    return int(at[first]), (rear - car.rear_axle_to_bumper) / pace if pace > 0.0 else math.inf


def _unbraked(ticks: pa.Table, brakes: int) -> dict[str, Floats]:
    """Return the ego's true motion, with constant speed and heading from the tick `brakes` on."""
    motion = {name: ticks[f"true_{name}"].to_numpy().copy() for name in EGO}
    if brakes >= ticks.num_rows:
        return motion
    times = ticks["time_s"].to_numpy()
    since = times[brakes:] - times[brakes]
    heading, speed = float(motion["heading_rad"][brakes]), float(motion["speed_mps"][brakes])
    motion["x_m"][brakes:] = motion["x_m"][brakes] + speed * math.cos(heading) * since
    motion["y_m"][brakes:] = motion["y_m"][brakes] + speed * math.sin(heading) * since
    motion["heading_rad"][brakes:], motion["speed_mps"][brakes:] = heading, speed
    return motion


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
