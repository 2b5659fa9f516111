"""All real stations of a drive: reports in, their bodies on the virtual road out.

A station has a body once two of its reports in a row were believed, until the last is too old. In between it goes on
as it said. A report that shows it elsewhere moves the body there within a second and not at once: no sensor could track
what jumps. Pure: time comes in with every call. Nothing that a report holds can move the car: it moves a body that
sensors see.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, MapFrame
from vve_sumo.stations.reports import StationReport
from vve_sumo.stations.station_gate import GateLimits, Place, StationGate, is_sound
from vve_sumo.v2x.pdu_header import MessageId
from vve_sumo.values import ActorState

#: twice the longest interval between two messages [s]: a station that has said nothing for longer is gone
LIFETIMES: Final[Mapping[int, float]] = {int(MessageId.CAM): 2.0, int(MessageId.VAM): 10.0}
#: reports in a row that are believed before a station has a body
MIN_REPORTS: Final = 2
#: longer than this nobody is taken to go on as they said [s]; then the body stands
EXTRAPOLATION: Final = 1.5
#: what a body is off from where its station has it falls to 1/e within this time [s]
CATCH_UP: Final = 0.3
#: a body that is off by more is placed anew [m]
MAX_OFFSET: Final = 5.0


@dataclass(frozen=True, slots=True)
class StationsSetup:
    """How real stations lie on the virtual road, and what of them is believed."""

    projection: str  #: PROJ string of the map in which they are placed
    offset: tuple[float, float]  #: what that map's coordinates have beyond the projected ones [m]
    alignment: Alignment  #: lays that map onto the virtual road's
    origin: tuple[float, float]  #: where the ego's path begins, virtual road's map [m]
    epoch: float  #: GNSS second of drive time 0
    limits: GateLimits

    def to_dict(self) -> dict[str, Any]:
        """Return plain JSON, for the record."""
        content = asdict(self)
        content["limits"]["ignored"] = sorted(self.limits.ignored)
        return content

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> StationsSetup:
        """Return what `to_dict` wrote; raises ConfigError for anything else."""
        try:
            alignment = Alignment(*(content["alignment"][key] for key in ("rotation", "x", "y")))
            limits = GateLimits(**{**content["limits"], "ignored": frozenset(content["limits"]["ignored"])})
            (offset_x, offset_y), (x, y) = content["offset"], content["origin"]
            return cls(content["projection"], (offset_x, offset_y), alignment, (x, y), content["epoch"], limits)
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"scenario.json: stations: none of this version: {error!r}") from None


class StationState(NamedTuple):
    """A station that has a body, at one time."""

    station: int
    body: ActorState  #: on the virtual road
    accuracy: float  #: radius that holds the reported place with 95 % [m]
    age: float  #: of the last believed report [s]


class ReceivedStations:
    """Everything that is kept of the stations. Pass it reports and steps in the order of their times."""

    def __init__(self, setup: StationsSetup) -> None:
        """Raise ConfigError for a projection that is none."""
        self._frame, self._setup = MapFrame(setup.projection, setup.offset), setup
        turned = setup.alignment
        self._cosine, self._sine, self._rotation = math.cos(turned.rotation), math.sin(turned.rotation), turned.rotation
        self._gate = StationGate(setup.limits)
        self._stations: dict[int, _Station] = {}

    def receive(self, received: float, report: StationReport) -> str:
        """Take a report that arrived at drive time `received` [s]; return why it is not believed, empty if it is."""
        if not is_sound(report):
            return "not_finite"
        self._forget(received)
        station = self._stations.get(report.station)
        placed = self._placed(report, station)
        place = Place(placed.x - self._setup.origin[0], placed.y - self._setup.origin[1])
        last = None if station is None else (station.report, station.place)
        reason = self._gate.judge(received, report, place, last, len(self._stations))
        if reason:
            return reason
        if station is None:
            self._stations[report.station] = _Station(report, place, placed)
        else:
            station.update(received, report, place, placed)
        return ""

    def step(self, now: float) -> tuple[StationState, ...]:
        """Return the stations that have a body at drive time `now` [s], by their IDs; changes nothing."""
        there = [
            (number, one)
            for number, one in sorted(self._stations.items())
            if one.reports >= MIN_REPORTS and not one.is_gone(now)
        ]
        return tuple(
            StationState(number, one.body(number, now), one.report.accuracy, max(now - one.report.measured, 0.0))
            for number, one in there
        )

    def _forget(self, now: float) -> None:
        for number, one in list(self._stations.items()):
            if one.is_gone(now):
                del self._stations[number]

    def _placed(self, report: StationReport, station: _Station | None) -> _Motion:
        """Return the middle of a reported body and its motion on the virtual road; NaN where it lies nowhere."""
        x, y = self._frame.to_map(report.latitude, report.longitude)
        heading = report.heading + self._frame.convergence(report.latitude, report.longitude) + self._rotation
        if math.isnan(heading):
            # Who stands may not know which way they face: they go on facing as before.
            heading = 0.0 if station is None else station.motion.heading
        east, north = self._cosine * x - self._sine * y, self._sine * x + self._cosine * y
        return _Motion(
            report.measured,
            east + self._setup.alignment.x - report.ahead * math.cos(heading),
            north + self._setup.alignment.y - report.ahead * math.sin(heading),
            heading,
            report.speed,
            report.yaw_rate,
        )


class _Motion(NamedTuple):
    """Where a body was at a time on the virtual road, and how it moved."""

    time: float  #: drive time [s]
    x: float  #: of the middle, map [m]
    y: float  #: likewise
    heading: float  #: [rad], counter-clockwise from the map's +x
    speed: float  #: [m/s]
    yaw_rate: float  #: [rad/s]

    def at(self, now: float) -> tuple[float, float, float]:
        """Return place [m] and heading [rad] at a drive time [s], at constant speed and yaw rate."""
        elapsed = min(max(now - self.time, 0.0), EXTRAPOLATION)
        middle = self.heading + 0.5 * self.yaw_rate * elapsed
        way = self.speed * elapsed
        return (
            self.x + way * math.cos(middle),
            self.y + way * math.sin(middle),
            self.heading + self.yaw_rate * elapsed,
        )


class _Station:
    """One station, since its first report that was believed."""

    def __init__(self, report: StationReport, place: Place, motion: _Motion) -> None:
        self.report, self.place, self.motion, self.reports = report, place, motion, 1
        self._off_x = self._off_y = 0.0  # of the body from where its station had it, when that was last said [m]
        self._said = report.measured  # drive time of that [s]

    def update(self, now: float, report: StationReport, place: Place, motion: _Motion) -> None:
        """Take the next report, which arrived at drive time `now` [s]."""
        if self.reports >= MIN_REPORTS:
            shown_x, shown_y = self._shown(now)
            x, y, _heading = motion.at(now)
            self._off_x, self._off_y, self._said = shown_x - x, shown_y - y, now
            if math.hypot(self._off_x, self._off_y) > MAX_OFFSET:
                self._off_x = self._off_y = 0.0
        self.report, self.place, self.motion = report, place, motion
        self.reports += 1

    def is_gone(self, now: float) -> bool:
        """Whether the last report is too old at drive time `now` [s]."""
        return now - self.report.measured > LIFETIMES[self.report.message]

    def body(self, number: int, now: float) -> ActorState:
        """Return the body at drive time `now` [s]."""
        x, y = self._shown(now)
        going = now - self.report.measured <= EXTRAPOLATION
        heading, report = math.remainder(self.motion.at(now)[2], math.tau), self.report
        speed = report.speed if going else 0.0
        return ActorState(f"station.{number}", report.kind, x, y, heading, speed, report.length, report.width)

    def _shown(self, now: float) -> tuple[float, float]:
        x, y, _heading = self.motion.at(now)
        share = math.exp(-max(now - self._said, 0.0) / CATCH_UP)
        return x + share * self._off_x, y + share * self._off_y
