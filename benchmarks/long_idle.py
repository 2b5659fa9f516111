"""Hours of standing, creeping and slow driving in one drive without a stop: does anything wrap, drift or grow?

Usage: PYTHONPATH=. python benchmarks/long_idle.py [--hours H] [--smoke]. The whole pipeline with the simulated vehicle
and no street, as in benchmarks/false_alarms.py. Prints the memory of the process and the true deviation each quarter of
an hour, and the first reason to stop, which there should not be; changes nothing.
"""

from __future__ import annotations

import argparse
import resource
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.false_alarms import NoWayToRest
from controllers import follow_and_stop
from tests import vehicles
from tests.vehicle.closed_loop import ClosedLoop
from vve_sumo.path import ReferencePath
from vve_sumo.values import ArmingState, ControlCommand, Observation

EVERY = 900.0  # between lines [s]
CYCLE = 120.0  # stands for the first part of each, then drives [s]
STANDS = 90.0  # [s]
SPEEDS = (0.6, 1.2, 3.0)  # in turn [m/s]
ROAD = 1500.0  # metres for each hour


class Dawdling:
    """Stands for a minute and a half, then drives slowly for half a minute."""

    def __init__(self) -> None:
        self._follower = follow_and_stop.make(vehicles.parameters().vehicle, {})

    def step(self, observation: Observation) -> ControlCommand:
        """Answer one observation."""
        cycle, into = divmod(observation.time, CYCLE)
        speed = SPEEDS[int(cycle) % len(SPEEDS)]
        answer = self._follower.step(replace(observation, desired_speed=speed))
        return replace(answer, acceleration=-1.0) if 15.0 < into < STANDS + 15.0 else answer


def memory() -> float:
    """Resident memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize() / 1e6


def main() -> None:
    """Drive and tell."""
    parser = argparse.ArgumentParser(description="a drive of hours at walking pace")
    parser.add_argument("--hours", type=float, default=4.0)
    parser.add_argument("--smoke", action="store_true", help="half a minute, only to see that it runs")
    asked = parser.parse_args()
    hours = 30.0 / 3600.0 if asked.smoke else asked.hours
    x = np.arange(0.0, ROAD * max(hours, 1.0), 1.0)
    path = ReferencePath.from_points(x, 2.0 * np.sin(x / 20.0) * np.minimum(x / 40.0, 1.0))
    loop = ClosedLoop(path, 3.0, controller=Dawdling(), pipeline=NoWayToRest, deviation_limit=4.0)
    engaged, reported, farthest, driven = False, 0.0, 0.0, 0.0
    for ticked in loop.ticks():
        state = ticked.status.state
        engaged |= state is ArmingState.ENGAGED
        farthest, driven = max(farthest, abs(ticked.deviation)), driven + 0.02 * ticked.truth.speed
        over = ticked.now >= 3600.0 * hours or (engaged and state is not ArmingState.ENGAGED)
        if ticked.now >= reported or over:
            reported += EVERY
            words = f"{ticked.now / 3600.0:.2f} h: {memory():.1f} MB, {driven:.0f} m, {farthest:.3f} m off at most"
            print(f"{words}; {state} {'+'.join(ticked.status.reasons)}", flush=True)
        if over:
            break


if __name__ == "__main__":
    main()
