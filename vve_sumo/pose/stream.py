"""Common part of decoders of a stream of messages: cuts it into messages, and gives fixes in the order of their times.

It knows bytes, checksums by a function of the format's, and times; it must not know what a message says.
"""

from __future__ import annotations

import enum
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Generic, NamedTuple, TypeVar

from vve_sumo.physical_constants import GRAVITY
from vve_sumo.pose.arrivals import Arrivals, JudgedArrival
from vve_sumo.pose.census import MessageCensus
from vve_sumo.pose.rates import DifferencedRates
from vve_sumo.values import Fix, FixQuality

Epoch = TypeVar("Epoch")

MIN_EARLINESS: Final = 0.01  #: an epoch earlier than the fastest by less counts as equal [s]
MAX_JUMP: Final = 1.5  #: from epoch to epoch of one arrival, as a file is [s]
SLOW_LIFETIME: Final = 2_500  #: of what is often sent once a second; one message may be lost [ms]
MAX_OPEN: Final = 8  #: epochs of which messages are awaited


class Outcome(enum.StrEnum):
    """Outcome of a message (first four) or of an epoch, which is all messages of one time (the rest)."""

    READ = "read"
    OTHER = "other_message"  #: a kind of message that is not read
    MALFORMED = "malformed"  #: right checksum, wrong content
    WRONG_CHECKSUM = "wrong_checksum"  #: a message, or what began like one
    FIX = "fix"
    INCOMPLETE = "incomplete"  #: a later epoch was complete before all of this one had arrived
    NO_TIME = "time_unknown"  #: the receiver does not know the time yet
    NO_POSITION = "no_position"  #: the receiver has no position
    NOT_INCREASING = "time_not_increasing"
    AHEAD = "time_ahead"  #: of what the arrivals before allow (`arrivals.Arrivals`)


class Framing(NamedTuple):
    """How a format marks the beginning, the length and the integrity of its messages."""

    begin: re.Pattern[bytes]  #: the first byte of a message
    #: of a buffer and the place of a first byte: the message's length, 0 where none begins there, None where that
    #: cannot be known yet
    length: Callable[[bytes, int], int | None]
    intact: Callable[[bytes], bool]  #: whether a message's checksum is right


class MessageCutter:
    """Cuts a byte stream, however it arrives in pieces, into messages with right checksums.

    After a wrong checksum the search goes on behind the first byte, so that a message that was cut short or a false
    beginning costs none of the whole messages after it. Nor does it delay them: what waits for its rest is no message
    where a whole one begins within.
    """

    def __init__(self, framing: Framing) -> None:
        self._framing = framing
        self._buffer = b""
        self.discarded = 0  #: bytes that belonged to no message
        self.damaged = 0  #: beginnings of messages whose checksum was wrong

    @property
    def held(self) -> int:
        """How many bytes may be the beginning of a message."""
        return len(self._buffer)

    def cut(self, data: bytes) -> list[bytes]:
        """Return the messages that `data` completes."""
        buffer, messages = self._buffer + data, []
        start = at = 0
        while (at := self._begin(buffer, at)) < len(buffer):
            length = self._framing.length(buffer, at)
            if length is None:
                break
            if at + length > len(buffer):
                if not self._holds_a_whole_one(buffer, at + 1):
                    break
                length = 0
                self.damaged += 1
            if length == 0 or not self._framing.intact(buffer[at : at + length]):
                self.damaged += length > 0
                at += 1
                continue
            self.discarded += at - start
            messages.append(buffer[at : at + length])
            start = at = at + length
        self.discarded += at - start
        self._buffer = buffer[at:]
        return messages

    def _begin(self, buffer: bytes, at: int) -> int:
        """Return where a message may begin from `at` on; the buffer's length where none does."""
        found = self._framing.begin.search(buffer, at)
        return len(buffer) if found is None else found.start()

    def _holds_a_whole_one(self, buffer: bytes, at: int) -> bool:
        while (at := self._begin(buffer, at)) < len(buffer):
            length = self._framing.length(buffer, at)
            if length and at + length <= len(buffer) and self._framing.intact(buffer[at : at + length]):
                return True
            at += 1
        return False


class OpenEpochs(Generic[Epoch]):
    """The epochs of which some messages have arrived, by time and in the order of their first messages.

    Messages of later epochs may come in between: two receivers may have sent them. What is given up is counted.
    """

    def __init__(self, make: Callable[[], Epoch], counts: dict[Outcome, int]) -> None:
        self._make, self._counts = make, counts
        self._open: dict[int, Epoch] = {}

    def at(self, time: int) -> Epoch:
        """Return the epoch of a time; the oldest one is given up where too many are open."""
        epoch = self._open.get(time)
        if epoch is None:
            epoch = self._open[time] = self._make()
            if len(self._open) > MAX_OPEN:
                self._give_up_oldest()
        return epoch

    def close(self, time: int) -> None:
        """Close the epoch of a time, and give up those that were opened before it."""
        while next(iter(self._open)) != time:
            self._give_up_oldest()
        del self._open[time]

    def _give_up_oldest(self) -> None:
        del self._open[next(iter(self._open))]
        self._counts[Outcome.INCOMPLETE] += 1


