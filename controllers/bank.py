"""A place across the path and the speed of it, as a bank of Kalman filters: one for each speed that it may have.

An interacting multiple model (Blom and Bar-Shalom, *IEEE Transactions on Automatic Control* 33, 780, 1988). One
Gaussian cannot say "it stays, or else it comes": a pedestrian at the kerb and a car in the next lane mostly do one of
the two, and the one that sets out is told from the one that stays by where it was. The bank must not know the path's
band, nor what is done about the target.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.values import Floats

LONGEST_STEP: Final = 0.1  #: changes of speed are counted on for at most so long between two scans [s]
LEAST_PROBABILITY: Final = 1e-12  #: no speed becomes less probable than this: each can come back
NEGLIGIBLE: Final = 1e-4  #: a speed less probable than this adds nothing to what is foreseen


class Habits(NamedTuple):
    """How a kind of road user moves across the path. The figures are assumptions; the tests show what they lead to."""

    spacing: float  #: of the speeds [m/s]
    fastest: float  #: [m/s]
    usual: float  #: speed of one that moves [m/s]
    spread: float  #: its standard deviation [m/s]
    others: float  #: probability of a speed far from the usual one, as a share of that one's
    stays: float  #: probability that one stays that is seen for the first time
    sets_out: float  #: rate with which one that stays sets out [1/s]
    stops: float  #: rate with which one that moves at the usual speed stops [1/s]
    changes: float  #: rate with which one that moves becomes faster or slower by `spacing` [1/s]
    drift: float  #: of the place of one that moves [m2/s]
    sways: float  #: of the place of one that stays [m2/s]


#: people on foot and on bicycles
WALKERS = Habits(0.5, 5.0, 1.4, 0.6, 0.08, 0.8, 0.2, 1.0, 1.5, 0.02, 0.02)
#: cars that go along
LANE_CHANGERS = Habits(0.4, 2.8, 1.2, 0.5, 0.02, 0.8, 0.3, 0.5, 2.0, 0.02, 0.01)


class _Table:
    """What the habits say: the speeds [m/s], how probable each is at first, rates of change [1/s], and drifts [m2/s].

    Computed by `math`: numpy's exponentials differ in their last bits between processors.
    """

    def __init__(self, habits: Habits) -> None:
        still = round(habits.fastest / habits.spacing)  # index of speed 0
        speeds = [habits.spacing * step for step in range(-still, still + 1)]
        moving = [
            math.exp(-0.5 * ((abs(speed) - habits.usual) / habits.spread) ** 2) + habits.others if speed else 0.0
            for speed in speeds
        ]
        sets_out = [share * math.exp(-abs(speed)) for share, speed in zip(moving, speeds, strict=True)]
        self.speeds: Floats = np.array(speeds)
        self.first: Floats = (1.0 - habits.stays) * np.array(moving) / math.fsum(moving)
        self.first[still] = habits.stays
        changes = np.zeros((len(speeds), len(speeds)))  # to the speed of a row, from that of a column
        for low in range(len(speeds) - 1):
            if still not in (low, low + 1):
                # In balance with what is probable at first.
                more = math.sqrt(self.first[low + 1] / self.first[low])
                changes[low + 1, low], changes[low, low + 1] = habits.changes * more, habits.changes / more
        changes[:, still] = habits.sets_out * np.array(sets_out) / math.fsum(sets_out)
        changes[still] = [habits.stops * math.exp(1.0 - abs(speed) / habits.usual) for speed in speeds]
        np.fill_diagonal(changes, 0.0)
        np.fill_diagonal(changes, -changes.sum(axis=0))
        self.changes: Floats = changes
        self.drifts: Floats = np.full(len(speeds), habits.drift)
        self.drifts[still] = habits.sways


_table = cache(_Table)


class SpeedHypothesis(NamedTuple):
    """One filter of a bank: what holds if the target has its speed."""

    speed: float  #: across the path, left positive [m/s]
    probability: float  #: of this speed
    place: float  #: across the path, left positive [m]
    variance: float  #: of the place [m2]


class Bank:
    """How probable each of the speeds is, and where the target is then."""

    __slots__ = ("_table", "habits", "place", "probability", "variance")

    def __init__(self, place: float, variance: float, habits: Habits) -> None:
        """Begin at a place [m] with a variance [m2]."""
        self.habits, self._table = habits, _table(habits)
        self.probability: Floats = self._table.first.copy()
        self.place: Floats = np.full(self.probability.size, place)
        self.variance: Floats = np.full(self.probability.size, variance)

    @property
    def speeds(self) -> Floats:
        """Across the path, left positive [m/s]."""
        return self._table.speeds

    def modes(self) -> list[SpeedHypothesis]:
        """Return the filters whose speed is not negligibly improbable."""
        columns = (self.speeds, self.probability, self.place, self.variance)
        rows = zip(*(column.tolist() for column in columns), strict=True)
        return [mode for mode in map(SpeedHypothesis._make, rows) if mode.probability >= NEGLIGIBLE]

    def predict(self, dt: float, drift: float = 0.0) -> None:
        """Move on by a time [s]; `drift` of the place on top of what the habits have [m2/s]."""
        place, table = self.place, self._table
        moments = np.empty((3, place.size))
        moments[0] = self.probability
        moments[1] = self.probability * place
        moments[2] = self.probability * (self.variance + place * place)
        # Products summed, and no `@`: the order in which BLAS adds depends on the processor.
        moments += min(dt, LONGEST_STEP) * (table.changes * moments[:, None, :]).sum(axis=2)
        self.probability = moments[0]
        mean = moments[1] / self.probability
        self.variance = moments[2] / self.probability - mean * mean + (table.drifts + drift) * dt
        self.place = mean + dt * table.speeds

    def spread(self) -> tuple[float, float]:
        """Return mean [m] and variance [m2] of the place, whatever the speed."""
        mean = float((self.probability * self.place).sum())
        away = self.place - mean
        return mean, float((self.probability * (self.variance + away * away)).sum())

    def update(self, place: float, variance: float) -> None:
        """Take a measurement of the place [m] with its variance [m2] in."""
        total, error = self.variance + variance, place - self.place
        fit = np.array([math.exp(-0.5 * squares) for squares in (error * error / total).tolist()]) / np.sqrt(total)
        probability = self.probability * fit + LEAST_PROBABILITY
        self.probability = probability / probability.sum()
        gain = self.variance / total
        self.place = self.place + gain * error
        self.variance = self.variance * (1.0 - gain)
