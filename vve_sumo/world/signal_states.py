"""Keeps the states of the signals over a drive, change by change. Knows neither the ego nor traffic."""

from __future__ import annotations

import libsumo

from vve_sumo.intersections import SignalPhase
from vve_sumo.values import SignalChange


class SignalStates:
    """All signals of the network that SUMO runs."""

    def __init__(self) -> None:
        self._names: tuple[str, ...] = tuple(libsumo.trafficlight.getIDList())
        self.shown: dict[str, str] = {}  #: by name, a letter for each of its links
        self.changes: list[SignalChange] = []  #: in the order of their times; the first of each is its state at first
        self.timed = False  #: whether it is looked how long they show it
        self._ends = dict.fromkeys(self._names, 0.0)  # drive times [s]

    def look(self, time: float) -> None:
        """Note what the signals show at a drive time [s]; raises SUMO's errors."""
        state_of, shown = libsumo.trafficlight.getRedYellowGreenState, self.shown
        for name in self._names:
            state = state_of(name)
            if state != shown.get(name):
                shown[name] = state
                self.changes.append(SignalChange(time, name, state))
        if self.timed:
            # A step shows what was switched at its beginning.
            begun = libsumo.simulation.getTime() - libsumo.simulation.getDeltaT() - time
            switch_of = libsumo.trafficlight.getNextSwitch
            self._ends = {name: switch_of(name) - begun for name in self._names}

    def phases(self, now: float) -> dict[str, SignalPhase]:
        """Return what the signals show, and how long at least from drive time `now` [s] on, 0 s where not `timed`."""
        return {name: SignalPhase(state, max(self._ends[name] - now, 0.0)) for name, state in self.shown.items()}
