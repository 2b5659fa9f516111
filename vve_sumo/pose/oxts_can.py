"""Codec of the OXTS CAN output: frames to fixes and back.

It knows the unit's default CAN map; it must not know buses, trust or maps. Identifiers and scales as in the RT3000 and
RT3003 manuals (tables "CAN bus messages"), little endian; the status channels are those of NCOM. The resolution is
coarser than NCOM's: 1.1 cm, 0.01 deg, 1 cm/s.
"""

from __future__ import annotations

import enum
import math
import struct
from collections.abc import Iterable
from typing import Final

from vve_sumo.frames import wrap_angle
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.pose.arrivals import Arrivals, JudgedArrival
from vve_sumo.pose.ncom import WRITERS, StatusChannels, quality_of
from vve_sumo.values import Fix, Frame

POSITION: Final = 0x601  #: latitude, longitude [1e-7 deg]
ALTITUDE: Final = 0x602  #: [mm], above mean sea level unless configured otherwise
VELOCITY: Final = 0x603  #: north, east, down, horizontal [cm/s]
ACCELERATION: Final = 0x605  #: along the vehicle's axes: forward, right, down, gravity's share included [cm/s2]
ACCELERATION_LEVEL: Final = 0x606  #: as 0x605, but in the horizontal plane and without gravity's share
ATTITUDE: Final = 0x607  #: heading, pitch, roll [0.01 deg]
RATE: Final = 0x608  #: about the vehicle's axes [0.01 deg/s]
RATE_LEVEL: Final = 0x609  #: about the horizontal plane's axes
TIME: Final = 0x630  #: milliseconds since 1980-01-06, 48 bits, then the UTC offset
STATUS: Final = 0x500  #: plus the number of an NCOM status channel, the same 8 bytes
#: all of the default map, whether read or not, and one for each status channel
IDENTIFIERS: Final = frozenset(range(0x500, 0x640))

LAYOUTS: Final = {
    POSITION: struct.Struct("<ii"),
    ALTITUDE: struct.Struct("<i"),
    VELOCITY: struct.Struct("<hhhH"),
    ACCELERATION: struct.Struct("<hhh"),
    ACCELERATION_LEVEL: struct.Struct("<hhh"),
    ATTITUDE: struct.Struct("<Hhh"),
    RATE: struct.Struct("<hhh"),
    RATE_LEVEL: struct.Struct("<hhh"),
}
RANGES: Final = {"h": (-0x7FFF, 0x7FFF), "H": (0, 0xFFFF), "i": (-0x7FFFFFFF, 0x7FFFFFFF)}
TIME_BYTES: Final = 7
TIME_SET: Final = 60_000_000  #: an earlier time means an unknown time [ms]; as NCOM's first 1000 minutes
TIME_LIMIT: Final = 1 << 43  #: year 2258 [ms]
MAX_CYCLE_GAP: Final = 1_000  #: cycles further apart than this start anew [ms]
BACK: Final = 3  #: this many time frames in a row that are not newer mean that the unit's clock went back: start anew
MIN_EARLINESS: Final = 0.002  #: a time frame earlier than the fastest by less counts as equal [s]; it has 1 ms
MAX_JUMP: Final = 1.0  #: from cycle to cycle of one arrival, as a file is [s]
LOCKING: Final = 12_000  #: a second of initialising and ten of catching up, and a little [ms]
UTC_OFFSET: Final = -18  #: leap seconds since 2017-01-01 [s]


class Outcome(enum.StrEnum):
    """Outcome of one frame on an identifier of the map."""

    PART = "part"  #: taken into the open cycle
    STATUS = "status"
    WRONG_LENGTH = "wrong_length"
    FIX = "fix"  #: a time frame that closed a cycle with a fix; all below are time frames without a fix
    INCOMPLETE = "incomplete"  #: no position in the cycle
    TIME_LOST = "time_lost"  #: the previous time frame is missing, so parts may be of an older cycle
    NO_POSITION = "no_position"  #: out of range
    NO_TIME = "no_time"  #: the unit does not know the time
    AHEAD = "dated_ahead"  #: the time is ahead of what arrivals so far allow
    NOT_INCREASING = "time_not_increasing"


