"""The playback shell: a recorded drive goes through the same chain, laid on the street by matched start.

Time is the recording's own; nothing here looks at a real clock. The trust profile can never arm: setpoints are computed
and recorded, the gateway stays disarmed, and nobody obeys.
"""

from __future__ import annotations

import math
from dataclasses import astuple
from pathlib import Path as FilePath

import numpy as np

from vve_sumo.controller import Guarded
from vve_sumo.drive.lockstep import CAR_BUS, DriveEnd, Watch, gateway_of
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.drive.prediction_error import PredictionError
from vve_sumo.drive.resolved_scenario import PERIOD, ResolvedScenario
from vve_sumo.drive.termination import Outcome
from vve_sumo.drive.tick_rows import RecordedTick, keep_scan, tick_row
from vve_sumo.drive.virtual_road import VirtualRoad, cast_of, laid, open_world, standing
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, Mounting, Placement, local_frame
from vve_sumo.pose import recording
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.trust import PLAYBACK, TrustGate
from vve_sumo.record.record import MemoryRecorder
from vve_sumo.sensors.radar import Radar
from vve_sumo.values import Fix

#: a recording says nothing of its receiver's place: its positions are taken as the rear axle's
AT_REAR_AXLE = Mounting(0.0, 0.0)


#: a recording that says nothing for longer is two recordings [s]
LONGEST_GAP = 60.0


def _first_usable(file: FilePath) -> tuple[float, Fix]:
    """Read the whole recording once; return its epoch [s of its own time] and the first fix that can be played.

    Raises ConfigError where a row is wrong, where none can be played, and for a gap in time.
    """
    gate: TrustGate | None = None
    first: Fix | None = None
    epoch, last = 0.0, 0.0
    for fix in recording.fixes(file):
        if gate is None:
            epoch = last = math.floor(fix.time)
            gate = TrustGate(PLAYBACK, epoch)
        if fix.time - last > LONGEST_GAP:
            raise ConfigError(f"{file}: {fix.time - last:.0f} s without a fix before time {fix.time:.3f}; cut it there")
        last = fix.time
        if first is None and gate.step(fix.time - epoch, fix).trusted:
            first = fix
    if first is None:
        raise ConfigError(f"{file}: no fix with time, position, velocity and heading that could be played")
    return epoch, first


class Playback:
    """One recorded drive. Making it starts SUMO; `close` it in any case."""

    def __init__(self, setting: ResolvedScenario, file: FilePath, working: FilePath) -> None:
        """Match the recording's first usable fix with the start of the path; raises ConfigError where that fails."""
        self.epoch, first = _first_usable(file)
        self._fixes = recording.fixes(file)
        frame = local_frame(first.latitude, first.longitude)
        begin = setting.path.at(0.0)
        there = Placement(frame, Alignment(), AT_REAR_AXLE, self.epoch).place(first)
        alignment = Alignment.from_matched_start(there, standing(begin.x, begin.y, begin.heading))
        self.laid = laid(frame, alignment, self.epoch)
        self._setting, self._begin = setting, first.time - self.epoch
        controller = setting.controller(working)
        self._chain = Pipeline(
            decoder=Decoder(),
            gate=TrustGate(PLAYBACK, self.epoch),
            placement=Placement(frame, alignment, AT_REAR_AXLE, self.epoch),
            predictor=Predictor(),
            radar=Radar(setting.radar(), setting.vehicle, np.random.default_rng(setting.scenario.seed)),
            controller=Guarded(controller),
            vehicle=setting.vehicle,
            path=setting.path,
            desired_speed=setting.scenario.ego.speed_mps,
        )
        self._gateway = gateway_of(setting.model)
        self._datagrams = 0
        self._world = open_world(setting)
        self._street = VirtualRoad(self._world, cast_of(setting))
        self._staleness = PredictionError()

    def close(self) -> None:
        """End the simulation."""
        self._world.close()

    def run(self, record: MemoryRecorder, watch: Watch) -> DriveEnd:
        """Play to the end of the recording and return how it went; everything else is in the record."""
        tick = math.ceil(self._begin / PERIOD)
        coming = next(self._fixes, None)
        reasons: tuple[str, ...] = ()
        while coming is not None:
            now = tick * PERIOD
            while coming is not None and coming.time - self.epoch <= now:
                record.received_pose(coming.time_received, repr(astuple(coming)).encode() + b"\n")
                self._datagrams += 1
                pose = self._chain.accept(coming.time - self.epoch, coming)
                if pose is not None:
                    self._staleness.step(pose)
                coming = next(self._fixes, None)
            reasons = self._tick(tick, now, record, watch)
            tick += 1
        return DriveEnd(
            outcome=Outcome.PLAYED,
            reasons=reasons,
            cleared=self._world.cleared,
            warnings=self._world.warnings,
            text=self._chain.failure or self._street.detail,
            standoffs=self._world.standoffs,
            extra={
                "prediction_error_100ms_mean_m": self._staleness.mean,
                "prediction_error_100ms_max_m": self._staleness.greatest,
            },
        )

    def _tick(self, tick: int, now: float, record: MemoryRecorder, watch: Watch) -> tuple[str, ...]:
        street, chain = self._street, self._chain
        chain.see(now, street.actors)
        decided = chain.decide(tick, now, math.nan, street.found)
        output = self._gateway.step(now, decided.setpoint, ())
        record.saw_frames(now, CAR_BUS, output.frames)
        keep_scan(record, tick, decided)
        chain.prepare(now + PERIOD, math.nan)
        asked = chain.front_bumper_at((tick + 1) * PERIOD)
        report = street.advance(asked)
        moment = RecordedTick(tick, now, self._datagrams, math.nan, decided, output.verdict)
        record.ticked(tick_row(moment, None, self._setting.path, asked, report, street))
        if report is not None:
            record.snapshot(tick + 1, street.actors)
        watch(tick, now, decided.pose.speed if decided.pose else 0.0, decided.station)
        return output.verdict.reasons
