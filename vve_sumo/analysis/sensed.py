"""What each sensor of a drive measured, in the map: readings and rows of every sensor that declares how it is drawn.

Reads a record by the sensors' declarations alone; knows no kind of sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vve_sumo.metrics.lead_vehicle import index_of_tick
from vve_sumo.record.drawings import drawings_of
from vve_sumo.record.layout import sensor_table
from vve_sumo.sensors.drawing import Drawing, Placed, placed, quantities, ranges
from vve_sumo.values import Floats

if TYPE_CHECKING:
    from vve_sumo.analysis.run import Run


class FirstSight(NamedTuple):
    """The first row of a sensor's table that is of an actor."""

    actor: str
    time: float  #: drive time at which it came out [s]
    range: float  #: as measured, from the origin of the drawing's frame [m]


@dataclass(frozen=True, slots=True)
class SensedTable:
    """The readings of one sensor, in the order in which they came out, also those without a row."""

    name: str  #: of the sensor
    drawing: Drawing
    at: NDArray[np.int64]  #: index of the tick at which each reading came out, rising
    time: Floats  #: drive time of that tick [s]
    measured: Floats  #: drive time at which each was measured [s]
    first: NDArray[np.int64]  #: rows of reading k are those from first[k] to first[k + 1]
    rows: pa.Table  #: the sensor's table
    shapes: Placed  #: the rows in the map, NaN where the car's pose was not known
    range: Floats  #: of each row, from the origin of the drawing's frame [m]
    actors: list[str] | None  #: name behind each row, empty for none; None where the sensor does not say it

    def of_reading(self, number: int) -> slice:
        """Return the rows of a reading."""
        return slice(int(self.first[number]), int(self.first[number + 1]))

    def times_of(self, actor: str) -> Floats:
        """Return the drive times at which readings with a row of an actor came out [s], rising."""
        rows = np.array([name == actor for name in self.actors or ()], bool)
        times: Floats = self.time[np.unique(self._reading_of_rows()[np.flatnonzero(rows)])]
        return times

    def first_sights(self) -> list[FirstSight]:
        """Return the first row of every actor, in the order in which they came out."""
        found: dict[str, FirstSight] = {}
        time = self.time[self._reading_of_rows()]
        for row, name in enumerate(self.actors or ()):
            if name and name not in found:
                found[name] = FirstSight(name, float(time[row]), float(self.range[row]))
        return list(found.values())

    def actors_of_readings(self) -> list[frozenset[str]]:
        """Return the names in each reading."""
        names = self.actors or [""] * len(self.range)
        return [frozenset(names[self.of_reading(number)]) for number in range(len(self.at))]

    def _reading_of_rows(self) -> NDArray[np.intp]:
        return np.repeat(np.arange(len(self.at)), np.diff(self.first))


def sensed(run: Run) -> dict[str, SensedTable]:
    """Return the table of every sensor of a drive that declares how it is drawn, by name."""
    return {name: _table(run, name, drawing) for name, drawing in drawings_of(run.resolved).items()}


def _table(run: Run, name: str, drawing: Drawing) -> SensedTable:
    readings, rows = run.arrow("readings"), run.arrow(sensor_table(name))
    ticks = run.arrow("ticks")
    own = np.array([sensor == name for sensor in readings["sensor"].to_pylist()], bool)
    at = index_of_tick(ticks, readings)
    own &= at >= 0
    number, came_out = rows["tick"].to_numpy(), ticks["tick"].to_numpy()[at[own]]
    known = np.isin(number, came_out)
    rows, number = rows.filter(pa.array(known)), number[known]
    first = np.searchsorted(number, np.append(came_out, np.iinfo(np.int64).max))
    measured: Floats = readings["measured_s"].to_numpy()[own]
    numbers = {column: rows[column].to_numpy().astype(np.float64) for column in quantities(drawing).values()}
    poses = np.repeat(pose_at(run, measured), np.diff(first), axis=1)
    return SensedTable(
        name,
        drawing,
        at[own],
        run.time[at[own]],
        measured,
        first,
        rows,
        placed(drawing, numbers, *poses),
        ranges(drawing, numbers),
        None if drawing.actor is None else rows[drawing.actor].to_pylist(),
    )


def pose_at(run: Run, time: Floats) -> Floats:
    """Return rows x, y [m], heading [rad] of the rear axle as the drive's pipeline had it at these drive times [s]."""
    known = np.isfinite(run.data.column("x_m"))
    if not known.any():
        return np.full((3, len(time)), np.nan)
    names = ("x_m", "y_m", "heading_rad")
    x, y, heading = (run.data.column(name)[known] for name in names)
    return np.array([np.interp(time, run.time[known], values) for values in (x, y, np.unwrap(heading))])
