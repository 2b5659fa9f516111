"""Judges positions that a person's phone or receiver reports: which are believed, and why the others are not.

Knows no virtual road and no car. A position that is not believed changes nothing but the age of the last one.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from vve_sumo.people.reports import PositionReport

#: A position dated later than it arrived by more than this is of another clock [s].
FUTURE_TOLERANCE: Final = 0.05

#: A field is not larger: a position farther from its anchor is of another place on Earth [m].
MAX_FIELD_RADIUS: Final = 2000.0

#: Reason codes of positions that are not believed, in plain words.
REASONS: Final[dict[str, str]] = {
    "report_elsewhere": "the person's position is kilometres from the field's anchor",
    "report_from_future": "the person's position is dated later than it arrived",
    "report_inaccurate": "the person's position is less accurate than the scenario takes",
    "report_jumped": "the person's position is farther from the last one than a person can go",
    "report_not_finite": "the person's position holds what is no number, no place on Earth or no accuracy",
    "report_old": "the person's position was too old when it arrived",
    "report_out_of_order": "the person's position is not newer than the last one",
}


class Place(NamedTuple):
    """A reported place in the field's map."""

    time: float  #: drive time [s]
    x: float  #: [m]
    y: float  #: [m]
    accuracy: float  #: radius of the 95 % circle [m]


class ReportGate:
    """Believes positions that are finite, new, in order, accurate enough, and within a person's reach of the last."""

    def __init__(self, max_speed: float, max_accuracy: float, max_age: float) -> None:
        """Judge the positions of a person who goes no faster than `max_speed` [m/s].

        Positions are refused with an accuracy above `max_accuracy` [m], and older than `max_age` [s] on arrival.
        """
        self._max_speed, self._max_accuracy, self._max_age = max_speed, max_accuracy, max_age
        self._last: Place | None = None

    def step(self, received: float, report: PositionReport, place: Place) -> str:
        """Return the reason code for which a position is refused; empty for one that is believed.

        `received` is the drive time of its arrival [s], `place` where it lies in the field's map.
        """
        reason = self._judge(received, report, place)
        if not reason:
            self._last = place
        return reason

    def forget(self) -> None:
        """Forget the last position: the next one is the first of a person who was lost."""
        self._last = None

    def _judge(self, received: float, report: PositionReport, place: Place) -> str:
        if not (
            all(map(math.isfinite, (received, *place)))
            and abs(report.latitude) <= 0.5 * math.pi
            and place.accuracy > 0.0
        ):
            return "report_not_finite"
        if math.hypot(place.x, place.y) > MAX_FIELD_RADIUS:
            return "report_elsewhere"
        if place.time > received + FUTURE_TOLERANCE:
            return "report_from_future"
        if self._last is not None and place.time <= self._last.time:
            return "report_out_of_order"
        if received - place.time > self._max_age:
            return "report_old"
        # Before the accuracy: a place that nobody can have reached may be where they are, however vague it is.
        if self._last is not None and not self._reaches(self._last, place):
            return "report_jumped"
        return "report_inaccurate" if place.accuracy > self._max_accuracy else ""

    def _reaches(self, last: Place, place: Place) -> bool:
        way = math.hypot(place.x - last.x, place.y - last.y)
        return way <= last.accuracy + place.accuracy + self._max_speed * (place.time - last.time)
