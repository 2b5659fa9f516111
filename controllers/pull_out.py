"""Lays the first part of a way out for a car at rest close behind what stands in its path: near full lock, at a crawl.

The car turns to one side, goes on straight, and turns back until it goes along the path again. Its body is taken as it
is turned: a planner of lateral offsets takes it for nearly parallel to the path, and needs twice the room.
It must not know when the car sets out, nor how the way goes on.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.path import swept_half_widths
from vve_sumo.values import Vehicle

from .free_space import hidden_length
from .lateral_plan import CURVATURE_SHARE, TURNING_SHARE
from .outlines import Body

CRAWLS: Final = (3.0, 2.0, 1.5)  #: speeds of the car on it, tried one after the other [m/s]
STEP: Final = 0.25  #: between the places of the rear axle that are computed [m]
LOOKS_EVERY: Final = 2  #: of these the car's body is looked at
REACH: Final = 25.0  #: way ahead that is looked at [m]
TURNS: Final = np.arange(1.0, 12.1, 0.5)  #: ways of the first turn that are tried [m]
ASIDES: Final = 3  #: distances from the path to which it may lead, from the least to the greatest
SWINGS: Final = 0.2  #: so much nearer than at the start the car's rear may swing to who stands beside it [m]
CLOSEST: Final = 0.3  #: and never nearer to anybody than this [m]
ROUNDED: Final = 0.05  #: and what STEP makes of distances [m]
SHALLOW: Final = 0.02  #: a car that is turned by less does not come aside [rad]


class Start(NamedTuple):
    """Where the car stands."""

    s: float  #: of the rear axle along the path [m]
    d: float  #: of the rear axle, left positive [m]
    heading_error: float  #: heading of the car less that of the path [rad]
    curvature: float  #: of the path there [1/m]


class WayOut(NamedTuple):
    """The first part of a way out, at places that are STEP apart along it; beyond its end it goes on along the path."""

    start: Start
    s: np.ndarray  #: of the rear axle [m]
    d: np.ndarray  #: [m]
    ends: float  #: s from which on the car goes along the path [m]

    def d_at(self, s: float) -> float:
        """Return d at an s [m]; behind the car, on the straight line through it."""
        if s < self.start.s:
            return self.start.d + math.tan(self.start.heading_error) * (s - self.start.s)
        return float(np.interp(s, self.s, self.d))


def way_out(
    vehicle: Vehicle, start: Start, past: Iterable[Body], standing: Iterable[Body], *,
    left: bool, speed: float, clearance: float, aside: float,
) -> WayOut | None:  # fmt: skip
    """Return the way out past bodies on one side that leads least far from the path, None where there is none.

    The car's body keeps `clearance` [m] from each of the bodies that are `standing`, or SWINGS less than it has from it
    at the start. The rear axle goes no farther than `aside` from its path [m]. The slower the car's `speed` [m/s], the
    less way it takes to turn the steering wheel.
    """
    reach_left, reach_right = swept_half_widths(start.curvature, vehicle.rear_axle_to_bumper, vehicle.width)
    if left:
        least = max(float(body.d.max()) for body in past) + float(reach_right) + clearance
    else:
        least = -min(float(body.d.min()) for body in past) + float(reach_left) + clearance
    if least > aside:
        return None
    turns = _Turns.of(vehicle, start, np.repeat(TURNS, ASIDES), 1.0 if left else -1.0, speed)
    turns = turns.leading_to(start, np.tile(np.linspace(least, aside, ASIDES), len(TURNS)))
    if not len(turns.out):
        return None
    s, d, heading = turns.places(start)
    clear = np.abs(d[-1]) < aside + ROUNDED
    looked_at = slice(None, None, LOOKS_EVERY)
    for body in standing:
        if not _is_far(vehicle, start, s, d, body, clearance):  # a NaN is nowhere far
            away = _distances(vehicle, s[looked_at], d[looked_at], heading[looked_at], start.curvature, body)
            clear &= away.min(axis=0) >= np.minimum(clearance - ROUNDED, np.maximum(away[0] - SWINGS, CLOSEST))
    if not clear.any():
        return None
    best = int(np.where(clear, np.abs(d[-1]), math.inf).argmin())
    end = min(math.ceil(float(turns.length[best]) / STEP), len(s) - 1)
    return WayOut(start, s[:, best], d[:, best], float(s[end, best]))


class _Turns(NamedTuple):
    """Ways of a turn out, a straight piece and a turn back, one each: shape (ways,).

    The steering wheel turns as fast as it may, so that the curvature along a turn is a trapezium or triangle. The turn
    back ends along the path.
    """

    side: float  #: 1 to the left, -1 to the right
    change: float  #: of curvature along a way [1/m2]
    out: np.ndarray  #: length of the turn out [m]
    peak: np.ndarray  #: its greatest curvature beyond that of the path [1/m]
    straight: np.ndarray  #: length of the straight piece [m]
    back: np.ndarray  #: length of the turn back [m]
    back_peak: np.ndarray  #: as peak

    @classmethod
    def of(cls, vehicle: Vehicle, start: Start, out: np.ndarray, side: float, speed: float) -> _Turns:
        """Return ways whose turns out have lengths [m], without straight pieces."""
        most = max(CURVATURE_SHARE * vehicle.tightest_curvature - abs(start.curvature), 1e-3)
        change = TURNING_SHARE * vehicle.steering_rate_limit / vehicle.wheelbase / speed
        peak = np.minimum(most, 0.5 * change * out)
        turned = (peak * (out - peak / change) + side * start.heading_error).clip(min=SHALLOW)
        back_peak = np.minimum(most, np.sqrt(turned * change))
        return cls(side, change, out, peak, np.zeros_like(out), turned / back_peak + back_peak / change, back_peak)

    @property
    def length(self) -> np.ndarray:
        """The ways' lengths [m]."""
        total: np.ndarray = self.out + self.straight + self.back
        return total

    def leading_to(self, start: Start, aside: np.ndarray) -> _Turns:
        """Return those that lead as far aside as `aside` [m], by straight pieces of some length."""
        _s, d, heading = self.places(start)
        missing = aside - self.side * d[-1]
        steepest = np.sin((self.side * heading).max(axis=0)).clip(min=SHALLOW)
        chosen = self._replace(straight=missing / steepest)
        kept = (missing >= 0.0) & (chosen.length <= REACH)
        return _Turns(self.side, self.change, *(column[kept] for column in chosen[2:]))

    def places(self, start: Start) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return s [m], d [m] and the heading against the path [rad] along the ways, shape (places, ways)."""
        along = STEP * np.arange(round(REACH / STEP) + 1)[:, None]
        since = along - self.out - self.straight
        curvature = self.side * (self._turn(along, self.out, self.peak) - self._turn(since, self.back, self.back_peak))
        heading = start.heading_error + _summed(curvature)
        d = start.d + _summed(np.sin(heading))
        s = start.s + _summed(np.cos(heading) / (1.0 - start.curvature * d))
        return s, d, heading

    def _turn(self, along: np.ndarray, length: np.ndarray, peak: np.ndarray) -> np.ndarray:
        curvature: np.ndarray = np.minimum(np.minimum(along, length - along) * self.change, peak).clip(min=0.0)
        return curvature


def _is_far(vehicle: Vehicle, start: Start, s: np.ndarray, d: np.ndarray, body: Body, clearance: float) -> bool:
    """Tell whether a body surely stays beyond the clearance: it is behind the car, or out of its reach."""
    reach = math.hypot(vehicle.rear_axle_to_bumper, 0.5 * vehicle.width) + clearance
    behind = float(body.s.max()) + hidden_length(body) < start.s - vehicle.rear_overhang - clearance
    aside = float(body.d.min()) > float(d.max()) + reach or float(body.d.max()) < float(d.min()) - reach
    return behind or aside or float(body.s.min()) > float(s.max()) + reach


def _summed(values: np.ndarray) -> np.ndarray:
    """Return the integrals of columns over the way, from 0 on, by trapezia."""
    pieces = 0.5 * STEP * (values[1:] + values[:-1])
    return np.concatenate((np.zeros((1, values.shape[1])), np.cumsum(pieces, axis=0)))


def _distances(
    vehicle: Vehicle, s: np.ndarray, d: np.ndarray, heading: np.ndarray, bend: float, body: Body
) -> np.ndarray:
    """Return how far the car's body is from the rectangle along the path that encloses another one [m].

    What is hidden of that may reach farther along. Two rectangles are nearest to each other at a corner of one of them.
    """
    near, far = float(body.s.min()), float(body.s.max()) + hidden_length(body)
    right, left = float(body.d.min()), float(body.d.max())
    front, rear, half = vehicle.rear_axle_to_bumper, -vehicle.rear_overhang, 0.5 * vehicle.width
    cos, sin = np.cos(heading), np.sin(heading)
    least = np.full(s.shape, math.inf)
    for place_s, place_d in ((near, right), (near, left), (far, right), (far, left)):
        along = (place_s - s) * (1.0 - bend * d)
        across = place_d - d + 0.5 * bend * along * along
        ahead, beside = cos * along + sin * across, cos * across - sin * along
        least = np.minimum(least, np.hypot(_beyond(ahead, rear, front), _beyond(beside, -half, half)))
    for ahead_of, beside_of in ((front, half), (front, -half), (rear, half), (rear, -half)):
        along, across = cos * ahead_of - sin * beside_of, sin * ahead_of + cos * beside_of
        place_s = s + along / (1.0 - bend * d)
        place_d = d + across - 0.5 * bend * along * along
        least = np.minimum(least, np.hypot(_beyond(place_s, near, far), _beyond(place_d, right, left)))
    return least


def _beyond(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return by how much values lie outside an interval, 0 within it."""
    outside: np.ndarray = np.maximum(np.maximum(low - values, values - high), 0.0)
    return outside
