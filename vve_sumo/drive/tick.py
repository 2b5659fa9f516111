"""Runs one tick of a drive, the same in every shell: see, decide, hand over; in the slack prepare, simulate, record.

The tick hands the setpoint to the gateway before it does anything else. Then, while the shell would wait, the fallback
path is prepared, the ego is placed for the next tick, SUMO steps, and the tick is recorded. A shell only says when a
tick is due, where bytes come from and where they go.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from vve_sumo.drive.pipeline import Pipeline, TickResult
from vve_sumo.drive.tick_rows import RecordedTick, tick_row
from vve_sumo.drive.virtual_road import VirtualRoad
from vve_sumo.path import ReferencePath
from vve_sumo.record.rows import TickRow
from vve_sumo.sensors.port import Column
from vve_sumo.timing import PERIOD
from vve_sumo.values import Actors, CommandedPath, Fix, GatewayStatus, Pose, Setpoint


class DueTick(NamedTuple):
    """A tick that is due, as its shell numbers it."""

    number: int
    time: float  #: drive time of the tick's pose and setpoint [s]
    next_time: float  #: drive time of the next tick, for which the ego is placed [s]
    catch_up: int = 0  #: extra steps of SUMO that make up for ticks skipped before this one


class CompletedTick(NamedTuple):
    """What a tick yielded."""

    result: TickResult
    status: GatewayStatus  #: the gateway's newest
    actors: Actors  #: that the tick's sensors saw
    seen: float  #: when the sensors were done, on the clock that was passed in [s]; NaN without one
    decided: float  #: when the controller was done, on the same clock [s]


class TickHost(Protocol):
    """What a tick asks of the shell that runs it."""

    def faults(self) -> tuple[str, ...]:
        """Return reason codes of faults that the shell found; called once the tick's pose is predicted."""
        ...

    def hand_over(self, now: float, setpoint: Setpoint | None) -> GatewayStatus:
        """Hand the tick's setpoint, if there is one, to the gateway; return the gateway's newest status."""
        ...


class TickRecorder(Protocol):
    """What records a tick: a record, or a client that sends to one."""

    def received_pose(self, time: float, data: bytes) -> None:
        """Record pose bytes unaltered, with their receive time [s]."""
        ...

    def sensed(self, tick: int, sensor: str, measured: float, columns: tuple[Column, ...]) -> None:
        """Record a sensor's reading at a tick: drive time of the measurement [s], columns of the sensor's table."""
        ...

    def snapshot(self, tick: int, actors: Actors) -> None:
        """Record the actors that the sensors see at tick `tick`."""
        ...

    def commanded(self, tick: int, path: CommandedPath) -> None:
        """Record the path that the command of a tick carries; not called for a command without one."""
        ...

    def ticked(self, row: TickRow) -> None:
        """Record the row of a tick."""
        ...


def _no_clock() -> float:
    return math.nan


class Tick:
    """Runs one tick after the other, for one shell and into one record."""

    def __init__(
        self,
        pipeline: Pipeline,
        road: VirtualRoad,
        path: ReferencePath,
        shell: TickHost,
        record: TickRecorder,
        clock: Callable[[], float] = _no_clock,
    ) -> None:
        """`clock` [s] gives only the times `seen` and `decided` of a completed tick."""
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
        """Take an already decoded fix, as `Pipeline.accept` does; `data` are the bytes that the record keeps of it."""
        self._received(fix.time_received, data)
        return self._pipeline.accept(now, fix)

    def _received(self, received: float, data: bytes) -> None:
        self._record.received_pose(received, data)
        self._portions += 1

    def step(self, due: DueTick, steering: float, truth: Pose | None = None) -> CompletedTick:
        """Run a tick.

        `steering` is the road-wheel angle that the car reports [rad], NaN for none; `truth` is the rear axle's true
        pose on the virtual road, for the record, None where it is unknown.
        """
        pipeline, actors = self._pipeline, self._road.actors
        pipeline.see(due.time, actors)
        seen = self._clock()
        result = pipeline.decide(due.number, due.time, steering, self._road.faults + self._shell.faults())
        decided = self._clock()
        status = self._shell.hand_over(due.time, result.setpoint)
        # The setpoint is on its way: the rest runs in the slack.
        self._record_looks(due.number, result, actors)
        if result.commanded_path is not None:
            self._record.commanded(due.number, result.commanded_path)
        recorded = RecordedTick(due.number, due.time, self._portions, steering, result, status, truth)
        self._simulate(due, steering, recorded)
        return CompletedTick(result, status, actors, seen, decided)

    def finish(self) -> None:
        """Record the actors of SUMO's last step, under the number of the tick that would have seen them.

        Call it once, after the last tick: these rows show what the ego touched at the end.
        """
        if self._road.actors is not self._looked_at:
            self._record.snapshot(self._next, self._road.actors)

    def _record_looks(self, number: int, result: TickResult, actors: Actors) -> None:
        """Record the actors that the tick saw, and the sensors' readings of them."""
        for name, columns in result.readings.items():
            self._record.sensed(number, name, result.sensors[name].time, columns)
        self._record.snapshot(number, actors)
        self._looked_at = actors

    def _simulate(self, due: DueTick, steering: float, recorded: RecordedTick) -> None:
        """Prepare the fallback path, step the virtual road to the next tick, and record this tick."""
        self._pipeline.prepare(due.time + PERIOD, steering)
        asked = report = None
        for behind in range(due.catch_up, -1, -1):
            asked = self._pipeline.front_bumper_at(due.next_time - behind * PERIOD)
            report = self._road.advance(asked)
        # Without a report SUMO was not stepped, so the row has no requested pose.
        placed = asked if report is not None else None
        self._record.ticked(tick_row(recorded, self._path, placed, report, self._road))
        self._next = due.number + 1
