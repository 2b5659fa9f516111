"""The playback shell: feeds a recorded drive through the same pipeline, aligned with the start of the scenario's path.

Time is the recording's own; nothing here reads a real clock. The trust profile can never arm: setpoints are computed
and recorded, the gateway stays disarmed, and no car obeys.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, replace
from itertools import count
from pathlib import Path

from vve_sumo.drive.assembly import LotAlignment, PoseInput, build_pipeline
from vve_sumo.drive.lockstep import CAR_BUS, TickCallback, drive_end, gateway_of
from vve_sumo.drive.prediction_error import PredictionError
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.termination import DriveEnd, Outcome
from vve_sumo.drive.tick import CarInput, DueTick, EgoTick, Tick
from vve_sumo.drive.virtual_road import VirtualRoad, open_world, pose_at_rest, scenario_engine
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, Mounting, Placement, local_frame
from vve_sumo.lot.fallback import deferred_fallback_path
from vve_sumo.pose import recording
from vve_sumo.pose.receivers.port import standard
from vve_sumo.pose.trust import PLAYBACK, TrustGate
from vve_sumo.record.writer import MemoryRecorder
from vve_sumo.timing import PERIOD
from vve_sumo.values import EGO, Fix, GatewayStatus, Setpoint
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.world.loaded_road import LoadedRoad

#: a recording does not say where its receiver was mounted: its positions are taken as the rear axle's
AT_REAR_AXLE = Mounting(0.0, 0.0)
#: longest time without a fix in one recording [s]
MAX_GAP = 60.0


def _first_usable(file: Path) -> tuple[float, Fix]:
    """Read the whole recording once; return its epoch [s of its own time] and the first fix that can be played.

    Raises ConfigError for a wrong row, for a gap longer than MAX_GAP, and where no fix can be played.
    """
    gate: TrustGate | None = None
    first: Fix | None = None
    epoch, last = 0.0, 0.0
    for fix in recording.fixes(file):
        if gate is None:
            epoch = last = math.floor(fix.time)
            gate = TrustGate(PLAYBACK, epoch)
        if fix.time - last > MAX_GAP:
            raise ConfigError(f"{file}: {fix.time - last:.0f} s without a fix before time {fix.time:.3f}; cut it there")
        last = fix.time
        if first is None and gate.step(fix.time - epoch, fix).trusted:
            first = fix
    if first is None:
        raise ConfigError(f"{file}: no fix with time, position, velocity and heading that could be played")
    return epoch, first


class Playback:
    """One recorded drive. The constructor starts SUMO; always call `close`."""

    def __init__(self, resolved: ResolvedScenario, file: Path, working: Path, loaded: LoadedRoad | None = None) -> None:
        """Align the recording's first usable fix with the start of the path; raises ConfigError where that fails.

        A road that is `loaded` is driven on.
        """
        epoch, first = _first_usable(file)
        self._fixes = recording.fixes(file)
        frame = local_frame(first.latitude, first.longitude)
        begin = resolved.path.at(0.0)
        start = Placement(frame, Alignment(), AT_REAR_AXLE, epoch).place(first)
        alignment = Alignment.from_matched_start(start, pose_at_rest(begin.x, begin.y, begin.heading))
        self.lot = LotAlignment(frame.projection, alignment, epoch)
        self.lots: Sequence[LotAlignment] = [self.lot]
        self._resolved, self._begin = resolved, first.time - epoch
        placement = Placement(frame, alignment, AT_REAR_AXLE, epoch)
        pose_input = PoseInput(standard().decoder(), PLAYBACK, placement, epoch)
        self._pipeline = build_pipeline(resolved, pose_input, working, fallback=deferred_fallback_path)
        self._gateway = gateway_of(resolved.model)
        self._road = VirtualRoad(open_world(resolved, loaded=loaded), scenario_engine(resolved))
        self._prediction_error = PredictionError()

    def close(self) -> None:
        """End the simulation."""
        self._road.close()

    def run(self, records: Sequence[MemoryRecorder], on_tick: TickCallback) -> list[DriveEnd]:
        """Play to the end of the recording and return how the drive of its one ego ended.

        Everything else is in the ego's record.
        """
        (record,) = records
        ego = EgoTick(EGO, self._pipeline, self._resolved.path, _Unheard(self._gateway, record), record)
        tick = Tick([ego], self._road)
        try:
            reasons = self._play(ego, tick, on_tick)
        finally:
            tick.finish()
        error = self._prediction_error
        extra = {"prediction_error_100ms_mean_m": error.mean, "prediction_error_100ms_max_m": error.greatest}
        return [replace(drive_end(EGO, Outcome.PLAYED, reasons, self._pipeline.failure, self._road), extra=extra)]

    def _play(self, ego: EgoTick, tick: Tick, on_tick: TickCallback) -> tuple[str, ...]:
        """Tick until the recording ends; return the gateway's reason codes of the last tick."""
        reasons: tuple[str, ...] = ()
        coming = next(self._fixes, None)
        for number in count(math.ceil(self._begin / PERIOD)):
            if coming is None:
                break
            now = number * PERIOD
            while coming is not None and coming.time - self.lot.epoch <= now:
                pose = ego.accept(coming.time - self.lot.epoch, coming, repr(astuple(coming)).encode() + b"\n")
                if pose is not None:
                    self._prediction_error.step(pose)
                coming = next(self._fixes, None)
            done = tick.step(DueTick(number, now, (number + 1) * PERIOD), {EGO: CarInput(math.nan)})[EGO]
            pose, reasons = done.result.pose, done.status.reasons
            on_tick(number, now, pose.speed if pose else 0.0, done.result.s)
        return reasons


class _Unheard:
    """The tick's shell of a playback: a gateway that stays disarmed, and no car that would obey it."""

    def __init__(self, gateway: Gateway, record: MemoryRecorder) -> None:
        self._gateway, self._record = gateway, record

    def faults(self) -> tuple[str, ...]:
        """Return no fault: a failure of this shell ends the playback."""
        return ()

    def hand_over(self, now: float, setpoint: Setpoint | None) -> GatewayStatus:
        """Run one gateway step without reports of a car."""
        output = self._gateway.step(now, setpoint, ())
        self._record.saw_frames(now, CAR_BUS, output.frames)
        return output.status
