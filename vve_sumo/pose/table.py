"""Writes the table of `vve-sumo pose decode`: one row for each fix of an NCOM file, with the trust gate's verdict.

It knows the decoder, the gate and text; it must not know maps. A row is a packet with three right checksums, navigation
status 2, 3 or 4, a known GNSS minute, a valid position, and a time later than the row before. Packets of status 1 and
below (no time), 10 (status only), 11 (structure B) and 20 to 22 (triggers) give no row, nor do those before the first
status channel 0, which alone carries the minute.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from vve_sumo.errors import ConfigError
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.recording import decode
from vve_sumo.pose.trust import DRIVE, Trust, TrustGate
from vve_sumo.values import Fix

COLUMNS: Final = (
    "time_gps_s",  #: since 1980-01-06, no leap seconds
    "nav_status",  #: NCOM code
    "latitude_deg",  #: WGS84
    "longitude_deg",  #: WGS84
    "altitude_m",
    "heading_deg",  #: clockwise from true north, 0 to 360, empty where the receiver says invalid
    "velocity_north_mps",
    "velocity_east_mps",
    "velocity_down_mps",
    "position_mode",  #: NCOM code, empty where not known
    "trusted",  #: whether a car may drive on it, had it arrived at once
    "reason",  #: codes of `trust.REASONS`, separated by blanks
)


def rows(path: Path, decoder: Decoder | None = None) -> Iterator[dict[str, str]]:
    """Yield the rows of an NCOM file, texts by the names of `COLUMNS`.

    `decoder` is used if given, so that its counts can be read afterwards. A fix is judged as if it had arrived the
    moment it was made, as a file does not hold arrivals. Raises ConfigError for a file without a packet.
    """
    gate: TrustGate | None = None
    epoch = 0.0
    decoder = decoder or Decoder()
    for fix in decode(path, decoder):
        if gate is None:
            epoch = math.floor(fix.time)
            gate = TrustGate(DRIVE, epoch)
        yield _row(fix, decoder.codes, gate.step(fix.time - epoch, fix))


def write_csv(path: Path, out: Path) -> Decoder:
    """Write the rows of the NCOM file `path` to `out`; return the decoder, whose counts show what gave no row."""
    decoder = Decoder()
    table = list(rows(path, decoder))
    if out.exists() and out.samefile(path):
        raise ConfigError(f"{out}: this is the recording itself, expected another file to write to")
    with out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)
    return decoder


def _text(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def _compass(heading: float) -> str:
    """Compass heading [deg, clockwise from north, below 360] of a heading [rad, counter-clockwise from east]."""
    return "" if math.isnan(heading) else f"{round(90.0 - math.degrees(heading), 6) % 360.0:.6f}"


def _row(fix: Fix, codes: tuple[int, int], trust: Trust) -> dict[str, str]:
    status, mode = codes
    cells = (
        f"{fix.time:.3f}",
        str(status),
        _text(math.degrees(fix.latitude), 10),
        _text(math.degrees(fix.longitude), 10),
        _text(fix.altitude, 3),
        _compass(fix.heading),
        _text(fix.velocity_north, 4),
        _text(fix.velocity_east, 4),
        _text(fix.velocity_down, 4),
        "" if mode < 0 else str(mode),
        "true" if trust.trusted else "false",
        " ".join(trust.reasons),
    )
    return dict(zip(COLUMNS, cells, strict=True))
