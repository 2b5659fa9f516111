"""Codec of the collective perception message, CPM (ETSI TS 103 324 V2.1.1, release 2): what a station's sensors see.

Free space, segments of a message, a trailer and other shapes of what a sensor sees than a sector are not sent, and not
read of a received message. The module must not know which objects are worth a message.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, Final

from vve_sumo.frozen import fast_frozen
from vve_sumo.v2x import uper
from vve_sumo.v2x.data_elements import (
    LENGTH,
    angle_count,
    angle_of,
    heading_count,
    heading_of,
    require_number,
    rounded_angle,
    rounded_heading,
)
from vve_sumo.v2x.its_time import require_time
from vve_sumo.v2x.pdu_header import MessageId, header_content, require_station, station_of
from vve_sumo.v2x.perceived_object import (
    MAX_SENSORS,
    PerceivedObject,
    object_content,
    object_of,
    require_object,
    rounded_object,
)
from vve_sumo.v2x.reference_position import (
    CONFIDENCES,
    ConfidenceEllipse,
    position_content,
    position_of,
    rounded_position,
)

MESSAGE: Final = "CollectivePerceptionMessage"
MAX_OBJECTS: Final = 255
# Containers by their number: the vehicle or the roadside unit that sends, its sensors, the objects.
_VEHICLE, _ROADSIDE, _SENSORS, _OBJECTS = 1, 2, 3, 5
_CONTAINERS: Final = {
    _VEHICLE: "OriginatingVehicleContainer",
    _ROADSIDE: "OriginatingRsuContainer",
    _SENSORS: "SensorInformationContainer",
    _OBJECTS: "PerceivedObjectContainer",
}
_NO_CONFIDENCE: Final = 127  # of an angle


class SensorType(IntEnum):
    """Kinds of sensors."""

    UNDEFINED = 0
    RADAR = 1
    LIDAR = 2
    MONOVIDEO = 3
    STEREOVISION = 4
    NIGHTVISION = 5
    ULTRASONIC = 6
    PMD = 7  #: photonic mixing device
    INDUCTION_LOOP = 8
    SPHERICAL_CAMERA = 9
    UWB = 10
    ACOUSTIC = 11
    LOCAL_AGGREGATION = 12  #: of several sensors, by fusion too
    ITS_AGGREGATION = 13  #: of other messages
    RFID = 14


@fast_frozen
@dataclass(frozen=True, slots=True)
class Sensor:
    """One sensor of the station, and the sector that it sees."""

    id: int  #: 0 to 255, within the message
    kind: SensorType
    range: float | None = None  #: of the sector [m], to 0.1, at most 409.5; None: no sector is sent
    start: float = 0.0  #: of the sector [rad], counter-clockwise from the station's forward axis
    end: float = 0.0  #: of the sector, counter-clockwise from its start [rad], likewise
    shadowing: bool = True  #: objects hide what is behind them


@fast_frozen
@dataclass(frozen=True, slots=True)
class Cpm:
    """What a station perceives at one time."""

    station: int  #: identifier, 32 bits
    reference_time_ms: int  #: TimestampIts from which times count [ms since 2004-01-01, leap seconds counted]
    latitude_deg: float  #: WGS84, of the reference position [degree]
    longitude_deg: float  #: WGS84 [degree]
    confidence: ConfidenceEllipse | None = None  #: of the position
    roadside: bool = False  #: the station is a roadside unit, and no vehicle
    orientation: float | None = None  #: of a vehicle's forward axis [rad], counter-clockwise from true east
    sensors: tuple[Sensor, ...] = ()
    objects: tuple[PerceivedObject, ...] = ()
    total: int | None = None  #: objects perceived, 0 to 255, more than are listed perhaps; None: as many as listed


def encode(cpm: Cpm) -> bytes:
    """Return the bytes of a message.

    Raises ValueError for what no message can say: numbers that are not finite or beyond their range, places that are
    not on the earth, a roadside unit's orientation, an object that is a roadside unit. Raises ConfigError where
    asn1tools is missing.
    """
    _require(cpm)
    if cpm.roadside:
        containers: list[tuple[int, Any]] = [(_ROADSIDE, {})]
    else:
        forward = {"value": heading_count(cpm.orientation), "confidence": _NO_CONFIDENCE}
        containers = [(_VEHICLE, {"orientationAngle": forward})]
    if cpm.sensors:
        containers.append((_SENSORS, [_sensor_content(sensor) for sensor in cpm.sensors]))
    if cpm.objects or cpm.total:
        perceived = [object_content(one) for one in cpm.objects]
        container = {"numberOfPerceivedObjects": _total(cpm), "perceivedObjects": perceived}
        containers.append((_OBJECTS, container))
    position = position_content(cpm.latitude_deg, cpm.longitude_deg, cpm.confidence, CONFIDENCES)
    payload = {
        "managementContainer": {"referenceTime": cpm.reference_time_ms, "referencePosition": position},
        "cpmContainers": [
            {"containerId": number, "containerData": uper.encode(MESSAGE, content, _CONTAINERS[number])}
            for number, content in containers
        ],
    }
    return uper.encode(MESSAGE, {"header": header_content(MessageId.CPM, cpm.station), "payload": payload})


def _total(cpm: Cpm) -> int:
    return len(cpm.objects) if cpm.total is None else cpm.total


def _require(cpm: Cpm) -> None:
    """Raise ValueError for whole numbers beyond their range, and for what must not stand together."""
    require_station(cpm.station)
    require_time(cpm.reference_time_ms)
    if cpm.roadside and cpm.orientation is not None:
        raise ValueError("orientation: expected none of a roadside unit")
    if len(cpm.sensors) > MAX_SENSORS:
        raise ValueError(f"sensors: expected {MAX_SENSORS} at most, got {len(cpm.sensors)}")
    if not len(cpm.objects) <= _total(cpm) <= MAX_OBJECTS:
        raise ValueError(f"total: expected {len(cpm.objects)} to {MAX_OBJECTS} objects, got {_total(cpm)}")
    for sensor in cpm.sensors:
        require_number("sensor", sensor.id, 0, 255)
    for one in cpm.objects:
        require_object(one)


def _sensor_content(sensor: Sensor) -> dict[str, Any]:
    content: dict[str, Any] = {
        "sensorId": sensor.id,
        "sensorType": int(sensor.kind),
        "shadowingApplies": sensor.shadowing,
    }
    if sensor.range is not None:
        sector = {
            "range": LENGTH.count(sensor.range),
            "horizontalOpeningAngleStart": angle_count(sensor.start),
            "horizontalOpeningAngleEnd": angle_count(sensor.end),
        }
        content["perceptionRegionShape"] = ("radial", sector)
    return content


def decode(data: bytes) -> Cpm:
    """Return the message of some bytes; its reference time is whole, so that no clock is needed.

    Of several classifications of an object the first is read. Raises MessageDecodeError for bytes that are no CPM, have
    no position, or list an object without an identifier.
    """
    content = uper.decode(MESSAGE, data)
    station, payload = station_of(content["header"], MessageId.CPM), content["payload"]
    management = payload["managementContainer"]
    position = position_of(management["referencePosition"], CONFIDENCES)
    containers: dict[int, Any] = {}
    for wrapped in payload["cpmContainers"]:
        number = wrapped["containerId"]
        if number in _CONTAINERS:
            containers[number] = uper.decode(MESSAGE, wrapped["containerData"], _CONTAINERS[number])
    vehicle, perceived = containers.get(_VEHICLE), containers.get(_OBJECTS)
    objects = () if perceived is None else tuple(object_of(one) for one in perceived["perceivedObjects"])
    return Cpm(
        station,
        management["referenceTime"],
        position.latitude_deg,
        position.longitude_deg,
        position.ellipse,
        _ROADSIDE in containers and vehicle is None,
        None if vehicle is None else heading_of(vehicle["orientationAngle"]["value"]),
        tuple(_sensor_of(one) for one in containers.get(_SENSORS, ())),
        objects,
        max(len(objects), 0 if perceived is None else perceived["numberOfPerceivedObjects"]),
    )


def _sensor_of(content: dict[str, Any]) -> Sensor:
    number = content["sensorType"]
    kind = SensorType(number) if number <= SensorType.RFID else SensorType.UNDEFINED
    shape, region = content.get("perceptionRegionShape", (None, None))
    start, end = (
        (angle_of(region["horizontalOpeningAngleStart"]), angle_of(region["horizontalOpeningAngleEnd"]))
        if shape == "radial"
        else (None, None)
    )
    if start is None or end is None:
        return Sensor(content["sensorId"], kind, shadowing=content["shadowingApplies"])
    return Sensor(content["sensorId"], kind, LENGTH.value(region["range"]), start, end, content["shadowingApplies"])


def rounded(cpm: Cpm) -> Cpm:
    """Return what a receiver reads of a message, without making its bytes; raises ValueError as `encode` does."""
    _require(cpm)
    latitude_deg, longitude_deg, confidence = rounded_position(cpm.latitude_deg, cpm.longitude_deg, cpm.confidence)
    return Cpm(
        cpm.station,
        cpm.reference_time_ms,
        latitude_deg,
        longitude_deg,
        confidence,
        cpm.roadside,
        rounded_heading(cpm.orientation),
        tuple(_rounded_sensor(sensor) for sensor in cpm.sensors),
        tuple(rounded_object(one) for one in cpm.objects),
        _total(cpm),
    )


def _rounded_sensor(sensor: Sensor) -> Sensor:
    if sensor.range is None:
        return replace(sensor, start=0.0, end=0.0)
    start, end = rounded_angle(sensor.start), rounded_angle(sensor.end)
    return replace(sensor, range=LENGTH.rounded(sensor.range), start=start, end=end)
