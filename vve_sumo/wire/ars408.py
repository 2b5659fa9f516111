"""Codec of the Continental ARS408's object list on CAN: status, general, quality and extended frames of each object.

It knows frames and objects; it must not know which bus they travel on, nor how an object was found. Layout as in public
drivers of the sensor (Tier IV's ars408_driver, ArduPilot's AP_Proximity_ARS408, LittleProjects' 02_Sensor).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from vve_sumo.values import Frame
from vve_sumo.wire.signals import Signal, bits_of, data_of

RADAR_STATE, OBJECTS, GENERAL, QUALITY, EXTENDED = 0x201, 0x60A, 0x60B, 0x60C, 0x60D
HOST_SPEED, HOST_YAW_RATE = 0x300, 0x301  #: what the host sends
SENSOR_STEP: Final = 0x10  #: between the identifiers of two sensors
MAX_OBJECTS: Final = 100
PERIOD: Final = 0.075  #: of a cycle [s]
COUNTS: Final = 0x10000  #: after which the measurement counter begins again
INTERFACE_VERSION: Final = 1

_ID = Signal(7, 8)
_LONGITUDINAL = Signal(15, 13, 0.2, -500.0)
_LATERAL = Signal(18, 11, 0.2, -204.6)  #: left positive
_LONGITUDINAL_SPEED = Signal(39, 10, 0.25, -128.0)
_LATERAL_SPEED = Signal(45, 9, 0.25, -64.0)
_MOTION = Signal(50, 3)
_CROSS_SECTION = Signal(63, 8, 0.5, -64.0)  #: [dBsm]

_EXISTENCE = Signal(55, 3)
_MEASUREMENT = Signal(52, 3)

_CLASS = Signal(26, 3)
_ORIENTATION = Signal(39, 10, 0.4, -180.0)
_LENGTH = Signal(55, 8, 0.2)
_WIDTH = Signal(63, 8, 0.2)
_LONGITUDINAL_ACCELERATION = Signal(15, 11, 0.01, -10.0)
_LATERAL_ACCELERATION = Signal(20, 9, 0.01, -2.5)

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


def encode(found: ObjectList, sensor: int = 0, valid: bool = True) -> tuple[Frame, ...]:
    """Return the frames of a cycle in the order sent, from sensor number `sensor` (0 to 7).

    The sensor's state comes first: it reports a persistent error where `valid` is False, and the list is empty then. A
    value beyond what its signal carries saturates. Raises ValueError for a number that is not finite, for more than
    MAX_OBJECTS objects, and for a sensor or an object's number that is not there.
    """
    if not 0 <= sensor <= 7:
        raise ValueError(f"an ARS408 is sensor 0 to 7, got {sensor}")
    objects = found.objects if valid else ()
    if len(objects) > MAX_OBJECTS:
        raise ValueError(f"an ARS408 sends at most {MAX_OBJECTS} objects, got {len(objects)}")
    shift = SENSOR_STEP * sensor
    status = bytes((len(objects),)) + (found.counter % COUNTS).to_bytes(2, "big") + bytes((INTERFACE_VERSION << 4,))
    frames = [Frame(RADAR_STATE + shift, _state(sensor, valid)), Frame(OBJECTS + shift, status)]
    for base, pack in ((GENERAL, _general), (QUALITY, _quality), (EXTENDED, _extended)):
        frames += [Frame(base + shift, pack(each)) for each in objects]
    return tuple(frames)


_PERSISTENT_ERROR = Signal(21, 1)
_SENSOR_NUMBER = Signal(34, 3)
_OUTPUT_TYPE = Signal(43, 2)
_SEND_QUALITY, _SEND_EXTENDED = Signal(44, 1), Signal(45, 1)


def _state(sensor: int, valid: bool) -> bytes:
    """State of the sensor: number, kind of output (1: objects), which frames it sends, and whether it has failed."""
    return data_of(
        _PERSISTENT_ERROR.put(not valid),
        _SENSOR_NUMBER.put(sensor),
        _OUTPUT_TYPE.put(1),
        _SEND_QUALITY.put(1),
        _SEND_EXTENDED.put(1),
    )


def with_persistent_error(frame: Frame) -> Frame:
    """Return a frame in which sensor 0 reports a persistent error, all else in it as it was; others as they are."""
    if frame.id != RADAR_STATE:
        return frame
    return frame._replace(data=data_of(bits_of(frame.data), _PERSISTENT_ERROR.put(1.0)))


def _general(one: Object) -> bytes:
    return data_of(
        _number(one),
        _LONGITUDINAL.put(one.longitudinal),
        _LATERAL.put(one.lateral),
        _LONGITUDINAL_SPEED.put(one.longitudinal_speed),
        _LATERAL_SPEED.put(one.lateral_speed),
        _MOTION.put(one.motion),
        _CROSS_SECTION.put(one.cross_section),
    )


def _number(one: Object) -> int:
    if not 0 <= one.number <= 0xFF:
        raise ValueError(f"an ARS408 numbers its objects 0 to 255, got {one.number}")
    return _ID.put(one.number)


def _quality(one: Object) -> bytes:
    step = max(n for n, least in enumerate(EXISTENCE) if one.existence >= least)
    return data_of(_number(one), _EXISTENCE.put(step), _MEASUREMENT.put(one.measurement))[:7]


def _extended(one: Object) -> bytes:
    return data_of(
        _number(one),
        _LONGITUDINAL_ACCELERATION.put(0.0),
        _LATERAL_ACCELERATION.put(0.0),
        _CLASS.put(one.kind),
        _ORIENTATION.put(math.degrees(one.orientation)),
        _LENGTH.put(one.length),
        _WIDTH.put(one.width),
    )


class Decoder:
    """Gathers the frames of a list; a list is complete when every object that its status announces has its frames."""

    def __init__(self, sensor: int = 0) -> None:
        self._shift = SENSOR_STEP * sensor
        self._announced = 0
        self._counter: int | None = None
        self._parts: dict[int, dict[int, int]] = {}  # by base identifier and number of the object: bits
        self.failed = False  #: the sensor's state reports a persistent error

    def feed(self, frames: Iterable[Frame]) -> list[ObjectList]:
        """Return the lists that these frames complete."""
        return [found for frame in frames if (found := self._take(frame)) is not None]

    def _take(self, frame: Frame) -> ObjectList | None:
        base, bits = frame.id - self._shift, bits_of(frame.data)
        if base == RADAR_STATE and len(frame.data) == 8:
            self.failed = bool(_PERSISTENT_ERROR.get(bits))
            return None
        if base == OBJECTS and len(frame.data) == 4:
            self._announced, self._counter = frame.data[0], int.from_bytes(frame.data[1:3], "big")
            self._parts = {GENERAL: {}, QUALITY: {}, EXTENDED: {}}
        elif base in self._parts and len(frame.data) == (7 if base == QUALITY else 8):
            self._parts[base][frame.data[0]] = bits
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
        general, quality, extended = (self._parts[base][number] for base in (GENERAL, QUALITY, EXTENDED))
        return Object(
            number,
            _LONGITUDINAL.get(general),
            _LATERAL.get(general),
            _LONGITUDINAL_SPEED.get(general),
            _LATERAL_SPEED.get(general),
            Motion(int(_MOTION.get(general))),
            _CROSS_SECTION.get(general),
            EXISTENCE[int(_EXISTENCE.get(quality))],
            Measurement(int(_MEASUREMENT.get(quality)) & 3),
            Kind(min(int(_CLASS.get(extended)), Kind.WIDE)),
            math.radians(_ORIENTATION.get(extended)),
            _LENGTH.get(extended),
            _WIDTH.get(extended),
        )
