"""One tick of a drive, the same in every shell: see, decide, hand over; in the slack prepare, simulate and record.

Sense and act first: the setpoint is on its way to the gateway before anything else is done. Then, while the shell would
wait, the fallback path is prepared, the ego is placed for the next tick, SUMO steps, and the tick is recorded. A shell
says when a tick is, where bytes come from and where they go to, and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from vve_sumo.drive.pipeline import Pipeline, TickResult
from vve_sumo.drive.resolved_scenario import PERIOD
from vve_sumo.drive.tick_rows import RecordedTick, tick_row
from vve_sumo.drive.virtual_road import VirtualRoad
from vve_sumo.path import Path
from vve_sumo.sensors.port import Column
from vve_sumo.values import Actors, Fix, GatewayStatus, Pose, Setpoint, TickRow


class DueTick(NamedTuple):
    """A tick that is due, as its shell counts."""

    number: int
    time: float  #: drive time that its pose and setpoint are to have [s]
    next_time: float  #: drive time of the tick after it, which the ego is placed for [s]
    catch_up: int = 0  #: extra steps of SUMO that make up for ticks skipped before this one


class CompletedTick(NamedTuple):
    """What a tick came to."""

    result: TickResult
    status: GatewayStatus  #: the gateway's newest
    actors: Actors  #: that the tick looked at
    seen: float  #: when the sensors had looked, on the clock that was passed in [s]; NaN without one
    decided: float  #: when the controller had answered, likewise [s]


class Shell(Protocol):
    """What a tick asks of the shell that runs it."""

    def faults(self) -> tuple[str, ...]:
        """Return reason codes of faults that the shell found; asked once the pipeline knows the tick's pose."""
        ...

    def hand_over(self, now: float, setpoint: Setpoint | None) -> GatewayStatus:
        """Give the gateway the tick's setpoint, None for none; return the newest status that the gateway gave."""
        ...


class TickRecorder(Protocol):
    """What keeps a tick: a record, or the way to one."""

    def received_pose(self, time: float, data: bytes) -> None:
        """Keep pose bytes as they came, with their receive time."""
        ...

    def sensed(self, tick: int, sensor: str, measured: float, columns: tuple[Column, ...]) -> None:
        """Keep what came out of a sensor at a tick: drive time at which it was measured [s], columns of its table."""
        ...

    def snapshot(self, tick: int, actors: Actors) -> None:
        """Keep the actors that tick `tick` looks at."""
        ...

    def ticked(self, row: TickRow) -> None:
        """Keep the row of a tick."""
        ...


def _no_clock() -> float:
    return math.nan


class Tick:
    """Does one tick after the other, for one shell and into one record."""

    def __init__(
        self,
        pipeline: Pipeline,
        road: VirtualRoad,
        path: Path,
        shell: Shell,
        record: TickRecorder,
        clock: Callable[[], float] = _no_clock,
    ) -> None:
        """`clock` [s] dates the marks of a completed tick and nothing else."""
        self._pipeline, self._road, self._path = pipeline, road, path
        self._shell, self._record, self._clock = shell, record, clock
        self._portions = 0
        self._next = 0
        self._looked_at: Actors | None = None

    def receive(self, received: float, data: bytes) -> None:
        """Take a portion of pose bytes that arrived at drive time `received` [s], before the next `step`."""
        self._pipeline.receive(received, data)
        self._received(received, data)

    def accept(self, now: float, fix: Fix, data: bytes) -> Pose | None:
        """Take a fix that was decoded already, as `Pipeline.accept` does; `data` is what the record keeps of it."""
        self._received(fix.time_received, data)
        return self._pipeline.accept(now, fix)

    def _received(self, received: float, data: bytes) -> None:
        self._record.received_pose(received, data)
        self._portions += 1

    def step(self, due: DueTick, steering: float, truth: Pose | None = None) -> CompletedTick:
        """Do a tick.

        `steering` is the road-wheel angle that the car reports [rad], NaN for none; `truth` is where the rear axle
        really is on the virtual road, for the record, None where nobody knows.
        """
        pipeline, actors = self._pipeline, self._road.actors
        pipeline.see(due.time, actors)
        seen = self._clock()
        result = pipeline.decide(due.number, due.time, steering, self._road.faults + self._shell.faults())
        decided = self._clock()
        status = self._shell.hand_over(due.time, result.setpoint)
        # All that follows happens in the slack.
        self._record_looks(due.number, result, actors)
        recorded = RecordedTick(due.number, due.time, self._portions, steering, result, status, truth)
        self._simulate(due, steering, recorded)
        return CompletedTick(result, status, actors, seen, decided)

    def finish(self) -> None:
        """Record the actors as the last step of SUMO left them, under the tick that would have looked at them.

        To be called once, after the last tick: who was touched at the end stands there.
        """
        if self._road.actors is not self._looked_at:
            self._record.snapshot(self._next, self._road.actors)

    def _record_looks(self, number: int, result: TickResult, actors: Actors) -> None:
        """Record what the tick looked at, the actors and what the sensors made of them."""
        for name, columns in result.readings.items():
            self._record.sensed(number, name, result.sensors[name].time, columns)
        self._record.snapshot(number, actors)
        self._looked_at = actors

    def _simulate(self, due: DueTick, steering: float, recorded: RecordedTick) -> None:
        """Prepare the fallback path, have the virtual road reach the next tick, and record this one."""
        self._pipeline.prepare(due.time + PERIOD, steering)
        asked = report = None
        for behind in range(due.catch_up, -1, -1):
            asked = self._pipeline.front_bumper_at(due.next_time - behind * PERIOD)
            report = self._road.advance(asked)
        # What SUMO did not take was not asked of it.
        placed = asked if report is not None else None
        self._record.ticked(tick_row(recorded, self._path, placed, report, self._road))
        self._next = due.number + 1
