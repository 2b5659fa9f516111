"""Replays what a real on-board unit received: recorded datagrams through what reads, judges and places stations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from vve_sumo.drive.replay import Difference, compare, read_rows
from vve_sumo.drive.stations_on_road import StationsOnRoad
from vve_sumo.record.declared import read_resolved
from vve_sumo.record.layout import STATION_DATAGRAMS, STATIONS
from vve_sumo.record.reader import holds_table
from vve_sumo.record.rows import StationDatagramRow, StationRow
from vve_sumo.stations import reports
from vve_sumo.stations.received_stations import ReceivedStations, StationsSetup


class _Kept:
    """Takes what a replay of stations would record."""

    def __init__(self) -> None:
        self.received: list[dict[str, Any]] = []
        self.placed: list[dict[str, Any]] = []

    def station_received(self, row: StationDatagramRow) -> None:
        """Take what was made of a datagram."""
        self.received.append(asdict(row))

    def station_placed(self, row: StationRow) -> None:
        """Take a station's row."""
        self.placed.append(asdict(row))


def replay_stations(folder: Path) -> Difference | None:
    """Run a record's datagrams through what reads, judges and places stations; return the first difference.

    Nothing where none had come. Raises ConfigError where a table is unreadable or of another version, and where the
    package that reads the messages is missing.
    """
    content = read_resolved(folder).get("stations")
    if content is None or not holds_table(folder, STATION_DATAGRAMS):
        return None
    setup, mine = StationsSetup.from_dict(content), _Kept()
    reports.prepare()
    stations = StationsOnRoad(ReceivedStations(setup), mine)
    datagrams = read_rows(folder, STATION_DATAGRAMS).to_pylist()
    bodies = read_rows(folder, STATIONS).to_pylist() if holds_table(folder, STATIONS) else []
    times = {row["step"]: row["time_s"] for row in bodies}
    taken = 0
    for step in range(max((*times, *(row["step"] for row in datagrams)), default=-1) + 1):
        while taken < len(datagrams) and datagrams[taken]["step"] <= step:
            received, data = datagrams[taken]["received_s"], datagrams[taken]["datagram"]
            stations.receive(received, data, reports.read(data, received, setup.epoch))
            taken += 1
        # At a step without a time nobody had a body: that is so at the end of time.
        stations.step(times.get(step, math.inf))
    return _first_difference("datagram of station", datagrams, mine.received) or _first_difference(
        "station", bodies, mine.placed
    )


def _first_difference(
    what: str, recorded: Sequence[dict[str, Any]], replayed: Sequence[Mapping[str, Any]]
) -> Difference | None:
    """Return the first difference; rows that a killed recorder did not come to write are none."""
    for row, again in zip(recorded, replayed, strict=False):
        if (difference := compare(row["step"], row, again)) is not None:
            return replace(difference, item=f"{what} {row['station']}: {difference.item}")
    if len(replayed) < len(recorded):
        return Difference(recorded[len(replayed)]["step"], what, f"{len(recorded)} rows", f"{len(replayed)} rows")
    return None
