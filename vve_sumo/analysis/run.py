"""One drive as its record tells it: tables with units, the path, the car, what was ahead.

Reads a record's folder, whole or left open by a kill, and nothing else; a table is read when it is first asked for. It
must not know how a drive is run, nor what anybody makes of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vve_sumo.analysis import json_models
from vve_sumo.analysis.sensed import SensedTable, sensed
from vve_sumo.analysis.shown import shown
from vve_sumo.analysis.units import described
from vve_sumo.config_file import read_json
from vve_sumo.errors import ConfigError, hint
from vve_sumo.metrics.drive_columns import Motion
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.lead_vehicle import LeadVehicle
from vve_sumo.metrics.own import DeclaredMetrics
from vve_sumo.path import ReferencePath
from vve_sumo.record.declared import read_resolved, recorded_path, recorded_vehicle
from vve_sumo.record.layout import (
    COMMANDED,
    LIVE_SCHEMAS,
    OPTIONAL_SCHEMAS,
    PROVENANCE,
    ROADS,
    ROADS_SCHEMA,
    SCHEMAS,
    TICK_METRICS,
    ego_folder,
    further_egos,
    recorded_brain,
    recorded_metrics,
    sensor_schemas,
    sensor_table,
    tick_metrics_schema,
)
from vve_sumo.record.reader import read_commanded, read_table
from vve_sumo.record.roads import read_roads
from vve_sumo.sensors.port import STANDARD
from vve_sumo.values import EGO, Floats, Vehicle

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Run:
    """A drive, read from its record's folder as it is needed; `load` opens one.

    >>> import vve_sumo as vve
    >>> run = vve.load("mine")  # what vve.drive returns, read again
    >>> print(run.summary["outcome"], "from", round(run.ticks["speed_mps"].max()), "m/s")
    stopped from 12 m/s
    >>> figure = run.plot()
    """

    def __init__(self, folder: Path) -> None:
        """Open the record in a folder.

        Raises ConfigError in one line where there is none, or one of another layout, or where it holds no tick.
        """
        self.folder = folder
        self.resolved = _resolved(folder)  #: content of `scenario.json`
        #: rows of the user's metrics that were measured beside the shipped ones
        self.own_metrics = _own_metrics(folder, self.resolved)
        self.summary = _summary(folder, self.own_metrics)  #: content of `summary.json`; None of a drive that was killed
        if self.arrow("ticks").num_rows == 0:
            raise ConfigError(f"{folder}: the record holds no tick: the drive ended before its first")

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return str(self.resolved["scenario"])

    @property
    def title(self) -> str:
        """Title of the scenario, with a further ego's id."""
        title = str(self.resolved["settings"]["title"])
        return title if self.ego == EGO else f"{title}: ego {self.ego}"

    @property
    def ego(self) -> str:
        """Id of the ego whose drive this is: `ego` for the car of [ego]."""
        return str((self.resolved.get("further_ego") or {}).get("id", EGO))

    @cached_property
    def egos(self) -> dict[str, Run]:
        """The drives of all egos by their ids, this one's first; of a further ego's record its own alone."""
        return {self.ego: self} | {ego: Run(ego_folder(self.folder, ego)) for ego in further_egos(self.folder)}

    @property
    def live(self) -> bool:
        """Whether it was driven in real time, on a rig."""
        return "rig" in self.resolved

    @property
    def brain(self) -> str:
        """Kind of the external controller that decided, `setpoints` or `external`; empty for the scenario's own."""
        return recorded_brain(self.resolved)

    @property
    def complete(self) -> bool:
        """Whether the drive came to its end; else it was killed or broke, and ends at its last whole tick."""
        return self.summary is not None and self.summary["outcome"] != "broken"

    @property
    def period(self) -> float:
        """Period of a tick [s]."""
        return float(self.resolved["period_s"])

    @cached_property
    def path(self) -> ReferencePath:
        """Where the rear axle was to go, in the virtual road's map."""
        return recorded_path(self.resolved)

    @cached_property
    def vehicle(self) -> Vehicle:
        """The car as it was declared."""
        return recorded_vehicle(self.resolved)

    def holds(self, name: str) -> bool:
        """Whether the record has a table of that name; `gateway` and `latency` are of live drives alone."""
        return any(self.folder.glob(f"{name}.parquet")) or any(self.folder.glob(f"{name}.arrows"))

    def arrow(self, name: str) -> pa.Table:
        """Return a table of the record, read once.

        Tables are ticks, actors, readings, one of each sensor (`sensor_NAME`), roads (the lanes around the path; no
        rows in a record of an earlier layout), commanded_paths (no rows where no command carried one), of a live drive
        gateway, latency, and of a drive with metrics of a user's that say something of every tick metrics. Raises
        ConfigError where it is not there or cannot be read.
        """
        known: dict[str, pa.Table] = self.__dict__.setdefault("_tables", {})
        if name not in known:
            table = self._read(name)
            torn = not self.complete and "tick" in table.schema.names
            known[name] = table.filter(pc.field("tick") <= self._last) if torn else table
        return known[name]

    def table(self, name: str) -> pd.DataFrame:
        """Return a table of the record for pandas; `attrs` hold the unit and the meaning of every column."""
        arrow = self.arrow(name)
        meanings = {field.name: (field.metadata or {}).get(b"meaning", b"").decode() for field in arrow.schema}
        return described(arrow.to_pandas(), meanings)

    @cached_property
    def provenance(self) -> json_models.Provenance | None:
        """Where the drive came from: its code, machine and people; None where the record does not say it."""
        try:
            return json_models.Provenance.model_validate_json((self.folder / PROVENANCE).read_bytes())
        except (OSError, ValueError):
            return None

    @cached_property
    def ticks(self) -> pd.DataFrame:
        """A row a tick."""
        return self.table("ticks")

    def sensor(self, name: str) -> pd.DataFrame:
        """Return what a sensor measured: the rows of its readings, at the ticks at which they came out."""
        return self.table(sensor_table(name))

    @cached_property
    def detections(self) -> pd.DataFrame:
        """A row a detection of the sensor that every scenario has."""
        return self.sensor(STANDARD)

    @cached_property
    def sensed(self) -> dict[str, SensedTable]:
        """What each sensor that declares how it is drawn measured, in the map, by the sensor's name."""
        return sensed(self)

    @cached_property
    def actors(self) -> pd.DataFrame:
        """A row an actor and tick."""
        return self.table("actors")

    @cached_property
    def data(self) -> DriveData:
        """The tables as metrics read them."""
        tables = self.arrow("ticks"), self.arrow("actors")
        lanes, commanded = self.arrow("roads"), self.arrow(COMMANDED)
        return DriveData(*tables, self.path, self.vehicle, self.period, lanes, commanded, self.ego)

    @property
    def motion(self) -> Motion:
        """How the rear axle moved: the truth where there is one, else the estimate."""
        return self.data.motion

    @cached_property
    def time(self) -> Floats:
        """Drive time of every tick [s]."""
        time: Floats = self.arrow("ticks")["time_s"].to_numpy()
        return time

    @property
    def lead(self) -> LeadVehicle:
        """What was ahead in the ego's way, and its gap, tick by tick."""
        return self.data.lead

    def engaged(self) -> NDArray[np.bool_]:
        """Whether the gateway obeyed the controller, tick by tick."""
        return np.array([state == "engaged" for state in self.arrow("ticks")["state"].to_pylist()], bool)

    def plot(self) -> Figure:
        """Draw the page of the drive: path and actors from above; speed, gap and more over time."""
        figure: Figure = shown("plotting:drive_overview", self)
        return figure

    def export(self, form: str, out: str | Path | None = None) -> list[Path]:
        """Write the drive as "csv", "fcd", "commonroad" or "openscenario"; return the files.

        `out` is a file that does not exist yet, or a folder; by default the working folder. Raises ConfigError for a
        format that there is not or that is not installed, and where a file exists.

        >>> import vve_sumo as vve
        >>> [file.name for file in vve.load("mine").export("csv")]
        ['mine.csv', 'mine.actors.csv', 'mine.columns.csv']
        """
        files: list[Path] = shown("export.write:export", self, form, out)
        return files

    def view(self) -> Any:
        """Show the drive in the cell of a notebook, and play it back, wherever the notebook's kernel runs.

        The cell holds the whole page, a few megabytes of a long drive. In a browser `vve-sumo view` shows it.
        """
        return shown("view.notebook:ShownPage", self.folder)

    def __repr__(self) -> str:
        return str(shown("api.results:run_text", self))

    def _repr_html_(self) -> str:
        return str(shown("api.results:run_html", self))

    @cached_property
    def _last(self) -> int:
        """Number of the last tick of a killed drive that every table holds whole."""
        sensors = {name: self._read(sensor_table(name)) for name in self.resolved["sensors"]}
        return _last_whole(self._read("ticks"), self._read("actors"), self._read("readings"), sensors)

    def _read(self, name: str) -> pa.Table:
        always = SCHEMAS | sensor_schemas(self.resolved)
        known = always | OPTIONAL_SCHEMAS | LIVE_SCHEMAS | {ROADS: ROADS_SCHEMA}
        known |= {TICK_METRICS: tick_metrics_schema({})} if self.own_metrics.per_tick else {}
        if name not in known:
            raise ConfigError(f"{self.folder}: no table {name!r} in a record; {hint(name, known)}")
        folder = self.folder
        missing_is_empty: dict[str, Callable[[Path], pa.Table]] = {ROADS: read_roads, COMMANDED: read_commanded}
        table = missing_is_empty[name](folder) if name in missing_is_empty else read_table(folder, name)
        missing = [column for column in known[name].names if column not in table.schema.names]
        if missing:
            raise ConfigError(f"{self.folder}: its table {name} has no column {missing[0]}: another vve-sumo wrote it")
        return table


