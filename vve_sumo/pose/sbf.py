"""Decodes Septentrio SBF: PVTGeodetic and AttEuler with their covariances as fixes.

It knows blocks and how they belong together; it must not know whether a fix is good enough to drive on (trust.py) or
where the bytes come from. Layouts, units, codes and values for "do not use" by Septentrio's mosaic-H Reference Guide.
"""

from __future__ import annotations

import binascii
import math
import re
import struct
from dataclasses import dataclass
from typing import Final, NamedTuple

from vve_sumo.pose.census import MessageCensus, Needed
from vve_sumo.pose.gnss_time import WEEK, clock_of_week
from vve_sumo.pose.stream import SLOW_LIFETIME, Framing, Measured, OpenEpochs, Outcome, StreamDecoder, from_compass
from vve_sumo.values import Fix, FixQuality

SYNC: Final = b"$@"
HEADER: Final = struct.Struct("<2sHHH")  #: sync, checksum, revision and number of the block, length of the whole
PROTECTED: Final = 4  #: the checksum is over all from this byte on
NUMBER: Final = 0x1FFF  #: bits of the number; above are those of the revision
REVISION: Final = 13
MAX_LENGTH: Final = 4096  #: of a block [bytes]; what seems longer is taken for a false beginning
MAX_MORE: Final = 64  #: what revisions to come may add to a block that is read [bytes]
ALIGNMENT: Final = 4  #: lengths are multiples of it [bytes]

PVT: Final = 4007  #: PVTGeodetic
POSITION_COVARIANCE: Final = 5906  #: PosCovGeodetic
VELOCITY_COVARIANCE: Final = 5908  #: VelCovGeodetic
ATTITUDE: Final = 5938  #: AttEuler
ATTITUDE_COVARIANCE: Final = 5939  #: AttCovEuler
NAMES: Final = {
    PVT: "PVTGeodetic",
    POSITION_COVARIANCE: "PosCovGeodetic",
    VELOCITY_COVARIANCE: "VelCovGeodetic",
    ATTITUDE: "AttEuler",
    ATTITUDE_COVARIANCE: "AttCovEuler",
}
TIME: Final = struct.Struct("<IH")  #: every block begins with its time of week [ms] and GPS week
PVT_BLOCK: Final = struct.Struct("<BB ddd fffff df BBBB HH IB")
#: of PVTGeodetic from revision 2 on: bases, seed of PPP; latency; horizontal and vertical accuracy [cm]; flags
ACCURACY_BLOCK: Final = struct.Struct("<BH HHH B x")
COVARIANCE_BLOCK: Final = struct.Struct("<BB 10f")  #: mode, error; variances north, east, up, clock; covariances
ATTITUDE_BLOCK: Final = struct.Struct("<BBHH ffffff")
ATTITUDE_COVARIANCE_BLOCK: Final = struct.Struct("<BB 6f")  #: reserved, error; variances of heading, pitch, roll; …
LENGTHS: Final = {
    PVT: PVT_BLOCK.size,
    POSITION_COVARIANCE: COVARIANCE_BLOCK.size,
    VELOCITY_COVARIANCE: COVARIANCE_BLOCK.size,
    ATTITUDE: ATTITUDE_BLOCK.size,
    ATTITUDE_COVARIANCE: ATTITUDE_COVARIANCE_BLOCK.size,
}

NO_TIME: Final = 0xFFFF_FFFF  #: as a time of week
NO_WEEK: Final = 0xFFFF
NO_NUMBER: Final = -2e10  #: as a floating-point number
NO_AGE: Final = 0xFFFF  #: as an age of corrections or an accuracy
MODE: Final = 0xF  #: bits of PVTGeodetic's mode
#: Of the modes, a moving base (7, 8) says nothing about the place on the earth, and a fixed one (3) is not measured.
QUALITIES: Final = {
    1: FixQuality.SINGLE,
    2: FixQuality.DIFFERENTIAL,
    4: FixQuality.RTK_FIXED,
    5: FixQuality.RTK_FLOAT,
    6: FixQuality.DIFFERENTIAL,
    10: FixQuality.PPP,
}
INTEGRITY: Final = 0b11  #: of the alert flags: of the receiver's autonomous integrity monitoring
INTEGRITY_LOST: Final = 2
DRMS_TWICE: Final = 0.5e-2  #: from HAccuracy, twice the root mean square of distance [cm], to 1 sigma at most [m]
WITHOUT_ROLL: Final = 2  #: mode of AttEuler: heading and pitch by fixed ambiguities
WITH_ROLL: Final = 4
BASELINE_ERROR: Final = 0b10000011  #: of AttEuler's error: of the first auxiliary antenna, or attitude not computed

