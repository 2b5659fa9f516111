"""Data elements that messages share: a quantity as the count that ETSI TS 102 894-2 (V2.4.1) gives it, and back.

A count is what a receiver reads. Where the standard says "equal to or less than n steps and greater than n - 1", a
quantity is rounded up; where it says nothing, to the nearest. Beyond the range it becomes the count for out of range,
whose value is then read as if it were exact. None is "unavailable". Headings are counter-clockwise from true east here,
clockwise from true north on the wire.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Final

#: a quantity that is a whole number of steps is so to this part of one: decimal fractions are not exact in binary
_TOLERANCE: Final = 1e-6


class StationType(IntEnum):
    """TrafficParticipantType: in what the station is, or what an object is."""

    UNKNOWN = 0
    PEDESTRIAN = 1
    CYCLIST = 2
    MOPED = 3
    MOTORCYCLE = 4
    PASSENGER_CAR = 5
    BUS = 6
    LIGHT_TRUCK = 7
    HEAVY_TRUCK = 8
    TRAILER = 9
    SPECIAL_VEHICLE = 10
    TRAM = 11
    LIGHT_VRU_VEHICLE = 12
    ANIMAL = 13
    AGRICULTURAL = 14
    INFRASTRUCTURE = 15  #: a roadside unit

    @classmethod
    def of(cls, number: int) -> StationType:
        """Return the type of a number on the wire; UNKNOWN for those that are reserved."""
        return cls(number) if number <= cls.INFRASTRUCTURE else cls.UNKNOWN


class ExteriorLights(IntFlag):
    """Which switches of lights are on; both turn signals are the hazard lights. The standard's bit 0 is the highest."""

    PARKING = 1
    FOG = 2
    REVERSE = 4
    DAYTIME_RUNNING = 8
    RIGHT_TURN = 16
    LEFT_TURN = 32
    HIGH_BEAM = 64
    LOW_BEAM = 128


@dataclass(frozen=True, slots=True)
class Scale:
    """How a quantity that is always known is counted on the wire."""

    name: str  #: of the ASN.1 type
    steps: float  #: in a unit of the quantity
    lowest: int  #: count; of a quantity with a sign it means "or less"
    highest: int  #: count; it means "or more"
    upward: bool = True  #: the standard rounds up

    def count(self, value: float) -> int:
        """Return the count of a quantity.

        Raises ValueError for one that is not finite, and for a negative one where counts have no sign.
        """
        scaled = value * self.steps
        if not math.isfinite(scaled):
            raise ValueError(f"{self.name}: expected a finite number, got {value}")
        if scaled < -_TOLERANCE and self.lowest >= 0:
            raise ValueError(f"{self.name}: expected a number that is not negative, got {value}")
        count = math.ceil(scaled - _TOLERANCE) if self.upward else round(scaled)
        return self.lowest if count < self.lowest else self.highest if count > self.highest else count

    def value(self, count: int) -> float:
        """Return the quantity of a count."""
        return count / self.steps

    def rounded(self, value: float) -> float:
        """Return the quantity that a receiver reads; raises ValueError as `count` does."""
        return self.count(value) / self.steps


@dataclass(frozen=True, slots=True)
class DataElement:
    """How a quantity is counted on the wire that may be unavailable, which is None here."""

    scale: Scale
    unavailable: int  #: count

    def count(self, value: float | None) -> int:
        """Return the count of a quantity; raises ValueError as the scale does."""
        return self.unavailable if value is None else self.scale.count(value)

    def value(self, count: int) -> float | None:
        """Return the quantity of a count."""
        return None if count == self.unavailable else self.scale.value(count)

    def rounded(self, value: float | None) -> float | None:
        """Return the quantity that a receiver reads; raises ValueError as the scale does."""
        return None if value is None else self.scale.rounded(value)


_DEGREE: Final = math.degrees(1.0)  # degrees in a radian

