"""When a receiver's fixes arrive, and when it has lost the fixed ambiguities of its carrier phases.

Times only; the module knows no fix and no packet.
"""

from __future__ import annotations

import numpy as np

from vve_sumo.vehicle.model import Imperfections


class Bursts:
    """A link that holds fixes back and lets them through together.

    The times between bursts have the distribution of `Imperfections.receiver_gap_min`, whose quantiles are those of a
    recorded stream: fixes that arrive with the one before, 95 % quantile and longest time.
    """

    def __init__(self, imperfections: Imperfections, seeds: np.random.SeedSequence, begin: float = 0.0) -> None:
        """The first burst comes soon after the time `begin` [s]."""
        self._random = np.random.Generator(np.random.PCG64(seeds))
        self._shortest, self._late = imperfections.receiver_gap_min, imperfections.receiver_gap_p95
        self._longest = imperfections.receiver_gap_max
        self._share_beyond = 0.05 / (1.0 - imperfections.receiver_short_gaps)
        self._next = begin + self._random.uniform(0.0, self._longest)

    def arrival(self, ready: float) -> float:
        """Return when a fix arrives that is ready at a time [s], not earlier than that of the call before."""
        while self._next < ready:
            beyond = self._random.random() < self._share_beyond
            bounds = (self._late, self._longest) if beyond else (self._shortest, self._late)
            self._next += self._random.uniform(*bounds)
        return self._next


class FloatSpells:
    """Spells in which the position is a float solution; they begin and end independently of everything else."""

    def __init__(self, imperfections: Imperfections, seeds: np.random.SeedSequence, begin: float = 0.0) -> None:
        """The ambiguities are fixed at the time `begin` [s]."""
        self._random = np.random.Generator(np.random.PCG64(seeds))
        self._every, self._time = imperfections.receiver_float_every, imperfections.receiver_float_time
        self._sigma = imperfections.receiver_float_sigma
        self._offset: tuple[float, float] | None = None
        self._until = begin + self._random.exponential(self._every)

    def offset(self, time: float) -> tuple[float, float] | None:
        """Return the error of the position, north and east [m], at a time [s]; None while the ambiguities are fixed.

        Times must not decrease from call to call.
        """
        while self._until <= time:
            fixed = self._offset is not None
            self._offset = None if fixed else self._drawn()
            self._until += self._random.exponential(self._every if fixed else self._time)
        return self._offset

    def _drawn(self) -> tuple[float, float]:
        north, east = (self._sigma * self._random.standard_normal(2)).tolist()
        return north, east
