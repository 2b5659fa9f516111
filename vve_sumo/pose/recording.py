"""Reads recorded drives as fixes: CSV files of positions, and logs of receivers in any of `log_formats.FORMATS`.

It knows files, not trust, maps or the drive that plays them. A CSV needs a header with `time_s`, `latitude_deg`,
`longitude_deg`, `heading_deg` (compass, clockwise from true north) and `speed_mps` (along the heading, reversing
negative), one row for each fix; `altitude_m` is optional, other columns are ignored. `time_s` is kept as the fix's
time: GNSS seconds where the file has them, else the file's own. `ALSO_CALLED` lists other accepted names, so that a
table of `vve-sumo pose decode` can be played too.
"""

from __future__ import annotations

import csv
import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.pose.log_formats import FORMATS, PORTION, LogDecoder, LogFormat, format_of
from vve_sumo.pose.ncom import LENGTH, MINUTE, MINUTES_SET, SYNC, Decoder, Encoder
from vve_sumo.values import Fix

COLUMNS: Final = ("time_s", "latitude_deg", "longitude_deg", "heading_deg", "speed_mps")
#: other names of a column, in the same unit; `speed_mps` may also come as velocity north and east
ALSO_CALLED: Final = {
    "time_s": ("time_gps_s", "time"),
    "latitude_deg": ("latitude",),
    "longitude_deg": ("longitude",),
    "heading_deg": ("heading",),
    "speed_mps": ("speed",),
}
VELOCITIES: Final = ("velocity_north_mps", "velocity_east_mps")
RANGES: Final = {"latitude_deg": 90.0, "longitude_deg": 360.0, "heading_deg": 360.0, "speed_mps": 100.0}
HEADING_HELD: Final = 1.5  #: below this speed a missing heading is replaced by the last one, as a course is noise [m/s]
RATE_WINDOW: Final = 0.3  #: over which acceleration and yaw rate are differenced, to keep noise down [s]
TIMES_SENT: Final = (MINUTES_SET * MINUTE / 1000.0, 4e9)  #: GNSS seconds that NCOM can express


def fixes(path: Path) -> Iterator[Fix]:
    """Yield the fixes of a recorded drive: a file named .csv is read as CSV, any other as the log of a receiver.

    `time_received` is the time since the whole second of the first fix, as if each had arrived when it was made. Raises
    ConfigError naming file, line and column, or the byte count of a file without a single message.
    """
    return _csv_fixes(path) if path.suffix.lower() == ".csv" else _log_fixes(path)


def _log_fixes(path: Path) -> Iterator[Fix]:
    (raw, of), epoch = read_log(path), math.nan
    for fix in decode(raw, of.decoder()):
        if math.isnan(epoch):
            epoch = math.floor(fix.time)
        yield replace(fix, time_received=fix.time - epoch)


def decode(raw: bytes, decoder: LogDecoder) -> Iterator[Fix]:
    """Yield the fixes of a log; arrival is taken as 0.

    The bytes are fed an NCOM packet's length at a time, so `codes` of an NCOM decoder are those of the fix that was
    yielded last.
    """
    for start in range(0, len(raw), PORTION):
        yield from decoder.feed(raw[start : start + PORTION], 0.0)


def read_log(path: Path) -> tuple[bytes, LogFormat]:
    """Return the bytes of a log, or those that its hexadecimal text says, and its format.

    Raises ConfigError when the file cannot be read, or holds no message of any format.
    """
    raw = _bytes(path)
    of = format_of(raw)
    if of is None:
        raise _no_message(path)
    return raw, of


def portions(path: Path) -> Iterator[tuple[float, bytes]]:
    """Yield a recorded drive as portions of NCOM bytes that each complete a fix, with the time each is due [s].

    Times count from the first fix, by the fixes' own times. Raises ConfigError as `fixes` does.
    """
    if path.suffix.lower() == ".csv":
        return _csv_portions(path)
    raw, of = read_log(path)
    return _ncom_portions(path, raw) if of.decoder is Decoder else _log_portions(path, raw, of)


def _csv_portions(path: Path) -> Iterator[tuple[float, bytes]]:
    """The bytes that a unit would have sent. A file's own seconds are moved to where the unit's clock counts as set."""
    encoder, first, moved = Encoder(), math.nan, 0.0
    for fix in _csv_fixes(path):
        if math.isnan(first):
            first = fix.time
            moved = 0.0 if TIMES_SENT[0] <= first <= TIMES_SENT[1] else TIMES_SENT[0] - math.floor(first)
        yield fix.time - first, encoder.encode(replace(fix, time=fix.time + moved, locked=True))


def _ncom_portions(path: Path, raw: bytes) -> Iterator[tuple[float, bytes]]:
    decoder, first, begin = Decoder(), math.nan, 0
    for end in range(LENGTH, len(raw) + LENGTH, LENGTH):
        made = decoder.feed(raw[end - LENGTH : end], 0.0)
        if made:
            first = made[0].time if math.isnan(first) else first
            yield made[-1].time - first, raw[begin:end]
            begin = end
    if math.isnan(first):
        raise _no_fix(path)


def _log_portions(path: Path, raw: bytes, of: LogFormat) -> Iterator[tuple[float, bytes]]:
    """The bytes that an OXTS unit would have sent in place of the receiver."""
    encoder, first = Encoder(), math.nan
    for fix in decode(raw, of.decoder()):
        first = fix.time if math.isnan(first) else first
        yield fix.time - first, encoder.encode(fix)
    if math.isnan(first):
        raise _no_fix(path)


