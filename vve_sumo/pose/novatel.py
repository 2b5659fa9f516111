"""Decodes logs of NovAtel OEM7 receivers, binary and ASCII: INSPVAX and BESTPOS as fixes.

It knows logs and how they belong together; it must not know whether a fix is good enough to drive on (trust.py) or
where the bytes come from. Layouts, codes and the checksum by NovAtel's OEM7 Commands and Logs Reference Manual.
"""

from __future__ import annotations

import math
import re
import struct
import zlib
from typing import Final, NamedTuple

from vve_sumo.pose.census import MessageCensus, Needed
from vve_sumo.pose.gnss_time import WEEK, clock_of_week
from vve_sumo.pose.stream import SLOW_LIFETIME, Framing, Measured, Outcome, StreamDecoder, finite, from_compass
from vve_sumo.values import Fix, FixQuality

SYNC: Final = b"\xaa\x44\x12"
#: sync, length of the header, number of the log, its type, port, length of the content, sequence, idle time, status of
#: the time, week, time of week [ms], status of the receiver, reserved, version of its software
HEADER: Final = struct.Struct("<3sBHBBHHBBHiIHH")
CHECKSUM: Final = struct.Struct("<I")
MAX_LENGTH: Final = 4096  #: of a log [bytes]; what seems longer is taken for a false beginning
RESPONSE: Final = 0x80  #: of a binary log's type: an answer to a command
SOURCE: Final = 0x1F  #: bits of a binary log's type: the antenna, 0 is the first
ASCII: Final = re.compile(rb"#([A-Z][A-Z0-9_]{2,39})A,([^*;\r\n#]{1,200});([^*\r\n#]{0,3800})\*([0-9a-fA-F]{8})")
#: the possible beginning of an ASCII log: whether its end can still come
ASCII_BEGUN: Final = re.compile(rb"#(?:[A-Z][A-Z0-9_]{0,40}(?:,[^*\r\n#]{0,4040}(?:\*[0-9a-fA-F]{0,7})?)?)?")

BESTPOS: Final = 42
INSPVAX: Final = 1465
NAMES: Final = {BESTPOS: "BESTPOS", INSPVAX: "INSPVAX"}
NUMBERS: Final = {name.encode(): number for number, name in NAMES.items()}
#: status of solution, type of position; latitude, longitude [deg], height [m]; undulation [m], datum; 1 sigma north,
#: east, up [m]; base station; ages of corrections and solution [s]; satellites; signals
BESTPOS_CONTENT: Final = struct.Struct("<II ddd fI fff 4s ff BBBB BBBB")
#: status of the INS, type of position; latitude, longitude [deg], height [m]; undulation [m]; velocity north, east, up
#: [m/s]; roll, pitch, azimuth [deg]; 1 sigma of all nine; extended status; time since the last update [s]
INSPVAX_CONTENT: Final = struct.Struct("<II ddd f ddd ddd fff fff fff IH")
CONTENTS: Final = {BESTPOS: BESTPOS_CONTENT.size, INSPVAX: INSPVAX_CONTENT.size}
BESTPOS_FIELDS: Final = 21  #: of the ASCII log
INSPVAX_FIELDS: Final = 23

#: statuses of the time at which it is that of GPS to less than a millisecond: FINE, FINEBACKUPSTEERING, FINESTEERING,
#: SATTIME
FINE_TIMES: Final = {160: b"FINE", 170: b"FINEBACKUPSTEERING", 180: b"FINESTEERING", 200: b"SATTIME"}
FINE_NAMES: Final = frozenset(FINE_TIMES.values())
SOLUTION_COMPUTED: Final = 0
SOLUTION_GOOD: Final = 3  #: the only status of the INS at which it has converged and agrees with GNSS
INS_STATUSES: Final = {
    b"INS_INACTIVE": 0, b"INS_ALIGNING": 1, b"INS_HIGH_VARIANCE": 2, b"INS_SOLUTION_GOOD": SOLUTION_GOOD,
    b"INS_SOLUTION_FREE": 6, b"INS_ALIGNMENT_COMPLETE": 7, b"DETERMINING_ORIENTATION": 8, b"WAITING_INITIALPOS": 9,
    b"WAITING_AZIMUTH": 10, b"INITIALIZING_BIASES": 11, b"MOTION_DETECT": 12, b"WAITING_ALIGNMENTORIENTATION": 14,
}  # fmt: skip
#: types of position of the INS, by its last update
INS_TYPES: Final = {
    b"NONE": 0, b"INS_SBAS": 52, b"INS_PSRSP": 53, b"INS_PSRDIFF": 54, b"INS_RTKFLOAT": 55, b"INS_RTKFIXED": 56,
    b"INS_PPP_CONVERGING": 73, b"INS_PPP": 74, b"INS_PPP_BASIC_CONVERGING": 79, b"INS_PPP_BASIC": 80,
}  # fmt: skip
QUALITIES: Final = {
    0: FixQuality.NONE,
    52: FixQuality.DIFFERENTIAL,
    53: FixQuality.SINGLE,
    54: FixQuality.DIFFERENTIAL,
    55: FixQuality.RTK_FLOAT,
    56: FixQuality.RTK_FIXED,
    73: FixQuality.PPP,
    74: FixQuality.PPP,
    79: FixQuality.PPP,
    80: FixQuality.PPP,
}
LAST_WEEK: Final = 0xFFFF  #: that a binary header can state
UNKNOWN_CODE: Final = -1  #: of a name that is not listed

