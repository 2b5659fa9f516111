"""Codec of the signal phase and timing message, SPATEM (ETSI TS 103 301 V2.1.1, ISO/TS 19091).

Advisory speeds, queues, prioritizations and names are not sent, and not read of a received message. The module must not
know how a signal is controlled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum, IntFlag
from typing import Any, Final

from vve_sumo.v2x import dsrc
from vve_sumo.v2x.data_elements import require_number
from vve_sumo.v2x.dsrc import MAX_INTERSECTIONS, SECOND, TIME_MARK, UNKNOWN_MINUTE
from vve_sumo.v2x.pdu_header import MessageId, require_station

MAX_MOVEMENTS, MAX_EVENTS = 255, 16
_STATUS_BITS: Final = 16


class Phase(IntEnum):
    """What a signal shows (MovementPhaseState)."""

    UNAVAILABLE = 0
    DARK = 1
    STOP_THEN_PROCEED = 2  #: flashing red
    STOP_AND_REMAIN = 3  #: red
    PRE_MOVEMENT = 4  #: red and yellow
    PERMISSIVE_MOVEMENT_ALLOWED = 5  #: green, others may have the right of way
    PROTECTED_MOVEMENT_ALLOWED = 6  #: green, nobody else may go
    PERMISSIVE_CLEARANCE = 7  #: yellow after permissive green
    PROTECTED_CLEARANCE = 8  #: yellow after protected green
    CAUTION_CONFLICTING_TRAFFIC = 9  #: flashing yellow


#: names of the phases in the ASN.1
_PHASES: Final = (
    "unavailable", "dark", "stop-Then-Proceed", "stop-And-Remain", "pre-Movement", "permissive-Movement-Allowed",
    "protected-Movement-Allowed", "permissive-clearance", "protected-clearance", "caution-Conflicting-Traffic",
)  # fmt: skip


class Status(IntFlag):
    """How the controller of an intersection works (IntersectionStatusObject). The standard's bit 0 is the highest."""

    MANUAL_CONTROL = 1 << 15
    STOP_TIME = 1 << 14
    FAILURE_FLASH = 1 << 13
    PREEMPT = 1 << 12
    SIGNAL_PRIORITY = 1 << 11
    FIXED_TIME = 1 << 10
    TRAFFIC_DEPENDENT = 1 << 9
    STANDBY = 1 << 8
    FAILURE_MODE = 1 << 7
    OFF = 1 << 6
    RECENT_MAP_UPDATE = 1 << 5
    RECENT_CHANGE_OF_LANES = 1 << 4
    NO_VALID_MAP = 1 << 3
    NO_VALID_SPAT = 1 << 2


_NOTHING_SPECIAL: Final = Status(0)


@dataclass(frozen=True, slots=True)
class Event:
    """One phase of a signal; times count from the full hour in UTC, of this hour or the next; None is unknown."""

    phase: Phase
    min_end: float | None = None  #: earliest end [s], 0 to 3600, to 0.1
    max_end: float | None = None  #: latest end [s], likewise
    likely_end: float | None = None  #: [s], likewise
    start: float | None = None  #: [s], likewise
    next_start: float | None = None  #: of the same phase again [s], likewise
    confidence: int | None = None  #: class of the likely end's probability, 0 to 15


@dataclass(frozen=True, slots=True)
class Movement:
    """A group of signals that always show the same."""

    signal_group: int  #: 0 to 255, by which lanes of a MAPEM name it
    events: tuple[Event, ...]  #: the present one, then what follows; 1 to 16


@dataclass(frozen=True, slots=True)
class IntersectionState:
    """The signals of one intersection."""

    id: int  #: 0 to 65535
    movements: tuple[Movement, ...]  #: 1 to 255
    region: int | None = None  #: of the identifier, 0 to 65535
    revision: int = 0  #: of the content's changes, 0 to 127
    status: Status = _NOTHING_SPECIAL
    minute_of_year: int | None = None  #: in UTC, from 0
    second: float | None = None  #: within the minute [s], to 0.001


@dataclass(frozen=True, slots=True)
class Spatem:
    """What the signals of some intersections show, and until when."""

    station: int  #: identifier, 32 bits
    intersections: tuple[IntersectionState, ...]  #: 1 to 32


def encode(spatem: Spatem) -> bytes:
    """Return the bytes of a message.

    Raises ValueError for what no message can say: numbers that are not finite, negative or beyond their range, too many
    or no parts. Raises ConfigError where pycrate is missing.
    """
    _require(spatem)
    states = [_state_content(state) for state in spatem.intersections]
    return dsrc.encode(MessageId.SPATEM, spatem.station, {"intersections": states})