def _no_fix(path: Path) -> ConfigError:
    return ConfigError(f"{path}: no fix with a time and a position; vve-sumo pose decode says what is in it")


def _no_message(path: Path) -> ConfigError:
    *messages, last = (one.message for one in FORMATS)
    size = path.stat().st_size
    return ConfigError(f"{path}: no {', '.join(messages)} or {last} with a right checksum in {size} bytes")


def _bytes(path: Path) -> bytes:
    try:
        return _from_hex(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None


def _from_hex(data: bytes) -> bytes:
    """The bytes of hexadecimal text; anything else unchanged (a raw packet begins with a non-ASCII byte)."""
    if data[:2].lower() != SYNC.hex().encode():
        return data
    try:
        return bytes.fromhex(data.decode("ascii"))
    except ValueError:
        return data


class _Row(NamedTuple):
    time: float
    speed: float
    heading: float  #: [rad] counter-clockwise from east


def _csv_fixes(path: Path) -> Iterator[Fix]:
    try:
        file = path.open(newline="", encoding="utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
    drive = _CsvDrive(path)
    with file:
        reader = csv.DictReader(file)
        try:
            names = _names(path, reader.fieldnames or ())
            for row in reader:
                yield drive.fix(reader.line_num, {name: row[theirs] for name, theirs in names.items()})
        except (UnicodeDecodeError, csv.Error) as error:
            raise ConfigError(f"{path}: no CSV file after line {reader.line_num}: {error}") from None
    if drive.empty:
        raise ConfigError(f"{path}: no row after the header")


def _names(path: Path, header: Sequence[str]) -> dict[str, str]:
    """The name of each needed column in a file; raises ConfigError where one is missing."""
    found = {}
    for name in COLUMNS:
        theirs = next((one for one in (name, *ALSO_CALLED[name]) if one in header), None)
        if theirs is not None:
            found[name] = theirs
    if "speed_mps" not in found and all(name in header for name in VELOCITIES):
        found |= {name: name for name in VELOCITIES}
    missing = [name for name in COLUMNS if name not in found and not (name == "speed_mps" and VELOCITIES[0] in found)]
    if missing:
        raise ConfigError(f"{path}, line 1: no column {', '.join(missing)}; a drive needs {', '.join(COLUMNS)}")
    return found | ({"altitude_m": "altitude_m"} if "altitude_m" in header else {})


class _CsvDrive:
    """Reads row after row, and keeps the rows from which rates and a missing heading are computed."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._epoch = math.nan
        self._recent: deque[_Row] = deque()  #: rows within `RATE_WINDOW`, at least the last one

    @property
    def empty(self) -> bool:
        return not self._recent

    def fix(self, line: int, cells: dict[str, str | None]) -> Fix:
        time, latitude, longitude = (
            self._number(line, cells, column) for column in ("time_s", "latitude_deg", "longitude_deg")
        )
        speed = self._speed(line, cells)
        if self.empty:
            self._epoch = math.floor(time)
        elif time <= self._recent[-1].time:
            raise ConfigError(self._at(line, "time_s") + f"{time} does not come after {self._recent[-1].time}")
        row = _Row(time, speed, self._heading(line, cells, speed))
        acceleration, yaw_rate = self._rates(row)
        self._recent.append(row)
        return Fix(
            time=time,
            time_received=time - self._epoch,
            latitude=math.radians(latitude),
            longitude=math.radians(longitude),
            altitude=self._number(line, cells, "altitude_m") if cells.get("altitude_m") else math.nan,
            heading=row.heading,
            pitch=math.nan,
            roll=math.nan,
            velocity_north=speed * math.sin(row.heading),
            velocity_east=speed * math.cos(row.heading),
            velocity_down=math.nan,
            yaw_rate=yaw_rate,
            acceleration=acceleration,
        )

    def _at(self, line: int, column: str) -> str:
        return f"{self._path}, line {line}, column {column}: "

    def _number(self, line: int, cells: dict[str, str | None], column: str) -> float:
        text, limit = cells[column], RANGES.get(column, math.inf)
        try:
            value = float(text or "")
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and abs(value) <= limit):
            wanted = "a finite number" if math.isinf(limit) else f"a number within +-{limit:g}"
            raise ConfigError(self._at(line, column) + f"expected {wanted}, got {text!r}")
        return value

    def _speed(self, line: int, cells: dict[str, str | None]) -> float:
        if "speed_mps" in cells:
            return self._number(line, cells, "speed_mps")
        north, east = (self._number(line, cells, column) for column in VELOCITIES)
        if not (cells["heading_deg"] or "").strip():
            return math.hypot(north, east)
        compass = math.radians(self._number(line, cells, "heading_deg"))
        return north * math.cos(compass) + east * math.sin(compass)

    def _heading(self, line: int, cells: dict[str, str | None], speed: float) -> float:
        if (cells["heading_deg"] or "").strip():
            compass = self._number(line, cells, "heading_deg")
            return math.remainder(math.radians(90.0 - compass), math.tau)
        held = self._recent and abs(speed) < HEADING_HELD
        return self._recent[-1].heading if held else math.nan

    def _rates(self, row: _Row) -> tuple[float, float]:
        """Acceleration and yaw rate since the oldest row of the window; 0 where there is no earlier value."""
        recent = self._recent
        while len(recent) > 1 and recent[0].time < row.time - RATE_WINDOW:
            recent.popleft()
        if not recent:
            return 0.0, 0.0
        then = recent[0]
        step = row.time - then.time
        turn = math.remainder(row.heading - then.heading, math.tau)
        return (row.speed - then.speed) / step, 0.0 if math.isnan(then.heading) else turn / step
