"""Finds a driver's foot in what the car does, where no module reports one: brake torque that nobody commanded.

The brake torque that the car reports is another sender's than the brake module's own report, so both must fail before a
foot goes unseen; what is left then is the car's motion (`slowing_monitor`). Decides nothing and commands nothing.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from vve_sumo.values import Vehicle
from vve_sumo.vehicle.setpoint_validation import Debounce

# Torque beyond what was commanded that is somebody's foot [N m], and the share of the commanded torque that a brake
# controller which is 10 % off may report beside it.
UNASKED_TORQUE: Final = 150.0
UNASKED_SHARE: Final = 0.15
UNASKED_TIME: Final = 0.03  # for which it lasts: two reports of 50 Hz [s]
# Fastest fall of a brake torque that is released [N m/s]: the simulated one takes 0.1 s from full, a real one longer.
RELEASE_RATE: Final = 8000.0
# From a command to the last report of the torque that it causes, before the torque's fall, beyond the brakes' declared
# delay and LAGS of their lags: the report's 20 ms, two steps, and a brake that is slower than declared [s].
REPORT_DELAY: Final = 0.15
LAGS: Final = 3.0

# A foot this strong for this long latches the override of a brake module: Dataspeed's takes 0.22 of the pedal's sensor,
# which is 517 N m, for 0.1 s. A weaker one is assumed, because a latched module brakes no more.
LATCH_TORQUE: Final = 450.0  # [N m]
LATCH_TIME: Final = 0.08  # [s]


class DriverBrakingDetector:
    """Compares the reported brake torque with the commanded one, step by step."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._delay = REPORT_DELAY + vehicle.brake_delay + LAGS * vehicle.brake_lag
        self._unasked_long = Debounce(UNASKED_TIME)
        self._strong_long = Debounce(LATCH_TIME)
        self._explained = 0.0  # torque that the commands explain [N m]
        self._explained_report = math.nan  # the last report that they explained [N m]
        #: the report is, to the bit, the last one that the commands explained: the command has fallen, and the report
        #: may be frozen
        self.repeated = False
        self._commands: deque[tuple[float, float]] = deque()  # time and torque of the recent ones, falling torques only
        self.brakes_latched = False  #: a foot was strong enough, for long enough, to take the brakes from the gateway

    def reset(self) -> None:
        """Forget the past: the driver's overrides are being cleared."""
        self._unasked_long.reset()
        self._strong_long.reset()
        self.brakes_latched = False

    def step(self, now: float, elapsed: float, commanded: float, reported: float, foot: float) -> bool:
        """Return whether the car brakes with a torque that nobody commanded.

        `commanded` is the torque of the step before, `reported` the car's own, NaN where it reports none, `foot` what
        the driver's pedal asks for by the brake module, NaN where that is not reported [N m].
        """
        largest, falling = self._largest(now, commanded), self._explained - RELEASE_RATE * elapsed
        self._explained = explained = falling if falling > largest else largest
        unasked = reported - (1.0 + UNASKED_SHARE) * explained
        if unasked <= UNASKED_TORQUE:  # never where the torque is not known: the last known one stays
            self._explained_report = reported
        self.repeated = reported == self._explained_report
        strong = unasked > LATCH_TORQUE or foot > LATCH_TORQUE
        self.brakes_latched |= self._strong_long.step(now, strong)
        return self._unasked_long.step(now, unasked > UNASKED_TORQUE)

    def _largest(self, now: float, commanded: float) -> float:
        """Largest torque commanded within the delay of its report, `commanded` included [N m]."""
        commands = self._commands
        while commands and commands[-1][1] <= commanded:
            commands.pop()
        commands.append((now, commanded))
        oldest = now - self._delay
        while commands[0][0] < oldest:
            commands.popleft()
        return commands[0][1]
