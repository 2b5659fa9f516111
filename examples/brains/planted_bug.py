"""Brains with a planted bug each, to test benches with; none of them must ever drive a car.

    python planted_bug.py BUG WAYPOINTS.csv [--gnss PORT] [--radar PORT] [--setpoints PORT] [--key FILE]

All the rest of each is `stop_for_parked.py`'s. Without a BUG that there is, the bugs are listed.
"""

from __future__ import annotations

import math
import sys
from collections import deque
from collections.abc import Mapping
from dataclasses import replace

from driving import Answers, Brain, Seen, Target, answer, arguments, waypoints

from vve_sumo.values import Fix
from vve_sumo.wire.datagrams import RadarDatagram

DELAY = 25  # ticks of a slow brain: 0.5 s


class ActsOnInvalid(Brain):
    """Acts on radar that is marked as invalid."""

    def valid(self, _beat: RadarDatagram) -> bool:
        """Return the wrong answer: yes, whatever the flag says."""
        return True


class IgnoresAge(Brain):
    """Never looks at the time of measurement."""

    def age(self, _seen: Seen) -> float:
        """Return the wrong age: none, however old the scan is [s]."""
        return 0.0


class IgnoresSequence(Brain):
    """Takes a datagram whose sequence stands for a new one."""

    def newer(self, _beat: RadarDatagram) -> bool:
        """Return the wrong answer: yes, whatever the sequence says."""
        return True


class IgnoresDelay(Brain):
    """Takes a datagram for as new as the moment at which it came."""

    def timely(self, _fix: Fix, _beat: RadarDatagram) -> bool:
        """Return the wrong answer: yes, however late the datagram is."""
        return True


class DrivesOnDeadGnss(IgnoresDelay):
    """Goes on from its last fix when no other comes, by the motion that the radar datagram tells."""

    def __init__(self, waypoints: list[tuple[float, float]], speed: float) -> None:
        super().__init__(waypoints, speed)
        self._last: tuple[Fix, float, float, float] | None = None  # the fix, and metres and radians since

    def answer(self, fix: Fix, radar: Seen) -> tuple[float, float]:
        """Return steering and acceleration by the last place, carried on."""
        return super().answer(self._carried_on(fix, radar), radar)

    def _carried_on(self, fix: Fix, radar: Seen) -> Fix:
        last = self._last
        north = east = turned = 0.0
        if last is not None and last[0].time == fix.time:
            heading = fix.heading + last[3]
            north = last[1] + 0.02 * radar.speed * math.sin(heading)
            east = last[2] + 0.02 * radar.speed * math.cos(heading)
            turned = last[3] + 0.02 * float(getattr(radar, "yaw_rate", 0.0))
        self._last = (fix, north, east, turned)
        latitude = fix.latitude + north / 6_371_000.0
        longitude = fix.longitude + east / (6_371_000.0 * math.cos(fix.latitude))
        return replace(fix, latitude=latitude, longitude=longitude, heading=fix.heading + turned)


class SwapsRangeRate(Brain):
    """Takes a range rate for closing positive."""

    def range_rate(self, target: Target) -> float:
        """Return the wrong radial speed: closing positive [m/s]."""
        return -target.range_rate


class RangeRateInKmh(Brain):
    """Takes range rates for kilometres an hour."""

    def range_rate(self, target: Target) -> float:
        """Return the wrong radial speed: 3.6 times too large [m/s]."""
        return 3.6 * target.range_rate


class MirrorsAzimuth(Brain):
    """Takes an azimuth for right positive."""

    def azimuth(self, target: Target) -> float:
        """Return the wrong direction [rad], right positive."""
        return -target.azimuth


class AzimuthInDegrees(Brain):
    """Takes azimuths for degrees."""

    def azimuth(self, target: Target) -> float:
        """Return the wrong direction: 57 times too small [rad]."""
        return math.radians(target.azimuth)


class SteersBackwards(Brain):
    """Steers with the wrong sign."""

    def answer(self, fix: Fix, radar: Seen) -> tuple[float, float]:
        """Return the steering, right positive, and the acceleration."""
        steering, acceleration = super().answer(fix, radar)
        return -steering, acceleration


class SteersInDegrees(Brain):
    """Asks for steering in degrees."""

    def answer(self, fix: Fix, radar: Seen) -> tuple[float, float]:
        """Return the steering [deg], and the acceleration."""
        steering, acceleration = super().answer(fix, radar)
        return math.degrees(steering), acceleration


class AcceleratesInG(Brain):
    """Asks for acceleration in multiples of gravity."""

    def answer(self, fix: Fix, radar: Seen) -> tuple[float, float]:
        """Return the steering, and the acceleration [g]."""
        steering, acceleration = super().answer(fix, radar)
        return steering, acceleration / 9.81


class AcceleratesBackwards(Brain):
    """Asks for acceleration with the wrong sign."""

    def answer(self, fix: Fix, radar: Seen) -> tuple[float, float]:
        """Return the steering, and the acceleration, braking positive."""
        steering, acceleration = super().answer(fix, radar)
        return steering, -acceleration


class ReactsLate(Brain):
    """Asks for the acceleration of half a second ago."""

    def __init__(self, waypoints: list[tuple[float, float]], speed: float) -> None:
        super().__init__(waypoints, speed)
        self._asked: deque[float] = deque(maxlen=DELAY + 1)

    def answer(self, fix: Fix, radar: Seen) -> tuple[float, float]:
        """Return the steering, and an old acceleration."""
        steering, acceleration = super().answer(fix, radar)
        self._asked.append(acceleration)
        return steering, self._asked[0]


class LivesTooLong(Answers):
    """Asks for setpoints that live for a second."""

    lifetime = 1.0


BUGS: Mapping[str, type[Brain]] = {
    "acts_on_invalid": ActsOnInvalid,
    "ignores_age": IgnoresAge,
    "ignores_sequence": IgnoresSequence,
    "ignores_delay": IgnoresDelay,
    "drives_on_dead_gnss": DrivesOnDeadGnss,
    "swaps_range_rate": SwapsRangeRate,
    "range_rate_in_kmh": RangeRateInKmh,
    "mirrors_azimuth": MirrorsAzimuth,
    "azimuth_in_degrees": AzimuthInDegrees,
    "steers_backwards": SteersBackwards,
    "steers_in_degrees": SteersInDegrees,
    "accelerates_in_g": AcceleratesInG,
    "accelerates_backwards": AcceleratesBackwards,
    "reacts_late": ReactsLate,
    "lives_too_long": Brain,
}


def answers_of(bug: str, brain: Brain, key: bytes = b"") -> Answers:
    """Return what answers by the radar datagram, for a brain with a bug."""
    kind = LivesTooLong if bug == "lives_too_long" else Answers
    return kind(brain, lambda _fix, radar: radar, key)


def main() -> None:
    """Answer until interrupted."""
    if len(sys.argv) < 2 or sys.argv[1] not in BUGS:
        raise SystemExit(f"expected a bug: {', '.join(BUGS)}")
    bug = sys.argv.pop(1)
    given = arguments(__doc__).parse_args()
    brain = BUGS[bug](waypoints(given.waypoints), given.speed)
    answer(answers_of(bug, brain, given.key), given.gnss, given.radar, given.setpoints)


if __name__ == "__main__":
    main()