class Decoder:
    """Turns frames into fixes; never raises on any frames.

    A cycle is all frames after the last time frame (0x630, the highest identifier that is read, so arbitration puts it
    last) up to the next, and gives one fix. What was not sent in its own cycle is NaN, and without a position there is
    no fix. Cycles can only mix where a time frame was lost, and then the time makes more than one step (the least step
    seen): such a cycle is dropped. Acceleration and yaw rate are taken along the vehicle's axes, or from the level
    frames where only those are sent.

    A time that is ahead of what arrivals allow (`arrivals.Arrivals`) closes no cycle and is ignored until a run of them
    lasts; one that is not newer gives no fix, but `BACK` of them in a row start the unit anew.

    The map has no navigation status. A unit that is locking sends old data, catching up for ten seconds, and its frames
    do not show this; so a fix is locked once cycles have come without a break for `LOCKING`.
    """

    def __init__(self) -> None:
        self.counts: dict[Outcome, int] = dict.fromkeys(Outcome, 0)
        self.discarded = 0  #: frames with an identifier that is not read
        self._cycle: dict[int, tuple[int, ...]] = {}
        self._status: dict[int, bytes] = {}  #: status channels of the open cycle
        self._channels = StatusChannels()
        self._arrivals = Arrivals(MIN_EARLINESS, MAX_JUMP)
        self._clock = 0  #: of the newest time frame [ms since 1980-01-06 GPS]
        self._behind = 0  #: time frames since then that are not newer
        self._period = MAX_CYCLE_GAP  #: least step of the time so far [ms]
        self._since = 0  #: first time frame of the unbroken series up to now [ms]
        self._emitted = 0  #: time of the newest fix [ms]

    def feed_frames(self, frames: Iterable[Frame], time_received: float) -> list[Fix]:
        """Return the fixes that `frames` complete, all stamped with `time_received` [s, the drive's clock]."""
        fixes = []
        for identifier, data in frames:
            if identifier == TIME:
                outcome, fix = self._close(data, time_received)
                if fix is not None:
                    fixes.append(fix)
            elif identifier in LAYOUTS:
                outcome = self._take(identifier, data)
            elif STATUS <= identifier <= STATUS | 0xFF:
                outcome = self._listen(identifier - STATUS, data)
            else:
                self.discarded += 1
                continue
            self.counts[outcome] += 1
        return fixes

    def _take(self, identifier: int, data: bytes) -> Outcome:
        layout = LAYOUTS[identifier]
        if not layout.size <= len(data) <= 8:
            return Outcome.WRONG_LENGTH
        self._cycle[identifier] = layout.unpack_from(data)
        return Outcome.PART

    def _listen(self, channel: int, data: bytes) -> Outcome:
        if len(data) != 8:
            return Outcome.WRONG_LENGTH
        self._status[channel] = data
        return Outcome.STATUS

    def _close(self, data: bytes, time_received: float) -> tuple[Outcome, Fix | None]:
        if not TIME_BYTES <= len(data) <= 8:
            self._cycle = {}
            return Outcome.WRONG_LENGTH, None
        clock = int.from_bytes(data[:6], "little", signed=True)
        judged = self._arrivals.judge(time_received, clock / 1000.0) if TIME_SET <= clock < TIME_LIMIT else None
        if judged is JudgedArrival.AHEAD:
            return Outcome.AHEAD, None
        cycle, self._cycle = self._cycle, {}
        if judged is None:
            return Outcome.NO_TIME, None
        if judged is JudgedArrival.NOT_NEWER:
            self._behind += 1
            return Outcome.NOT_INCREASING, None
        step, self._clock = clock - self._clock, clock
        if step > MAX_CYCLE_GAP or self._behind >= BACK:
            self._since = clock
        self._behind = 0
        self._hear(clock)
        if 0 < step < self._period:
            self._period = step
        if self._emitted and step > 1.5 * self._period:
            return Outcome.TIME_LOST, None
        if POSITION not in cycle:
            return Outcome.INCOMPLETE, None
        latitude, longitude = (math.radians(raw * 1e-7) for raw in cycle[POSITION])
        if not (abs(latitude) <= math.pi / 2 and abs(longitude) <= math.pi):
            return Outcome.NO_POSITION, None
        self._emitted = clock
        return Outcome.FIX, self._fix(cycle, clock, time_received, latitude, longitude)

    def _hear(self, clock: int) -> None:
        for channel, data in self._status.items():
            self._channels.hear(channel, data, clock)
        self._status.clear()

    def _fix(
        self, cycle: dict[int, tuple[int, ...]], clock: int, time_received: float, latitude: float, longitude: float
    ) -> Fix:
        mode, position_sigma, velocity_sigma, heading_sigma, differential_age = self._channels.values(clock)
        north, east, down = _scaled(cycle.get(VELOCITY), 0.01)
        compass, pitch, roll = _scaled(cycle.get(ATTITUDE), math.radians(0.01))
        heading = math.pi / 2 - compass if 0.0 <= compass <= math.tau else math.nan
        altitude = cycle.get(ALTITUDE)
        return Fix(
            time=clock / 1000.0,
            time_received=time_received,
            latitude=latitude,
            longitude=longitude,
            altitude=math.nan if altitude is None else altitude[0] * 1e-3,
            heading=wrap_angle(heading) if math.isfinite(heading) else math.nan,
            pitch=pitch,
            roll=roll,
            velocity_north=north,
            velocity_east=east,
            velocity_down=down,
            yaw_rate=-_scaled(cycle.get(RATE, cycle.get(RATE_LEVEL)), math.radians(0.01))[2],
            acceleration=_acceleration(cycle, pitch),
            locked=clock - self._since >= LOCKING,
            quality=quality_of(mode),
            position_sigma=position_sigma,
            velocity_sigma=velocity_sigma,
            heading_sigma=heading_sigma,
            differential_age=differential_age,
        )


