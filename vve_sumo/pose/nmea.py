"""Decodes NMEA 0183 sentences into fixes.

It knows sentences, checksums and how receivers send them; it must not know whether a fix is good enough to drive on
(trust.py) or where the bytes come from. NMEA carries less than NCOM: rates are differenced here, and what a receiver
does not send is declared by the rig or stays NaN.
"""

from __future__ import annotations

import datetime
import enum
import math
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import Any, Final, NamedTuple

import pynmea2

from vve_sumo.physical_constants import GRAVITY
from vve_sumo.pose.arrivals import Arrivals, JudgedArrival, Repeated
from vve_sumo.pose.census import MessageCensus, Needed
from vve_sumo.pose.gnss_time import DAY, GPS_EPOCH, GPS_MINUS_UTC
from vve_sumo.pose.rates import DifferencedRates
from vve_sumo.values import Fix, FixQuality

SENTENCE: Final = re.compile(rb"\$([^$*\r\n]{1,250})\*([0-9A-Fa-f]{2})")
BEGUN: Final = re.compile(rb"\$[^$*\r\n]{0,250}(?:\*[0-9A-Fa-f]?)?")  #: the possible beginning of a sentence
SLOW_LIFETIME: Final = 2_500  #: accuracies are often sent once a second; one may be lost [ms]
MIN_EARLINESS: Final = 0.01  #: an epoch earlier than the fastest by less counts as equal [s]; many send hundredths
MAX_JUMP: Final = 1.5  #: from epoch to epoch of one arrival, as a file is [s]
DATED: Final = 2_000  #: a date counts if its time of day is this near to the epoch's [ms]
MAX_PERIOD_SHARE: Final = 0.7  #: of a period; a later sentence without a time no longer belongs to the open epoch
COURSE_LOST: Final = 0.2  #: receivers leave the course empty when slower than about this [m/s]
KNOT: Final = 1852.0 / 3600.0  #: [m/s]

#: Fix quality by the quality indicator of GGA; military PPS, estimated and others are unknown.
QUALITIES: Final = {1: FixQuality.SINGLE, 2: FixQuality.DIFFERENTIAL, 4: FixQuality.RTK_FIXED, 5: FixQuality.RTK_FLOAT}
NEW: Final = frozenset({JudgedArrival.NEWER, JudgedArrival.CHANGED})
NOT_MEASURED: Final = frozenset("NESM")  #: mode indicators: not valid, estimated, simulated, manual
MEASURED: Final = "A"  #: status of THS; E, M, S and V are estimated, manual, simulated and not valid
#: rank of the sentences that state the heading: THS says what HDT does, and whether it is valid
HEADINGS: Final = {"HDT": 1, "THS": 2, "PASHR": 3}
#: sentences that carry the time: one of these opens an epoch
TIMED: Final = ("GGA", "RMC", "PASHR", "GST")
NEEDED: Final = (
    Needed("position", ("GGA",)),
    Needed("heading", ("HDT", "THS", "PASHR")),
    Needed("velocity", ("VTG", "RMC")),
    Needed("accuracy of the position", ("GST",), every_fix=False),
    Needed("date", ("RMC", "ZDA"), every_fix=False),
)


class THS(pynmea2.TalkerSentence):  # type: ignore[misc]
    """True heading and status, which pynmea2 does not know; it finds the class by its name."""

    fields = (("True heading", "true_heading"), ("Status", "status"))


class Outcome(enum.StrEnum):
    """Outcome of a sentence (first five) or of an epoch, which is all sentences of one time (the rest)."""

    READ = "read"
    OTHER = "other_sentence"  #: a sentence type that is not read
    WRONG_CHECKSUM = "wrong_checksum"
    MALFORMED = "malformed"  #: right checksum, wrong fields
    STRAY = "stray"  #: its epoch is not open: complete, over, not begun, or ahead of what arrivals allow
    FIX = "fix"
    INCOMPLETE = "incomplete"  #: another epoch began before position, heading and velocity had arrived
    DATE_UNKNOWN = "date_unknown"  #: no RMC or ZDA yet
    NOT_INCREASING = "time_not_increasing"
    NO_POSITION = "no_position"  #: the receiver has no position


class _Position(NamedTuple):
    latitude: float
    longitude: float
    altitude: float
    quality: int
    differential_age: float


