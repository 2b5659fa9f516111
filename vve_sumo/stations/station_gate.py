"""Judges what stations say of themselves: which reports are believed, and why the others are not.

Knows no virtual road: a place is where the report lies on a plane map. A report that is not believed changes nothing.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from vve_sumo.body_kinds import PERSONS
from vve_sumo.stations.reports import REASONS as UNREAD
from vve_sumo.stations.reports import StationReport

#: a report dated later than it arrived by more than this is of another clock [s]
FUTURE_TOLERANCE: Final = 0.1
#: a report that is older on arrival is too late to be of use [s]
MAX_AGE: Final = 1.0
#: nothing on a road is faster, by what it is [m/s]: assumptions
MAX_SPEED: Final = {"person": 12.0, "bicycle": 25.0, "vehicle": 70.0}
#: no road vehicle brakes harder, and none gains speed as fast [m/s2]
MAX_ACCELERATION: Final = 12.0
#: what two speeds of a station may differ by beyond that [m/s]
SPEED_TOLERANCE: Final = 1.0
#: so many stations may be new within so long [s]
MAX_NEW: Final = 10
NEW_PERIOD: Final = 10.0

#: Reason codes of reports that are not believed, in plain words.
REASONS: Final[dict[str, str]] = UNREAD | {
    "churn": "more stations were new within ten seconds than there can be",
    "elsewhere": "the station is farther away than the rig takes",
    "from_future": "the station's report is dated later than it arrived",
    "ignored": "the rig says that this station is not to be placed: it is the ego's own",
    "inaccurate": "the station knows its place less accurately than the rig takes, or does not say how well",
    "jumped": "the station is farther from where it was than it can have gone",
    "not_finite": "the station's report holds what is no number or no place",
    "old": "the station's report was too old when it arrived",
    "out_of_order": "the station's report is not newer than its last one",
    "too_fast": "the station is faster than anything of its kind",
    "too_many": "more stations are there than the rig takes",
    "unknown_motion": "the station does not say which way it moves",
}


@dataclass(frozen=True, slots=True)
class GateLimits:
    """What a rig takes of stations."""

    reach: float = 500.0  #: from where the ego's path begins [m]
    accuracy: float = 5.0  #: radius that holds the place with 95 % [m]
    stations: int = 32  #: at a time
    ignored: frozenset[int] = frozenset()  #: IDs of the ego's own station


class Place(NamedTuple):
    """Where a report has its station on a plane map."""

    x: float  #: [m]
    y: float  #: [m]


@dataclass(slots=True)
class StationGate:
    """Believes reports that are finite, new, in order, accurate, and within a station's reach of its last."""

    limits: GateLimits
    _new: deque[float] = field(default_factory=deque)  # when stations were new, within NEW_PERIOD [s]

    def judge(
        self, received: float, report: StationReport, place: Place, last: tuple[StationReport, Place] | None, known: int
    ) -> str:
        """Return the reason code for which a report is refused; empty for one that is believed.

        `received` is the drive time of its arrival [s], `place` is relative to where the ego's path begins, `last` is
        the last one of this station that was believed, `known` the number of the stations that are there.
        """
        reason = self._of_itself(received, report, place)
        if reason:
            return reason
        if last is not None:
            return _after(report, place, *last)
        if known >= self.limits.stations:
            return "too_many"
        while self._new and received - self._new[0] > NEW_PERIOD:
            self._new.popleft()
        if len(self._new) >= MAX_NEW:
            return "churn"
        self._new.append(received)
        return ""

    def _of_itself(self, received: float, report: StationReport, place: Place) -> str:
        limits = self.limits
        if report.station in limits.ignored:
            return "ignored"
        if not (is_sound(report) and all(map(math.isfinite, (received, *place)))):
            return "not_finite"
        if report.measured > received + FUTURE_TOLERANCE:
            return "from_future"
        if received - report.measured > MAX_AGE:
            return "old"
        if not report.accuracy <= limits.accuracy:
            return "inaccurate"
        if math.isnan(report.speed) or (report.speed > 0.0 and math.isnan(report.heading)):
            return "unknown_motion"
        if report.speed > _max_speed(report.kind):
            return "too_fast"
        return "elsewhere" if math.hypot(*place) > limits.reach else ""


def is_sound(report: StationReport) -> bool:
    """Whether a report has a place, a size and numbers; NaN stands only for what may be unknown."""
    known = (report.measured, report.latitude, report.longitude, report.ahead, report.yaw_rate)
    return (
        all(map(math.isfinite, known))
        and abs(report.latitude) <= 0.5 * math.pi
        and not (math.isinf(report.heading) or math.isinf(report.speed) or report.speed < 0.0)
        and 0.0 < report.length < math.inf
        and 0.0 < report.width < math.inf
        and not report.accuracy <= 0.0
    )


def _after(report: StationReport, place: Place, last: StationReport, last_place: Place) -> str:
    """Return why a report cannot follow another of the same station; empty where it can."""
    elapsed = report.measured - last.measured
    if elapsed <= 0.0:
        return "out_of_order"
    fastest = max(report.speed, last.speed) + 0.5 * MAX_ACCELERATION * elapsed
    way = math.hypot(place.x - last_place.x, place.y - last_place.y)
    # The middle of a body that turns about its front moves on by half a length at most.
    turned = abs(report.ahead) + abs(last.ahead)
    if way > report.accuracy + last.accuracy + turned + fastest * elapsed:
        return "jumped"
    if abs(report.speed - last.speed) > SPEED_TOLERANCE + MAX_ACCELERATION * elapsed:
        return "jumped"
    return "jumped" if report.kind != last.kind else ""


def _max_speed(kind: str) -> float:
    return MAX_SPEED["person" if kind in PERSONS else "bicycle" if kind == "bicycle" else "vehicle"]
