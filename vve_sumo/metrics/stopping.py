"""The braking episodes of a drive, and its last stop: where its braking began, what was demanded, how the car stopped.

Reads columns of a drive's ticks after the drive. It must not know the virtual road, the controller or who asks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.laws import stopping_distance
from vve_sumo.values import DRIVE_LAG, Floats, Vehicle

if TYPE_CHECKING:
    import pyarrow as pa

#: below this speed the car is at rest, and has a gap to talk of [m/s]
AT_REST: Final = 0.05
#: above this speed it has left its rest: what an estimate of a standing car's speed shows is far less [m/s]
MOVING: Final = 0.5
#: a car that gains less than this between two brakings coasts, or creeps on an idling engine [m/s]
GAINED: Final = 0.3
#: a car that gains back this share of the speed that an episode had taken from it drives on: of a stop that loses
#: 0.3 m/s2 or more on average, a loop that oscillates by as much as 2 m/s within 3 s gains back less
REGAINED: Final = 0.75
#: more than drag and an idling engine do: asked for this much the car is being braked, not trimmed [m/s2]
PRESSED: Final = 0.5
#: asked for less than this it coasts [m/s2]; a stop that never asks for more has no braking
RELEASED: Final = 0.1
#: a demand that grows more slowly is trim, not the set-in of a braking [m/s3]
RISING: Final = 0.5
#: so long a release, or so long a rest, ends an episode [s]: a loop that oscillates at the comfort envelope's limits
#: with half a second of delay lets go for less; a driver or a program who has another reason to brake again takes more
MIN_RELEASE_TIME: Final = 2.0
#: an acceleration that is smaller than this either way says nothing of its sign [m/s2]: drag, an idling engine's push,
#: a grade of 3 % and the estimate's noise give no more
REVERSED: Final = 0.3
#: shares of the rise of deceleration that a straight line is laid through
LOW, HIGH = 0.1, 0.9
#: over so many ticks the deceleration before the braking is averaged
TICKS_BEFORE: Final = 10
#: states of the gateway in which it commands the brakes
_COMMANDING: Final = frozenset({"engaged", "stopping", "stopped"})


class StopPart(NamedTuple):
    """A part of a stop."""

    duration: float  #: [s]
    distance: float  #: [m]


@dataclass(frozen=True, slots=True)
class Stop:
    """The braking that ended at rest."""

    onset: int  #: index of the tick that commanded it first
    rest: int  #: index of the first tick at rest
    onset_speed: float  #: [m/s]
    onset_acceleration: float  #: mean of the TICKS_BEFORE until then [m/s2]
    demand: float  #: constant deceleration [m/s2] that stops in the distance that the course granted would take
    reaction: StopPart  #: until the car's deceleration begins to rise
    build_up: StopPart  #: until it has risen
    braking: StopPart  #: until rest
    mfdd: float  #: mean fully developed deceleration [m/s2], of UN R13-H; NaN where the record is too coarse for it
    ripple: float  #: root mean square of what the course differed from the demand by [m/s2]
    reversals: int  #: sign changes of the acceleration, see `sign_changes`; 0 where the car never gained speed

    @property
    def duration(self) -> float:
        """From the first command to rest [s]."""
        return self.reaction.duration + self.build_up.duration + self.braking.duration

    @property
    def distance(self) -> float:
        """From the first command to rest [m]."""
        return self.reaction.distance + self.build_up.distance + self.braking.distance

    def bound(self, vehicle: Vehicle, latency: float = 0.0) -> float:
        """Return the distance [m] that the car as declared needs for it, `latency` [s] from command to frame.

        The closed form of `laws.stopping_distance` from the onset's speed at the demand. The declared lag of the brakes
        counts as a ramp of twice its length, which costs v T - a T^2 / 6 where the lag costs v T - a T^2 / 2. A car
        that was still gaining speed at the onset first gains what the fading push of its throttle gives, whatever lag
        was calibrated.
        """
        delay, build_up = latency + vehicle.brake_delay, 2.0 * vehicle.brake_lag
        gained = max(self.onset_acceleration, 0.0) * (delay + DRIVE_LAG)
        return stopping_distance(self.onset_speed + gained, self.demand, delay, build_up)


class _Way(NamedTuple):
    """Time [s], distance [m], speed [m/s] and deceleration [m/s2] from the onset to rest, an entry a tick."""

    time: Floats
    distance: Floats
    speed: Floats
    deceleration: Floats


class BrakingEpisode(NamedTuple):
    """Braking from its first command to a release after which the car clearly drove on, or to rest."""

    start: int  #: index of the first tick at which braking may have begun: the end of the episode before, or 0
    end: int  #: index after the last tick that commanded braking


def commanded_deceleration(ticks: pa.Table) -> Floats:
    """Return the deceleration [m/s2] that the gateway commanded at every tick, acceleration negative; 0 for none."""
    granted = ticks["granted_acceleration_mps2"].to_numpy()
    return np.where(_commanded(ticks) & np.isfinite(granted), -granted, 0.0)


def _commanded(ticks: pa.Table) -> NDArray[np.bool_]:
    # Arrow's own `array`, which its `is_in` wants, imports pandas.
    return np.array([state in _COMMANDING for state in ticks["state"].to_pylist()], bool)


def braking_episodes(time: Floats, course: Floats, speed: Floats) -> list[BrakingEpisode]:
    """Return the braking episodes of a course of decelerations, in their order; trim below PRESSED among them.

    Time [s], deceleration [m/s2] and speed [m/s], an entry a tick. Brakings, each at RELEASED or more, belong to one
    episode unless the car clearly drove on between them: it gained back the share REGAINED of the speed that the
    episode had taken from it (and GAINED at least), it had stood for MIN_RELEASE_TIME, or it was released for
    MIN_RELEASE_TIME and then gained speed or was braked by PRESSED again. A loop that lets go and brakes again on its
    way to rest so holds one episode, not many, and a brake that is eased off belongs to its stop.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([False], course >= RELEASED, [False])).astype(np.int8)))
    episodes: list[BrakingEpisode] = []
    first = start = end = 0
    for begin, after in edges.reshape(-1, 2).tolist():
        pressed = bool(course[begin:after].max() >= PRESSED)
        if end and _drives_on(time, speed, (first, end, begin), pressed):
            episodes.append(BrakingEpisode(start, end))
            first, start = begin, end
        elif not end:
            first = begin
        end = after
    return [*episodes, BrakingEpisode(start, end)] if end else []


