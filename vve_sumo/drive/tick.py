"""Runs one tick of a drive, the same in every shell: see, decide, hand over; in the slack prepare, simulate, record.

For each ego the tick hands the setpoint to the gateway before it does anything else. Then, while the shell would wait,
the fallback paths are prepared, all egos are placed for the next tick, SUMO steps once, and the tick is recorded. A
shell only says when a tick is due, where bytes come from and where they go.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple, Protocol

from vve_sumo.drive.pipeline import Pipeline, TickResult
from vve_sumo.drive.tick_rows import RecordedTick, tick_row
from vve_sumo.drive.virtual_road import EgoSurroundings
from vve_sumo.intersections import SignalPhase
from vve_sumo.path import ReferencePath
from vve_sumo.record import signals
from vve_sumo.record.rows import SignalRow, TickRow
from vve_sumo.sensors.port import Column
from vve_sumo.timing import PERIOD
from vve_sumo.values import Actors, CommandedPath, Fix, Frame, GatewayStatus, Pose, Setpoint, SignalChange
from vve_sumo.world.ego_sync import EgoSyncReport


class DueTick(NamedTuple):
    """A tick that is due, as its shell numbers it."""

    number: int
    time: float  #: drive time of the tick's pose and setpoint [s]
    next_time: float  #: drive time of the next tick, for which the egos are placed [s]
    catch_up: int = 0  #: extra steps of SUMO that make up for ticks skipped before this one


class CarInput(NamedTuple):
    """What a shell knows of an ego's car at a tick."""

    steering: float  #: road-wheel angle that the car reports [rad], NaN for none
    truth: Pose | None = None  #: true pose of the rear axle on the virtual road, for the record; None where unknown


class CompletedTick(NamedTuple):
    """What a tick yielded for one ego."""

    result: TickResult
    status: GatewayStatus  #: the gateway's newest
    actors: Actors  #: that the tick's sensors saw
    seen: float  #: when the sensors were done, on the clock that was passed in [s]; NaN without one
    decided: float  #: when the controller was done, on the same clock [s]


class CarInputs(Protocol):
    """What a shell knows of the egos' cars; an ego's is asked for just before the ego acts."""

    def __getitem__(self, ego: str, /) -> CarInput:
        """Return what is known of the car of the ego with this id."""
        ...


class TickHost(Protocol):
    """What an ego's tick asks of the shell that runs it."""

    def faults(self) -> tuple[str, ...]:
        """Return reason codes of faults that the shell found; called once the tick's pose is predicted."""
        ...

    def hand_over(self, now: float, setpoint: Setpoint | None) -> GatewayStatus:
        """Hand the tick's setpoint, if there is one, to the gateway; return the gateway's newest status."""
        ...


class TickRecorder(Protocol):
    """What records an ego's ticks: a record, or a client that sends to one."""

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

    def signal_changed(self, row: SignalRow) -> None:
        """Record a change of a traffic signal, of which the ego's sensors are told."""
        ...

    def ticked(self, row: TickRow) -> None:
        """Record the row of a tick."""
        ...


class NoRecord:
    """A record that keeps nothing."""

    def saw_frames(self, time: float, channel: str, frames: Iterable[Frame]) -> None:
        """Keep nothing."""

    def received_pose(self, time: float, data: bytes) -> None:
        """Keep nothing."""

    def sensed(self, tick: int, sensor: str, measured: float, columns: tuple[Column, ...]) -> None:
        """Keep nothing."""

    def snapshot(self, tick: int, actors: Actors) -> None:
        """Keep nothing."""

    def commanded(self, tick: int, path: CommandedPath) -> None:
        """Keep nothing."""

    def signal_changed(self, row: SignalRow) -> None:
        """Keep nothing."""

    def ticked(self, row: TickRow) -> None:
        """Keep nothing."""


def _no_clock() -> float:
    return math.nan


