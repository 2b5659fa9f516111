"""Codec of the Continental ARS408's object list on CAN: status, general, quality and extended frames of each object.

It knows frames and objects; it must not know which bus they travel on, nor how an object was found. `ars408.dbc` is the
layout: that of public drivers of the sensor (Tier IV's ars408_driver, ArduPilot's AP_Proximity_ARS408, LittleProjects'
02_Sensor).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Final

from vve_sumo import dbc
from vve_sumo.values import Frame

_LAYOUTS: Final = dbc.read(Path(__file__).with_name("ars408.dbc"))
_STATE, _OBJECTS, _GENERAL, _QUALITY, _EXTENDED = (
    _LAYOUTS[name] for name in ("RadarState", "Objects", "General", "Quality", "Extended")
)
RADAR_STATE, OBJECTS = _STATE.id, _OBJECTS.id
GENERAL, QUALITY, EXTENDED = _GENERAL.id, _QUALITY.id, _EXTENDED.id
HOST_SPEED, HOST_YAW_RATE = 0x300, 0x301  #: what the host sends
SENSOR_STEP: Final = 0x10  #: between the identifiers of two sensors
MAX_OBJECTS: Final = 100
PERIOD: Final = 0.075  #: of a cycle [s]
COUNTS: Final = 0x10000  #: after which the measurement counter begins again
INTERFACE_VERSION: Final = 1

#: steps of the probability that an object exists; 0 is invalid
EXISTENCE: Final = (0.0, 0.25, 0.5, 0.75, 0.9, 0.99, 0.999, 1.0)


class Motion(IntEnum):
    """How an object moves over the ground."""

    MOVING = 0
    STATIONARY = 1
    ONCOMING = 2
    STATIONARY_CANDIDATE = 3
    UNKNOWN = 4
    CROSSING_STATIONARY = 5
    CROSSING_MOVING = 6
    STOPPED = 7


class Measurement(IntEnum):
    """What the newest cycle says of an object."""

    DELETED = 0
    NEW = 1
    MEASURED = 2
    PREDICTED = 3


class Kind(IntEnum):
    """What an object is."""

    POINT = 0
    CAR = 1
    TRUCK = 2
    PEDESTRIAN = 3
    MOTORCYCLE = 4
    BICYCLE = 5
    WIDE = 6


@dataclass(frozen=True, slots=True)
class Object:
    """One object of the list, seen from the sensor."""

    number: int  #: 0 to 255; it keeps its number from cycle to cycle
    longitudinal: float  #: distance ahead [m]
    lateral: float  #: distance to the left [m]
    longitudinal_speed: float  #: relative, opening positive [m/s]
    lateral_speed: float = 0.0  #: relative, left positive [m/s]
    motion: Motion = Motion.UNKNOWN
    cross_section: float = 10.0  #: [dBsm]
    existence: float = 1.0  #: probability; the greatest step that it reaches is sent
    measurement: Measurement = Measurement.MEASURED
    kind: Kind = Kind.POINT
    orientation: float = 0.0  #: heading against the sensor's axis [rad], left positive
    length: float = 0.0  #: [m], 0 unknown
    width: float = 0.0  #: [m], 0 unknown


@dataclass(frozen=True, slots=True)
class ObjectList:
    """What the sensor sends in one cycle."""

    counter: int  #: counts measurements up, modulo COUNTS
    objects: Sequence[Object]


def encode(cycle: ObjectList, sensor: int = 0, valid: bool = True) -> tuple[Frame, ...]:
    """Return the frames of a cycle in the order sent, from sensor number `sensor` (0 to 7).

    The sensor's state comes first: it reports a persistent error where `valid` is False, and the list is empty then. A
    value beyond what its signal carries saturates. Raises ValueError for a number that is not finite, for more than
    MAX_OBJECTS objects, and for a sensor or an object's number that is not there.
    """
    if not 0 <= sensor <= 7:
        raise ValueError(f"an ARS408 is sensor 0 to 7, got {sensor}")
    objects = cycle.objects if valid else ()
    if len(objects) > MAX_OBJECTS:
        raise ValueError(f"an ARS408 sends at most {MAX_OBJECTS} objects, got {len(objects)}")
    shift = SENSOR_STEP * sensor
    status = _OBJECTS.encode(
        NUMBER_OF_OBJECTS=len(objects),
        MEASUREMENT_COUNTER=cycle.counter % COUNTS,
        INTERFACE_VERSION=INTERFACE_VERSION,
    )
    frames = [Frame(RADAR_STATE + shift, _state(sensor, valid)), Frame(OBJECTS + shift, status)]
    for base, pack in ((GENERAL, _general), (QUALITY, _quality), (EXTENDED, _extended)):
        frames += [Frame(base + shift, pack(each)) for each in objects]
    return tuple(frames)


def _state(sensor: int, valid: bool) -> bytes:
    """State of the sensor: number, kind of output (1: objects), which frames it sends, and whether it has failed."""
    return _STATE.encode(PERSISTENT_ERROR=not valid, SENSOR_ID=sensor, OUTPUT_TYPE=1, SEND_QUALITY=1, SEND_EXTENDED=1)


def with_persistent_error(frame: Frame) -> Frame:
    """Return a frame in which sensor 0 reports a persistent error, all else in it as it was; others as they are."""
    if frame.id != RADAR_STATE:
        return frame
    return frame._replace(data=_STATE.altered(frame.data, PERSISTENT_ERROR=1))


def _general(one: Object) -> bytes:
    return _GENERAL.encode(
        ID=_number(one),
        LONGITUDINAL=one.longitudinal,
        LATERAL=one.lateral,
        LONGITUDINAL_SPEED=one.longitudinal_speed,
        LATERAL_SPEED=one.lateral_speed,
        MOTION=one.motion,
        CROSS_SECTION=one.cross_section,
    )


def _number(one: Object) -> int:
    if not 0 <= one.number <= 0xFF:
        raise ValueError(f"an ARS408 numbers its objects 0 to 255, got {one.number}")
    return one.number


def _quality(one: Object) -> bytes:
    step = max(n for n, least in enumerate(EXISTENCE) if one.existence >= least)
    return _QUALITY.encode(ID=_number(one), EXISTENCE=step, MEASUREMENT=one.measurement)


def _extended(one: Object) -> bytes:
    return _EXTENDED.encode(
        ID=_number(one),
        LONGITUDINAL_ACCELERATION=0.0,
        LATERAL_ACCELERATION=0.0,
        CLASS=one.kind,
        ORIENTATION=math.degrees(one.orientation),
        LENGTH=one.length,
        WIDTH=one.width,
    )


class Decoder:
    """Gathers the frames of a list; a list is complete when every object that its status announces has its frames."""

    def __init__(self, sensor: int = 0) -> None:
        self._shift = SENSOR_STEP * sensor
        self._announced = 0
        self._counter: int | None = None
        self._parts: dict[int, dict[int, bytes]] = {}  # by base identifier and number of the object: data
        self.failed = False  #: the sensor's state reports a persistent error

    def feed(self, frames: Iterable[Frame]) -> list[ObjectList]:
        """Return the lists that these frames complete."""
        return [found for frame in frames if (found := self._take(frame)) is not None]

    def _take(self, frame: Frame) -> ObjectList | None:
        base, data = frame.id - self._shift, frame.data
        if base == RADAR_STATE and len(data) == _STATE.size:
            self.failed = bool(_STATE.value(data, "PERSISTENT_ERROR"))
            return None
        if base == OBJECTS and len(data) == _OBJECTS.size:
            self._announced = int(_OBJECTS.value(data, "NUMBER_OF_OBJECTS"))
            self._counter = int(_OBJECTS.value(data, "MEASUREMENT_COUNTER"))
            self._parts = {GENERAL: {}, QUALITY: {}, EXTENDED: {}}
        elif base in self._parts and len(data) == (_QUALITY if base == QUALITY else _GENERAL).size:
            self._parts[base][data[0]] = data
        else:
            return None
        return self._complete()

    def _complete(self) -> ObjectList | None:
        numbers = [set(part) for part in self._parts.values()]
        if self._counter is None or any(each != numbers[0] or len(each) != self._announced for each in numbers):
            return None
        found = ObjectList(self._counter, tuple(self._object(number) for number in self._parts[GENERAL]))
        self._counter, self._parts = None, {}
        return found

    def _object(self, number: int) -> Object:
        general = _GENERAL.decode(self._parts[GENERAL][number])
        quality = _QUALITY.decode(self._parts[QUALITY][number])
        extended = _EXTENDED.decode(self._parts[EXTENDED][number])
        return Object(
            number,
            general["LONGITUDINAL"],
            general["LATERAL"],
            general["LONGITUDINAL_SPEED"],
            general["LATERAL_SPEED"],
            Motion(int(general["MOTION"])),
            general["CROSS_SECTION"],
            EXISTENCE[int(quality["EXISTENCE"])],
            Measurement(int(quality["MEASUREMENT"]) & 3),
            Kind(min(int(extended["CLASS"]), Kind.WIDE)),
            math.radians(extended["ORIENTATION"]),
            extended["LENGTH"],
            extended["WIDTH"],
        )
