"""Codec of the cooperative awareness message, CAM (ETSI TS 103 900 V2.3.1, release 2).

Release 1 (EN 302 637-2 V1.4.1) has the same bytes for what is sent here. Altitude and confidences other than the
position's are sent as unavailable, the path history is empty, optional containers are absent; what a received message
has of them is not read. The module must not know when a message is due.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from vve_sumo.frozen import fast_frozen
from vve_sumo.v2x import uper
from vve_sumo.v2x.data_elements import (
    ACCELERATION,
    CURVATURE,
    SPEED,
    VEHICLE_LENGTH,
    VEHICLE_WIDTH,
    YAW_RATE,
    ExteriorLights,
    StationType,
    heading_count,
    heading_of,
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

# What is unavailable: confidences of heading and speed, acceleration, curvature and yaw rate, whether there is a
# trailer, and how the curvature was found.
_NO_CONFIDENCE, _NO_ACCELERATION_CONFIDENCE, _NO_CURVATURE_CONFIDENCE, _NO_YAW_RATE_CONFIDENCE = 127, 102, 7, 8
_NO_TRAILER_INFORMATION, _NO_CALCULATION_MODE = 4, 2
_DEFAULT_ROLE: Final = 0
_DIRECTIONS: Final = {False: 0, True: 1, None: 2}
_REVERSING: Final = {number: reversing for reversing, number in _DIRECTIONS.items()}


@fast_frozen
@dataclass(frozen=True, slots=True)
class Cam:
    """What a station says of itself; None is unavailable.

    A roadside unit (INFRASTRUCTURE) whose motion and size are all unavailable sends the container of roadside units.
    """

    station: int  #: identifier, 32 bits
    station_type: StationType
    time_ms: int  #: TimestampIts at which it was where it says [ms since 2004-01-01, leap seconds counted]
    latitude_deg: float  #: WGS84, of the middle of the front bumper [degree]
    longitude_deg: float  #: WGS84 [degree]
    confidence: ConfidenceEllipse | None = None  #: of the position
    heading: float | None = None  #: of the motion [rad], counter-clockwise from true east
    speed: float | None = None  #: [m/s], not negative
    reversing: bool | None = None  #: whether it drives backwards
    acceleration: float | None = None  #: along the vehicle [m/s2], forward positive
    yaw_rate: float | None = None  #: [rad/s], counter-clockwise
    curvature: float | None = None  #: of the trajectory [1/m], left positive
    length: float | None = None  #: [m]
    width: float | None = None  #: without mirrors [m]
    lights: ExteriorLights | None = None  #: None: the message has no low-frequency container


def encode(cam: Cam) -> bytes:
    """Return the bytes of a message.

    Raises ValueError for a number that is not finite, a place that is not on the earth, a negative speed or size, and
    ConfigError where asn1tools is missing.
    """
    roadside = cam.station_type is StationType.INFRASTRUCTURE and _has_no_motion(cam)
    parameters: dict[str, Any] = {
        "basicContainer": {
            "stationType": int(cam.station_type),
            "referencePosition": position_content(cam.latitude_deg, cam.longitude_deg, cam.confidence, AXIS_LENGTHS),
        },
        "highFrequencyContainer": ("rsuContainerHighFrequency", {})
        if roadside
        else ("basicVehicleContainerHighFrequency", _vehicle_content(cam)),
    }
    if cam.lights is not None:
        low = {"vehicleRole": _DEFAULT_ROLE, "exteriorLights": (bytes([cam.lights]), 8), "pathHistory": []}
        parameters["lowFrequencyContainer"] = ("basicVehicleContainerLowFrequency", low)
    body = {"generationDeltaTime": require_time(cam.time_ms) % GENERATION_DELTA, "camParameters": parameters}
    return uper.encode("CAM", {"header": header_content(MessageId.CAM, cam.station), "cam": body})


def _has_no_motion(cam: Cam) -> bool:
    said = (cam.heading, cam.speed, cam.reversing, cam.acceleration, cam.yaw_rate, cam.curvature, cam.length, cam.width)
    return all(one is None for one in said)


def _vehicle_content(cam: Cam) -> dict[str, Any]:
    return {
        "heading": {"headingValue": heading_count(cam.heading), "headingConfidence": _NO_CONFIDENCE},
        "speed": {"speedValue": SPEED.count(cam.speed), "speedConfidence": _NO_CONFIDENCE},
        "driveDirection": _DIRECTIONS[cam.reversing],
        "vehicleLength": {
            "vehicleLengthValue": VEHICLE_LENGTH.count(cam.length),
            "vehicleLengthConfidenceIndication": _NO_TRAILER_INFORMATION,
        },
        "vehicleWidth": VEHICLE_WIDTH.count(cam.width),
        "longitudinalAcceleration": {
            "value": ACCELERATION.count(cam.acceleration),
            "confidence": _NO_ACCELERATION_CONFIDENCE,
        },
        "curvature": {
            "curvatureValue": CURVATURE.count(cam.curvature),
            "curvatureConfidence": _NO_CURVATURE_CONFIDENCE,
        },
        "curvatureCalculationMode": _NO_CALCULATION_MODE,
        "yawRate": {"yawRateValue": YAW_RATE.count(cam.yaw_rate), "yawRateConfidence": _NO_YAW_RATE_CONFIDENCE},
    }


def decode(data: bytes, now_ms: int) -> Cam:
    """Return the message of some bytes that came at a TimestampIts [ms], within half a minute of its time.

    Raises MessageDecodeError for bytes that are no CAM or have no position.
    """
    content = uper.decode("CAM", data)
    station, body = station_of(content["header"], MessageId.CAM), content["cam"]
    parameters = body["camParameters"]
    basic = parameters["basicContainer"]
    latitude_deg, longitude_deg, confidence = position_of(basic["referencePosition"], AXIS_LENGTHS)
    kind, motion = parameters["highFrequencyContainer"]
    low = parameters.get("lowFrequencyContainer")
    return Cam(
        station,
        StationType.of(basic["stationType"]),
        unfold(body["generationDeltaTime"], GENERATION_DELTA, now_ms),
        latitude_deg,
        longitude_deg,
        confidence,
        *(_motion(motion) if kind == "basicVehicleContainerHighFrequency" else _Motion()),
        _lights(low),
    )


class _Motion(NamedTuple):
    """The fields of a `Cam` that a vehicle's high-frequency container has, in their order."""

    heading: float | None = None
    speed: float | None = None
    reversing: bool | None = None
    acceleration: float | None = None
    yaw_rate: float | None = None
    curvature: float | None = None
    length: float | None = None
    width: float | None = None