def _drives_on(time: Floats, speed: Floats, marks: tuple[int, int, int], pressed: bool) -> bool:
    """Whether the car drove on between two brakings.

    `marks` are the ticks at which the episode began, the first braking ended and the next one began; `pressed` says
    whether that one is more than trim.
    """
    first, end, begin = marks
    since, after = speed[first : begin + 1], speed[end : begin + 1]
    least = np.fmin.reduce(since)
    released = time[begin] - time[end] > MIN_RELEASE_TIME
    if released and (pressed or _gain(after) > GAINED):
        return True
    regained = np.fmax.reduce(after) - least
    return bool(regained > max(GAINED, REGAINED * (speed[first] - least))) or _stood(time[first:begin], since[:-1])


def _gain(speed: Floats) -> float:
    """Return the most that a speed rises above what it was before [m/s]."""
    return float(np.fmax.reduce(speed - np.fmin.accumulate(speed)))


def _stood(time: Floats, speed: Floats) -> bool:
    """Whether the car stood for MIN_RELEASE_TIME at once."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], np.abs(speed) < AT_REST, [False])).astype(np.int8)))
    return any(time[after - 1] - time[begin] > MIN_RELEASE_TIME for begin, after in edges.reshape(-1, 2).tolist())


def last_stop(ticks: pa.Table, speed: Floats, acceleration: Floats, limit: float = math.inf) -> Stop | None:
    """Return the last stop that was commanded: the braking episode that ended at rest; None where there is none.

    `speed` [m/s] and `acceleration` [m/s2] are the rear axle's, an entry a tick; the car promises no more than a
    deceleration of `limit` [m/s2], whatever it is granted. The demand is v^2 / 2 d: d is the way in which a car that
    did at once what was granted, up to the limit, would have stopped from the onset's speed v.
    """
    rest = _rest(speed)
    if rest is None or not _commanded(ticks)[rest]:
        return None
    time, course = ticks["time_s"].to_numpy(), commanded_deceleration(ticks)
    # What is first asked for at rest holds a car that came to rest without it.
    episodes = braking_episodes(time[:rest], course[:rest], speed[:rest])
    if not episodes or _coasted(time, speed, episodes[-1].end, rest):
        return None
    onset = onset_of(time, course, episodes[-1])
    granted = np.minimum(course[onset:rest], limit)
    demand = _demand(time[onset : rest + 1], granted, float(speed[onset]))
    before = slice(max(0, onset - TICKS_BEFORE + 1), onset + 1)
    way = _way(time[onset : rest + 1], speed[onset : rest + 1], acceleration[onset : rest + 1])
    gaining = float(np.mean(acceleration[before]))
    ripple = math.sqrt(float(np.mean((granted - demand) ** 2)))
    parts, reversals = _parts(way, -gaining, demand), sign_changes(acceleration[onset:rest])
    return Stop(onset, rest, float(speed[onset]), gaining, demand, *parts, _mfdd(way), ripple, reversals)


def sign_changes(acceleration: Floats) -> int:
    """Return how often an acceleration [m/s2] changed its sign since it first was below -REVERSED.

    It has a sign where it is larger than REVERSED either way, and keeps it until it is so large the other way.
    """
    sign = np.where(acceleration > REVERSED, 1, np.where(acceleration < -REVERSED, -1, 0))
    known = sign[sign != 0]
    braking = np.flatnonzero(known < 0)
    return int(np.count_nonzero(np.diff(known[braking[0] :]))) if len(braking) else 0


def _rest(speed: Floats) -> int | None:
    """Return the tick of the last rest after motion; None where there is none."""
    standing = np.flatnonzero(np.abs(speed) < AT_REST)
    moving = np.flatnonzero(speed[: standing[-1]] > MOVING) if len(standing) else standing
    return int(standing[np.searchsorted(standing, moving[-1])]) if len(moving) else None


def _coasted(time: Floats, speed: Floats, end: int, rest: int) -> bool:
    """Whether the car drove on after the last braking, and came to rest without another."""
    return bool(time[rest] - time[end] > MIN_RELEASE_TIME and _gain(speed[end : rest + 1]) > GAINED)


def onset_of(time: Floats, course: Floats, episode: BrakingEpisode) -> int:
    """Return the tick at which the braking of an episode begins.

    What was asked for before it first exceeded PRESSED (or half of the most that a gentle episode asks for) is trim,
    but for the rise that led there.
    """
    times, asked = time[episode.start : episode.end], np.maximum(course[episode.start : episode.end], 0.0)
    first = int(np.argmax(asked >= min(PRESSED, 0.5 * float(asked.max()))))
    slowly = RISING * np.diff(times[: first + 1], prepend=times[0])
    not_rising = np.flatnonzero(~(np.diff(asked[: first + 1], prepend=0.0) > slowly))
    return episode.start + (min(int(not_rising[-1]) + 1, first) if len(not_rising) else 0)


def _demand(time: Floats, course: Floats, speed: float) -> float:
    """Return v^2 / 2 d of a car that follows a course of decelerations, each held until the next tick."""
    step = np.diff(time)
    left = np.concatenate(([speed], speed - np.cumsum(course * step)))
    stops = int(np.argmax(left <= 0.0)) if left[-1] <= 0.0 else len(left)
    distance = float(np.sum(0.5 * (left[: stops - 1] + left[1:stops]) * step[: stops - 1]))
    last = float(left[stops - 1])
    # A car that came to rest sooner than its course: the rest of its speed goes at the mean so far.
    deceleration = float(course[stops - 1]) if stops < len(left) else (speed - last) / float(time[-1] - time[0])
    return speed * speed / (2.0 * distance + last * last / deceleration) if deceleration > 0.0 else math.nan


def _way(time: Floats, speed: Floats, acceleration: Floats) -> _Way:
    driven = np.concatenate(([0.0], np.cumsum(0.5 * (speed[:-1] + speed[1:]) * np.diff(time))))
    return _Way(time - time[0], driven, speed, -acceleration)


def _parts(way: _Way, before: float, demand: float) -> tuple[StopPart, StopPart, StopPart]:
    """Return reaction, build-up and braking: a line through the rise of deceleration from `before` to its level.

    The level is the demand, or the most that the car reached where that is less. A delay and a straight rise come out
    as they are.
    """
    rise = min(demand, float(np.fmax.reduce(way.deceleration))) - before
    low, high = (_reached(way, before + share * rise) for share in (LOW, HIGH))
    slope = (high - low) / (HIGH - LOW)
    end = float(way.time[-1])
    answer = min(max(low - LOW * slope, 0.0), end)
    risen = min(max(high + (1.0 - HIGH) * slope, answer), end)
    marks = [0.0, answer, risen, end]
    places = [_place(way, mark) for mark in marks]
    one, two, three = (StopPart(b - a, t - s) for (a, b), (s, t) in zip(pairwise(marks), pairwise(places), strict=True))
    return one, two, three


def _reached(way: _Way, level: float) -> float:
    """Return when the deceleration first reaches a level [s]; 0 where it has it from the start, the end if never."""
    above = np.flatnonzero(way.deceleration >= level)
    if not len(above):
        return float(way.time[-1])
    after = int(above[0])
    return _between(level, way.deceleration, way.time, after) if after else 0.0


def _place(way: _Way, time: float) -> float:
    """Return the distance [m] driven at a time, the speed straight between two ticks."""
    after = min(max(int(np.searchsorted(way.time, time)), 1), len(way.time) - 1)
    speed = _between(time, way.time, way.speed, after)
    return float(way.distance[after - 1] + 0.5 * (way.speed[after - 1] + speed) * (time - way.time[after - 1]))


def _mfdd(way: _Way) -> float:
    """Return (vb^2 - ve^2) / 2 (se - sb) with vb and ve eight tenths and one tenth of the onset's speed."""
    places, speeds = [], []
    for share in (0.8, 0.1):
        level = share * float(way.speed[0])
        below = np.flatnonzero(way.speed <= level)
        if not len(below) or below[0] == 0:
            return math.nan
        places.append(_place(way, _between(level, way.speed, way.time, int(below[0]))))
        speeds.append(level)
    return (speeds[0] ** 2 - speeds[1] ** 2) / (2.0 * (places[1] - places[0]))


def _between(value: float, one: Floats, other: Floats, after: int) -> float:
    """Return the other at which one has a value, straight between the tick before `after` and that tick."""
    share = (value - one[after - 1]) / (one[after] - one[after - 1])
    return float(other[after - 1] + share * (other[after] - other[after - 1]))
