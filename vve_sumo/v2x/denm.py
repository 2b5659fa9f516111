"""Codec of the decentralized environmental notification message, DENM (ETSI TS 103 831 V2.3.1, release 2).

Release 1 (EN 302 637-3 V1.3.1) has the same bytes for what is sent here, under some other names: relevance distance for
awareness distance, traces for detection zones. One empty detection zone is sent, the container "à la carte" never. What
a received message has beyond `Denm` is not read. The module must not know when an event is over.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final, TypeVar

from vve_sumo.frozen import fast_frozen
from vve_sumo.v2x import uper
from vve_sumo.v2x.data_elements import SPEED, StationType, heading_count, heading_of, require_number, rounded_heading
from vve_sumo.v2x.decode_error import MessageDecodeError
from vve_sumo.v2x.its_time import require_time
from vve_sumo.v2x.pdu_header import MAX_STATION, MessageId, header_content, require_station, station_of
from vve_sumo.v2x.reference_position import (
    CONFIDENCES,
    ConfidenceEllipse,
    position_content,
    position_of,
    rounded_position,
)

MAX_CAUSE: Final = 128  #: causes beyond cannot be sent in release 2
DEFAULT_VALIDITY: Final = 600  #: [s]
MAX_VALIDITY: Final = 86_400  #: [s]
MAX_INTERVAL: Final = 10_000  #: [ms]
_NO_CONFIDENCE: Final = 127  # of speed and heading
_NOTHING: Final = (None, 0, 0, None, None)  # what a termination says of cause, sub-cause, quality, speed and heading

Kind = TypeVar("Kind", bound=IntEnum)


class Cause(IntEnum):
    """What has happened: the cause codes that are not reserved."""

    TRAFFIC_CONDITION = 1
    ACCIDENT = 2
    ROADWORKS = 3
    DETECTED_ROADWORKS = 4
    IMPASSABILITY = 5
    ADHESION = 6
    AQUAPLANING = 7
    SURFACE_CONDITION = 9
    OBSTACLE_ON_THE_ROAD = 10
    ANIMAL_ON_THE_ROAD = 11
    HUMAN_PRESENCE_ON_THE_ROAD = 12
    WRONG_WAY_DRIVING = 14
    RESCUE_RECOVERY_AND_MAINTENANCE_WORK_IN_PROGRESS = 15
    WIND = 17
    VISIBILITY = 18
    PRECIPITATION = 19
    VIOLENCE = 20
    SLOW_VEHICLE = 26
    DANGEROUS_END_OF_QUEUE = 27
    PUBLIC_TRANSPORT_VEHICLE_APPROACHING = 28
    VEHICLE_BREAKDOWN = 91
    POST_CRASH = 92
    HUMAN_PROBLEM = 93
    STATIONARY_VEHICLE = 94
    EMERGENCY_VEHICLE_APPROACHING = 95
    DANGEROUS_CURVE = 96
    COLLISION_RISK = 97
    SIGNAL_VIOLATION = 98
    DANGEROUS_SITUATION = 99
    RAILWAY_LEVEL_CROSSING = 100


class Termination(IntEnum):
    """How an event ends: by its originator, or denied by another station."""

    CANCELLATION = 0
    NEGATION = 1


class AwarenessDistance(IntEnum):
    """How far from the event one should know of it."""

    LESS_THAN_50_M = 0
    LESS_THAN_100_M = 1
    LESS_THAN_200_M = 2
    LESS_THAN_500_M = 3
    LESS_THAN_1000_M = 4
    LESS_THAN_5_KM = 5
    LESS_THAN_10_KM = 6
    OVER_10_KM = 7


class TrafficDirection(IntEnum):
    """Whom the event may meet."""

    ALL = 0
    UPSTREAM = 1  #: towards the event, in the reference direction
    DOWNSTREAM = 2  #: away from the event, in the reference direction
    OPPOSITE = 3


@fast_frozen
@dataclass(frozen=True, slots=True)
class Denm:
    """One notification of an event; None is absent or unavailable."""

    station: int  #: identifier of the sender, 32 bits
    station_type: StationType  #: of the sender
    originator: int  #: identifier of the station that first told of the event, 32 bits
    sequence: int  #: number of the event at its originator, 0 to 65535
    detection_time_ms: int  #: TimestampIts [ms]
    reference_time_ms: int  #: TimestampIts of this notification, update or termination [ms]
    latitude_deg: float  #: WGS84, of the event [degree]
    longitude_deg: float  #: WGS84, of the event [degree]
    cause: int | None  #: as in `Cause`, or another of 0 to 128; None for a termination, which has none
    sub_cause: int = 0  #: 0 to 255, by the cause; 0 unavailable
    confidence: ConfidenceEllipse | None = None  #: of the position
    termination: Termination | None = None  #: None: the event is there
    quality: int = 0  #: of the information, 1 lowest to 7 highest; 0 unavailable
    awareness_distance: AwarenessDistance | None = None
    traffic_direction: TrafficDirection | None = None
    validity_s: int = DEFAULT_VALIDITY  #: for which it holds, from the detection [s], at most a day
    interval_ms: int | None = None  #: at which it is repeated [ms], 1 to 10000
    speed: float | None = None  #: of the event [m/s], not negative
    heading: float | None = None  #: of the event [rad], counter-clockwise from true east


def encode(denm: Denm) -> bytes:
    """Return the bytes of a notification.

    Raises ValueError for what no message can say: numbers that are not finite or beyond their range, places that are
    not on the earth, a termination with a cause, an event without one. Raises ConfigError where asn1tools is missing.
    """
    _require(denm)
    management: dict[str, Any] = {
        "actionId": {"originatingStationId": denm.originator, "sequenceNumber": denm.sequence},
        "detectionTime": denm.detection_time_ms,
        "referenceTime": denm.reference_time_ms,
        "eventPosition": position_content(denm.latitude_deg, denm.longitude_deg, denm.confidence, CONFIDENCES),
        "validityDuration": denm.validity_s,
        "stationType": int(denm.station_type),
    }
    for name, value in (
        ("termination", denm.termination),
        ("awarenessDistance", denm.awareness_distance),
        ("trafficDirection", denm.traffic_direction),
        ("transmissionInterval", denm.interval_ms),
    ):
        if value is not None:
            management[name] = int(value)
    body: dict[str, Any] = {"management": management}
    if denm.cause is not None:
        event = {"ccAndScc": (uper.alternatives("DENM", "CauseCodeChoice")[denm.cause], denm.sub_cause)}
        body["situation"] = {"informationQuality": denm.quality, "eventType": event}
        body["location"] = _location_content(denm)
    return uper.encode("DENM", {"header": header_content(MessageId.DENM, denm.station), "denm": body})


def _location_content(denm: Denm) -> dict[str, Any]:
    location: dict[str, Any] = {"detectionZonesToEventPosition": [[]]}
    if denm.speed is not None:
        location["eventSpeed"] = {"speedValue": SPEED.count(denm.speed), "speedConfidence": _NO_CONFIDENCE}
    if denm.heading is not None:
        location["eventPositionHeading"] = {"value": heading_count(denm.heading), "confidence": _NO_CONFIDENCE}
    return location


def _require(denm: Denm) -> None:
    """Raise ValueError for whole numbers beyond their range, and for what a termination or an event may not say."""
    require_station(denm.station)
    for time_ms in (denm.detection_time_ms, denm.reference_time_ms):
        require_time(time_ms)
    for name, value, least, greatest in (
        ("originator", denm.originator, 0, MAX_STATION),
        ("sequence", denm.sequence, 0, 0xFFFF),
        ("cause", denm.cause, 0, MAX_CAUSE),
        ("sub_cause", denm.sub_cause, 0, 0xFF),
        ("quality", denm.quality, 0, 7),
        ("validity_s", denm.validity_s, 0, MAX_VALIDITY),
        ("interval_ms", denm.interval_ms, 1, MAX_INTERVAL),
    ):
        require_number(name, value, least, greatest)
    if denm.termination is None and denm.cause is None:
        raise ValueError("cause: expected one for an event that is not terminated, got None")
    if (
        denm.termination is not None
        and (denm.cause, denm.sub_cause, denm.quality, denm.speed, denm.heading) != _NOTHING
    ):
        raise ValueError("a termination has no cause, quality, speed or heading, expected None and 0")


def decode(data: bytes) -> Denm:
    """Return the notification of some bytes; its times are whole, so that no clock is needed.

    Raises MessageDecodeError for bytes that are no DENM, have no position, or are neither an event nor a termination.
    """
    content = uper.decode("DENM", data)
    station, body = station_of(content["header"], MessageId.DENM), content["denm"]
    management, situation = body["management"], body.get("situation")
    termination = management.get("termination")
    if (termination is None) == (situation is None):
        raise MessageDecodeError("expected either a situation or a termination")
    position = position_of(management["eventPosition"], CONFIDENCES)
    cause, sub_cause, quality = (None, 0, 0) if situation is None else _situation(situation)
    location = body.get("location", {})
    speed, heading = location.get("eventSpeed"), location.get("eventPositionHeading")
    return Denm(
        station,
        StationType.of(management["stationType"]),
        management["actionId"]["originatingStationId"],
        management["actionId"]["sequenceNumber"],
        management["detectionTime"],
        management["referenceTime"],
        position.latitude_deg,
        position.longitude_deg,
        cause,
        sub_cause,
        position.ellipse,
        None if termination is None else Termination(termination),
        quality,
        _known(AwarenessDistance, management.get("awarenessDistance")),
        _known(TrafficDirection, management.get("trafficDirection")),
        management["validityDuration"],
        management.get("transmissionInterval"),
        None if speed is None else SPEED.value(speed["speedValue"]),
        None if heading is None else heading_of(heading["value"]),
    )


def _situation(situation: dict[str, Any]) -> tuple[int, int, int]:
    """Cause, sub-cause and quality."""
    name, sub_cause = situation["eventType"]["ccAndScc"]
    return uper.alternatives("DENM", "CauseCodeChoice").index(name), sub_cause, situation["informationQuality"]


def _known(kind: type[Kind], number: int | None) -> Kind | None:
    return None if number is None else kind(number)


def rounded(denm: Denm) -> Denm:
    """Return what a receiver reads of a notification, without making its bytes; raises ValueError as `encode` does."""
    _require(denm)
    position = rounded_position(denm.latitude_deg, denm.longitude_deg, denm.confidence)
    return replace(
        denm,
        latitude_deg=position.latitude_deg,
        longitude_deg=position.longitude_deg,
        confidence=position.ellipse,
        speed=SPEED.rounded(denm.speed),
        heading=rounded_heading(denm.heading),
    )