def _motion(motion: dict[str, Any]) -> _Motion:
    return _Motion(
        heading_of(motion["heading"]["headingValue"]),
        SPEED.value(motion["speed"]["speedValue"]),
        _REVERSING[motion["driveDirection"]],
        ACCELERATION.value(motion["longitudinalAcceleration"]["value"]),
        YAW_RATE.value(motion["yawRate"]["yawRateValue"]),
        CURVATURE.value(motion["curvature"]["curvatureValue"]),
        VEHICLE_LENGTH.value(motion["vehicleLength"]["vehicleLengthValue"]),
        VEHICLE_WIDTH.value(motion["vehicleWidth"]),
    )


def _lights(low: tuple[str, Any] | None) -> ExteriorLights | None:
    if low is None or low[0] != "basicVehicleContainerLowFrequency":
        return None
    return ExteriorLights(low[1]["exteriorLights"][0][0])


def rounded(cam: Cam) -> Cam:
    """Return what a receiver reads of a message, without making its bytes.

    Raises ValueError for what `encode` refuses.
    """
    latitude_deg, longitude_deg, confidence = rounded_position(cam.latitude_deg, cam.longitude_deg, cam.confidence)
    return Cam(
        require_station(cam.station),
        cam.station_type,
        require_time(cam.time_ms),
        latitude_deg,
        longitude_deg,
        confidence,
        rounded_heading(cam.heading),
        SPEED.rounded(cam.speed),
        cam.reversing,
        ACCELERATION.rounded(cam.acceleration),
        YAW_RATE.rounded(cam.yaw_rate),
        CURVATURE.rounded(cam.curvature),
        VEHICLE_LENGTH.rounded(cam.length),
        VEHICLE_WIDTH.rounded(cam.width),
        cam.lights,
    )
