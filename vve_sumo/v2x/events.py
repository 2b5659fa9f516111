"""Says when a vehicle warns of what has happened to it, and what its notification (DENM) then says.

Two events that a vehicle knows of by itself: it brakes hard, or it stands with its hazard lights on. The conditions are
those of CAR 2 CAR's release 1 (C2C-CC RS 2003, dangerous situation, and RS 2006, stationary vehicle, R1.6.10); the
deceleration is that of the emergency braking signal of UN R13-H (5.2.23). That UN R48 lights the lamp only above 50
km/h is left out: in a lot nobody is as fast. Times are whole microseconds. Knows no radio.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from vve_sumo.v2x.data_elements import StationType
from vve_sumo.v2x.denm import AwarenessDistance, Cause, Denm, Termination, TrafficDirection
from vve_sumo.v2x.reference_position import ConfidenceEllipse

#: from this deceleration on a vehicle tells that it brakes hard [m/s2] (UN R13-H: no signal below it)
HARD_BRAKING: Final = 6.0
#: below this one it does so no longer [m/s2] (UN R13-H: off at the latest)
BRAKING_ENDS: Final = 2.5
#: slower than this a vehicle stands [m/s]: an assumption
STANDING: Final = 0.3
#: so long a vehicle has stood with its hazard lights on before it tells of it [us]: RS 2006's 30 s, less 10 s each for
#: a gear in park and a parking brake that is on, as who has broken down leaves them
STANDING_TIME: Final = 10_000_000
#: between two notifications of a vehicle that stands [us]
STANDING_INTERVAL: Final = 1_000_000
#: so often the event of a vehicle that stands is detected anew [us]
STANDING_UPDATE: Final = 15_000_000
#: so long the end of such an event is told of [us]
CANCELLED_FOR: Final = 15_000_000
#: a vehicle that has moved for so long stands no longer [us]
MOVING_TIME: Final = 5_000_000
SEQUENCES: Final = 1 << 16  #: numbers of events begin again after so many
_LONG_AGO: Final = -(2**62)


class EventKind(NamedTuple):
    """What a notification says of every event of a cause."""

    sub_cause: int
    validity_s: int  #: after the detection [s]
    interval_ms: int  #: between two notifications [ms]
    distance: AwarenessDistance
    radius: int  #: of the area that a notification is for [m]
    traffic_class: int  #: profile of congestion control (TS 103 175: DP0, DP1)


#: by cause: an emergency brake light, and a vehicle that has broken down
KINDS: Final[Mapping[Cause, EventKind]] = {
    Cause.DANGEROUS_SITUATION: EventKind(1, 2, 100, AwarenessDistance.LESS_THAN_500_M, 500, 0),
    Cause.STATIONARY_VEHICLE: EventKind(2, 30, 1000, AwarenessDistance.LESS_THAN_1000_M, 1000, 1),
}


class Notice(NamedTuple):
    """A notification that is due."""

    cause: Cause
    sequence: int  #: of the event at its station
    detected: int  #: when the event was last detected [us]
    ended: bool = False  #: it is the end of the event that is told of


@dataclass(slots=True)
class EventTrigger:
    """The rules of one vehicle. Pass it every check in order."""

    standing_time: int = STANDING_TIME  #: with its hazard lights on, before it tells of it [us]
    _sequence: int = -1  # of the newest event
    _braking: int | None = None  # the event's number while it lasts
    _stationary: int | None = None  # likewise, until nobody is told any more that it has ended
    _detected: int = 0  # when the vehicle that stands was last detected [us]
    _sent: int = 0  # the last notification of it [us]
    _cancelled: int | None = None  # since when its end is told of [us]
    _stood: int | None = None  # since when it has stood with its hazard lights on [us]
    _moved: int | None = None  # since when it has moved again [us]
    _checked: bool = False

    def due(self, now: int, acceleration: float, speed: float, *, hazard_lights: bool) -> tuple[Notice, ...]:
        """Return the notifications to be sent at a time [us].

        The acceleration is along the way [m/s2], the speed over the ground [m/s]. A vehicle that stands at the first
        check has stood long enough.
        """
        notices = (self._of_braking(now, acceleration), self._of_standing(now, speed < STANDING, hazard_lights))
        self._checked = True
        return tuple(notice for notice in notices if notice is not None)

    def _of_braking(self, now: int, acceleration: float) -> Notice | None:
        """While the vehicle brakes, each check detects the event anew; nothing tells of its end."""
        if acceleration > -(HARD_BRAKING if self._braking is None else BRAKING_ENDS):
            self._braking = None
            return None
        if self._braking is None:
            self._braking = self._next()
        return Notice(Cause.DANGEROUS_SITUATION, self._braking, now)

    def _of_standing(self, now: int, stands: bool, hazard_lights: bool) -> Notice | None:
        if not (stands and hazard_lights):
            self._stood = None
        elif self._stood is None:
            self._stood = now if self._checked else _LONG_AGO
        if self._stationary is None:
            if self._stood is None or now - self._stood < self.standing_time:
                return None
            self._stationary, self._cancelled, self._moved = self._next(), None, None
            self._detected = self._sent = now
            return Notice(Cause.STATIONARY_VEHICLE, self._stationary, now)
        return self._of_stationary(self._stationary, now, stands, hazard_lights)

    def _of_stationary(self, number: int, now: int, stands: bool, hazard_lights: bool) -> Notice | None:
        """Go on with an event: told of each second, detected anew each 15 s, and at last called off."""
        self._moved = None if stands else now if self._moved is None else self._moved
        over = not hazard_lights or (self._moved is not None and now - self._moved >= MOVING_TIME)
        if over and self._cancelled is None:
            self._cancelled, self._sent = now, _LONG_AGO
        if self._cancelled is not None and now - self._cancelled >= CANCELLED_FOR:
            self._stationary = None
            return None
        if now - self._sent < STANDING_INTERVAL:
            return None
        self._sent = now
        if self._cancelled is None and now - self._detected >= STANDING_UPDATE:
            self._detected = now
        return Notice(Cause.STATIONARY_VEHICLE, number, self._detected, self._cancelled is not None)

    def _next(self) -> int:
        self._sequence = (self._sequence + 1) % SEQUENCES
        return self._sequence


class Warner(NamedTuple):
    """Who warns, and where."""

    station: int
    station_type: StationType
    time_ms: int  #: TimestampIts of the notification [ms]
    latitude_deg: float
    longitude_deg: float
    confidence: ConfidenceEllipse | None
    heading: float  #: [rad], counter-clockwise from true east
    speed: float  #: [m/s]


def notification(notice: Notice, warner: Warner, detected_ms: int) -> Denm:
    """Return the message of a notice; `detected_ms` is the TimestampIts of the event's detection [ms]."""
    kind, there = KINDS[notice.cause], not notice.ended
    return Denm(
        warner.station,
        warner.station_type,
        warner.station,
        notice.sequence,
        detected_ms,
        warner.time_ms,
        warner.latitude_deg,
        warner.longitude_deg,
        int(notice.cause) if there else None,
        kind.sub_cause if there else 0,
        warner.confidence,
        None if there else Termination.CANCELLATION,
        awareness_distance=kind.distance,
        traffic_direction=TrafficDirection.ALL,
        validity_s=kind.validity_s,
        interval_ms=kind.interval_ms,
        speed=warner.speed if there else None,
        heading=math.remainder(warner.heading, math.tau) if there else None,
    )
