"""Decodes u-blox UBX: NAV-PVT (position, velocity) and NAV-RELPOSNED (heading of a moving baseline) as fixes.

It knows messages and how they belong together; it must not know whether a fix is good enough to drive on (trust.py) or
where the bytes come from. Layouts, units and codes by
u-blox's F9 HPG Interface Description.
"""

from __future__ import annotations

import datetime
import math
import re
import struct
from collections import deque
from dataclasses import dataclass
from itertools import accumulate
from typing import Final, NamedTuple

from vve_sumo.pose.census import MessageCensus, Needed
from vve_sumo.pose.gnss_time import DAY, GPS_EPOCH, WEEK, clock_by_date
from vve_sumo.pose.stream import MAX_OPEN, Framing, Measured, OpenEpochs, Outcome, StreamDecoder, from_compass
from vve_sumo.values import Fix, FixQuality

SYNC: Final = b"\xb5\x62"
HEADER: Final = struct.Struct("<2sHH")  #: sync, class and identifier, length of the payload
CHECKSUM_LENGTH: Final = 2
PVT: Final = 0x0701  #: identifier, class
RELPOSNED: Final = 0x3C01
PVT_PAYLOAD: Final = struct.Struct("<I HBBBBBB Ii BBBB ii ii II iiii i II H H 4x i hH")
RELPOSNED_PAYLOAD: Final = struct.Struct("<BxHI iiii i 4x bbbb IIII I 4x I")
PAYLOADS: Final = {PVT: PVT_PAYLOAD.size, RELPOSNED: RELPOSNED_PAYLOAD.size}
MAX_PAYLOAD: Final = 2048  #: of a message that is not read; what seems longer is taken for a false beginning
RELPOSNED_VERSION: Final = 1

ANGLE: Final = math.radians(1e-5)  #: of headings and their accuracies [rad]
PLACE: Final = math.radians(1e-7)  #: of latitude and longitude [rad]
MILLI: Final = 1e-3

DATED: Final = 0b11  #: of NAV-PVT's validity: date and time of day
FIX_OK: Final = 1 << 0  #: of flags: within the masks of DOP and accuracy
DIFFERENTIAL: Final = 1 << 1  #: of flags: corrections were applied
HEADING_OF_VEHICLE: Final = 1 << 5  #: of flags: by sensors of the receiver's own
CARRIER: Final = 6  #: of flags: shift of the carrier solution: none, float, fixed
INVALID_PLACE: Final = 1 << 0  #: of flags3
AGE: Final = 1  #: of flags3: shift of the code of the corrections' age
#: greatest age of the corrections by its code [s]; 0 is not known, and codes beyond the last are more than that
AGES: Final = (math.nan, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0)
TWO_DIMENSIONAL: Final = 2  #: types of fix
THREE_DIMENSIONAL: Final = 3
WITH_SENSORS: Final = 4
CARRIER_FIXED: Final = 2
CARRIER_QUALITIES: Final = {1: FixQuality.RTK_FLOAT, CARRIER_FIXED: FixQuality.RTK_FIXED}

#: of NAV-RELPOSNED's flags. Where the base stands still, the heading is the direction in which the car lies from there.
MOVING: Final = 1 << 5
#: baseline valid and of fixed ambiguities, its base moving, its heading valid
BASELINE: Final = 1 << 2 | CARRIER_FIXED << 3 | MOVING | 1 << 8
BASELINE_BITS: Final = BASELINE | 0b11 << 3

PVT_NAME: Final = "NAV-PVT"
RELPOSNED_NAME: Final = "NAV-RELPOSNED"
OF_STILL_BASE: Final = "NAV-RELPOSNED to a base that stands still"
SECOND_NAME: Final = "NAV-PVT of a second receiver"
VEHICLE_NAME: Final = "NAV-PVT with headVeh"
NEEDED: Final = (
    Needed("position, velocity", (PVT_NAME, VEHICLE_NAME)),
    Needed("heading", (RELPOSNED_NAME, VEHICLE_NAME)),
)


