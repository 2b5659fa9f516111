"""Codec of the VRU awareness message, VAM (ETSI TS 103 300-3 V2.3.1, release 2): pedestrians, cyclists and the like.

Altitude and confidences other than the position's are sent as unavailable; clusters, predictions and exterior lights
are absent, and not read of a received message. The module must not know when a message is due.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

from vve_sumo.frozen import fast_frozen
from vve_sumo.v2x import uper
from vve_sumo.v2x.data_elements import (
    ACCELERATION,
    SPEED,
    YAW_RATE,
    StationType,
    heading_count,
    heading_of,
    require_number,
    rounded_heading,
)
from vve_sumo.v2x.its_time import GENERATION_DELTA, require_time, unfold
from vve_sumo.v2x.pdu_header import MessageId, header_content, require_station, station_of
from vve_sumo.v2x.reference_position import (
    AXIS_LENGTHS,
    ConfidenceEllipse,
    position_content,
    position_of,
    rounded_position,
)

# Confidences that are unavailable: of heading and speed, acceleration, yaw rate.
_NO_CONFIDENCE, _NO_ACCELERATION_CONFIDENCE, _NO_YAW_RATE_CONFIDENCE = 127, 102, 8
_MAX_SUB_PROFILE: Final = 15


class Profile(IntEnum):
    """Kinds of vulnerable road users (VRU profiles of TS 103 300-2)."""

    PEDESTRIAN = 1
    BICYCLIST_AND_LIGHT_VRU_VEHICLE = 2
    MOTORCYCLIST = 3
    ANIMAL = 4


#: names of the profiles in the choice of them
_PROFILES: Final = {
    Profile.PEDESTRIAN: "pedestrian",
    Profile.BICYCLIST_AND_LIGHT_VRU_VEHICLE: "bicyclistAndLightVruVehicle",
    Profile.MOTORCYCLIST: "motorcyclist",
    Profile.ANIMAL: "animal",
}
_PROFILE_OF: Final = {name: profile for profile, name in _PROFILES.items()}


class SizeClass(IntEnum):
    """About how large the road user is among those of its profile."""

    UNAVAILABLE = 0
    LOW = 1
    MEDIUM = 2
    HIGH = 3


class Environment(IntEnum):
    """Where the road user is."""

    UNAVAILABLE = 0
    INTERSECTION_CROSSING = 1
    ZEBRA_CROSSING = 2
    SIDEWALK = 3
    ON_VEHICLE_ROAD = 4
    PROTECTED_GEOGRAPHIC_AREA = 5


@fast_frozen
@dataclass(frozen=True, slots=True)
class Vam:
    """What a vulnerable road user says of itself; None is unavailable."""

    station: int  #: identifier, 32 bits
    station_type: StationType
    time_ms: int  #: TimestampIts at which it was where it says [ms since 2004-01-01, leap seconds counted]
    latitude_deg: float  #: WGS84, of its reference position [degree]
    longitude_deg: float  #: WGS84 [degree]
    confidence: ConfidenceEllipse | None = None  #: of the position
    heading: float | None = None  #: of the motion [rad], counter-clockwise from true east
    speed: float | None = None  #: [m/s], not negative
    acceleration: float | None = None  #: along the motion [m/s2], forward positive
    yaw_rate: float | None = None  #: [rad/s], counter-clockwise
    environment: Environment = Environment.UNAVAILABLE
    profile: Profile | None = None  #: None: the message has no low-frequency container
    sub_profile: int = 0  #: 0 to 15, by the profile; 0 unavailable
    size_class: SizeClass = SizeClass.UNAVAILABLE  #: needs a profile


def encode(vam: Vam) -> bytes:
    """Return the bytes of a message.

    Raises ValueError for a number that is not finite, a place that is not on the earth, a negative speed, and a
    sub-profile or a size without a profile. Raises ConfigError where asn1tools is missing.
    """
    _require(vam)
    motion: dict[str, Any] = {
        "heading": {"value": heading_count(vam.heading), "confidence": _NO_CONFIDENCE},
        "speed": {"speedValue": SPEED.count(vam.speed), "speedConfidence": _NO_CONFIDENCE},
        "longitudinalAcceleration": {
            "longitudinalAccelerationValue": ACCELERATION.count(vam.acceleration),
            "longitudinalAccelerationConfidence": _NO_ACCELERATION_CONFIDENCE,
        },
    }
    if vam.yaw_rate is not None:
        yaw_rate = {"yawRateValue": YAW_RATE.count(vam.yaw_rate), "yawRateConfidence": _NO_YAW_RATE_CONFIDENCE}
        motion["yawRate"] = yaw_rate
    if vam.environment is not Environment.UNAVAILABLE:
        motion["environment"] = int(vam.environment)
    position = position_content(vam.latitude_deg, vam.longitude_deg, vam.confidence, AXIS_LENGTHS)
    parameters: dict[str, Any] = {
        "basicContainer": {"stationType": int(vam.station_type), "referencePosition": position},
        "vruHighFrequencyContainer": motion,
    }
    if vam.profile is not None:
        low: dict[str, Any] = {"profileAndSubprofile": (_PROFILES[vam.profile], vam.sub_profile)}
        if vam.size_class is not SizeClass.UNAVAILABLE:
            low["sizeClass"] = int(vam.size_class)
        parameters["vruLowFrequencyContainer"] = low
    body = {"generationDeltaTime": vam.time_ms % GENERATION_DELTA, "vamParameters": parameters}
    return uper.encode("VAM", {"header": header_content(MessageId.VAM, vam.station), "vam": body})


def _require(vam: Vam) -> None:
    require_station(vam.station)
    require_time(vam.time_ms)
    require_number("sub_profile", vam.sub_profile, 0, _MAX_SUB_PROFILE)
    if vam.profile is None and (vam.sub_profile or vam.size_class):
        raise ValueError("profile: expected one beside a sub-profile or a size class, got None")


def decode(data: bytes, now_ms: int) -> Vam:
    """Return the message of some bytes that came at a TimestampIts [ms], within half a minute of its time.

    Raises MessageDecodeError for bytes that are no VAM or have no position.
    """
    content = uper.decode("VAM", data)
    station, body = station_of(content["header"], MessageId.VAM), content["vam"]
    parameters = body["vamParameters"]
    basic, motion = parameters["basicContainer"], parameters["vruHighFrequencyContainer"]
    position = position_of(basic["referencePosition"], AXIS_LENGTHS)
    yaw_rate = motion.get("yawRate")
    return Vam(
        station,
        StationType.of(basic["stationType"]),
        unfold(body["generationDeltaTime"], GENERATION_DELTA, now_ms),
        position.latitude_deg,
        position.longitude_deg,
        position.ellipse,
        heading_of(motion["heading"]["value"]),
        SPEED.value(motion["speed"]["speedValue"]),
        ACCELERATION.value(motion["longitudinalAcceleration"]["longitudinalAccelerationValue"]),
        None if yaw_rate is None else YAW_RATE.value(yaw_rate["yawRateValue"]),
        _environment(motion.get("environment", 0)),
        *_profile(parameters.get("vruLowFrequencyContainer")),
    )


def _environment(number: int) -> Environment:
    return Environment(number) if number <= Environment.PROTECTED_GEOGRAPHIC_AREA else Environment.UNAVAILABLE


def _profile(low: dict[str, Any] | None) -> tuple[Profile | None, int, SizeClass]:
    """Profile, sub-profile and size class; none for a profile that a later version has added."""
    name, sub_profile = (None, 0) if low is None else low["profileAndSubprofile"]
    if low is None or name not in _PROFILE_OF:
        return None, 0, SizeClass.UNAVAILABLE
    size = low.get("sizeClass", 0)
    return _PROFILE_OF[name], sub_profile, SizeClass(size) if size <= SizeClass.HIGH else SizeClass.UNAVAILABLE


def rounded(vam: Vam) -> Vam:
    """Return what a receiver reads of a message, without making its bytes; raises ValueError as `encode` does."""
    _require(vam)
    latitude_deg, longitude_deg, confidence = rounded_position(vam.latitude_deg, vam.longitude_deg, vam.confidence)
    return Vam(
        vam.station,
        vam.station_type,
        vam.time_ms,
        latitude_deg,
        longitude_deg,
        confidence,
        rounded_heading(vam.heading),
        SPEED.rounded(vam.speed),
        ACCELERATION.rounded(vam.acceleration),
        YAW_RATE.rounded(vam.yaw_rate),
        vam.environment,
        vam.profile,
        vam.sub_profile,
        vam.size_class,
    )
