"""A simulated ego beside the real car of a live drive: vehicle, pipeline and gateway in the drive's own process.

It is the ego of a lockstep drive, and the live drive's ticks are its clock. It stands at the start of its path until
the car of [ego] goes. It runs after the real cars' setpoints were handed over, so that these come no later for it.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Final

from vve_sumo.drive.lockstep import LockstepEgo
from vve_sumo.drive.lockstep import lone_steps as skipped
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.termination import Outcome
from vve_sumo.drive.tick import CarInput, CompletedTick, DueTick, EgoTick
from vve_sumo.live.recorder_client import RecorderClient
from vve_sumo.live.road import LiveRoad
from vve_sumo.plant.car import STEPS_PER_SECOND
from vve_sumo.plant.receiver import unaltered

#: reason code that keeps the ego from driving until the car of [ego] goes
WAITS: Final = "first_car_waits"
#: outcomes of the car of [ego] with which its drive has come to its end
_WHOLE: Final = frozenset({Outcome.STOPPED, Outcome.ARRIVED, Outcome.TIMEOUT, Outcome.COMPLETED})
#: a time of a step of the simulated vehicle is missed by rounding by less than this share of a step
_ROUNDING: Final = 1e-6


def lockstep_ego(resolved: ResolvedScenario, working: Path) -> LockstepEgo:
    """Return the ego of a further ego's scenario; raises ConfigError where something in the scenario is not usable."""
    return LockstepEgo(resolved.ego_id, resolved, working, unaltered, None)


class SimulatedEgo:
    """One simulated ego of a live drive."""

    def __init__(self, resolved: ResolvedScenario, working: Path, recorder: RecorderClient) -> None:
        """Build everything but the virtual road; raises ConfigError as `lockstep_ego` does."""
        self.id = resolved.ego_id
        self._ego, self.recorder = lockstep_ego(resolved, working), recorder
        self._ego.held = (WAITS,)
        self._duration = resolved.scenario.duration_s
        self._before: DueTick | None = None
        self._began: float | None = None  # when the car of [ego] went [s]
        self._outcome: Outcome | None = None
        self._road: LiveRoad

    def begin(self, road: LiveRoad) -> EgoTick:
        """Return what runs the ego's part of every tick, on a road."""
        self._road = road
        return self._ego.begin(self.recorder)

    def drive_to(self, due: DueTick) -> CarInput:
        """Let the simulated vehicle drive to a tick that is due; return what the tick takes from it."""
        if self._before is not None:
            for _number, time in skipped(self._before.number, self._before.time, due.number, due.time):
                self._ego.drive_alone(_step_before(time))
                self._ego.step_alone(time)
        self._before = due
        self._ego.drive_alone(_step_before(due.time))
        return self._ego.input()

    def go(self, now: float) -> None:
        """Let the ego drive: the car of [ego] has gone at drive time `now` [s]."""
        if self._began is None:
            self._began, self._ego.held = now, ()

    def ticked(self, done: CompletedTick, now: float) -> None:
        """Take a completed tick, and find out whether the ego's drive is over."""
        if self._began is None or self._outcome is not None:
            return
        driven = now - self._began
        ticked, around = self._ego.ticked(done), self._road.around[self.id]
        if (end := self._ego.end(driven, ticked, bool(around.contacts), False, driven > self._duration)) is not None:
            self._close(*end)
            self._ego.finish(around)

    def close(self, of_first: Outcome | None) -> None:
        """End the ego's drive with that of the car of [ego], which ended like `of_first`, unless it was over before."""
        if self._outcome is None:
            whole = of_first in _WHOLE
            self._close(Outcome.COMPLETED if whole else Outcome.INTERRUPTED, ("live_drive_over",))

    def _close(self, outcome: Outcome, reasons: tuple[str, ...]) -> None:
        self._outcome = outcome
        self.recorder.ended(self._summary(outcome, reasons))

    def _summary(self, outcome: Outcome, reasons: tuple[str, ...]) -> dict[str, Any]:
        road = self._road
        return {
            "outcome": outcome.value,
            "reasons": list(reasons),
            "signals": road.signals,
            "removed_at_entry": list(road.removed_at_entry),
            "removed_after_standoff": list(road.removed_after_standoff),
            "warnings": list(road.warnings),
            "text": self._ego.pipeline.failure or self._ego.gateway.interface_error or road.around[self.id].detail,
        }


def _step_before(time: float) -> float:
    """Return the last step of the simulated vehicle that is not after a drive time [s]."""
    return math.floor(time * STEPS_PER_SECOND + _ROUNDING) / STEPS_PER_SECOND
