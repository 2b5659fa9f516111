"""Codec of OXTS NCOM: 72-byte packets to fixes and back.

It knows bytes, checksums and the unit's clock; it must not know whether a fix is good enough to drive on (trust.py),
where the car is in a map, or where the bytes come from. Layout and rules as in OXTS's own decoder
NComRxC.c (github.com/OxfordTechnicalSolutions/NCOMdecoder, nav/NComRxC.c, UpdateNav and DecodeExtra*) and, for the
status codes, github.com/harry-harris-27/Ncom.
"""

from __future__ import annotations

import enum
import math
import struct
import zlib
from collections.abc import Callable
from typing import Final

from vve_sumo.frames import wrap_angle
from vve_sumo.pose.arrivals import Arrivals, JudgedArrival, Repeated
from vve_sumo.values import Fix, FixQuality

SYNC: Final = b"\xe7"
LENGTH: Final = 72  #: of a packet [bytes]
LOCKING, LOCKED = 3, 4  #: navigation statuses: catching up with the time; in real time
NAVIGATION: Final = frozenset({2, LOCKING, LOCKED})  #: status 2 is initialising: it already has time and position
STRUCTURE_B: Final = 11  #: another layout under the same sync byte

MINUTE: Final = 60_000  #: [ms]
MINUTES_SET: Final = 1_000  #: a smaller channel-0 value means that the unit does not know the time yet (NComRxC)
CLOCK_HOLD: Final = 30.0  #: silence after which the minute is unknown again [s]: half the range of the packet's clock
MIN_EARLINESS: Final = 0.002  #: a packet earlier than the fastest by less counts as equal [s]; its clock has 1 ms
MAX_JUMP: Final = 1.0  #: from packet to packet of one arrival, as a file is [s]
CHANNEL_LIFETIME: Final = 5_000  #: a status channel silent for longer is not used [ms]; a cycle takes about 2 s
AGE_LIMIT: Final = 150  #: an accuracy with this age counter or more is stale (NComRxC)

ACCELERATION: Final = 1e-4  #: [m/s2]
RATE: Final = 1e-5  #: [rad/s]
VELOCITY: Final = 1e-4  #: [m/s]
ANGLE: Final = 1e-6  #: [rad]
INVALID: Final = -0x800000  #: of a 24-bit field
MAX_RAW: Final = 0x7FFFFF  #: of a 24-bit field, either sign

#: What a fix takes from a packet, in its order. `Hb` is a 24-bit field: its low two bytes, then its signed high byte.
_MEASUREMENTS = struct.Struct(
    "<3x Hb"  # forward acceleration
    "12x Hb B"  # downward angular rate, navigation status
    "x ddf"  # latitude, longitude, altitude
    "Hb Hb Hb"  # velocity north, east, down
    "Hb Hb Hb 11x"  # heading, pitch, roll
)
#: A whole packet.
_PACKET = struct.Struct(
    "<c H Hb 12s"  # sync byte, time, forward acceleration, four quantities that no fix has
    "Hb B B"  # downward angular rate, navigation status, checksum
    "ddf"  # latitude, longitude, altitude
    "Hb Hb Hb"  # velocity north, east, down
    "Hb Hb Hb B"  # heading, pitch, roll, checksum
    "B 8s B"  # status channel, checksum
)
_NOT_SENT: Final = 4 * b"\x00\x00\x80"
_CHANNEL_0 = struct.Struct("<iBBBB")
_ACCURACY = struct.Struct("<HHHBB")
_DIFFERENTIAL = struct.Struct("<h4s2x")
_ROTATION = struct.Struct("<hhhBB")
_UTC_MINUS_GPS: Final = -18  #: leap seconds since 2017-01-01 [s]


class Outcome(enum.StrEnum):
    """Outcome of one packet whose three checksums are right."""

    FIX = "fix"
    MINUTE_UNKNOWN = "minute_unknown"  #: no status channel 0 yet, or none since a long silence
    MINUTE_DOUBTED = "minute_doubted"  #: its minute is not the known one, and too few others in a row agree on it yet
    AHEAD = "dated_ahead"  #: dated ahead of what arrivals so far allow
    NOT_INCREASING = "time_not_increasing"  #: duplicate, out of order, or the unit's clock went back
    NO_POSITION = "no_position"  #: latitude or longitude not a number or out of range
    NO_TIME = "no_time"  #: milliseconds beyond the minute
    NOT_NAVIGATION = "not_navigation"  #: status 0, 1, 5, 6, 7 or unknown
    STATUS_ONLY = "status_only"
    STRUCTURE_B = "structure_b"
    TRIGGER = "trigger"


