"""Behaviours of a brain that a safety layer must survive: legal but nasty commands, illegal ones, lost setpoints.

A brain behaves as the scenario's controller until a behaviour is due. Knows no gateway and no car.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from vve_sumo.controller import Controller
from vve_sumo.values import ControlCommand, Observation, Setpoint

#: half a cycle of a behaviour that changes sides [s]
HALF_CYCLE: Final = 0.5
#: road-wheel angle that a nasty brain asks for [rad]; the gateway's limits cut it down
FULL_STEERING: Final = 0.6
#: accelerations that a nasty brain asks for [m/s2]; the gateway's limits cut them down
FULL_THROTTLE, FULL_BRAKING = 10.0, -10.0
#: a number that no car can follow
HUGE: Final = 1e30

#: Behaviour to plain words.
BEHAVIOURS: Final[dict[str, str]] = {
    "brain_full_throttle": "asks for full throttle for ever, and steers as before",
    "brain_full_braking": "asks for full emergency braking",
    "brain_flapping": "full throttle and full emergency braking in turn, every 0.5 s",
    "brain_bang_bang": "steers fully left and fully right in turn, every 0.5 s",
    "brain_astray": "steers fully left for ever",
    "brain_nan": "asks for an acceleration that is not a number",
    "brain_raises": "raises an exception",
    "brain_huge": "asks for numbers that no car can follow",
    "brain_silent": "sends no setpoint",
    "brain_stale": "sends its last setpoint again and again",
    "brain_faults": "sends setpoints with a fault",
    "brain_setpoint_nan": "sends setpoints that are not numbers, past all checks before the gateway",
    "brain_future": "sends setpoints that are dated 1 s ahead",
}


class Behaviour(NamedTuple):
    """A behaviour and when it is due, drive times [s]."""

    kind: str
    begin: float
    end: float


def _right_now(time: float) -> bool:
    """Whether a behaviour that changes sides is on its first side."""
    return math.floor(time / HALF_CYCLE) % 2 == 0


def _raise(_own: ControlCommand, _time: float) -> ControlCommand:
    raise RuntimeError("the brain fails")


def _flap(own: ControlCommand, time: float) -> ControlCommand:
    if _right_now(time):
        return replace(own, acceleration=FULL_THROTTLE, emergency=False)
    return replace(own, acceleration=FULL_BRAKING, emergency=True)


_COMMANDS: Final[dict[str, Callable[[ControlCommand, float], ControlCommand]]] = {
    "brain_full_throttle": lambda own, time: replace(own, acceleration=FULL_THROTTLE, emergency=False),
    "brain_full_braking": lambda own, time: replace(own, acceleration=FULL_BRAKING, emergency=True),
    "brain_flapping": _flap,
    "brain_bang_bang": lambda own, time: replace(own, steering=FULL_STEERING if _right_now(time) else -FULL_STEERING),
    "brain_astray": lambda own, time: replace(own, steering=FULL_STEERING),
    "brain_nan": lambda own, time: replace(own, acceleration=math.nan),
    "brain_raises": _raise,
    "brain_huge": lambda own, time: replace(own, acceleration=HUGE, steering=-HUGE),
}
_SETPOINTS: Final[dict[str, Callable[[Setpoint, Setpoint | None], Setpoint | None]]] = {
    "brain_silent": lambda own, last: None,
    "brain_stale": lambda own, last: last,
    "brain_faults": lambda own, last: replace(own, faults=(*own.faults, "brain_fault")),
    "brain_setpoint_nan": lambda own, last: replace(own, acceleration=math.nan, steering=math.nan),
    "brain_future": lambda own, last: replace(own, time=own.time + 1.0, expires=own.expires + 1.0),
}


class TurningBrain:
    """A controller that behaves as another one until a behaviour is due."""

    def __init__(self, own: Controller) -> None:
        self._own = own
        self.behaviours: Sequence[Behaviour] = ()
        self._last: Setpoint | None = None

    def step(self, observation: Observation) -> ControlCommand:
        """Return the controller's command, or what a behaviour makes of it."""
        command = self._own.step(observation)
        for behaviour in self._due(observation.time):
            if (change := _COMMANDS.get(behaviour.kind)) is not None:
                command = change(command, observation.time - behaviour.begin)
        return command

    def sent(self, now: float, setpoint: Setpoint | None) -> Setpoint | None:
        """Return what reaches the gateway in place of a tick's setpoint."""
        altered = setpoint
        for behaviour in self._due(now):
            if altered is not None and (change := _SETPOINTS.get(behaviour.kind)) is not None:
                altered = change(altered, self._last)
        if altered is not None and altered is setpoint:
            self._last = setpoint
        return altered

    def _due(self, time: float) -> list[Behaviour]:
        return [one for one in self.behaviours if one.begin <= time < one.end]