NEEDED: Final = (
    Needed("position, velocity, heading", (NAMES[INSPVAX],)),
    Needed("age of the corrections", (NAMES[BESTPOS],), every_fix=False),
)


class Inspvax(NamedTuple):
    """INSPVAX; numbers that are not finite may stand where the receiver knows none."""

    status: int
    kind: int
    latitude: float  #: [deg]
    longitude: float  #: [deg]
    height: float  #: above mean sea level [m]
    undulation: float  #: of the geoid [m]
    velocity_north: float  #: [m/s]
    velocity_east: float  #: [m/s]
    velocity_up: float  #: [m/s]
    roll: float  #: right side down [deg]
    pitch: float  #: nose up [deg]
    azimuth: float  #: clockwise from north [deg]
    latitude_sigma: float  #: [m]
    longitude_sigma: float  #: [m]
    height_sigma: float  #: [m]
    velocity_north_sigma: float  #: [m/s]
    velocity_east_sigma: float  #: [m/s]
    velocity_up_sigma: float  #: [m/s]
    roll_sigma: float  #: [deg]
    pitch_sigma: float  #: [deg]
    azimuth_sigma: float  #: [deg]
    extended_status: int
    since_update: int  #: [s]


class _Log(NamedTuple):
    """A log, binary or ASCII, whose time is known."""

    number: int
    clock: int  #: [ms GPS]
    content: bytes | list[bytes]  #: of a binary log, or the fields of an ASCII one


class _Correction(NamedTuple):
    clock: int  #: of the log [ms GPS]
    age: float  #: then [s]


def checksum(data: bytes) -> int:
    """Return the 32-bit CRC of a log: that of zlib, begun with 0 and not inverted."""
    return zlib.crc32(data, 0xFFFF_FFFF) ^ 0xFFFF_FFFF


def _length(buffer: bytes, at: int) -> int | None:
    if buffer[at] == SYNC[0]:
        return _binary_length(buffer[at : at + HEADER.size])
    if found := ASCII.match(buffer, at):
        return found.end() - at
    return None if ASCII_BEGUN.fullmatch(buffer, at) else 0


def _binary_length(head: bytes) -> int | None:
    if not head.startswith(SYNC[: len(head)]):
        return 0
    if len(head) < HEADER.size:
        return None
    _sync, header, number, kind, _port, content, *_rest = HEADER.unpack(head)
    plausible = header == HEADER.size and (number not in CONTENTS or kind & RESPONSE or content == CONTENTS[number])
    length = int(header + content + CHECKSUM.size)
    return length if plausible and length <= MAX_LENGTH else 0


def _intact(log: bytes) -> bool:
    if log[0] == SYNC[0]:
        return checksum(log[: -CHECKSUM.size]) == int.from_bytes(log[-CHECKSUM.size :], "little")
    body, _star, stated = log[1:].rpartition(b"*")
    return checksum(body) == int(stated, 16)


FRAMING: Final = Framing(re.compile(rb"[\xaa#]"), _length, _intact)