NEEDED: Final = (
    Needed("position, velocity", (NAMES[PVT],)),
    Needed("heading", (NAMES[ATTITUDE],)),
    Needed("accuracy of the velocity", (NAMES[VELOCITY_COVARIANCE],), every_fix=False),
    Needed("accuracy of the heading", (NAMES[ATTITUDE_COVARIANCE],), every_fix=False),
)


class Pvt(NamedTuple):
    """PVTGeodetic, without its time."""

    mode: int
    error: int  #: 0 is none
    latitude: float  #: [rad]
    longitude: float  #: [rad]
    height: float  #: above the ellipsoid [m]
    undulation: float  #: of the geoid [m]
    velocity_north: float  #: [m/s]
    velocity_east: float  #: [m/s]
    velocity_up: float  #: [m/s]
    course: float  #: [deg]
    clock_bias: float  #: [ms]
    clock_drift: float  #: [ppm]
    time_system: int
    datum: int
    satellites: int
    corrections: int
    reference: int
    correction_age: int  #: [0.01 s]
    signals: int
    alerts: int


class Attitude(NamedTuple):
    """AttEuler, without its time."""

    satellites: int
    error: int
    mode: int
    information: int
    heading: float  #: clockwise from north [deg]
    pitch: float  #: nose up [deg]
    roll: float  #: right side down [deg]
    pitch_rate: float  #: [deg/s]
    roll_rate: float  #: [deg/s]
    heading_rate: float  #: [deg/s]


def checksum(data: bytes) -> int:
    """Return the 16-bit CRC of CCITT, begun with 0, of a block's bytes behind its checksum."""
    return binascii.crc_hqx(data, 0)


def _length(buffer: bytes, at: int) -> int | None:
    head = buffer[at : at + HEADER.size]
    if not head.startswith(SYNC[: len(head)]):
        return 0
    if len(head) < HEADER.size:
        return None
    _sync, _checksum, kind, length = HEADER.unpack(head)
    least, most = HEADER.size + TIME.size, MAX_LENGTH
    if kind & NUMBER in LENGTHS:
        least += LENGTHS[kind & NUMBER]
        most = least + MAX_MORE
    return length if least <= length <= most and length % ALIGNMENT == 0 else 0


def _intact(block: bytes) -> bool:
    return checksum(block[PROTECTED:]) == int.from_bytes(block[2:PROTECTED], "little")


FRAMING: Final = Framing(re.compile(rb"\$"), _length, _intact)


@dataclass(slots=True)
class _Epoch:
    """The blocks of one time that have arrived so far."""

    measured: Measured | None = None
    attitude: Attitude | None = None


class _Accuracy(NamedTuple):
    clock: int  #: of the block [ms GPS]
    sigma: float


NO_ACCURACY: Final = _Accuracy(-WEEK, math.nan)


