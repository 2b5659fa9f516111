"""A phone that reports a known walk with the errors of a real one, from a random number generator of its own.

The errors of a phone's position hold for a while (multipath, the ionosphere): a first-order Gauss-Markov process on
each axis beside a small white one. Positions come about once a second, some late. Knows no network.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from vve_sumo.frames import MapFrame
from vve_sumo.people.reports import PositionReport
from vve_sumo.people.track import CIRCLE_95
from vve_sumo.people.walk import Walk

#: For how long a phone's error holds [s], an assumption: multipath of somebody who walks changes within a minute.
ERROR_TIME: Final = 30.0
#: Share of the error's variance that is white, an assumption.
WHITE_SHARE: Final = 0.1
#: Of the time between two positions and of their way to this machine [s]: what varies evenly, assumptions.
PERIOD_JITTER: Final = 0.1
MIN_DELAY, MAX_DELAY = 0.1, 0.4  # [s]
#: A compass in a hand, 1 sigma [rad]; an assumption.
COMPASS_SIGMA: Final = math.radians(15.0)


@dataclass(frozen=True, slots=True)
class PhoneErrors:
    """How good a phone's positions are."""

    accuracy: float  #: radius that holds the true place with 95 %, as the phone reports it, too [m]
    period: float  #: mean time between two positions [s]


class SimulatedPhone:
    """A stream of reports."""

    def __init__(
        self, person: str, walk: Walk, frame: MapFrame, errors: PhoneErrors, seeds: np.random.SeedSequence
    ) -> None:
        """`frame` is the field's map; the first position is measured at drive time 0 or soon after."""
        self._person, self._walk, self._frame, self._errors = person, walk, frame, errors
        self._random = np.random.Generator(np.random.PCG64(seeds))
        variance = (errors.accuracy / CIRCLE_95) ** 2
        self._white, self._slow = math.sqrt(WHITE_SHARE * variance), math.sqrt((1.0 - WHITE_SHARE) * variance)
        self._error_x, self._error_y = self._slow * self._normal(), self._slow * self._normal()
        self._next = errors.period * self._random.random()
        self._before = self._next
        self._on_the_way: list[tuple[float, PositionReport]] = []

    def until(self, now: float) -> list[tuple[float, PositionReport]]:
        """Return the reports that arrive up to drive time `now` [s], each with its time of arrival, in that order."""
        while self._next <= now:
            self._measure(self._next)
            self._next += self._errors.period + PERIOD_JITTER * (2.0 * self._random.random() - 1.0)
        arrived = sorted((one for one in self._on_the_way if one[0] <= now), key=lambda one: (one[0], one[1].measured))
        self._on_the_way = [one for one in self._on_the_way if one[0] > now]
        return arrived

    def _measure(self, time: float) -> None:
        keep = math.exp(-(time - self._before) / ERROR_TIME)
        drive = self._slow * math.sqrt(1.0 - keep * keep)
        self._error_x = keep * self._error_x + drive * self._normal()
        self._error_y = keep * self._error_y + drive * self._normal()
        self._before = time
        pose = self._walk.at(time)
        x, y = (
            pose.x + self._error_x + self._white * self._normal(),
            pose.y + self._error_y + self._white * self._normal(),
        )
        latitude, longitude = self._frame.to_geodetic(x, y)
        heading = pose.heading - self._frame.convergence(latitude, longitude) + COMPASS_SIGMA * self._normal()
        report = PositionReport(
            self._person, time, latitude, longitude, self._errors.accuracy, math.remainder(heading, math.tau)
        )
        delay = MIN_DELAY + (MAX_DELAY - MIN_DELAY) * self._random.random()
        self._on_the_way.append((time + delay, report))

    def _normal(self) -> float:
        return float(self._random.standard_normal())
