"""One object that a station perceives: PerceivedObject of ETSI TS 102 894-2 (V2.4.1).

It is east and north of a reference position, in metres, with its heading counter-clockwise from true east. Heights of
positions, accelerations, correlations and confidences of speeds, angles and sizes are not sent, and not read.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

from vve_sumo.frozen import fast_frozen
from vve_sumo.v2x.data_elements import (
    COORDINATE,
    COORDINATE_CONFIDENCE,
    DELTA_TIME,
    OBJECT_DIMENSION,
    SPEED,
    VELOCITY,
    StationType,
    angle_count,
    angle_of,
    require_number,
    rounded_angle,
)
from vve_sumo.v2x.decode_error import MessageDecodeError

MAX_SENSORS: Final = 128  #: that are named for one object
_OLD: Final = 1500  # count of an age of 1.5 s and more
# Confidences that are unavailable: of speeds and angles, of a dimension, of a class [%].
_NO_CONFIDENCE, _NO_DIMENSION_CONFIDENCE, _NO_LEVEL = 127, 32, 101

#: alternative of an object's class and number in it, by what the object is; others are a vehicle's sub-class
_VRU_CLASSES: Final = {
    StationType.PEDESTRIAN: ("pedestrian", 1),  # ordinary pedestrian
    StationType.CYCLIST: ("bicyclistAndLightVruVehicle", 1),  # bicyclist
    StationType.LIGHT_VRU_VEHICLE: ("bicyclistAndLightVruVehicle", 6),  # personal transporter
    StationType.MOPED: ("motorcyclist", 1),  # moped
    StationType.MOTORCYCLE: ("motorcyclist", 2),  # motorcycle
    StationType.ANIMAL: ("animal", 0),  # unavailable which
}
#: numbers of the bicyclist's profile that are no bicycle: wheelchair to personal transporter
_LIGHT_VEHICLES: Final = range(2, 7)
_MOPED: Final = 1


@fast_frozen
@dataclass(frozen=True, slots=True)
class PerceivedObject:
    """One object; None is unavailable."""

    id: int  #: 0 to 65535; it keeps it from message to message
    delta_time: float  #: of the measurement [s], after the reference time positive, -2.048 to 2.047
    x: float  #: of its box's centre [m], east of the reference position, at most 1310.71 either way
    y: float  #: of its box's centre [m], north of the reference position, likewise
    confidence_x: float | None = None  #: with 95 % probability x is not off by more [m]
    confidence_y: float | None = None  #: of y [m]
    velocity_x: float | None = None  #: [m/s], eastward; None where the other is
    velocity_y: float | None = None  #: [m/s], northward
    heading: float | None = None  #: of its box [rad], counter-clockwise from true east
    length: float | None = None  #: [m], at most 25.4
    width: float | None = None  #: [m], likewise
    height: float | None = None  #: [m], likewise
    age: float | None = None  #: since it was first detected [s], 1.5 for longer
    quality: int | None = None  #: 0 to 15: overall confidence
    sensors: tuple[int, ...] = ()  #: identifiers of those that measured it
    kind: StationType | None = None  #: what it is, but no INFRASTRUCTURE; None: it has no classification
    kind_percent: int | None = None  #: confidence in the kind [%], 1 to 100; needs a kind


def require_object(one: PerceivedObject) -> None:
    """Raise ValueError for whole numbers beyond their range, and for what must not stand together."""
    require_number("object", one.id, 0, 0xFFFF)
    require_number("quality", one.quality, 0, 15)
    require_number("kind_percent", one.kind_percent, 1, 100)
    for sensor in one.sensors:
        require_number("sensor", sensor, 0, 255)
    if len(one.sensors) > MAX_SENSORS:
        raise ValueError(f"object {one.id}: expected {MAX_SENSORS} sensors at most, got {len(one.sensors)}")
    if (one.velocity_x is None) != (one.velocity_y is None):
        raise ValueError(f"object {one.id}: expected both components of the velocity, or none")
    if one.kind is StationType.INFRASTRUCTURE or (one.kind is None and one.kind_percent is not None):
        raise ValueError(f"object {one.id}: expected a kind of road user, got {one.kind}")


def object_content(one: PerceivedObject) -> dict[str, Any]:
    """Return the content of an object; raises ValueError for numbers that are not finite and negative sizes."""
    content: dict[str, Any] = {
        "objectId": one.id,
        "measurementDeltaTime": DELTA_TIME.count(one.delta_time),
        "position": {
            axis: {"value": COORDINATE.count(value), "confidence": COORDINATE_CONFIDENCE.count(confidence)}
            for axis, value, confidence in (
                ("xCoordinate", one.x, one.confidence_x),
                ("yCoordinate", one.y, one.confidence_y),
            )
        },
    }
    if one.velocity_x is not None:
        components = {
            axis: {"value": VELOCITY.count(value), "confidence": _NO_CONFIDENCE}
            for axis, value in (("xVelocity", one.velocity_x), ("yVelocity", one.velocity_y))
        }
        content["velocity"] = ("cartesianVelocity", components)
    if one.heading is not None:
        content["angles"] = {"zAngle": {"value": angle_count(one.heading), "confidence": _NO_CONFIDENCE}}
    for axis, size in (("X", one.length), ("Y", one.width), ("Z", one.height)):
        if size is not None:
            dimension = {"value": OBJECT_DIMENSION.count(size), "confidence": _NO_DIMENSION_CONFIDENCE}
            content[f"objectDimension{axis}"] = dimension
    if one.age is not None:
        content["objectAge"] = _age_count(one.age)
    if one.quality is not None:
        content["objectPerceptionQuality"] = one.quality
    if one.sensors:
        content["sensorIdList"] = list(one.sensors)
    if one.kind is not None:
        content["classification"] = [{"objectClass": _class_of(one.kind), "confidence": one.kind_percent or _NO_LEVEL}]
    return content


def _age_count(age: float) -> int:
    if age < 0.0:
        raise ValueError(f"age: expected a number that is not negative, got {age}")
    return min(DELTA_TIME.count(age), _OLD)


def _class_of(kind: StationType) -> tuple[str, Any]:
    if kind is StationType.UNKNOWN:
        return "otherSubClass", 0
    if kind in _VRU_CLASSES:
        return "vruSubClass", _VRU_CLASSES[kind]
    return "vehicleSubClass", int(kind)


def object_of(content: dict[str, Any]) -> PerceivedObject:
    """Return the object of a content; of several classifications the first is read.

    Raises MessageDecodeError for one without an identifier.
    """
    if "objectId" not in content:
        raise MessageDecodeError("an object has no identifier")
    position, age = content["position"], content.get("objectAge")
    kind, percent = _kind_of(content.get("classification"))
    x, y = position["xCoordinate"], position["yCoordinate"]
    return PerceivedObject(
        content["objectId"],
        DELTA_TIME.value(content["measurementDeltaTime"]),
        COORDINATE.value(x["value"]),
        COORDINATE.value(y["value"]),
        COORDINATE_CONFIDENCE.value(x["confidence"]),
        COORDINATE_CONFIDENCE.value(y["confidence"]),
        *_velocity_of(content.get("velocity")),
        angle_of(content["angles"]["zAngle"]["value"]) if "angles" in content else None,
        _dimension_of(content.get("objectDimensionX")),
        _dimension_of(content.get("objectDimensionY")),
        _dimension_of(content.get("objectDimensionZ")),
        None if age is None else DELTA_TIME.value(min(age, _OLD)),
        content.get("objectPerceptionQuality"),
        tuple(content.get("sensorIdList", ())),
        kind,
        percent,
    )


def _dimension_of(dimension: dict[str, Any] | None) -> float | None:
    return None if dimension is None else OBJECT_DIMENSION.value(dimension["value"])


def _velocity_of(velocity: tuple[str, Any] | None) -> tuple[float | None, float | None]:
    """Eastward and northward component [m/s]; none where one is unavailable."""
    if velocity is None:
        return None, None
    kind, content = velocity
    if kind == "polarVelocity":
        speed = SPEED.value(content["velocityMagnitude"]["speedValue"])
        towards = angle_of(content["velocityDirection"]["value"])
        if speed is None or towards is None:
            return None, None
        return speed * math.cos(towards), speed * math.sin(towards)
    x, y = VELOCITY.value(content["xVelocity"]["value"]), VELOCITY.value(content["yVelocity"]["value"])
    return (None, None) if x is None or y is None else (x, y)


def _kind_of(classes: list[dict[str, Any]] | None) -> tuple[StationType | None, int | None]:
    """What an object is, and the confidence in it [%]."""
    if classes is None:
        return None, None
    level = classes[0]["confidence"]
    return _road_user(*classes[0]["objectClass"]), None if level == _NO_LEVEL else level


def _road_user(alternative: str, value: Any) -> StationType:
    if alternative == "vehicleSubClass":
        return StationType.of(value)
    if alternative != "vruSubClass":
        return StationType.UNKNOWN
    profile, number = value
    if profile == "pedestrian":
        return StationType.PEDESTRIAN
    if profile == "bicyclistAndLightVruVehicle":
        return StationType.LIGHT_VRU_VEHICLE if number in _LIGHT_VEHICLES else StationType.CYCLIST
    if profile == "motorcyclist":
        return StationType.MOPED if number == _MOPED else StationType.MOTORCYCLE
    return StationType.ANIMAL if profile == "animal" else StationType.UNKNOWN


def rounded_object(one: PerceivedObject) -> PerceivedObject:
    """Return what a receiver reads of an object; raises ValueError as `object_content` does."""
    return PerceivedObject(
        one.id,
        DELTA_TIME.rounded(one.delta_time),
        COORDINATE.rounded(one.x),
        COORDINATE.rounded(one.y),
        COORDINATE_CONFIDENCE.rounded(one.confidence_x),
        COORDINATE_CONFIDENCE.rounded(one.confidence_y),
        VELOCITY.rounded(one.velocity_x),
        VELOCITY.rounded(one.velocity_y),
        None if one.heading is None else rounded_angle(one.heading),
        OBJECT_DIMENSION.rounded(one.length),
        OBJECT_DIMENSION.rounded(one.width),
        OBJECT_DIMENSION.rounded(one.height),
        None if one.age is None else DELTA_TIME.value(_age_count(one.age)),
        one.quality,
        one.sensors,
        one.kind,
        one.kind_percent,
    )
