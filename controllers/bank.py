"""A place across the path and the speed of it, as a bank of Kalman filters: one for each speed that it may have.

An interacting multiple model (Blom and Bar-Shalom, 1988). One Gaussian cannot say "it stays, or else it comes": a
pedestrian at the kerb and a car in the next lane mostly do one of the two, and who sets out is told from who stays by
where it was. It must not know the path's band, nor what is done about who comes.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from vve_sumo.values import Floats

LONGEST_STEP = 0.1  #: farther than that the rates of change are not counted on [s]
LEAST = 1e-12  #: no speed becomes less likely than this: each can come back


class Habits(NamedTuple):
    """How a kind of road user moves across the path."""

    spacing: float  #: of the speeds [m/s]
    fastest: float  #: [m/s]
    usual: float  #: speed of who moves [m/s]
    spread: float  #: its standard deviation [m/s]
    others: float  #: how likely a speed far from the usual one is, against that one
    stays: float  #: how likely one stays that is seen for the first time
    sets_out: float  #: rate with which one who stays sets out [1/s]
    stops: float  #: rate with which one who moves at the usual speed stops [1/s]
    changes: float  #: rate with which one who moves becomes faster or slower by `spacing` [1/s]
    drift: float  #: of the place of who moves [m2/s]
    sways: float  #: of the place of who stays [m2/s]


WALKERS = Habits(0.5, 5.0, 1.4, 0.6, 0.08, 0.8, 0.2, 1.0, 1.5, 0.02, 0.02)  #: who is on foot or on a bicycle
LANE_CHANGERS = Habits(0.4, 2.8, 1.2, 0.5, 0.02, 0.8, 0.3, 0.5, 2.0, 0.02, 0.01)  #: cars that go along


class _Table:
    """What the habits say: the speeds [m/s], how likely each is at first, rates of change, and drifts."""

    def __init__(self, habits: Habits) -> None:
        count = round(habits.fastest / habits.spacing)
        self.speeds: Floats = np.linspace(-habits.fastest, habits.fastest, 2 * count + 1)
        pace = np.abs(self.speeds)
        moving = np.exp(-0.5 * ((pace - habits.usual) / habits.spread) ** 2) + habits.others
        moving[count] = 0.0
        self.first: Floats = (1.0 - habits.stays) * moving / moving.sum()
        self.first[count] = habits.stays
        rates = np.zeros((pace.size, pace.size))
        for low in range(pace.size - 1):
            if count not in (low, low + 1):
                more = math.sqrt(self.first[low + 1] / self.first[low])
                rates[low, low + 1], rates[low + 1, low] = habits.changes * more, habits.changes / more
        sets_out = moving * np.exp(-pace)
        rates[count] = habits.sets_out * sets_out / sets_out.sum()
        rates[:, count] = habits.stops * np.exp(1.0 - pace / habits.usual)
        np.fill_diagonal(rates, 0.0)
        np.fill_diagonal(rates, -rates.sum(axis=1))
        self.changes: Floats = rates.T.copy()
        self.drifts: Floats = np.full(pace.size, habits.drift)
        self.drifts[count] = habits.sways


_table = cache(_Table)


class Bank:
    """How likely each of the speeds is, and where it is then."""

    __slots__ = ("_table", "habits", "likely", "place", "variance")

    def __init__(self, place: float, variance: float, habits: Habits) -> None:
        """Begin at a place [m] with a variance [m2]."""
        self.habits, self._table = habits, _table(habits)
        self.likely: Floats = self._table.first.copy()
        self.place: Floats = np.full(self.likely.size, place)
        self.variance: Floats = np.full(self.likely.size, variance)

    @property
    def speeds(self) -> Floats:
        """Across the path, left positive [m/s]."""
        return self._table.speeds

    def predict(self, dt: float) -> None:
        """Move on by a time [s]."""
        place, table, likely = self.place, self._table, self.likely
        columns = np.stack((likely, likely * place, likely * (self.variance + place * place)), axis=1)
        columns += min(dt, LONGEST_STEP) * (table.changes @ columns)
        self.likely = likely = columns[:, 0]
        mean = columns[:, 1] / likely
        self.variance = columns[:, 2] / likely - mean * mean + table.drifts * dt
        self.place = mean + dt * table.speeds

    def update(self, place: float, variance: float) -> None:
        """Take a measurement of the place in."""
        total, error = self.variance + variance, place - self.place
        likely = self.likely * np.exp(-0.5 * error * error / total) / np.sqrt(total) + LEAST
        self.likely = likely / likely.sum()
        gain = self.variance / total
        self.place = self.place + gain * error
        self.variance = self.variance * (1.0 - gain)