# Members that nearly every packet needs, found once: Python looks them up in their class at the cost of a call.
_FIX, _MINUTE_UNKNOWN = Outcome.FIX, Outcome.MINUTE_UNKNOWN
_AHEAD, _NOT_NEWER = JudgedArrival.AHEAD, JudgedArrival.NOT_NEWER
_UNKNOWN = FixQuality.UNKNOWN


def checksums_hold(packet: bytes) -> bool:
    """Whether all three running checksums of a 72-byte packet are right."""
    # The low half of Adler-32 is start value plus sum of bytes, to the modulus 65521, which so few bytes never reach.
    total = zlib.adler32(packet[1:22], 0)
    if total & 0xFF != packet[22]:
        return False
    total = zlib.adler32(packet[22:61], total & 0xFFFF)
    if total & 0xFF != packet[61]:
        return False
    return zlib.adler32(packet[61:71], total & 0xFFFF) & 0xFF == packet[71]


def _signed(low: int, high: int, scale: float) -> float:
    """Value of a 24-bit field; NaN where it is marked as invalid."""
    raw = high << 16 | low
    return math.nan if raw == INVALID else raw * scale


def _read_mode(payload: bytes) -> float:
    return math.nan if payload[5] & 0x80 else payload[5]


def _read_horizontal_accuracy(payload: bytes) -> float:
    north, east, _, age, _ = _ACCURACY.unpack(payload)
    return max(north, east) * 1e-3 if age < AGE_LIMIT else math.nan


def _read_heading_accuracy(payload: bytes) -> float:
    heading, _, _, age, _ = _ACCURACY.unpack(payload)
    return heading * 1e-5 if age < AGE_LIMIT else math.nan


def _read_differential_age(payload: bytes) -> float:
    raw: int = _DIFFERENTIAL.unpack(payload)[0]
    return raw * 0.01 if raw >= 0 else math.nan


#: Fix quality by the GNSS position mode of channel 0. Doppler modes measure a velocity and no position.
QUALITIES: Final[dict[float, FixQuality]] = {
    **dict.fromkeys((0, 1, 2, 10, 11, 12, 20, 25), FixQuality.NONE),  # none, search, Doppler, no data, blanked
    **dict.fromkeys((3, 13, 21, 26), FixQuality.SINGLE),  # SPS; post-processed; gx, ix
    **dict.fromkeys((4, 7, 8, 14, 18, 22, 27), FixQuality.DIFFERENTIAL),  # SBAS, OmniSTAR VBS, CDGPS too
    **dict.fromkeys((9, 17, 30, 31), FixQuality.PPP),  # OmniSTAR HP and XP; PPP converging and converged
    **dict.fromkeys((5, 15, 23, 28), FixQuality.RTK_FLOAT),
    **dict.fromkeys((6, 16, 24, 29), FixQuality.RTK_FIXED),
}
#: position mode that a unit without post-processing sends for a quality; an unknown one is sent as invalid
MODES: Final = {
    FixQuality.NONE: 0,
    FixQuality.SINGLE: 3,
    FixQuality.DIFFERENTIAL: 4,
    FixQuality.PPP: 31,
    FixQuality.RTK_FLOAT: 5,
    FixQuality.RTK_FIXED: 6,
}


def quality_of(mode: float) -> FixQuality:
    """Return the fix quality of a position mode of channel 0; NaN is a mode that is not known."""
    return QUALITIES.get(mode, _UNKNOWN)


#: Reader of each status channel in use: one number each, NaN where the unit marks it as invalid or stale.
_READERS: Final[dict[int, Callable[[bytes], float]]] = {
    0: _read_mode,
    3: _read_horizontal_accuracy,  # of the position
    4: _read_horizontal_accuracy,  # of the velocity
    5: _read_heading_accuracy,
    20: _read_differential_age,
}


#: Navigation statuses without a fix whose status channel is still valid: raw IMU, status only, and the trigger packets
#: (interpolated, up to 30 ms late, and timed by their channel, not by bytes 1 and 2).
_CHANNEL_ONLY: Final = {
    1: Outcome.NOT_NAVIGATION,
    10: Outcome.STATUS_ONLY,
    20: Outcome.TRIGGER,
    21: Outcome.TRIGGER,
    22: Outcome.TRIGGER,
}


