"""Measures how late this computer wakes a process that waits for its next tick, as cyclictest does, and judges it.

It asks for the priority that a drive has, and knows nothing else of a drive.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final

from vve_sumo.commissioning.findings import Check, CheckResult, judged
from vve_sumo.live.jitter_wait import MAX_WAKE_UP_LATENESS
from vve_sumo.live.priority import DRIVE_PRIORITY, RealTimeSection, request_short_time_slice
from vve_sumo.timing import PERIOD

WAKE_UPS: Final = 150  #: number measured; 3 s
#: a later wake-up of the gateway [s] is a step of two periods, at which its own clock stops the car
TOO_LATE: Final = PERIOD


def wake_up() -> Check:
    """Measure for some seconds how late a waiting thread with a drive's priority is woken."""
    found: list[float] = []

    def measure() -> None:
        # Only this thread gets the priority, and it ends with the measurement.
        urgent = RealTimeSection(DRIVE_PRIORITY)
        if not urgent.granted:
            request_short_time_slice()
        urgent.begin()
        found.extend(lateness(WAKE_UPS, time.monotonic, time.sleep))

    thread = threading.Thread(target=measure)
    thread.start()
    thread.join()
    return judged_wake_up(max(found))


def lateness(count: int, clock: Callable[[], float], sleep: Callable[[float], None]) -> list[float]:
    """Return how late each of `count` waits ended [s], whose deadlines are a tick's period apart."""
    begun, late = clock(), []
    for number in range(1, count + 1):
        deadline = begun + number * PERIOD
        sleep(max(deadline - clock(), 0.0))
        late.append(clock() - deadline)
    return late


def judged_wake_up(worst: float) -> Check:
    """Return the check of the worst wake-up [s]."""
    found = f"at worst {1e3 * worst:.1f} ms late in {WAKE_UPS * PERIOD:.0f} s"
    advice = "close other programs, and see the line priority; a virtual machine also waits for its host"
    if worst <= TOO_LATE:
        return judged("wake-up", found, worst <= MAX_WAKE_UP_LATENESS, advice, otherwise=CheckResult.NOTE)
    return Check("wake-up", found, CheckResult.NO_GO, f"the gateway would stop the car: {advice}")