def _last_whole(ticks: pa.Table, actors: pa.Table, readings: pa.Table, sensors: dict[str, pa.Table]) -> int:
    """Return the last tick up to which no row is missing; -1 for none.

    A kill leaves tables that end at different ticks. A tick's row says how many readings came out at it, and how many
    actors the tick after it has; a reading says how many rows it has in its sensor's table.
    """
    number = ticks["tick"].to_numpy()
    looked_at = np.concatenate([[0], ticks["actors"].to_numpy()[:-1]])[: len(number)]
    whole = (_rows_of(number, readings) >= ticks["readings"].to_numpy()) & (_rows_of(number, actors) >= looked_at)
    for name, table in sensors.items():
        own = readings.filter(pc.field("sensor") == name)
        torn = own["tick"].to_numpy()[_rows_of(own["tick"].to_numpy(), table) < own["rows"].to_numpy()]
        whole &= ~np.isin(number, torn)
    end = len(whole) if whole.all() else int(np.argmin(whole))
    return int(number[end - 1]) if end else -1


def _rows_of(number: NDArray[np.int64], table: pa.Table) -> NDArray[np.int64]:
    """Return how many rows of a table each tick has."""
    there = np.sort(table["tick"].to_numpy())
    counts: NDArray[np.int64] = np.searchsorted(there, number, "right") - np.searchsorted(there, number, "left")
    return counts


def _resolved(folder: Path) -> dict[str, Any]:
    file = folder / "scenario.json"
    resolved = read_resolved(folder, "settings")
    json_models.check(resolved, json_models.RecordModel, file)
    return resolved


def _own_metrics(folder: Path, resolved: dict[str, Any]) -> DeclaredMetrics:
    try:
        own = recorded_metrics(resolved)
    except ConfigError as error:
        raise ConfigError(f"{folder}: {error}") from None
    own.enter()
    return own


def _summary(folder: Path, own: DeclaredMetrics) -> dict[str, Any] | None:
    file = folder / "summary.json"
    if not file.exists():
        return None
    summary = read_json(file, "a drive", "outcome")
    json_models.check(summary, json_models.summary_model(own.per_drive), file)
    return summary


def number(summary: dict[str, Any] | None, name: str) -> float:
    """Return a figure of a summary; NaN where it has none, which JSON calls null."""
    value = None if summary is None else summary.get(name)
    return math.nan if value is None else float(value)
