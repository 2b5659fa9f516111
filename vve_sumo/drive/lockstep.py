"""The lockstep shell: hardware-free car, street and chain on one simulated clock, as fast as it goes.

Time is `tick * PERIOD`; nothing here looks at a real clock. The wire formats are real: the car speaks NCOM bytes and
CAN frames, and the chain answers with CAN frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count, groupby
from operator import itemgetter
from pathlib import Path as FilePath

import numpy as np

from vve_sumo.controller import Controller, Guarded
from vve_sumo.drive.pipeline import Pipeline, TickResult
from vve_sumo.drive.resolved_scenario import EPOCH, PERIOD, ResolvedScenario
from vve_sumo.drive.termination import Outcome, TerminationMonitor, abort_reason
from vve_sumo.drive.tick_rows import RecordedTick, keep_scan, tick_row
from vve_sumo.drive.virtual_road import VirtualRoad, cast_of, laid, open_world, standing
from vve_sumo.frames import Alignment, MapFrame, Placement, local_frame
from vve_sumo.metrics import drive_metrics
from vve_sumo.plant import fusion as plant
from vve_sumo.plant.car import Car, CarOutput, CarParameters
from vve_sumo.plant.receiver import unaltered
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.record.record import MemoryRecorder
from vve_sumo.scenario.schema import Abort
from vve_sumo.sensors.radar import Radar
from vve_sumo.values import Actors, ArmingState, Fix, GatewayStatus, Pose
from vve_sumo.vehicle.gateway import Gateway, GatewayOutput, OperatorCommand
from vve_sumo.vehicle.interface import load

#: called once a tick with the tick's number, drive time [s], speed [m/s] and station [m]
Watch = Callable[[int, float, float, float], None]

#: the gateway's word for a car that is enabled, in drive, and held until the operator says go
WAITING = "waiting_for_go"

CAR_BUS = "can0"  #: the car's bus as it is called in the record


@dataclass(frozen=True, slots=True)
class DriveEnd:
    """How a drive went, beside what its record holds."""

    outcome: Outcome
    reasons: tuple[str, ...]  #: the gateway's, at the end; before them what the drive was ended for, if it was
    cleared: tuple[str, ...] = ()  #: vehicles taken off the street where the ego entered it
    warnings: tuple[str, ...] = ()  #: SUMO's
    text: str = ""  #: what an exception said, where one ended the drive
    standoffs: tuple[str, ...] = ()  #: vehicles taken off the street because they and the ego waited for each other
    extra: Mapping[str, float] = field(default_factory=dict)  #: figures of this shell alone, by summary key


def car_parameters(setting: ResolvedScenario) -> CarParameters:
    """Return the hardware-free car as the scenario perturbs it."""
    wanted = setting.scenario.ego.car
    return plant.parameters(
        interface=setting.interface,
        noise=wanted.noise_factor if wanted.noise else 0.0,
        delay=wanted.gnss_delay_s,
        hidden_delay=wanted.gnss_hidden_delay_s,
        mass_factor=wanted.mass_factor,
        brake_gain_factor=wanted.brake_gain_factor,
        friction=setting.scenario.weather.friction,
        grade=math.atan(wanted.grade_percent / 100.0),
        steering_wheel_bias=math.radians(wanted.steering_wheel_bias_deg),
        heading_misalignment=-math.radians(wanted.heading_misalignment_deg),
    )


@dataclass(frozen=True, slots=True)
class Laid:
    """The chain and the gateway of a lockstep drive, and how the lot lies on the street."""

    chain: Pipeline
    gateway: Gateway
    lot: MapFrame
    alignment: Alignment
    start: Pose  #: of the rear axle in the lot


def chain_of(setting: ResolvedScenario, controller: Controller) -> Laid:
    """Put the chain of a lockstep drive together; nothing in it knows whether a street runs or a record is replayed."""
    scenario = setting.scenario
    lot = scenario.ego.lot
    frame = local_frame(math.radians(lot.latitude_deg), math.radians(lot.longitude_deg))
    start, begin = standing(0.0, 0.0, math.radians(90.0 - lot.heading_deg)), setting.path.at(0.0)
    alignment = Alignment.from_matched_start(start, standing(begin.x, begin.y, begin.heading))
    parameters = car_parameters(setting)
    radar_seeds = seeds_of(setting)[1]
    chain = Pipeline(
        decoder=Decoder(),
        gate=TrustGate(DRIVE, EPOCH),
        placement=Placement(frame, alignment, parameters.receiver.mounting, EPOCH),
        predictor=Predictor(),
        radar=Radar(setting.radar(), setting.vehicle, np.random.default_rng(radar_seeds)),
        controller=Guarded(controller),
        vehicle=setting.vehicle,
        path=setting.path,
        desired_speed=scenario.ego.speed_mps,
        deviation_limit=scenario.ego.deviation_limit_m,
    )
    gateway = Gateway(
        setting.vehicle, calibration=parameters.calibration, period=PERIOD, interface=load(setting.interface)
    )  # fmt: skip
    return Laid(chain, gateway, frame, alignment, start)


def seeds_of(setting: ResolvedScenario) -> list[np.random.SeedSequence]:
    """Return the seeds of the car and of the radar."""
    return np.random.SeedSequence(setting.scenario.seed).spawn(2)


class ScriptedOperator:
    """Engages once, as soon as the gateway is ready, says go as soon as it waits for that, and never again.

    A fault from before it ever engaged, when nothing was commanded, it acknowledges.
    """

    def __init__(self) -> None:
        self._engaged = False
        self._next: OperatorCommand | None = None

    def act(self) -> OperatorCommand | None:
        """Return what is done before a tick."""
        return self._next

    def saw(self, verdict: GatewayStatus) -> None:
        """Take note of what the gateway said at a tick."""
        self._engaged |= verdict.state is ArmingState.ENGAGED
        if verdict.state is ArmingState.READY and not self._engaged:
            self._next = OperatorCommand.ENGAGE
        elif verdict.state is ArmingState.ENGAGED and WAITING in verdict.reasons:
            self._next = OperatorCommand.GO
        elif verdict.state is ArmingState.FAULT and not self._engaged:
            self._next = OperatorCommand.DISARM
        else:
            self._next = None


@dataclass(frozen=True, slots=True)
class LockstepTick:
    """One tick of a lockstep drive."""

    decided: TickResult
    output: GatewayOutput
    truth: Pose  #: where the car really was, on the street
    around: Actors  #: what was on the street then


class Lockstep:
    """One drive with the hardware-free car. Making it starts SUMO; `close` it in any case."""

    def __init__(
        self, setting: ResolvedScenario, working: FilePath, alter: Callable[[Fix], Fix | None] = unaltered
    ) -> None:
        """Put everything together; raises ConfigError where something in the setting is not usable.

        `alter` injects faults into the receiver: from a fix to another one, or to None for a lost packet.
        """
        put = chain_of(setting, setting.controller(working))
        self._chain, self._gateway, self._alignment, start = put.chain, put.gateway, put.alignment, put.start
        self.epoch, self.laid = EPOCH, laid(put.lot, put.alignment, EPOCH)
        begin = (start.x, start.y, start.heading)
        self._car = Car(car_parameters(setting), begin, put.lot, EPOCH, seeds_of(setting)[0], alter)
        self._setting = setting
        self._world = open_world(setting)
        self._street = VirtualRoad(self._world, cast_of(setting))
        self._ending = TerminationMonitor(setting.path.length, setting.scenario.after_stop_s)
        self._abort = None if setting.scenario.abort == Abort() else setting.scenario.abort
        self._operator = ScriptedOperator()
        self._datagrams = 0

    def close(self) -> None:
        """End the simulation."""
        self._world.close()

    def ticks(self, record: MemoryRecorder) -> Iterator[LockstepTick]:
        """Tick after tick, for ever."""
        heard = CarOutput([], [])
        for tick in count():
            ticked = self._tick(tick, tick * PERIOD, heard, record)
            heard = self._car.step((tick + 1) * PERIOD, ticked.output.frames)
            yield ticked

    def run(self, record: MemoryRecorder, watch: Watch) -> DriveEnd:
        """Drive to the end and return how it went; everything else is in the record."""
        last = round(self._setting.scenario.duration_s / PERIOD) - 1
        for tick, ticked in enumerate(self.ticks(record)):
            now, contact = tick * PERIOD, bool(self._street.contacts)
            speed, station, verdict = ticked.truth.speed, ticked.decided.station, ticked.output.verdict
            watch(tick, now, speed, station)
            if self._abort is not None and (why := self._abort_reason(self._abort, ticked)):
                return self._run(Outcome.ABORTED, (why, *verdict.reasons))
            outcome = self._ending.step(now, speed, station, verdict.state, contact)
            if outcome is None and tick >= last:
                outcome = Outcome.TIMEOUT
            if outcome is not None:
                return self._run(outcome, verdict.reasons)
        raise AssertionError("ticks never end by themselves")

    def _abort_reason(self, wanted: Abort, ticked: LockstepTick) -> str:
        """Return why the scenario ends the drive at this tick, by the truth as the figures see it; empty for not."""
        truth, station = ticked.truth, ticked.decided.station
        path, vehicle = self._setting.path, self._setting.vehicle
        bumper = deviation = ttc = math.nan
        if math.isfinite(station):
            place = path.project(truth.x, truth.y, station)
            bumper, deviation = place.s + vehicle.rear_axle_to_bumper, place.offset
        if wanted.ttc_s is not None:
            seen = drive_metrics.ahead_now(truth, station, ticked.around, path, vehicle)
            ttc = float(drive_metrics.time_to_collision(seen)[0])
        return abort_reason(wanted, bool(self._street.contacts), bumper, deviation, ttc)

    def _run(self, outcome: Outcome, reasons: tuple[str, ...]) -> DriveEnd:
        return DriveEnd(
            outcome=outcome,
            reasons=reasons,
            cleared=self._world.cleared,
            warnings=self._world.warnings,
            text=self._chain.failure or self._street.detail,
            standoffs=self._world.standoffs,
        )

    def _tick(self, tick: int, now: float, heard: CarOutput, record: MemoryRecorder) -> LockstepTick:
        for time, said in groupby(heard.reports, key=itemgetter(0)):
            record.saw_frames(time, CAR_BUS, [frame for _time, frame in said])
        for time, data in heard.ncom:
            record.received_pose(time, data)
            self._chain.receive(time, data)
        self._datagrams += len(heard.ncom)
        chain, street, steering = self._chain, self._street, self._gateway.measured_steering
        around = street.actors
        chain.see(now, around)
        decided = chain.decide(tick, now, steering, street.found)
        reports = [frame for _time, frame in heard.reports]
        output = self._gateway.step(now, decided.setpoint, reports, self._operator.act())
        record.saw_frames(now, CAR_BUS, output.frames)
        self._operator.saw(output.verdict)
        keep_scan(record, tick, decided)
        truth = self._alignment.apply(self._car.truth())
        chain.prepare(now + PERIOD, steering)
        asked = chain.front_bumper_at((tick + 1) * PERIOD)
        report = street.advance(asked)
        moment = RecordedTick(tick, now, self._datagrams, steering, decided, output.verdict)
        record.ticked(tick_row(moment, truth, self._setting.path, asked, report, street))
        if report is not None:
            record.snapshot(tick + 1, street.actors)
        return LockstepTick(decided, output, truth, around)
