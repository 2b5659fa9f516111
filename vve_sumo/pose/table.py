"""Writes the table of `vve-sumo pose decode`: one row for each fix of a receiver's log, with the trust gate's verdict.

It knows decoders, the gate and text; it must not know maps. A row of NCOM is a packet with three right checksums,
navigation status 2, 3 or 4, a known GNSS minute, a valid position, and a time later than the row before. Packets of
status 1 and below (no time), 10 (status only), 11 (structure B) and 20 to 22 (triggers) give no row, nor do those
before the first status channel 0, which alone carries the minute. Of the other formats a row is a complete epoch.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.pose.log_formats import FORMATS, LogDecoder, LogFormat
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.receivers.port import Receiver
from vve_sumo.pose.recording import decode, read_log
from vve_sumo.pose.trust import Trust, TrustGate
from vve_sumo.values import Fix

COLUMNS: Final = (
    "time_gps_s",  #: since 1980-01-06, no leap seconds
    "nav_status",  #: NCOM code, empty of other formats
    "latitude_deg",  #: WGS84
    "longitude_deg",  #: WGS84
    "altitude_m",
    "heading_deg",  #: clockwise from true north, 0 to 360, empty where the receiver says invalid
    "velocity_north_mps",
    "velocity_east_mps",
    "velocity_down_mps",
    "position_mode",  #: NCOM code, empty where not known and of other formats
    "quality",  #: of the position, as `FixQuality`
    "position_sigma_m",  #: 1 sigma; this one and those below are empty where the log does not say them
    "velocity_sigma_mps",  #: 1 sigma
    "heading_sigma_deg",  #: 1 sigma
    "corrections_age_s",
    "trusted",  #: whether a car may drive on it, had it arrived at once
    "reason",  #: codes of `trust.REASONS`, separated by blanks
)


class Log(NamedTuple):
    """What was found in a log."""

    format: LogFormat
    decoder: LogDecoder  #: its counts show what gave no row


def rows(path: Path, receiver: Receiver | None = None) -> Iterator[dict[str, str]]:
    """Yield the rows of a log, texts by the names of `COLUMNS`.

    A fix is judged as if it had arrived the moment it was made, as a file does not hold arrivals, and as strictly as
    that of a live receiver. With a `receiver` the log is decoded as that one would have decoded its bytes, with the
    accuracies that its table declares. Raises ConfigError for a file without a message, or without one of the receiver.
    """
    return _rows(*_opened(path, receiver))


def _opened(path: Path, receiver: Receiver | None) -> tuple[bytes, Log]:
    """Return the bytes of a log, and what decodes them; raises ConfigError as `rows` does."""
    raw, of = read_log(path)
    if receiver is None:
        return raw, Log(of, of.decoder())
    decoder, trial = receiver.decoder(), receiver.decoder()
    theirs = next((one for one in FORMATS if type(decoder) is one.decoder), None)
    if theirs is None or not receiver.profile.live or not isinstance(decoder, LogDecoder):
        names = ", ".join(one.name for one in FORMATS)
        raise ConfigError(f"{path}: the rig's pose.kind sends no log that is read, expected a receiver with {names}")
    trial.feed(raw, 0.0)
    assert isinstance(trial, LogDecoder)
    if not trial.recognised:
        raise ConfigError(f"{path}: it is {of.name}, expected {theirs.name} by the rig's pose.kind")
    return raw, Log(theirs, decoder)


def _rows(raw: bytes, log: Log) -> Iterator[dict[str, str]]:
    gate: TrustGate | None = None
    epoch = 0.0
    for fix in decode(raw, log.decoder):
        if gate is None:
            epoch = math.floor(fix.time)
            gate = TrustGate(log.format.profile, epoch)
        codes = log.decoder.codes if isinstance(log.decoder, Decoder) else None
        yield _row(fix, codes, gate.step(fix.time - epoch, fix))


def write_csv(path: Path, out: Path, receiver: Receiver | None = None) -> Log:
    """Write the rows of the log `path` to `out`; return what was found. Arguments and errors are those of `rows`."""
    raw, log = _opened(path, receiver)
    table = list(_rows(raw, log))
    if out.exists() and out.samefile(path):
        raise ConfigError(f"{out}: this is the recording itself, expected another file to write to")
    with out.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(table)
    return log


def _text(value: float, digits: int) -> str:
    return "" if math.isnan(value) else f"{value:.{digits}f}"


def _compass(heading: float) -> str:
    """Compass heading [deg, clockwise from north, below 360] of a heading [rad, counter-clockwise from east]."""
    return "" if math.isnan(heading) else f"{round(90.0 - math.degrees(heading), 6) % 360.0:.6f}"


def _row(fix: Fix, codes: tuple[int, int] | None, trust: Trust) -> dict[str, str]:
    status, mode = (-1, -1) if codes is None else codes
    cells = (
        f"{fix.time:.3f}",
        "" if status < 0 else str(status),
        _text(math.degrees(fix.latitude), 10),
        _text(math.degrees(fix.longitude), 10),
        _text(fix.altitude, 3),
        _compass(fix.heading),
        _text(fix.velocity_north, 4),
        _text(fix.velocity_east, 4),
        _text(fix.velocity_down, 4),
        "" if mode < 0 else str(mode),
        str(fix.quality),
        _text(fix.position_sigma, 4),
        _text(fix.velocity_sigma, 4),
        _text(math.degrees(fix.heading_sigma), 4),
        _text(fix.differential_age, 2),
        "true" if trust.trusted else "false",
        " ".join(trust.reasons),
    )
    return dict(zip(COLUMNS, cells, strict=True))
