"""Keeps the states of the signals over a drive, change by change. Knows neither the ego nor traffic."""

from __future__ import annotations

import libsumo

from vve_sumo.values import SignalChange


class SignalStates:
    """All signals of the network that SUMO runs."""

    def __init__(self) -> None:
        self._names: tuple[str, ...] = tuple(libsumo.trafficlight.getIDList())
        self.shown: dict[str, str] = {}  #: by name, a letter for each of its links
        self.changes: list[SignalChange] = []  #: in the order of their times; the first of each is its state at first

    def look(self, time: float) -> None:
        """Note what the signals show at a drive time [s]; raises SUMO's errors."""
        state_of, shown = libsumo.trafficlight.getRedYellowGreenState, self.shown
        for name in self._names:
            state = state_of(name)
            if state != shown.get(name):
                shown[name] = state
                self.changes.append(SignalChange(time, name, state))