def _require(spatem: Spatem) -> None:
    require_station(spatem.station)
    require_number("intersections", len(spatem.intersections), 1, MAX_INTERSECTIONS)
    for state in spatem.intersections:
        for name, value, greatest in (
            ("id", state.id, 0xFFFF),
            ("region", state.region, 0xFFFF),
            ("revision", state.revision, 127),
            ("minute_of_year", state.minute_of_year, UNKNOWN_MINUTE - 1),
        ):
            require_number(name, value, 0, greatest)
        require_number("movements", len(state.movements), 1, MAX_MOVEMENTS)
        for movement in state.movements:
            require_number("signal_group", movement.signal_group, 0, 255)
            require_number("events", len(movement.events), 1, MAX_EVENTS)
            for event in movement.events:
                require_number("confidence", event.confidence, 0, 15)


def _state_content(state: IntersectionState) -> dict[str, Any]:
    content: dict[str, Any] = {
        "id": {"id": state.id} if state.region is None else {"region": state.region, "id": state.id},
        "revision": state.revision,
        "status": (int(state.status), _STATUS_BITS),
        "states": [
            {"signalGroup": one.signal_group, "state-time-speed": [_event_content(event) for event in one.events]}
            for one in state.movements
        ],
    }
    if state.minute_of_year is not None:
        content["moy"] = state.minute_of_year
    if state.second is not None:
        content["timeStamp"] = SECOND.count(state.second)
    return content


def _event_content(event: Event) -> dict[str, Any]:
    timing = {
        name: TIME_MARK.count(value)
        for name, value in (
            ("startTime", event.start),
            ("maxEndTime", event.max_end),
            ("likelyTime", event.likely_end),
            ("nextTime", event.next_start),
        )
        if value is not None
    }
    if event.confidence is not None:
        timing["confidence"] = event.confidence
    content: dict[str, Any] = {"eventState": _PHASES[event.phase]}
    if timing or event.min_end is not None:
        content["timing"] = timing | {"minEndTime": TIME_MARK.count(event.min_end)}
    return content


def decode(data: bytes) -> Spatem:
    """Return the message of some bytes; raises MessageDecodeError for bytes that are no SPATEM."""
    station, body = dsrc.decode(MessageId.SPATEM, data)
    return Spatem(station, tuple(_state_of(content) for content in body["intersections"]))


def _state_of(content: dict[str, Any]) -> IntersectionState:
    minute, second = content.get("moy", UNKNOWN_MINUTE), content.get("timeStamp", SECOND.unavailable)
    return IntersectionState(
        content["id"]["id"],
        tuple(
            Movement(one["signalGroup"], tuple(_event_of(event) for event in one["state-time-speed"]))
            for one in content["states"]
        ),
        content["id"].get("region"),
        content["revision"],
        Status(content["status"][0]),
        None if minute == UNKNOWN_MINUTE else minute,
        SECOND.value(second),
    )


def _event_of(content: dict[str, Any]) -> Event:
    timing = content.get("timing", {})
    min_end, max_end, likely_end, start, next_start = (
        TIME_MARK.value(timing.get(name, TIME_MARK.unavailable))
        for name in ("minEndTime", "maxEndTime", "likelyTime", "startTime", "nextTime")
    )
    phase = Phase(_PHASES.index(content["eventState"]))
    return Event(phase, min_end, max_end, likely_end, start, next_start, timing.get("confidence"))


def rounded(spatem: Spatem) -> Spatem:
    """Return what a receiver reads of a message, without making its bytes; raises ValueError as `encode` does."""
    _require(spatem)
    return replace(spatem, intersections=tuple(_rounded_state(state) for state in spatem.intersections))


def _rounded_state(state: IntersectionState) -> IntersectionState:
    movements = tuple(
        Movement(one.signal_group, tuple(_rounded_event(event) for event in one.events)) for one in state.movements
    )
    return replace(state, movements=movements, second=SECOND.rounded(state.second))


def _rounded_event(event: Event) -> Event:
    return Event(
        event.phase,
        TIME_MARK.rounded(event.min_end),
        TIME_MARK.rounded(event.max_end),
        TIME_MARK.rounded(event.likely_end),
        TIME_MARK.rounded(event.start),
        TIME_MARK.rounded(event.next_start),
        event.confidence,
    )
