"""A place across the path and the speed of it, as a bank of Kalman filters: one for each speed that it may have.

An interacting multiple model (Blom and Bar-Shalom, 1988). One Gaussian cannot say "it stands, or else it walks": a
pedestrian at the kerb is mostly one of the two, and who sets out is told from who stands by where it stood. It must not
know the path's band, nor what is done about who walks.
"""

from __future__ import annotations

import math

import numpy as np

from vve_sumo.values import Floats

SPACING, FASTEST = 0.5, 5.0  #: of the speeds [m/s]
WALKING, SPREAD = 1.4, 0.6  #: speed of who walks, its standard deviation over people [m/s]
RUNNERS = 0.08  #: how likely a speed far from walking is, against walking
STANDS = 0.6  #: how likely one stands that is seen for the first time
SETS_OUT, STOPS = 0.3, 1.0  #: rates with which one who stands sets out, and one who walks stops [1/s]
CHANGES = 1.5  #: rate with which one who walks becomes faster or slower by SPACING [1/s]
DRIFT = 0.02  #: of the place, at each of the speeds [m2/s]
LONGEST_STEP = 0.2  #: farther than that the rates of change are not counted on [s]

_COUNT = round(FASTEST / SPACING)
SPEEDS: Floats = np.linspace(-FASTEST, FASTEST, 2 * _COUNT + 1)  #: across the path, left positive [m/s]


def _usual() -> Floats:
    """Return how likely each speed is of one seen for the first time."""
    moving = np.exp(-0.5 * ((np.abs(SPEEDS) - WALKING) / SPREAD) ** 2) + RUNNERS
    moving[_COUNT] = 0.0
    usual: Floats = (1.0 - STANDS) * moving / moving.sum()
    usual[_COUNT] = STANDS
    return usual


def _changes(usual: Floats) -> Floats:
    """Return the rates of change between the speeds [1/s], from row to column; every row adds up to 0."""
    rates = np.zeros((SPEEDS.size, SPEEDS.size))
    for of, to in [(i, i + 1) for i in range(SPEEDS.size - 1)] + [(i + 1, i) for i in range(SPEEDS.size - 1)]:
        if _COUNT not in (of, to):
            rates[of, to] = CHANGES * math.sqrt(usual[to] / usual[of])
    sets_out = usual * np.exp(-np.abs(SPEEDS))
    sets_out[_COUNT] = 0.0
    rates[_COUNT] = SETS_OUT * sets_out / sets_out.sum()
    rates[:, _COUNT] = STOPS * np.exp(1.0 - np.abs(SPEEDS) / WALKING)
    np.fill_diagonal(rates, 0.0)
    np.fill_diagonal(rates, -rates.sum(axis=1))
    return rates


USUAL = _usual()
_FROM = _changes(USUAL).T.copy()


class Walk:
    """How likely each of SPEEDS is, and where it is then."""

    __slots__ = ("likely", "place", "variance")

    def __init__(self, place: float, variance: float) -> None:
        """Begin at a place [m] with a variance [m2]."""
        self.likely = USUAL.copy()
        self.place: Floats = np.full(SPEEDS.size, place)
        self.variance: Floats = np.full(SPEEDS.size, variance)

    def predict(self, dt: float) -> None:
        """Move on by a time [s]."""
        place, step = self.place, min(dt, LONGEST_STEP)
        columns = np.empty((SPEEDS.size, 3))
        columns[:, 0] = self.likely
        columns[:, 1] = self.likely * place
        columns[:, 2] = self.likely * (self.variance + place * place)
        columns += step * (_FROM @ columns)
        self.likely = columns[:, 0]
        mean = columns[:, 1] / self.likely
        self.place = mean + dt * SPEEDS
        self.variance = columns[:, 2] / self.likely - mean * mean + DRIFT * dt

    def update(self, place: float, variance: float) -> None:
        """Take a measurement of the place in."""
        total, error = self.variance + variance, place - self.place
        likely = self.likely * np.exp(-0.5 * error * error / total) / np.sqrt(total) + 1e-12
        self.likely = likely / likely.sum()
        gain = self.variance / total
        self.place = self.place + gain * error
        self.variance = self.variance * (1.0 - gain)

    def speed(self) -> float:
        """Return the speed to be expected [m/s]."""
        return float(self.likely @ SPEEDS)
