"""The frames of a record for the page: all ticks as columns in one binary file, which the page takes apart.

The file is gzip of: the letters VVEF, the length of a JSON header as a 32-bit number, the header, and the columns one
after the other, each little endian and beginning at a multiple of eight bytes. `frame` gives one tick as plain JSON, in
the form in which a live drive sends it. Knows records; nothing of pages or servers.
"""

from __future__ import annotations

import gzip
import json
import math
import struct
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.analysis.run import Run
from vve_sumo.drive.assembly import LotAlignment
from vve_sumo.metrics.lead_vehicle import index_of_tick
from vve_sumo.record.latencies import DATAGRAM
from vve_sumo.record.layout import COMMANDED
from vve_sumo.record.signals import read_signals
from vve_sumo.values import Floats
from vve_sumo.view.events import events_of
from vve_sumo.view.persons import PersonRows, rows_of
from vve_sumo.view.scene import VERSION, body, scene_of
from vve_sumo.view.words import reasons_in_words, state_in_words, verdict_of

MAGIC: Final = b"VVEF"
_LENGTH: Final = struct.Struct("<I")
ALIGNMENT: Final = 8  #: of a column's first byte
COMPRESSION: Final = 1  #: gzip's level: the file goes over the loopback, and opening counts
#: a record with more rows of actors than this sends every fifth tick of them; the page draws lines between
MAX_ACTOR_ROWS: Final = 2_000_000
STRIDE: Final = 5

Codes = NDArray[np.int32]
Column = NDArray[Any]


class Coded(NamedTuple):
    """Texts, a number a row, and the texts that the numbers stand for."""

    codes: Codes
    texts: list[str]