class EgoTick:
    """One ego's part of every tick, with all that is kept of the ego from tick to tick."""

    def __init__(
        self, ego: str, pipeline: Pipeline, path: ReferencePath, shell: TickHost, record: TickRecorder
    ) -> None:
        """`ego` is the id of one of the virtual road's egos; its ticks go into `record`."""
        self.id = ego
        self.pipeline, self._path, self._shell = pipeline, path, shell
        self._record: TickRecorder = record
        self._portions = 0
        self._next = 0
        self._looked_at: Actors | None = None
        self._recorded: RecordedTick | None = None  # of the tick under way

    def receive(self, received: float, data: bytes) -> None:
        """Take a portion of pose bytes that arrived at drive time `received` [s], before the next tick."""
        self.pipeline.receive(received, data)
        self._received(received, data)

    def accept(self, now: float, fix: Fix, data: bytes) -> Pose | None:
        """Take an already decoded fix, as `Pipeline.accept` does; `data` are the bytes that the record keeps of it."""
        self._received(fix.time_received, data)
        return self.pipeline.accept(now, fix)

    def _received(self, received: float, data: bytes) -> None:
        self._record.received_pose(received, data)
        self._portions += 1

    def signals_changed(self, changes: Sequence[SignalChange]) -> None:
        """Record changes of the traffic signals, of which the sensors are told at the next tick."""
        for change in changes:
            self._record.signal_changed(signals.row_of(change))

    def act(self, due: DueTick, car: CarInput, around: EgoSurroundings, clock: Callable[[], float]) -> CompletedTick:
        """Let the sensors see what is around the ego, decide, and hand the setpoint over."""
        actors = around.actors
        self.pipeline.see(due.time, actors, around.signals(due.time))
        seen = clock()
        result = self.pipeline.decide(due.number, due.time, car.steering, around.faults + self._shell.faults())
        decided = clock()
        status = self._shell.hand_over(due.time, result.setpoint)
        self._recorded = RecordedTick(due.number, due.time, self._portions, car.steering, result, status, car.truth)
        return CompletedTick(result, status, actors, seen, decided)

    def prepare(self, due: DueTick, done: CompletedTick) -> None:
        """Record what the ego's tick looked at, and prepare the fallback path and the sensors of its next one."""
        self._record_looks(due.number, done.result, done.actors)
        if done.result.commanded_path is not None:
            self._record.commanded(due.number, done.result.commanded_path)
        assert self._recorded is not None
        self.pipeline.prepare(due.time + PERIOD, self._recorded.steering)
        self.pipeline.prepare_sensors()

    def record(self, pose: Pose | None, report: EgoSyncReport | None, around: EgoSurroundings) -> None:
        """Record the ego's tick, after SUMO has stepped to the next."""
        assert self._recorded is not None
        # Without a report SUMO was not stepped, so the row has no requested pose.
        placed = pose if report is not None else None
        self._record.ticked(tick_row(self._recorded, self._path, placed, report, around))
        self._next = self._recorded.tick + 1

    def finish(self, around: EgoSurroundings) -> None:
        """Record the actors of SUMO's last step, under the number of the tick that would have seen them.

        Nothing of the ego is recorded any more afterwards, also where it goes on.
        """
        if around.actors is not self._looked_at:
            self._record.snapshot(self._next, around.actors)
        self._record = NoRecord()

    def _record_looks(self, number: int, result: TickResult, actors: Actors) -> None:
        """Record the actors that the tick saw, and the sensors' readings of them."""
        for name, columns in result.readings.items():
            self._record.sensed(number, name, result.sensors[name].time, columns)
        self._record.snapshot(number, actors)
        self._looked_at = actors


class Road(Protocol):
    """What a tick needs of a virtual road."""

    @property
    def around(self) -> Mapping[str, EgoSurroundings]:
        """What surrounds each ego, by its id; kept up to date."""
        ...

    def advance(self, poses: Mapping[str, Pose]) -> Mapping[str, EgoSyncReport]:
        """Place the front bumpers of the egos that have a pose, step once, and report the placements."""
        ...

    def timed_signals(self) -> Callable[[float], Mapping[str, SignalPhase]]:
        """Return what tells, for a drive time [s], what each signal shows and how long at least from then on."""
        ...

    def signal_changes(self, since: int) -> Sequence[SignalChange]:
        """Return what the signals showed from their change number `since` on, counted from 0."""
        ...


class Tick:
    """Runs one tick after the other, for one shell: all egos act, all are placed, SUMO steps once."""

    def __init__(self, egos: Sequence[EgoTick], road: Road, clock: Callable[[], float] = _no_clock) -> None:
        """`clock` [s] gives only the times `seen` and `decided` of a completed tick."""
        self._egos = tuple((ego, road.around[ego.id]) for ego in egos)
        self._road, self._clock = road, clock
        self._sees_signals = tuple(ego for ego, _ in self._egos if ego.pipeline.sees_signals)
        self._changes = 0  # of the signals that are recorded
        for ego, around in self._egos:
            if ego in self._sees_signals:
                around.signals = road.timed_signals()

    def step(self, due: DueTick, cars: CarInputs) -> dict[str, CompletedTick]:
        """Run a tick of every ego, whose `cars` are given by the egos' ids, as are the completed ticks."""
        done = {}
        if self._sees_signals and (changes := self._road.signal_changes(self._changes)):
            self._changes += len(changes)
            for ego in self._sees_signals:
                ego.signals_changed(changes)
        for ego, around in self._egos:
            done[ego.id] = ego.act(due, cars[ego.id], around, self._clock)
        # The setpoints are on their way: the rest runs in the slack.
        for ego, _ in self._egos:
            ego.prepare(due, done[ego.id])
        asked: dict[str, Pose] = {}
        reports: Mapping[str, EgoSyncReport] = {}
        for behind in range(due.catch_up, -1, -1):
            asked = {}
            for ego, _ in self._egos:
                if (pose := ego.pipeline.front_bumper_at(due.next_time - behind * PERIOD)) is not None:
                    asked[ego.id] = pose
            reports = self._road.advance(asked)
        for ego, around in self._egos:
            ego.record(asked.get(ego.id), reports.get(ego.id), around)
        return done

    def finish(self) -> None:
        """Record the actors of SUMO's last step; call it once, after the last tick.

        These rows show what the egos touched at the end.
        """
        for ego, around in self._egos:
            ego.finish(around)