class Decoder(StreamDecoder):
    """Decodes a stream of binary and ASCII logs; see `StreamDecoder`.

    Each INSPVAX is a fix. The age of the corrections is that of the newest BESTPOS, as much older as that is, for
    `SLOW_LIFETIME`. The fix is locked at INS_SOLUTION_GOOD alone, and its quality is that of the last update of the
    INS. Logs whose time is coarser than FINE give none, and logs of a second antenna are not read.
    """

    def __init__(self) -> None:
        super().__init__(FRAMING, MessageCensus(NEEDED))
        self._correction = _Correction(-WEEK, math.nan)

    def _read(self, message: bytes, received: float) -> tuple[Outcome, Fix | None]:
        try:
            log = self._opened(message, received)
            if isinstance(log, Outcome):
                return log, None
            if log.number == BESTPOS:
                self._correction = _Correction(log.clock, _correction_age(log.content))
                return Outcome.READ, None
            ins = _inspvax(log.content)
        except (ValueError, LookupError):
            return Outcome.MALFORMED, None
        measured = _measured(ins)
        of, age = self._correction
        if 0 <= log.clock - of <= SLOW_LIFETIME:
            measured.differential_age = age + 1e-3 * (log.clock - of)
        return Outcome.READ, self._complete(log.clock, measured, received)

    def _opened(self, message: bytes, received: float) -> _Log | Outcome:
        """Return a log that is read; the outcome of another one. Raises ValueError or LookupError."""
        return self._binary(message, received) if message[0] == SYNC[0] else self._ascii(message, received)

    def _binary(self, message: bytes, received: float) -> _Log | Outcome:
        _sync, header, number, kind, _port, size, _sequence, _idle, status, week, time_of_week, *_rest = (
            HEADER.unpack_from(message)
        )
        ours = number in NAMES and not kind & (RESPONSE | SOURCE)
        self.census.note(NAMES[number] if ours else str(number), received)
        if not ours:
            return Outcome.OTHER
        if status not in FINE_TIMES:
            return Outcome.NO_TIME
        return _Log(number, _clock(week, time_of_week), message[header : header + size])

    def _ascii(self, message: bytes, received: float) -> _Log | Outcome:
        name, head, content, _checksum = _groups(message)
        number = NUMBERS.get(name)
        self.census.note(name.decode("ascii"), received)
        if number is None:
            return Outcome.OTHER
        _port, _sequence, _idle, status, week, seconds, *_rest = head.split(b",")
        if status not in FINE_NAMES:
            return Outcome.NO_TIME
        return _Log(number, _clock(int(week), 1000.0 * float(seconds)), content.split(b","))


def _groups(message: bytes) -> tuple[bytes, bytes, bytes, bytes]:
    found = ASCII.fullmatch(message)
    if found is None:
        raise ValueError("no ASCII log")
    name, head, content, stated = found.groups()
    return name, head, content, stated


def _clock(week: int, time_of_week: float) -> int:
    """Return the time of a week and a time of week [ms]; raises ValueError."""
    if not (0 <= week <= LAST_WEEK and 0.0 <= time_of_week < WEEK):
        raise ValueError("no time of week")
    return clock_of_week(week, round(time_of_week))


def _correction_age(content: bytes | list[bytes]) -> float:
    """Return the age of corrections and solution of BESTPOS, the larger [s]; NaN where there is no solution."""
    if isinstance(content, bytes):
        status, *_rest = fields = BESTPOS_CONTENT.unpack(content)
        ages = fields[11], fields[12]
    elif len(content) == BESTPOS_FIELDS:
        status = SOLUTION_COMPUTED if content[0] == b"SOL_COMPUTED" else UNKNOWN_CODE
        ages = float(content[11]), float(content[12])
    else:
        raise ValueError("fields of BESTPOS")
    return max(ages) if status == SOLUTION_COMPUTED and all(0.0 <= age < math.inf for age in ages) else math.nan


def _inspvax(content: bytes | list[bytes]) -> Inspvax:
    """Return INSPVAX; raises ValueError."""
    if isinstance(content, bytes):
        return Inspvax._make(INSPVAX_CONTENT.unpack(content))
    if len(content) != INSPVAX_FIELDS:
        raise ValueError("fields of INSPVAX")
    status, kind, *numbers, extended, since_update = content
    codes = INS_STATUSES.get(status, UNKNOWN_CODE), INS_TYPES.get(kind, UNKNOWN_CODE)
    return Inspvax._make((*codes, *map(float, numbers), int(extended, 16), int(since_update)))


def _measured(ins: Inspvax) -> Measured:
    placed = ins.kind != 0 and abs(ins.latitude) <= 90.0 and abs(ins.longitude) <= 360.0
    sigma, speed_sigma = (
        max(north, east) if north >= 0.0 and east >= 0.0 else math.nan
        for north, east in (
            (ins.latitude_sigma, ins.longitude_sigma),
            (ins.velocity_north_sigma, ins.velocity_east_sigma),
        )
    )
    return Measured(
        latitude=math.radians(ins.latitude) if placed else math.nan,
        longitude=math.radians(ins.longitude) if placed else math.nan,
        altitude=finite(ins.height),
        velocity_north=finite(ins.velocity_north),
        velocity_east=finite(ins.velocity_east),
        velocity_down=finite(ins.velocity_up, -1.0),
        locked=ins.status == SOLUTION_GOOD,
        quality=QUALITIES.get(ins.kind, FixQuality.UNKNOWN),
        heading=from_compass(ins.azimuth),
        pitch=finite(ins.pitch, math.radians(1.0)),
        roll=finite(ins.roll, math.radians(1.0)),
        position_sigma=finite(sigma),
        velocity_sigma=finite(speed_sigma),
        heading_sigma=finite(ins.azimuth_sigma, math.radians(1.0)),
    )