class Frames:
    """The frames of one record; columns are computed when they are first asked for."""

    def __init__(self, run: Run) -> None:
        self._run = run

    @cached_property
    def scene(self) -> dict[str, Any]:
        """The scene, with the record's actors and events."""
        run = self._run
        scene = scene_of(run.resolved, run.arrow("roads"), source="record")
        duration = float(run.time[-1])
        return scene | {
            "duration": duration,
            "begins": float(run.time[0]),
            "actors": self._bodies(),
            "events": events_of(run),
            "outcome": None if run.summary is None else run.summary["outcome"],
            "verdict": verdict_of(run.summary),
        }

    @cached_property
    def columns(self) -> dict[str, Column]:
        """Every column by its name."""
        return {**self._ego, **self._codes, **self._actors, **self._sensed, **self._commanded, **self._people}

    @cached_property
    def texts(self) -> dict[str, list[str]]:
        """What numbers stand for in columns `state`, `reason`, `said`, `note`, `quality`, `*_presence`, `*_code`."""
        return {name: coded.texts for name, coded in self._coded.items()} | {
            "actor": self._names,
            "person": self._persons[0].texts,
            "presence": self._persons[1].texts,
        }

    def packed(self) -> bytes:
        """Return the file."""
        head = {"version": VERSION, "texts": self.texts, "stride": self.stride}
        return pack(self.columns, head | {"signals": dict(read_signals(self._run.folder))})

    @cached_property
    def stride(self) -> int:
        """The actors are kept at every so many ticks."""
        return STRIDE if len(self._run.data.actor_rows.at) > MAX_ACTOR_ROWS else 1

    @cached_property
    def _ego(self) -> dict[str, Column]:
        run, motion = self._run, self._run.motion
        ticks = {name: run.data.column(name) for name in _TICK_COLUMNS}
        columns = {
            "x": motion.x,
            "y": motion.y,
            "heading": motion.heading,
            "speed": motion.speed,
            "acceleration": motion.acceleration,
            "wished": ticks["acceleration_setpoint_mps2"],
            "granted": ticks["granted_acceleration_mps2"],
            "steering": _first_finite(ticks["measured_steering_rad"], ticks["steering_rad"]),
            "wished_steering": ticks["steering_setpoint_rad"],
            "yaw_rate": ticks["yaw_rate_radps"],
            "s": ticks["s_m"],
            "deviation": ticks["estimated_deviation_m"],
            "latency": self._latency,
            **self._in_the_lot(),
        }
        return {"t": run.time.astype(np.float64)} | {name: _single(values) for name, values in columns.items()}

    def _in_the_lot(self) -> dict[str, Floats]:
        """Pose of the rear axle in the lot's map; NaN of a drive that was aligned with none."""
        run, motion = self._run, self._run.motion
        if "lot_to_road" not in run.resolved:
            return {name: np.full(len(run.time), np.nan) for name in ("real_x", "real_y", "real_heading")}
        turned = LotAlignment.from_dict(run.resolved).alignment.inverse()
        cos, sin = math.cos(turned.rotation), math.sin(turned.rotation)
        return {
            "real_x": cos * motion.x - sin * motion.y + turned.x,
            "real_y": sin * motion.x + cos * motion.y + turned.y,
            "real_heading": motion.heading + turned.rotation,
        }

    @property
    def _latency(self) -> Floats:
        """Latency of every tick [s]: arrival of the bytes to the last command frame; NaN without one."""
        run = self._run
        found = np.full(len(run.time), np.nan)
        if not run.holds("latency"):
            return found
        table = run.arrow("latency")
        woken = np.array([by == DATAGRAM for by in table["woken_by"].to_pylist()], bool)
        begun = np.where(woken, table["received_s"].to_numpy(), table["woken_s"].to_numpy())
        at = index_of_tick(run.arrow("ticks"), table)
        found[at[at >= 0]] = (table["framed_s"].to_numpy() - begun)[at >= 0]
        return found

    @cached_property
    def _coded(self) -> dict[str, Coded]:
        ticks = self._run.arrow("ticks")
        states, reasons = ticks["state"].to_pylist(), ticks["reasons"].to_pylist()
        phrases = [state_in_words(*pair) for pair in zip(states, reasons, strict=True)]
        trusted, why = ticks["pose_trusted"].to_pylist(), ticks["pose_reasons"].to_pylist()
        quality = [_quality(*pair) for pair in zip(trusted, why, strict=True)]
        texts = {"state": states, "reason": reasons, "said": phrases, "quality": quality}
        texts["note"] = ticks["note"].to_pylist()
        texts["contact"] = ticks["contacts"].to_pylist()
        return {name: coded(values) for name, values in texts.items()}

    @property
    def _codes(self) -> dict[str, Column]:
        return {name: one.codes for name, one in self._coded.items()}

    @property
    def _names(self) -> list[str]:
        return self._run.data.actor_rows.names

    @property
    def _actors(self) -> dict[str, Column]:
        """Rows of actors, those of tick k from actor_first[k] to actor_first[k + 1]."""
        rows = self._run.data.actor_rows
        kept = np.flatnonzero(rows.at % self.stride == 0) if self.stride > 1 else np.arange(len(rows.at))
        order = kept[np.argsort(rows.at[kept], kind="stable")]
        boxes = rows.boxes.select(order)
        ticks = len(self._run.time)
        return {
            "actor_first": np.searchsorted(rows.at[order], np.arange(ticks + 1)).astype(np.int32),
            "actor_code": rows.code[order].astype(np.int32),
            "actor_x": _single(boxes.x),
            "actor_y": _single(boxes.y),
            "actor_heading": _single(boxes.heading),
            "actor_speed": _single(boxes.speed),
        }

    @property
    def _commanded(self) -> dict[str, Column]:
        """Paths that commands carried: tick of each, and its points, those of path k from commanded_first[k] on."""
        table = self._run.arrow(COMMANDED)
        at = index_of_tick(self._run.arrow("ticks"), table)
        tick, first = np.unique(at[at >= 0], return_index=True)
        return {
            "commanded_tick": tick.astype(np.int32),
            "commanded_first": np.append(first, np.count_nonzero(at >= 0)).astype(np.int32),
            "commanded_x": _single(table["x_m"].to_numpy()[at >= 0]),
            "commanded_y": _single(table["y_m"].to_numpy()[at >= 0]),
        }

    @property
    def _sensed(self) -> dict[str, Column]:
        """Sensors' readings, sensor n's as `sensed{n}_...`: tick of each; its rows, from first[k] on, in the map."""
        known = {name: code for code, name in enumerate(self._names)}
        found: dict[str, Column] = {}
        for number, table in enumerate(self._run.sensed.values()):
            actors = ["" for _ in table.range] if table.actors is None else table.actors
            own: dict[str, Column] = {
                "tick": table.at.astype(np.int32),
                "measured": _single(table.measured),
                "first": table.first.astype(np.int32),
                "code": np.array([known.get(name, -1) for name in actors], np.int32),
            }
            shapes = table.shapes._asdict()
            if table.drawing.shape == "points":
                shapes = {"x": table.shapes.x, "y": table.shapes.y}
            own |= {name: _single(values) for name, values in shapes.items() if values is not None}
            found |= {f"sensed{number}_{name}": values for name, values in own.items()}
        return found

    @cached_property
    def _person_rows(self) -> PersonRows:
        return rows_of(self._run)

    @cached_property
    def _persons(self) -> tuple[Coded, Coded]:
        """Ids and presences of the rows of people."""
        return coded(self._person_rows.names), coded(self._person_rows.presences)

    @property
    def _people(self) -> dict[str, Column]:
        """Rows of real people, those of tick k from person_first[k] to person_first[k + 1]."""
        rows, (names, presences) = self._person_rows, self._persons
        return {
            "person_first": np.searchsorted(rows.at, np.arange(len(self._run.time) + 1)).astype(np.int32),
            "person_code": names.codes,
            "person_presence": presences.codes,
            **{f"person_{name}": _single(values) for name, values in rows.numbers.items()},
        }

    def _bodies(self) -> dict[str, Any]:
        run, rows = self._run, self._run.data.actor_rows
        kinds, heights = (run.arrow("actors")[name].to_numpy()[rows.rows] for name in ("kind", "height_m"))
        firsts = np.unique(rows.code, return_index=True)[1].tolist()
        found = {}
        for first in firsts:
            size = float(rows.boxes.length[first]), float(rows.boxes.width[first]), float(heights[first])
            found[rows.names[int(rows.code[first])]] = body(int(kinds[first]), *size)
        return found