class _Attitude(NamedTuple):
    heading: float  #: counter-clockwise from east
    pitch: float = math.nan
    roll: float = math.nan
    heading_sigma: float = math.nan


class _Motion(NamedTuple):
    speed: float
    course: float  #: counter-clockwise from east


@dataclass(slots=True)
class _Epoch:
    """The sentences of one time of day that have arrived so far."""

    time_of_day: int  #: UTC [ms]
    received: float
    open: bool = True
    heading_from: int = 0  #: rank in `HEADINGS` of the best sentence that has stated the heading; 0 is none
    position: _Position | None = None
    attitude: _Attitude | None = None
    motion: _Motion | None = None


def _number(value: Any) -> float:
    """A field as a number; NaN for empty, infinite or no number (pynmea2 leaves what it cannot read as text)."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan
    return number if math.isfinite(number) else math.nan


def _from_compass(degrees: float) -> float:
    return math.remainder(math.radians(90.0 - degrees), math.tau)


def _nearest(step: int) -> int:
    """A difference of times of day, wrapped to half a day either way [ms]."""
    return (step + DAY // 2) % DAY - DAY // 2


def _time_of_day(sentence: Any) -> int:
    """UTC time of day [ms]; raises ValueError where there is none."""
    time = sentence.timestamp
    if not isinstance(time, datetime.time):
        raise ValueError("no time of day")
    return (time.hour * 3600 + time.minute * 60 + time.second) * 1000 + round(time.microsecond / 1000)


def _position(sentence: Any) -> _Position:
    quality = sentence.gps_qual if isinstance(sentence.gps_qual, int) else 0
    known = quality > 0 and sentence.lat_dir in ("N", "S") and sentence.lon_dir in ("E", "W")
    latitude, longitude = (sentence.latitude, sentence.longitude) if known else (math.nan, math.nan)
    if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
        latitude = longitude = math.nan
    return _Position(
        math.radians(latitude),
        math.radians(longitude),
        _number(sentence.altitude),
        quality,
        _number(sentence.age_gps_data),
    )


def _attitude(sentence: Any) -> _Attitude:
    """Of PASHR: time, heading, T, roll, pitch, heave, three accuracies, quality of the aiding (0 is none)."""
    if sentence.is_true_heading != "T" or _number(sentence.aiding_status) == 0.0:
        return _Attitude(math.nan)
    heading, pitch, roll, sigma = (
        _number(value) for value in (sentence.true_heading, sentence.pitch, sentence.roll, sentence.heading_accuracy)
    )
    return _Attitude(_from_compass(heading), math.radians(pitch), math.radians(roll), math.radians(sigma))


def _motion_of_vtg(sentence: Any) -> _Motion:
    speed = _number(sentence.spd_over_grnd_kmph) / 3.6
    if math.isnan(speed):
        speed = _number(sentence.spd_over_grnd_kts) * KNOT
    if sentence.faa_mode in NOT_MEASURED:
        speed = math.nan
    return _Motion(speed, _from_compass(_number(sentence.true_track)))


def _motion_of_rmc(sentence: Any) -> _Motion:
    measured = sentence.status == "A" and sentence.mode_indicator not in NOT_MEASURED
    speed = _number(sentence.spd_over_grnd) * KNOT if measured else math.nan
    return _Motion(speed, _from_compass(_number(sentence.true_course)))


class Decoder:
    """Turns a byte stream, however it is cut, into fixes; never raises on any bytes.

    A fix is complete with GGA (position), HDT, THS or PASHR (heading) and VTG or RMC (velocity), and is emitted at
    once. THS also says whether the heading is valid, PASHR has pitch, roll and the heading's accuracy; the best of the
    three that the epoch before had is awaited. GST (accuracy) and the date (ZDA or RMC) may come less often, the date
    once before the first fix. Only sentences with a right checksum count. Emitted times are strictly increasing, except
    where the day was set back; a receiver whose clock goes back by less needs a new decoder. A time of day ahead of
    what arrivals allow (`arrivals.Arrivals`) and a date on another day than the known one (`arrivals.Repeated`) are
    ignored until a run of them lasts.

    HDT, THS and VTG carry no time. They belong to the epoch that the last sentence with a new time opened (GGA, RMC,
    PASHR or GST), if they arrive within `MAX_PERIOD_SHARE` of a period. The receiver must therefore send one of those
    first. A receiver that sends HDT or THS first gives no fix at all, rather than headings of the wrong epoch; `counts`
    then shows INCOMPLETE and STRAY.

    NMEA has no yaw rate and acceleration: they are differences of heading and of speed along it over the last
    `rates.RATE_WINDOW` (late by half of it, and blind where both are wrong together), NaN for the first fix and after a
    gap, which the trust gate refuses; gravity's share of the acceleration is added where the pitch is known. The
    accuracies of velocity and heading are those that the rig declares (1 sigma, [m/s] and [rad]); PASHR's heading
    accuracy counts where it is larger or none is declared. An unknown accuracy is NaN and refused. Altitude is above
    mean sea level.
    Where `needs_attitude` is false, a fix is complete without a heading, which is then NaN, as are the rates. That is
    enough for a person and too little for a car.
    """

    def __init__(
        self, *, velocity_sigma: float = math.nan, heading_sigma: float = math.nan, needs_attitude: bool = True
    ) -> None:
        self.counts: dict[Outcome, int] = dict.fromkeys(Outcome, 0)
        self.discarded = 0  #: bytes that belonged to no sentence, line ends aside
        self.census = MessageCensus(NEEDED, TIMED)  #: which sentences came
        self._velocity_sigma, self._heading_sigma = velocity_sigma, heading_sigma
        self._needs_attitude = needs_attitude
        self._buffer = b""
        self._epoch: _Epoch | None = None
        self._arrivals = Arrivals(MIN_EARLINESS, MAX_JUMP)
        self._begun = 0  #: time of day of the epoch, counted on beyond midnight [ms]
        self._day = Repeated()
        self._period = 0.0  #: between the last two epochs [s]
        self._awaited = 0  #: rank of the sentence by which the epoch before had its heading
        self._dated: int | None = None  #: a UTC time that is known with its date [ms since 1980-01-06]
        self._located = False  #: the newest GGA had a position; without one a receiver's date is only a guess
        self._emitted = 0  #: time of the newest fix [ms GPS]
        self._accuracy = (-DAY, math.nan)  #: time of day [ms] and 1 sigma [m] of the last GST
        self._rates = DifferencedRates()
        self._readers: dict[bytes, Callable[[Any, float], bool]] = {
            b"GGA": self._read_gga,
            b"RMC": self._read_rmc,
            b"VTG": self._read_vtg,
            b"HDT": self._read_hdt,
            b"THS": self._read_ths,
            b"GST": self._read_gst,
            b"ZDA": self._read_zda,
            b"PASHR": self._read_pashr,
        }

    @property
    def sentences(self) -> int:
        """How many sentences had a right checksum."""
        return sum(self.counts[one] for one in (Outcome.READ, Outcome.OTHER, Outcome.MALFORMED, Outcome.STRAY))

    @property
    def recognised(self) -> int:
        """How many of them are of a type that is read."""
        return self.counts[Outcome.READ] + self.counts[Outcome.STRAY]

    def feed(self, data: bytes, time_received: float) -> list[Fix]:
        """Return the fixes that `data` completes, all stamped with `time_received` [s, the drive's clock]."""
        buffer, fixes, end = self._buffer + data, [], 0
        for match in SENTENCE.finditer(buffer):
            self._discard(buffer[end : match.start()])
            end = match.end()
            outcome = self._take(match[1], int(match[2], 16), time_received)
            self.counts[outcome] += 1
            fix = self._completed(time_received)
            if fix is not None:
                fixes.append(fix)
        begin = buffer.rfind(b"$", end)
        if begin < 0 or not BEGUN.fullmatch(buffer, begin):
            begin = len(buffer)
        self._discard(buffer[end:begin])
        self._buffer = buffer[begin:]
        return fixes

    def _discard(self, garbage: bytes) -> None:
        self.discarded += len(garbage.translate(None, b"\r\n"))

    def _take(self, body: bytes, checksum: int, received: float) -> Outcome:
        if reduce(operator.xor, body) != checksum:
            return Outcome.WRONG_CHECKSUM
        head = body.split(b",", 1)[0]
        kind = head if head.startswith(b"P") else head[2:]
        self.census.note(kind.decode("ascii", "replace"), received)
        reader = self._readers.get(kind)
        if reader is None or (head == b"PASHR" and not body[6:7].isdigit()):  # Ashtech's own have a name there
            return Outcome.OTHER
        try:
            sentence = pynmea2.parse(f"${body.decode('ascii')}*{checksum:02X}", check=True)
            return Outcome.READ if reader(sentence, received) else Outcome.STRAY
        except (ValueError, LookupError, AttributeError, TypeError, OverflowError):
            return Outcome.MALFORMED  # pynmea2 raises any of these for a wrong field

    # --- epochs ---------------------------------------------------------------------------------------------------

    def _enter(self, time_of_day: int, received: float) -> _Epoch | None:
        """The epoch of a sentence with a time, begun if it is new; None if it is over or not plausible."""
        epoch = self._epoch
        step = _nearest(time_of_day - epoch.time_of_day) if epoch is not None else time_of_day
        if epoch is not None and step <= 0:
            return epoch if step == 0 and epoch.open else None
        if self._arrivals.judge(received, (self._begun + step) / 1000.0) not in NEW:
            return None
        self._begun += step
        if epoch is not None:
            self._period = step / 1000.0
            self._awaited = epoch.heading_from
            self.counts[Outcome.INCOMPLETE] += epoch.open
        self._epoch = _Epoch(time_of_day, received)
        return self._epoch

    def _newest(self, received: float) -> _Epoch | None:
        """The epoch of a sentence without a time that arrived at `received`, open or not."""
        epoch = self._epoch
        return epoch if epoch is not None and received - epoch.received <= MAX_PERIOD_SHARE * self._period else None

    # --- sentences: each reader returns whether the sentence belongs to an epoch ----------------------------------

    def _read_gga(self, sentence: Any, received: float) -> bool:
        time_of_day, position = _time_of_day(sentence), _position(sentence)
        self._located = math.isfinite(position.latitude)
        epoch = self._enter(time_of_day, received)
        if epoch is not None:
            epoch.position = position
        return epoch is not None

    def _read_rmc(self, sentence: Any, received: float) -> bool:
        time_of_day, motion = _time_of_day(sentence), _motion_of_rmc(sentence)
        epoch = self._enter(time_of_day, received)
        if sentence.status == "A" and isinstance(sentence.datestamp, datetime.date):
            self._date(sentence.datestamp, time_of_day)
        if epoch is not None and epoch.motion is None:
            epoch.motion = motion
        return epoch is not None

    def _read_vtg(self, sentence: Any, received: float) -> bool:
        motion, epoch = _motion_of_vtg(sentence), self._newest(received)
        if epoch is None or not epoch.open:
            return False
        epoch.motion = motion
        return True

    def _read_hdt(self, sentence: Any, received: float) -> bool:
        heading = _number(sentence.heading) if sentence.hdg_true == "T" else math.nan
        return _turned(self._newest(received), HEADINGS["HDT"], self._awaited, _Attitude(_from_compass(heading)))

    def _read_ths(self, sentence: Any, received: float) -> bool:
        heading = _number(sentence.true_heading) if sentence.status == MEASURED else math.nan
        return _turned(self._newest(received), HEADINGS["THS"], self._awaited, _Attitude(_from_compass(heading)))

    def _read_pashr(self, sentence: Any, received: float) -> bool:
        time_of_day, attitude = _time_of_day(sentence), _attitude(sentence)
        self._enter(time_of_day, received)
        epoch = self._epoch
        ours = epoch if epoch is not None and epoch.time_of_day == time_of_day else None
        return _turned(ours, HEADINGS["PASHR"], self._awaited, attitude)

    def _read_gst(self, sentence: Any, received: float) -> bool:
        time_of_day = _time_of_day(sentence)
        north, east = _number(sentence.std_dev_latitude), _number(sentence.std_dev_longitude)
        self._enter(time_of_day, received)
        if self._epoch is None or (self._epoch.time_of_day - time_of_day) % DAY > SLOW_LIFETIME:
            return False
        self._accuracy = (time_of_day, max(north, east) if math.isfinite(north + east) else math.nan)
        return True

    def _read_zda(self, sentence: Any, _received: float) -> bool:
        if self._located:
            self._date(sentence.datestamp, _time_of_day(sentence))
        return True

    # --- fixes ----------------------------------------------------------------------------------------------------

    def _date(self, date: datetime.date, time_of_day: int) -> None:
        if self._epoch is not None and abs(_nearest(time_of_day - self._epoch.time_of_day)) > DATED:
            return
        stated = (date - GPS_EPOCH).days * DAY + time_of_day
        if self._dated is not None:
            off = (stated - self._dated - _nearest(time_of_day - self._dated)) // DAY
            if not self._day.believe(off):
                return
            if off != 0:
                self._emitted = 0
        self._dated = stated

    def _completed(self, received: float) -> Fix | None:
        """The fix of the open epoch if it is complete; closes the epoch."""
        epoch = self._epoch
        if epoch is None or not epoch.open or epoch.position is None or epoch.motion is None:
            return None
        attitude = epoch.attitude
        if attitude is None and not self._needs_attitude:
            attitude = _Attitude(math.nan)
        if attitude is None:
            return None
        epoch.open = False
        outcome, fix = self._close(epoch, epoch.position, attitude, epoch.motion, received)
        self.counts[outcome] += 1
        return fix

    def _close(
        self, epoch: _Epoch, position: _Position, attitude: _Attitude, motion: _Motion, received: float
    ) -> tuple[Outcome, Fix | None]:
        if self._dated is None:
            return Outcome.DATE_UNKNOWN, None
        # Of all days, the one that puts the epoch nearest to the last dated time: midnight needs no new date.
        self._dated += _nearest(epoch.time_of_day - self._dated)
        clock = self._dated + GPS_MINUS_UTC
        if clock <= self._emitted:
            return Outcome.NOT_INCREASING, None
        if not math.isfinite(position.latitude + position.longitude):
            return Outcome.NO_POSITION, None
        self._emitted = clock
        return Outcome.FIX, self._fix(clock, epoch.time_of_day, position, attitude, motion, received)

    def _fix(
        self, clock: int, time_of_day: int, position: _Position, attitude: _Attitude, motion: _Motion, received: float
    ) -> Fix:
        lost = math.isnan(motion.course) and motion.speed < COURSE_LOST
        course = attitude.heading if lost else motion.course
        ahead = motion.speed * math.cos(course - attitude.heading)
        yaw_rate, acceleration = self._rates.step(clock, attitude.heading, ahead)
        quality = QUALITIES.get(position.quality, FixQuality.UNKNOWN)
        heard, position_sigma = self._accuracy
        return Fix(
            time=clock / 1000.0,
            time_received=received,
            latitude=position.latitude,
            longitude=position.longitude,
            altitude=position.altitude,
            heading=attitude.heading,
            pitch=attitude.pitch,
            roll=attitude.roll,
            velocity_north=motion.speed * math.sin(course),
            velocity_east=motion.speed * math.cos(course),
            velocity_down=math.nan,
            yaw_rate=yaw_rate,
            acceleration=acceleration + (0.0 if math.isnan(attitude.pitch) else GRAVITY * math.sin(attitude.pitch)),
            # NMEA has no navigation status: a receiver that reports one of these qualities works in real time.
            locked=quality is not FixQuality.UNKNOWN,
            quality=quality,
            position_sigma=position_sigma if (time_of_day - heard) % DAY <= SLOW_LIFETIME else math.nan,
            velocity_sigma=self._velocity_sigma,
            heading_sigma=_worse(self._heading_sigma, attitude.heading_sigma),
            differential_age=position.differential_age,
        )


def _turned(epoch: _Epoch | None, rank: int, awaited: int, attitude: _Attitude) -> bool:
    """Take the attitude of a sentence, unless a better one came or is awaited; return whether its epoch is open.

    A sentence that came too late for its epoch still lets the next one wait for its own.
    """
    if epoch is None:
        return False
    epoch.heading_from = max(epoch.heading_from, rank)
    if epoch.open and rank >= max(epoch.heading_from, awaited):
        epoch.attitude = attitude
    return epoch.open


def _worse(declared: float, reported: float) -> float:
    """The larger of two standard deviations; a missing one does not count."""
    if math.isnan(declared):
        return reported
    return declared if math.isnan(reported) else max(declared, reported)