class Pvt(NamedTuple):
    """The payload of NAV-PVT."""

    time_of_week: int  #: [ms]
    year: int  #: UTC
    month: int
    day: int
    hour: int
    minute: int
    second: int
    valid: int  #: `DATED`
    time_accuracy: int  #: [ns]
    nanosecond: int
    kind: int  #: of the fix
    flags: int
    flags2: int
    satellites: int
    longitude: int  #: [1e-7 deg]
    latitude: int  #: [1e-7 deg]
    height: int  #: above the ellipsoid [mm]
    altitude: int  #: above mean sea level [mm]
    horizontal_accuracy: int  #: [mm]
    vertical_accuracy: int  #: [mm]
    velocity_north: int  #: [mm/s]
    velocity_east: int  #: [mm/s]
    velocity_down: int  #: [mm/s]
    speed: int  #: [mm/s]
    course: int  #: [1e-5 deg]
    speed_accuracy: int  #: [mm/s]
    heading_accuracy: int  #: of course and heading of the vehicle [1e-5 deg]
    position_dop: int  #: [0.01]
    flags3: int
    vehicle_heading: int  #: [1e-5 deg]
    declination: int  #: magnetic [0.01 deg]
    declination_accuracy: int  #: [0.01 deg]


class RelPosNed(NamedTuple):
    """The payload of NAV-RELPOSNED, version 1: the rover's place as seen from the base."""

    version: int
    station: int
    time_of_week: int  #: [ms]
    north: int  #: [cm]
    east: int  #: [cm]
    down: int  #: [cm]
    length: int  #: [cm]
    heading: int  #: [1e-5 deg]
    more_north: int  #: [0.1 mm]
    more_east: int  #: [0.1 mm]
    more_down: int  #: [0.1 mm]
    more_length: int  #: [0.1 mm]
    north_accuracy: int  #: [0.1 mm]
    east_accuracy: int  #: [0.1 mm]
    down_accuracy: int  #: [0.1 mm]
    length_accuracy: int  #: [0.1 mm]
    heading_accuracy: int  #: [1e-5 deg]
    flags: int


def checksum(data: bytes) -> bytes:
    """Return the 8-bit Fletcher checksum of class, identifier, length and payload."""
    return bytes((sum(data) & 0xFF, sum(accumulate(data)) & 0xFF))


def _length(buffer: bytes, at: int) -> int | None:
    head = buffer[at : at + HEADER.size]
    if not head.startswith(SYNC[: len(head)]):
        return 0
    if len(head) < HEADER.size:
        return None
    _sync, kind, payload = HEADER.unpack(head)
    fits = payload == PAYLOADS[kind] if kind in PAYLOADS else payload <= MAX_PAYLOAD
    return HEADER.size + payload + CHECKSUM_LENGTH if fits else 0


def _intact(message: bytes) -> bool:
    return checksum(message[len(SYNC) : -CHECKSUM_LENGTH]) == message[-CHECKSUM_LENGTH:]


FRAMING: Final = Framing(re.compile(rb"\xb5"), _length, _intact)


@dataclass(slots=True)
class _Epoch:
    """The messages of one time of week that have arrived so far."""

    clock: int | None = None  #: [ms GPS]
    measured: Measured | None = None
    heading: tuple[float, float] | None = None  #: of the baseline and its 1 sigma [rad]; NaN where it is not valid