#: columns of the ticks that are sent as they are
_TICK_COLUMNS: Final = (
    "acceleration_setpoint_mps2",
    "granted_acceleration_mps2",
    "measured_steering_rad",
    "steering_rad",
    "steering_setpoint_rad",
    "yaw_rate_radps",
    "s_m",
    "estimated_deviation_m",
)


def pack(columns: dict[str, Column], head: dict[str, Any]) -> bytes:
    """Return the file of these columns; `head` is added to the header."""
    listed, parts, offset = [], [], 0
    for name, values in columns.items():
        data = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"), copy=False).tobytes()
        listed.append({"name": name, "kind": values.dtype.str[1:], "count": len(values), "offset": offset})
        data += bytes(-len(data) % ALIGNMENT)
        parts.append(data)
        offset += len(data)
    header = json.dumps(head | {"columns": listed}, allow_nan=False).encode()
    # The header ends where a column may begin.
    header += b" " * (-(len(MAGIC) + _LENGTH.size + len(header)) % ALIGNMENT)
    whole = b"".join([MAGIC, _LENGTH.pack(len(header)), header, *parts])
    return gzip.compress(whole, COMPRESSION, mtime=0)


def coded(values: Sequence[str]) -> Coded:
    """Return texts as numbers."""
    known: dict[str, int] = {}
    codes = np.fromiter((known.setdefault(value, len(known)) for value in values), np.int32, len(values))
    return Coded(codes, list(known))


def _quality(trusted: bool, why: str) -> str:
    if trusted:
        return "trusted"
    return f"refused: {', '.join(reasons_in_words(why))}" if why else "none"


def _first_finite(first: Floats, second: Floats) -> Floats:
    return np.where(np.isfinite(first), first, second)


def _single(values: Floats | Iterable[float]) -> NDArray[np.float32]:
    return np.asarray(values, np.float32)
