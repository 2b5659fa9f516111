"""Keeps the states of the signals over a drive, change by change. Knows neither the ego nor traffic."""

from __future__ import annotations

from typing import Final

import libsumo

from vve_sumo.intersections import SignalPhase
from vve_sumo.values import SignalChange

#: SUMO's type of a program whose phases have fixed durations
FIXED_TIME: Final = 0
#: digits of a time [s]: SUMO counts milliseconds
DIGITS: Final = 3


class SignalStates:
    """All signals of the network that SUMO runs."""

    def __init__(self) -> None:
        self._names: tuple[str, ...] = tuple(libsumo.trafficlight.getIDList())
        self.states: dict[str, str] = {}  #: by name, a letter for each of its links
        #: in the order of their times; the first of each is its state at first; where `timed`, also changes of plan
        self.changes: list[SignalChange] = []
        self.timed = False  #: whether it is looked how long they show it, and what comes then
        self._newest: dict[str, SignalChange] = {}

    def update(self, time: float) -> None:
        """Note what the signals show at a drive time [s]; raises SUMO's errors."""
        state_of, states = libsumo.trafficlight.getRedYellowGreenState, self.states
        # A step shows what was switched at its beginning.
        begun = libsumo.simulation.getTime() - libsumo.simulation.getDeltaT() - time
        for name in self._names:
            state = state_of(name)
            end = round(libsumo.trafficlight.getNextSwitch(name) - begun, DIGITS) if self.timed else 0.0
            newest = self._newest.get(name)
            if newest is not None and (newest.state, newest.end) == (state, end):
                continue
            coming = _coming(name) if self.timed else ()
            states[name] = state
            self._newest[name] = SignalChange(time, name, state, end, coming)
            self.changes.append(self._newest[name])

    def phases(self, now: float) -> dict[str, SignalPhase]:
        """Return what the signals show, and how long at least from drive time `now` [s] on, 0 s where not `timed`."""
        return {name: change.phase(now) for name, change in self._newest.items()}


def _coming(name: str) -> tuple[tuple[str, float], ...]:
    """Return what a signal shows after its phase, and how long at least: once around, up to a phase that may vary."""
    lights = libsumo.trafficlight
    program = lights.getProgram(name)
    logic = next((one for one in lights.getAllProgramLogics(name) if one.programID == program), None)
    if logic is None:
        return ()
    found, at = [], lights.getPhase(name)
    for _ in range(len(logic.phases)):
        following = logic.phases[at].next
        at = following[0] if following else (at + 1) % len(logic.phases)
        phase = logic.phases[at]
        fixed = logic.type == FIXED_TIME or phase.minDur == phase.maxDur
        found.append((phase.state, phase.duration if fixed else phase.minDur))
        if not fixed:
            break
    return tuple(found)