class Decoder(StreamDecoder):
    """Decodes a stream of UBX; see `StreamDecoder`.

    A fix is complete with NAV-PVT and NAV-RELPOSNED of one time of week, in either order. The heading is the baseline's
    from the moving base to the rover, where its ambiguities are fixed; otherwise it is NaN. NAV-RELPOSNED to a base
    that stands still is no heading of the car and is not read. A receiver that never sent one to a moving base and has
    sensors of its own gives the heading of the vehicle in NAV-PVT. The course is never taken for a heading. The week
    follows from the date. Corrections are as old as the upper end of the class that the receiver states. Where two
    different NAV-PVT come of one time, two receivers send them and nothing tells whose is right: no fix of this decoder
    is locked from then on.
    """

    def __init__(self) -> None:
        super().__init__(FRAMING, MessageCensus(NEEDED))
        self._epochs = OpenEpochs(_Epoch, self.counts)  # by time of week [ms]
        self._has_baseline = False
        self._positions: deque[Pvt] = deque(maxlen=MAX_OPEN)  # the newest with a fix
        self._two_receivers = False

    def _read(self, message: bytes, received: float) -> tuple[Outcome, Fix | None]:
        _sync, kind, _length = HEADER.unpack_from(message)
        payload = message[HEADER.size : -CHECKSUM_LENGTH]
        if kind == PVT:
            return self._read_pvt(payload, received)
        if kind == RELPOSNED:
            return self._read_relposned(payload, received)
        self.census.note(f"0x{kind & 0xFF:02X} 0x{kind >> 8:02X}", received)
        return Outcome.OTHER, None

    def _read_pvt(self, payload: bytes, received: float) -> tuple[Outcome, Fix | None]:
        pvt = Pvt._make(PVT_PAYLOAD.unpack(payload))
        of_vehicle = bool(pvt.flags & HEADING_OF_VEHICLE)
        second = self._is_second(pvt)
        self.census.note(SECOND_NAME if second else VEHICLE_NAME if of_vehicle else PVT_NAME, received)
        self._two_receivers |= second
        try:
            clock = _clock(pvt)
        except ValueError:
            return Outcome.MALFORMED, None
        epoch = self._epochs.at(pvt.time_of_week)
        epoch.clock, epoch.measured = clock, _measured(pvt)
        epoch.measured.locked &= not self._two_receivers
        if of_vehicle and not self._has_baseline:
            epoch.heading = from_compass(1e-5 * pvt.vehicle_heading), ANGLE * pvt.heading_accuracy
        return Outcome.READ, self._completed(pvt.time_of_week, epoch, received)

    def _is_second(self, pvt: Pvt) -> bool:
        """Whether another receiver said its position of the same time; one without a fix may set its clock back."""
        if pvt.valid & DATED != DATED or not pvt.flags & FIX_OK:
            return False
        second = any(pvt.time_of_week == one.time_of_week and pvt != one for one in self._positions)
        self._positions.append(pvt)
        return second

    def _read_relposned(self, payload: bytes, received: float) -> tuple[Outcome, Fix | None]:
        baseline = RelPosNed._make(RELPOSNED_PAYLOAD.unpack(payload))
        moving = bool(baseline.flags & MOVING)
        self.census.note(RELPOSNED_NAME if moving else OF_STILL_BASE, received)
        if baseline.version != RELPOSNED_VERSION or not moving:
            return Outcome.OTHER, None
        self._has_baseline = True
        epoch = self._epochs.at(baseline.time_of_week)
        valid = baseline.flags & BASELINE_BITS == BASELINE
        heading = from_compass(1e-5 * baseline.heading), ANGLE * baseline.heading_accuracy
        epoch.heading = heading if valid else (math.nan, math.nan)
        return Outcome.READ, self._completed(baseline.time_of_week, epoch, received)

    def _completed(self, time_of_week: int, epoch: _Epoch, received: float) -> Fix | None:
        """Return the fix of an epoch, if it is complete."""
        if epoch.measured is None or epoch.heading is None:
            return None
        self._epochs.close(time_of_week)
        if epoch.clock is None:
            self.counts[Outcome.NO_TIME] += 1
            return None
        epoch.measured.heading, epoch.measured.heading_sigma = epoch.heading
        return self._complete(epoch.clock, epoch.measured, received)


def _clock(pvt: Pvt) -> int | None:
    """Return the time of NAV-PVT [ms GPS]; None while the receiver does not know the date; raises ValueError."""
    if pvt.valid & DATED != DATED:
        return None
    if pvt.time_of_week >= WEEK:
        raise ValueError("no time of week")
    days = (datetime.date(pvt.year, pvt.month, pvt.day) - GPS_EPOCH).days
    utc = days * DAY + 1000 * (3600 * pvt.hour + 60 * pvt.minute + pvt.second)
    return clock_by_date(utc, pvt.time_of_week)


def _measured(pvt: Pvt) -> Measured:
    """Return what NAV-PVT says, without a heading."""
    placed = pvt.kind in (TWO_DIMENSIONAL, THREE_DIMENSIONAL, WITH_SENSORS) and not pvt.flags3 & INVALID_PLACE
    return Measured(
        latitude=PLACE * pvt.latitude if placed else math.nan,
        longitude=PLACE * pvt.longitude if placed else math.nan,
        altitude=MILLI * pvt.altitude,
        velocity_north=MILLI * pvt.velocity_north,
        velocity_east=MILLI * pvt.velocity_east,
        velocity_down=MILLI * pvt.velocity_down,
        locked=bool(pvt.flags & FIX_OK) and pvt.kind in (THREE_DIMENSIONAL, WITH_SENSORS),
        quality=_quality(pvt),
        position_sigma=MILLI * pvt.horizontal_accuracy,
        velocity_sigma=MILLI * pvt.speed_accuracy,
        differential_age=AGES[min(pvt.flags3 >> AGE & 0xF, len(AGES) - 1)],
    )


def _quality(pvt: Pvt) -> FixQuality:
    carrier = pvt.flags >> CARRIER & 0b11
    if carrier == 0 or pvt.kind == TWO_DIMENSIONAL:
        return FixQuality.DIFFERENTIAL if pvt.flags & DIFFERENTIAL else FixQuality.SINGLE
    return CARRIER_QUALITIES.get(carrier, FixQuality.UNKNOWN)