SPEED: Final = DataElement(Scale("SpeedValue", 100.0, 0, 16_382), 16_383)  #: [m/s]
ACCELERATION: Final = DataElement(Scale("AccelerationValue", 10.0, -160, 160), 161)  #: [m/s2]
YAW_RATE: Final = DataElement(Scale("YawRateValue", 100.0 * _DEGREE, -32_766, 32_766), 32_767)  #: [rad/s]
CURVATURE: Final = DataElement(Scale("CurvatureValue", 10_000.0, -1_023, 1_022), 1_023)  #: [1/m]
VEHICLE_LENGTH: Final = DataElement(Scale("VehicleLengthValue", 10.0, 1, 1_022), 1_023)  #: [m]
VEHICLE_WIDTH: Final = DataElement(Scale("VehicleWidth", 10.0, 1, 61), 62)  #: [m]
SEMI_AXIS: Final = DataElement(Scale("SemiAxisLength", 100.0, 1, 4_094), 4_095)  #: [m]
VELOCITY: Final = DataElement(Scale("VelocityComponentValue", 100.0, -16_383, 16_382), 16_383)  #: [m/s]
COORDINATE_CONFIDENCE: Final = DataElement(Scale("CoordinateConfidence", 100.0, 1, 4_095), 4_096)  #: [m]
OBJECT_DIMENSION: Final = DataElement(Scale("ObjectDimensionValue", 10.0, 1, 255), 256)  #: [m]
COORDINATE: Final = Scale("CartesianCoordinateLarge", 100.0, -131_072, 131_071)  #: [m]
DELTA_TIME: Final = Scale("DeltaTimeMilliSecondSigned", 1000.0, -2_048, 2_047)  #: [s]
LENGTH: Final = Scale("StandardLength12b", 10.0, 0, 4_095, upward=False)  #: [m]

NO_HEADING: Final = 3_601  #: HeadingValue, Wgs84AngleValue and CartesianAngleValue: unavailable
_TURN: Final = 3_600  #: counts of a turn


def heading_count(heading: float | None) -> int:
    """Return the count (0.1 degree, clockwise from true north) of a heading [rad, counter-clockwise from true east].

    Raises ValueError for one that is not finite.
    """
    if heading is None:
        return NO_HEADING
    if not math.isfinite(heading):
        raise ValueError(f"heading: expected a finite number, got {heading}")
    return round(10.0 * (90.0 - math.degrees(math.remainder(heading, math.tau)))) % _TURN


def heading_of(count: int) -> float | None:
    """Return the heading [rad, counter-clockwise from true east, -pi to pi] of a count; None if it is unavailable."""
    return None if count == NO_HEADING else math.remainder(math.radians(90.0 - count / 10.0), math.tau)


def rounded_heading(heading: float | None) -> float | None:
    """Return the heading that a receiver reads."""
    return None if heading is None else heading_of(heading_count(heading))


def angle_count(angle: float) -> int:
    """Return the count (CartesianAngleValue, 0.1 degree) of an angle [rad], counter-clockwise in both.

    Raises ValueError for one that is not finite.
    """
    if not math.isfinite(angle):
        raise ValueError(f"angle: expected a finite number, got {angle}")
    return math.ceil(10.0 * math.degrees(math.remainder(angle, math.tau)) - _TOLERANCE) % _TURN


def angle_of(count: int) -> float | None:
    """Return the angle [rad, -pi to pi] of a count; None if it is unavailable."""
    return None if count == NO_HEADING else _wrapped(count)


def rounded_angle(angle: float) -> float:
    """Return the angle that a receiver reads."""
    return _wrapped(angle_count(angle))


def _wrapped(count: int) -> float:
    return math.remainder(math.radians(count / 10.0), math.tau)


def require_number(name: str, value: int | None, least: int, greatest: int) -> None:
    """Raise ValueError for a whole number that its field cannot carry."""
    if value is not None and not least <= value <= greatest:
        raise ValueError(f"{name}: expected {least} to {greatest}, got {value}")