class StatusChannels:
    """Last values of the status channels; one channel travels with each packet, in turn."""

    def __init__(self) -> None:
        #: status channel to (clock when received [ms], value)
        self._heard: dict[int, tuple[float, float]] = dict.fromkeys(_READERS, (-math.inf, math.nan))

    def hear(self, channel: int, payload: bytes, clock: int) -> None:
        """Take the 8 bytes of a channel, sent at `clock` [ms], unless it is not used or has newer bytes already."""
        heard = self._heard.get(channel)
        if heard is not None and clock >= heard[0]:
            self._heard[channel] = clock, _READERS[channel](payload)

    def values(self, clock: int) -> list[float]:
        """Return position mode, accuracies of position, velocity and heading, and age of corrections, as last heard.

        NaN for a value that is not known or older than `CHANNEL_LIFETIME` at `clock` [ms].
        """
        return [
            value if abs(clock - heard) <= CHANNEL_LIFETIME else math.nan for heard, value in self._heard.values()
        ]  # fmt: skip


class Decoder:
    """Turns a byte stream, however it is cut, into fixes; never raises on any bytes.

    The packet's clock runs within a GPS minute; only status channel 0 carries the minute, about once in a cycle. In
    between, a packet is dated to the minute that puts it nearest to its predecessor's time plus the time passed on the
    receiving clock. That is NComRxC's roll-over rule (below 2000 ms after above 2000 ms is a new minute) wherever less
    than 30 s were lost; unlike that rule, it recognises a late packet as late. After `CLOCK_HOLD` of silence on the
    receiving clock the minute is unknown until a channel 0 carries it again.

    No single packet is accepted against those before it. A channel 0 with another minute is ignored until more of them
    in a row agree on it than have confirmed the known one (`arrivals.Repeated`); then the unit's clock is taken as set,
    back or forth. A packet dated ahead of what arrivals allow (`arrivals.Arrivals`) is ignored until a run of them
    lasts. Packets fed with one and the same arrival, as files are, may jump by `MAX_JUMP`; beyond a longer gap the
    first two packets are lost.

    Emitted fixes have strictly increasing times, except where the unit's minute was set back (a unit whose clock goes
    back by less needs a new decoder). All else is counted in `counts` by `Outcome`, bytes that belong to no packet in
    `discarded`. The three 8-bit running sums catch any one wrong byte; several wrong bytes between the same two sums
    pass once in 256 (over UDP only if Ethernet and UDP missed them too; the trust gate follows); random bytes after a
    sync byte pass once in 2**24.
    """

    def __init__(self) -> None:
        self.counts: dict[Outcome, int] = dict.fromkeys(Outcome, 0)
        self.discarded = 0  #: bytes that belonged to no packet
        self.codes = (0, -1)  #: the newest fix's navigation status and position mode, as NCOM numbers them; -1 unknown
        self._buffer = b""
        self._clock: int | None = None  #: of the newest packet that was accepted [ms since 1980-01-06 GPS]
        self._dated_at = -math.inf  #: its arrival [s]
        self._arrivals = Arrivals(MIN_EARLINESS, MAX_JUMP)
        self._minute = Repeated()
        self._channels = StatusChannels()

    @property
    def packets(self) -> int:
        """How many packets had three right checksums."""
        return sum(self.counts.values())

    @property
    def recognised(self) -> int:
        """The same: every packet is read."""
        return self.packets

    def feed(self, data: bytes, time_received: float) -> list[Fix]:
        """Return the fixes that `data` completes, all stamped with `time_received` [s, the drive's clock]."""
        buffer, fixes = self._buffer + data, []
        start = here = 0
        while (here := buffer.find(SYNC, here)) >= 0 and here + LENGTH <= len(buffer):
            packet = buffer[here : here + LENGTH]
            if not checksums_hold(packet):
                here += 1
                continue
            self.discarded += here - start
            start = here = here + LENGTH
            outcome, fix = self._take(packet, time_received)
            self.counts[outcome] += 1
            if fix is not None:
                fixes.append(fix)
        tail = here if here >= 0 else len(buffer)
        self.discarded += tail - start
        self._buffer = buffer[tail:]
        return fixes

    def _take(self, packet: bytes, time_received: float) -> tuple[Outcome, Fix | None]:
        status = packet[21]
        if status in NAVIGATION:
            return self._navigate(packet, time_received)
        if status == STRUCTURE_B:
            return Outcome.STRUCTURE_B, None
        if status in _CHANNEL_ONLY and self._clock is not None:
            self._channels.hear(packet[62], packet[63:71], self._clock)
        return _CHANNEL_ONLY.get(status, Outcome.NOT_NAVIGATION), None

    def _navigate(self, packet: bytes, time_received: float) -> tuple[Outcome, Fix | None]:
        milliseconds = packet[1] | packet[2] << 8
        if milliseconds >= MINUTE:
            return Outcome.NO_TIME, None
        outcome, clock = self._date(packet, milliseconds, time_received)
        if clock is None:
            return outcome, None
        judged = self._arrivals.judge(time_received, clock / 1000.0)
        if judged is _AHEAD:
            return Outcome.AHEAD, None
        # The channel of an overtaken packet counts too: channels take turns, and where of every two packets the later
        # one comes first, half of the channels travel only in overtaken packets.
        self._channels.hear(packet[62], packet[63:71], clock)
        if judged is _NOT_NEWER:
            return Outcome.NOT_INCREASING, None
        self._clock, self._dated_at = clock, time_received
        fix = self._fix(packet, clock, time_received)
        return (Outcome.NO_POSITION if fix is None else _FIX), fix

    def _date(self, packet: bytes, milliseconds: int, received: float) -> tuple[Outcome, int | None]:
        """The packet's time [ms], or None where it is not known, with the outcome for that case."""
        stated = None
        if packet[62] == 0:
            minutes = int.from_bytes(packet[63:67], "little", signed=True)
            stated = minutes * MINUTE + milliseconds if minutes >= MINUTES_SET else None
        if self._clock is None:
            return _MINUTE_UNKNOWN, stated
        passed = received - self._dated_at
        expected = self._clock + (round(1000.0 * passed) if 0.0 < passed < math.inf else 0)
        ahead = (milliseconds - expected) % MINUTE
        nearest = expected + (ahead if ahead <= MINUTE // 2 else ahead - MINUTE)
        if stated is None:
            return _MINUTE_UNKNOWN, None if passed > CLOCK_HOLD else nearest
        return Outcome.MINUTE_DOUBTED, stated if self._believed((stated - nearest) // MINUTE) else None

    def _believed(self, off: int) -> bool:
        """Whether to accept a status channel 0 whose minute is `off` from the expected one."""
        believed = self._minute.believe(off)
        if believed and off != 0:
            self._arrivals, self._channels = Arrivals(MIN_EARLINESS, MAX_JUMP), StatusChannels()
        return believed

    def _fix(self, packet: bytes, clock: int, time_received: float) -> Fix | None:
        """The fix in a packet of time `clock` [ms]; None where its position is not a number or out of range."""
        (
            forward_low, forward_high, turn_low, turn_high, status,
            latitude, longitude, altitude,
            north_low, north_high, east_low, east_high, down_low, down_high,
            heading_low, heading_high, pitch_low, pitch_high, roll_low, roll_high,
        ) = _MEASUREMENTS.unpack(packet)  # fmt: skip
        if not (abs(latitude) <= math.pi / 2 and abs(longitude) <= math.tau):
            return None
        mode, position_sigma, velocity_sigma, heading_sigma, differential_age = self._channels.values(clock)
        self.codes = status, -1 if math.isnan(mode) else int(mode)
        return Fix(
            time=clock / 1000.0,
            time_received=time_received,
            latitude=latitude,
            longitude=longitude,
            altitude=altitude if math.isfinite(altitude) else math.nan,
            heading=wrap_angle(math.pi / 2 - _signed(heading_low, heading_high, ANGLE)),
            pitch=_signed(pitch_low, pitch_high, ANGLE),
            roll=_signed(roll_low, roll_high, ANGLE),
            velocity_north=_signed(north_low, north_high, VELOCITY),
            velocity_east=_signed(east_low, east_high, VELOCITY),
            velocity_down=_signed(down_low, down_high, VELOCITY),
            yaw_rate=-_signed(turn_low, turn_high, RATE),
            acceleration=_signed(forward_low, forward_high, ACCELERATION),
            locked=status == LOCKED,
            quality=quality_of(mode),
            position_sigma=position_sigma,
            velocity_sigma=velocity_sigma,
            heading_sigma=heading_sigma,
            differential_age=differential_age,
        )


def _count(value: float, scale: float) -> int:
    """Count of a 24-bit field: NaN is sent as invalid, a value out of range saturates."""
    count = value / scale
    if -MAX_RAW <= count <= MAX_RAW:
        return round(count)
    if math.isnan(count):
        return INVALID
    return MAX_RAW if count > 0.0 else -MAX_RAW


def pack(fix: Fix, channel: int, payload: bytes) -> bytes:
    """Return the 72 bytes a unit sends for `fix`, with 8 bytes `payload` of status channel `channel`.

    Quantities that a fix does not have (lateral and vertical acceleration, roll and pitch rate) are sent as invalid.
    `fix.time` must be finite; `time_received` and what status channels carry (quality, sigmas, ages) are not read.
    """
    forward, yaw = _count(fix.acceleration, ACCELERATION), _count(-fix.yaw_rate, RATE)
    north, east = _count(fix.velocity_north, VELOCITY), _count(fix.velocity_east, VELOCITY)
    down, heading = _count(fix.velocity_down, VELOCITY), _count(wrap_angle(math.pi / 2 - fix.heading), ANGLE)
    pitch, roll = _count(fix.pitch, ANGLE), _count(fix.roll, ANGLE)
    # struct has no 24-bit integer: its lower two bytes go as one number, its upper byte as another.
    packet = bytearray(
        _PACKET.pack(
            SYNC, round(fix.time * 1000.0) % MINUTE, forward & 0xFFFF, forward >> 16, _NOT_SENT,
            yaw & 0xFFFF, yaw >> 16, LOCKED if fix.locked else LOCKING, 0,
            fix.latitude, fix.longitude, fix.altitude,
            north & 0xFFFF, north >> 16, east & 0xFFFF, east >> 16, down & 0xFFFF, down >> 16,
            heading & 0xFFFF, heading >> 16, pitch & 0xFFFF, pitch >> 16, roll & 0xFFFF, roll >> 16, 0,
            channel, payload, 0,
        )
    )  # fmt: skip
    return _sealed(packet)


def _sealed(packet: bytearray) -> bytes:
    """The packet with the three checksums that belong to it; each sums all bytes before it but the first."""
    total = zlib.adler32(packet[1:22], 0)  # its low half is the sum of the bytes; see `checksums_hold`
    packet[22] = total & 0xFF
    total = zlib.adler32(packet[22:61], total & 0xFFFF)
    packet[61] = total & 0xFF
    packet[71] = zlib.adler32(packet[61:71], total & 0xFFFF) & 0xFF
    return bytes(packet)


def with_status(packet: bytes, status: int) -> bytes:
    """Return a 72-byte packet with another navigation status, and the three checksums that belong to it."""
    changed = bytearray(packet)
    changed[21] = status
    return _sealed(changed)


def _accuracy(sigma: float, scale: float) -> bytes:
    """Payload of channels 3, 4 and 5, the same in all three axes; an unknown value gets an age that means stale."""
    if math.isnan(sigma):
        return _ACCURACY.pack(0, 0, 0, 0xFF, 0xFF)
    raw = round(min(sigma / scale, 0xFFFF))
    return _ACCURACY.pack(raw, raw, raw, 0, 0xFF)


def _mode(fix: Fix) -> bytes:
    mode = MODES.get(fix.quality, 0xFF)
    return _CHANNEL_0.pack(round(fix.time * 1000.0) // MINUTE, 0xFF, mode, mode, 0xFF)


def _differential(fix: Fix) -> bytes:
    age = fix.differential_age
    return _DIFFERENTIAL.pack(-1 if math.isnan(age) else round(min(age * 100.0, 0x7FFF)), b"VVE0")


#: Status channels in the order sent, with the function that writes each from a fix.
WRITERS: Final[tuple[tuple[int, Callable[[Fix], bytes]], ...]] = (
    (0, _mode),
    (3, lambda fix: _accuracy(fix.position_sigma, 1e-3)),
    (4, lambda fix: _accuracy(fix.velocity_sigma, 1e-3)),
    (5, lambda fix: _accuracy(fix.heading_sigma, 1e-5)),
    (20, _differential),
    (16, lambda _: _ROTATION.pack(0, 0, 0, 0, (_UTC_MINUS_GPS << 1 | 1) & 0xFF)),
)


#: bytes of a packet: its status channel, the minute of channel 0, the last checksum
_CHANNEL, _MINUTE, _MINUTE_END, _CHECKSUM = 62, 63, 67, 71


class Encoder:
    """Writes fixes as a unit would: one packet each, the status channels in turn, channel 0 first."""

    def __init__(self) -> None:
        self._turn = 0

    def encode(self, fix: Fix) -> bytes:
        """Return the packet for `fix` (finite time; see `pack`) with the status channel whose turn it is."""
        channel, write = WRITERS[self._turn]
        self._turn = (self._turn + 1) % len(WRITERS)
        return pack(fix, channel, write(fix))

    def with_wrong_minute(self, data: bytes, minutes: int) -> bytes | None:
        """Return a packet whose minute is so far off, with its checksum; None for one of another status channel."""
        if data[_CHANNEL : _CHANNEL + 1] != b"\0":
            return None
        minute = (int.from_bytes(data[_MINUTE:_MINUTE_END], "little") + minutes).to_bytes(4, "little")
        wrong = data[:_MINUTE] + minute + data[_MINUTE_END:_CHECKSUM]
        return wrong + bytes((sum(wrong[1:]) & 0xFF,)) + data[_CHECKSUM + 1 :]