def _scaled(raw: tuple[int, ...] | None, scale: float) -> tuple[float, float, float]:
    """Three fields in SI; NaN where the frame was not sent, and for the lowest number, which no measurement reaches."""
    if raw is None:
        return math.nan, math.nan, math.nan
    first, second, third = (math.nan if one == -0x8000 else one * scale for one in raw[:3])
    return first, second, third


def _acceleration(cycle: dict[int, tuple[int, ...]], pitch: float) -> float:
    """Acceleration along the car's forward axis with gravity's share, which the level frame lacks [m/s2]."""
    if ACCELERATION in cycle:
        return _scaled(cycle[ACCELERATION], 0.01)[0]
    return _scaled(cycle.get(ACCELERATION_LEVEL), 0.01)[0] + GRAVITY * math.sin(pitch)


def _pack(identifier: int, scale: float, *values: float) -> tuple[Frame, ...]:
    """The frame of `values`; none where one of them is not known; values out of range saturate."""
    if not all(math.isfinite(value) for value in values):
        return ()
    layout = LAYOUTS[identifier]
    ranges = (RANGES[kind] for kind in layout.format[1:])
    counts = (min(max(round(value / scale), low), high) for value, (low, high) in zip(values, ranges, strict=True))
    return (Frame(identifier, layout.pack(*counts)),)


class Encoder:
    """Writes fixes as a unit would: a cycle of frames each, the status channels in turn, the time last."""

    def __init__(self) -> None:
        self._turn = 0

    def encode(self, fix: Fix) -> tuple[Frame, ...]:
        """Return the frames of one cycle, without those whose values `fix` lacks. `fix.time` must be finite."""
        channel, write = WRITERS[self._turn]
        self._turn = (self._turn + 1) % len(WRITERS)
        hundredth = math.radians(0.01)
        compass = (math.pi / 2 - fix.heading) % math.tau
        north, east = fix.velocity_north, fix.velocity_east
        milliseconds = round(fix.time * 1000.0).to_bytes(6, "little", signed=True)
        return (
            Frame(STATUS + channel, write(fix)),
            *_pack(POSITION, 1e-7, math.degrees(fix.latitude), math.degrees(wrap_angle(fix.longitude))),
            *_pack(ALTITUDE, 1e-3, fix.altitude),
            *_pack(VELOCITY, 0.01, north, east, fix.velocity_down, math.hypot(north, east)),
            *_pack(ACCELERATION, 0.01, fix.acceleration, 0.0, 0.0),
            *_pack(ATTITUDE, hundredth, 0.0 if compass / hundredth >= 35_999.5 else compass, fix.pitch, fix.roll),
            *_pack(RATE, hundredth, 0.0, 0.0, -fix.yaw_rate),
            Frame(TIME, milliseconds + struct.pack("<b", UTC_OFFSET)),
        )
