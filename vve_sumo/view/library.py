"""What a replay's page is given: one or two records, or a sweep as a table with its kept records.

Reads records and datasets; knows neither servers nor how a page draws.
"""

from __future__ import annotations

import base64
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa

from vve_sumo.analysis.dataset import Sweep
from vve_sumo.analysis.load import load
from vve_sumo.analysis.run import Run
from vve_sumo.errors import ConfigError
from vve_sumo.metrics.metric import unit_of
from vve_sumo.view.assets import one_file
from vve_sumo.view.details import details
from vve_sumo.view.frames import Frames, coded, pack
from vve_sumo.view.scene import VERSION
from vve_sumo.view.street import with_network

#: records that are shown side by side, at most
MAX_RECORDS: Final = 2
#: opened records that are kept in memory
MAX_OPEN: Final = 4
#: columns of a sweep's plot at first, right and up: the first parameter, and the first of these that it measured
PLOTTED_FIRST: Final = ("stop_gap_m", "min_gap_m", "min_ttc_s")


class ViewedRecord:
    """A record for the page; what is computed is computed once."""

    def __init__(self, run: Run, name: str = "") -> None:
        """`name` is what the page calls the record where another is beside it; by default that of its folder."""
        self._frames, self._run, self._name = Frames(run), run, name or run.folder.resolve().name
        self._lock = threading.RLock()
        self._made: dict[str, Any] = {}

    def scene(self) -> dict[str, Any]:
        """Return the scene."""
        return dict(self._once("scene", self._scene))

    def _scene(self) -> dict[str, Any]:
        return with_network(self._frames.scene, self._run.resolved, Path.cwd()) | {"record": self._name}

    def frames(self) -> bytes:
        """Return the file of frames."""
        return bytes(self._once("frames", self._frames.packed))

    def details(self) -> bytes:
        """Return the file of details, which takes longer."""
        return bytes(self._once("details", lambda: details(self._run)))

    def _once(self, name: str, make: Callable[[], Any]) -> Any:
        # A run reads its tables when they are first asked for, which two threads must not do at once.
        with self._lock:
            if name not in self._made:
                self._made[name] = make()
            return self._made[name]


class Library:
    """The records and the sweep that one page shows."""

    def __init__(self, folders: Sequence[Path]) -> None:
        """Open one sweep, or one or two records; raises ConfigError for anything else."""
        if not 1 <= len(folders) <= MAX_RECORDS:
            raise ConfigError(f"expected one or two folders, got {len(folders)}")
        held = [load(folder) for folder in folders]
        self.sweep = held[0] if isinstance(held[0], Sweep) else None
        if len(held) > 1 and any(isinstance(one, Sweep) for one in held):
            raise ConfigError("expected two drives' records to show side by side, got a sweep among them")
        names = names_apart(folders)
        self._open = {
            str(number): ViewedRecord(run, names[number]) for number, run in enumerate(held) if isinstance(run, Run)
        }
        self._lock = threading.Lock()
        self._record_keys = frozenset(_keys_with_record(self.sweep)) if self.sweep is not None else frozenset()

    def contents(self, run: str | None = None) -> dict[str, Any]:
        """Return what the page is to show; `run` is the key of a sweep's run, to be shown in place of the table."""
        if self.sweep is None:
            return {"version": VERSION, "kind": "drive", "records": list(self._open)}
        if run is not None:
            return {"version": VERSION, "kind": "drive", "records": [run]}
        return {
            "version": VERSION,
            "kind": "sweep",
            "title": self.sweep.title,
            "kept": sorted(self._record_keys),
            "records": [],
        }

    def record(self, key: str) -> ViewedRecord | None:
        """Return a record by its key; None where there is none. Raises ConfigError for one that cannot be read."""
        with self._lock:
            if key in self._open:
                return self._open[key]
            if self.sweep is None or key not in self._record_keys:
                return None
            while len(self._open) >= MAX_OPEN:
                self._open.pop(next(iter(self._open)))
            self._open[key] = ViewedRecord(self.sweep.run(key))
            return self._open[key]

    def table(self) -> bytes | None:
        """Return the sweep's rows as a file of columns; None of a record."""
        return None if self.sweep is None else packed_table(self.sweep)

    def page(self) -> str:
        """Return the page as one file that is sent around; of a sweep, the table alone."""
        data: dict[str, Any] = {"contents": self.contents() | {"kept": []}, "records": {}}
        for key, record in self._open.items():
            parts = {"frames": _text(record.frames()), "details": _text(record.details())}
            data["records"][key] = {"scene": record.scene(), **parts}
        table = self.table()
        if table is not None:
            data["sweep"] = _text(table)
        return one_file(data)


def names_apart(folders: Sequence[Path]) -> list[str]:
    """Return the shortest ends of the folders' paths, whole names, that tell them apart."""
    parts = [folder.resolve().parts for folder in folders]
    depth = next((n for n in range(1, max(map(len, parts))) if len({one[-n:] for one in parts}) == len(parts)), 1)
    return ["/".join(one[-depth:]) for one in parts]


def packed_table(sweep: Sweep) -> bytes:
    """Return a sweep's rows as a file of columns: c0, c1, … in the order of `names`, texts as numbers."""
    frame = sweep.rows()
    units: Mapping[str, str] = frame.attrs.get("units", {})
    columns: dict[str, Any] = {}
    texts: dict[str, list[str]] = {}
    for number, name in enumerate(frame):
        column = pa.Array.from_pandas(frame[name])
        key = f"c{number}"
        if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
            columns[key] = np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False), np.float64)
        else:
            cells = ["" if value is None else _cell_text(value) for value in column.to_pylist()]
            found = coded(cells)
            missing = np.array([value is None for value in column.to_pylist()], bool)
            columns[key], texts[key] = np.where(missing, -1, found.codes).astype(np.int32), found.texts
    names = [str(name) for name in frame]
    across = next((name for name in sweep.parameters if name in names), names[0])
    up = next((name for name in PLOTTED_FIRST if name in names and frame[name].notna().any()), names[-1])
    head = {"version": VERSION, "names": names, "units": [units.get(name) or unit_of(name) for name in names]}
    return pack(columns, head | {"texts": texts, "plotted": [across, up]})


def _cell_text(value: object) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def _keys_with_record(sweep: Sweep) -> list[str]:
    """Return the keys of the runs whose records were kept."""
    folder = sweep.folder / "records"
    return [one.name for one in folder.iterdir() if (one / "scenario.json").is_file()] if folder.is_dir() else []


def _text(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")