class Decoder(StreamDecoder):
    """Decodes a stream of SBF; see `StreamDecoder`.

    A fix is complete with PVTGeodetic and AttEuler of one time, in either order. The newest covariances count for
    `SLOW_LIFETIME`; where PosCovGeodetic is not of the same time, PVTGeodetic's own horizontal accuracy counts
    (revision 2). Heading and pitch are those of fixed ambiguities; otherwise they are NaN, as is a roll that was not
    measured. The yaw rate is AttEuler's where the receiver gives it.
    """

    def __init__(self) -> None:
        super().__init__(FRAMING, MessageCensus(NEEDED))
        self._epochs = OpenEpochs(_Epoch, self.counts)  # by time [ms GPS]
        self._accuracies: dict[int, _Accuracy] = {}  # by the number of the block

    def _read(self, message: bytes, received: float) -> tuple[Outcome, Fix | None]:
        kind = HEADER.unpack_from(message)[2]
        number = kind & NUMBER
        self.census.note(NAMES.get(number, str(number)), received)
        if number not in LENGTHS:
            return Outcome.OTHER, None
        time_of_week, week = TIME.unpack_from(message, HEADER.size)
        if time_of_week == NO_TIME or week == NO_WEEK:
            return Outcome.NO_TIME, None
        if time_of_week >= WEEK:
            return Outcome.MALFORMED, None
        clock, content = clock_of_week(week, time_of_week), message[HEADER.size + TIME.size :]
        if number not in (PVT, ATTITUDE):
            self._accuracies[number] = _Accuracy(clock, _sigma(number, content))
            return Outcome.READ, None
        epoch = self._epochs.at(clock)
        if number == PVT:
            epoch.measured = _measured(content, kind >> REVISION)
        else:
            epoch.attitude = Attitude._make(ATTITUDE_BLOCK.unpack_from(content))
        return Outcome.READ, self._completed(clock, epoch, received)

    def _completed(self, clock: int, epoch: _Epoch, received: float) -> Fix | None:
        """Return the fix of an epoch, if it is complete."""
        measured = epoch.measured
        if measured is None or epoch.attitude is None:
            return None
        self._epochs.close(clock)
        _turn(measured, epoch.attitude)
        of, sigma = self._accuracies.get(POSITION_COVARIANCE, NO_ACCURACY)
        if of == clock:
            measured.position_sigma = sigma
        elif math.isnan(measured.position_sigma):
            measured.position_sigma = self._accuracy(POSITION_COVARIANCE, clock)
        measured.velocity_sigma = self._accuracy(VELOCITY_COVARIANCE, clock)
        measured.heading_sigma = self._accuracy(ATTITUDE_COVARIANCE, clock)
        return self._complete(clock, measured, received)

    def _accuracy(self, number: int, clock: int) -> float:
        """Return the newest 1 sigma of a covariance block at a time [ms GPS]; NaN where it is too old, or later."""
        of, sigma = self._accuracies.get(number, NO_ACCURACY)
        return sigma if 0 <= clock - of <= SLOW_LIFETIME else math.nan


def _number(value: float) -> float:
    """Return a number; NaN where the receiver says not to use it, or it is none."""
    return value if math.isfinite(value) and value != NO_NUMBER else math.nan


def _measured(content: bytes, revision: int) -> Measured:
    pvt = Pvt._make(PVT_BLOCK.unpack_from(content))
    placed = pvt.error == 0 and pvt.mode & MODE != 0
    undulation = _number(pvt.undulation)
    measured = Measured(
        latitude=_number(pvt.latitude) if placed else math.nan,
        longitude=_number(pvt.longitude) if placed else math.nan,
        altitude=_number(pvt.height) - (0.0 if math.isnan(undulation) else undulation),
        velocity_north=_number(pvt.velocity_north),
        velocity_east=_number(pvt.velocity_east),
        velocity_down=-_number(pvt.velocity_up),
        locked=placed and pvt.alerts & INTEGRITY != INTEGRITY_LOST,
        quality=QUALITIES.get(pvt.mode & MODE, FixQuality.UNKNOWN),
        differential_age=math.nan if pvt.correction_age == NO_AGE else 0.01 * pvt.correction_age,
    )
    if revision >= 2 and len(content) >= PVT_BLOCK.size + ACCURACY_BLOCK.size:
        horizontal = ACCURACY_BLOCK.unpack_from(content, PVT_BLOCK.size)[3]
        measured.position_sigma = math.nan if horizontal == NO_AGE else DRMS_TWICE * horizontal
    return measured


def _turn(measured: Measured, attitude: Attitude) -> None:
    """Write an attitude into what was measured."""
    if attitude.error & BASELINE_ERROR or attitude.mode not in (WITHOUT_ROLL, WITH_ROLL):
        return
    measured.heading = from_compass(_number(attitude.heading))
    measured.pitch = math.radians(_number(attitude.pitch))
    if attitude.mode == WITH_ROLL:
        measured.roll = math.radians(_number(attitude.roll))
    measured.yaw_rate = -math.radians(_number(attitude.heading_rate))


def _sigma(number: int, content: bytes) -> float:
    """Return the larger horizontal standard deviation [m, m/s], or that of the heading [rad]; NaN where it is not."""
    if number == ATTITUDE_COVARIANCE:
        _reserved, error, heading, *_rest = ATTITUDE_COVARIANCE_BLOCK.unpack_from(content)
        variance = _number(heading)
        return math.radians(math.sqrt(variance)) if not error & BASELINE_ERROR and variance >= 0.0 else math.nan
    _mode, error, north, east, *_rest = COVARIANCE_BLOCK.unpack_from(content)
    north, east = _number(north), _number(east)
    return math.sqrt(max(north, east)) if error == 0 and north >= 0.0 and east >= 0.0 else math.nan