@dataclass(slots=True)
class Measured:
    """What the messages of one epoch say; NaN is not known."""

    latitude: float  #: [rad]
    longitude: float  #: [rad]
    altitude: float  #: above mean sea level [m]
    velocity_north: float  #: [m/s]
    velocity_east: float  #: [m/s]
    velocity_down: float  #: [m/s]
    locked: bool
    quality: FixQuality
    heading: float = math.nan  #: [rad] counter-clockwise from east
    pitch: float = math.nan  #: [rad] nose up
    roll: float = math.nan  #: [rad] right side down
    yaw_rate: float = math.nan  #: [rad/s] counter-clockwise; differenced where it is not known
    position_sigma: float = math.nan  #: [m]
    velocity_sigma: float = math.nan  #: [m/s]
    heading_sigma: float = math.nan  #: [rad]
    differential_age: float = math.nan  #: [s]


class StreamDecoder(ABC):
    """Turns a byte stream into fixes; never raises on any bytes.

    A kind reads its messages in `_read` and hands a complete epoch to `_complete`. Emitted times increase strictly; a
    receiver whose clock goes back needs a new decoder. A time ahead of what arrivals allow is left out until a run of
    such times lasts (`arrivals.Arrivals`). Acceleration is differenced from the speed along the heading, and gravity's
    share is added where the pitch is known; the yaw rate is differenced where the messages do not hold it.
    """

    def __init__(self, framing: Framing, census: MessageCensus) -> None:
        self.counts: dict[Outcome, int] = dict.fromkeys(Outcome, 0)
        self.census = census  #: which messages came
        self._cutter = MessageCutter(framing)
        self._arrivals = Arrivals(MIN_EARLINESS, MAX_JUMP)
        self._rates = DifferencedRates()

    @property
    def messages(self) -> int:
        """How many messages had a right checksum."""
        return sum(self.counts[one] for one in (Outcome.READ, Outcome.OTHER, Outcome.MALFORMED))

    @property
    def recognised(self) -> int:
        """How many of them are of a kind that is read."""
        return self.messages - self.counts[Outcome.OTHER]

    @property
    def discarded(self) -> int:
        """How many bytes belonged to no message."""
        return self._cutter.discarded

    @property
    def held(self) -> int:
        """How many bytes wait for the rest of their message."""
        return self._cutter.held

    def feed(self, data: bytes, time_received: float) -> list[Fix]:
        """Return the fixes that `data` completes, all stamped with `time_received` [s, the drive's clock]."""
        fixes = []
        messages = self._cutter.cut(data)
        self.counts[Outcome.WRONG_CHECKSUM] = self._cutter.damaged
        for message in messages:
            outcome, fix = self._read(message, time_received)
            self.counts[outcome] += 1
            if fix is not None:
                fixes.append(fix)
        return fixes

    @abstractmethod
    def _read(self, message: bytes, received: float) -> tuple[Outcome, Fix | None]:
        """Read an intact message; return its outcome, and the fix that it completes."""

    def _complete(self, clock: int, measured: Measured, received: float) -> Fix | None:
        """Return the fix of an epoch of time `clock` [ms GPS]; None, and counted, where it is none."""
        outcome = self._judge(clock, measured, received)
        self.counts[outcome] += 1
        return self._fix(clock, measured, received) if outcome is Outcome.FIX else None

    def _judge(self, clock: int, measured: Measured, received: float) -> Outcome:
        if not (abs(measured.latitude) <= math.pi / 2 and abs(measured.longitude) <= math.tau):
            return Outcome.NO_POSITION
        judged = self._arrivals.judge(received, clock / 1000.0)
        if judged is JudgedArrival.AHEAD:
            return Outcome.AHEAD
        return Outcome.NOT_INCREASING if judged is JudgedArrival.NOT_NEWER else Outcome.FIX

    def _fix(self, clock: int, of: Measured, received: float) -> Fix:
        ahead = of.velocity_east * math.cos(of.heading) + of.velocity_north * math.sin(of.heading)
        turning, gaining = self._rates.step(clock, of.heading, ahead)
        return Fix(
            time=clock / 1000.0,
            time_received=received,
            latitude=of.latitude,
            longitude=of.longitude,
            altitude=of.altitude,
            heading=of.heading,
            pitch=of.pitch,
            roll=of.roll,
            velocity_north=of.velocity_north,
            velocity_east=of.velocity_east,
            velocity_down=of.velocity_down,
            yaw_rate=turning if math.isnan(of.yaw_rate) else of.yaw_rate,
            acceleration=gaining + (0.0 if math.isnan(of.pitch) else GRAVITY * math.sin(of.pitch)),
            locked=of.locked,
            quality=of.quality,
            position_sigma=of.position_sigma,
            velocity_sigma=of.velocity_sigma,
            heading_sigma=of.heading_sigma,
            differential_age=of.differential_age,
        )


def finite(value: float, scale: float = 1.0) -> float:
    """Return a number times `scale`; NaN where it is not finite, which no field of a fix may be."""
    return value * scale if math.isfinite(value) else math.nan


def from_compass(degrees: float) -> float:
    """Return a heading [rad], counter-clockwise from east, of degrees clockwise from north; NaN of no number."""
    return math.remainder(math.radians(90.0 - degrees), math.tau) if math.isfinite(degrees) else math.nan


def to_compass(heading: float) -> float:
    """Return degrees clockwise from north, from 0 to below 360, of a heading [rad] counter-clockwise from east."""
    return (90.0 - math.degrees(heading)) % 360.0
