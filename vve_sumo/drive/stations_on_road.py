"""Real stations on the virtual road: what an on-board unit received in, bodies out, all of it recorded.

The same for every shell and for the replay; knows neither SUMO nor where datagrams come from.
"""

from __future__ import annotations

from typing import Protocol

from vve_sumo.record.rows import StationDatagramRow, StationRow
from vve_sumo.stations.received_stations import ReceivedStations, StationState
from vve_sumo.stations.reports import StationReport
from vve_sumo.values import ActorState


class StationsRecorder(Protocol):
    """What records stations: a record, or a client that sends to one."""

    def station_received(self, row: StationDatagramRow) -> None:
        """Record what the on-board unit received."""
        ...

    def station_placed(self, row: StationRow) -> None:
        """Record a station's body at one step of the virtual road."""
        ...


class StationsOnRoad:
    """All real stations of a drive, step by step of the virtual road."""

    def __init__(self, stations: ReceivedStations, record: StationsRecorder) -> None:
        self._stations, self._record = stations, record
        self._steps = 0

    def receive(self, received: float, datagram: bytes, said: StationReport | str) -> None:
        """Take a datagram that arrived at drive time `received` [s], with what `reports.read` makes of it."""
        station = said.station if isinstance(said, StationReport) else -1
        refused = self._stations.receive(received, said) if isinstance(said, StationReport) else said
        self._record.station_received(StationDatagramRow(self._steps, received, datagram, station, refused))

    def step(self, time: float) -> tuple[ActorState, ...]:
        """Return the bodies of all stations that have one at drive time `time` [s], which never falls."""
        states = self._stations.step(time)
        for state in states:
            self._record.station_placed(row_of(self._steps, time, state))
        self._steps += 1
        return tuple(state.body for state in states)


def row_of(step: int, time: float, state: StationState) -> StationRow:
    """Return a station at one step as a row of the record."""
    body = state.body
    return StationRow(
        step=step,
        time_s=time,
        station=state.station,
        kind=body.kind,
        x_m=body.x,
        y_m=body.y,
        heading_rad=body.heading,
        speed_mps=body.speed,
        length_m=body.length,
        width_m=body.width,
        uncertainty_m=state.accuracy,
        age_s=state.age,
    )
