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
from vve_sumo.drive.chain import Acted, Chain
from vve_sumo.drive.ending import Ending, Outcome
from vve_sumo.drive.record import Record
from vve_sumo.drive.rows import tick_row
from vve_sumo.drive.setting import EPOCH, PERIOD, Setting
from vve_sumo.drive.street import Street, laid, lot_frame, open_world, standing
from vve_sumo.frames import Alignment, MapFrame, Placement
from vve_sumo.plant import fusion as plant
from vve_sumo.plant.car import Car, CarOutput, CarParameters
from vve_sumo.plant.receiver import unaltered
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.sensors.radar import Radar
from vve_sumo.values import ArmingState, Fix, Pose
from vve_sumo.vehicle.gateway import Act, Gateway

#: called once a tick with the tick's number, drive time [s], speed [m/s] and station [m]
Watch = Callable[[int, float, float, float], None]

CAR_BUS = "can0"  #: the car's bus as it is called in the record


@dataclass(frozen=True, slots=True)
class Run:
    """How a drive went, beside what its record holds."""

    outcome: Outcome
    reasons: tuple[str, ...]  #: the gateway's, at the end
    cleared: tuple[str, ...] = ()  #: vehicles taken off the street where the ego entered it
    warnings: tuple[str, ...] = ()  #: SUMO's
    text: str = ""  #: what an exception said, where one ended the drive
    extra: Mapping[str, float] = field(default_factory=dict)  #: figures of this shell alone, by summary key


def car_parameters(setting: Setting) -> CarParameters:
    """Return the hardware-free car as the scenario perturbs it."""
    wanted = setting.scenario.ego.car
    return plant.parameters(
        noise=wanted.noise,
        delay=wanted.gnss_delay_s,
        mass_factor=wanted.mass_factor,
        brake_gain_factor=wanted.brake_gain_factor,
        grade=math.atan(wanted.grade_percent / 100.0),
        steering_wheel_bias=math.radians(wanted.steering_wheel_bias_deg),
        heading_misalignment=-math.radians(wanted.heading_misalignment_deg),
    )


@dataclass(frozen=True, slots=True)
class Laid:
    """The chain of a lockstep drive, and how the lot lies on the street."""

    chain: Chain
    lot: MapFrame
    alignment: Alignment
    start: Pose  #: of the rear axle in the lot


def chain_of(setting: Setting, controller: Controller) -> Laid:
    """Put the chain of a lockstep drive together; nothing in it knows whether a street runs or a record is replayed."""
    scenario = setting.scenario
    lot = scenario.ego.lot
    frame = lot_frame(math.radians(lot.latitude_deg), math.radians(lot.longitude_deg))
    start, begin = standing(0.0, 0.0, math.radians(90.0 - lot.heading_deg)), setting.path.at(0.0)
    alignment = Alignment.from_matched_start(start, standing(begin.x, begin.y, begin.heading))
    parameters = car_parameters(setting)
    radar_seeds = seeds_of(setting)[1]
    chain = Chain(
        decoder=Decoder(),
        gate=TrustGate(DRIVE, EPOCH),
        placement=Placement(frame, alignment, parameters.receiver.mounting, EPOCH),
        predictor=Predictor(),
        radar=Radar(setting.radar(), setting.vehicle, np.random.default_rng(radar_seeds)),
        controller=Guarded(controller),
        gateway=Gateway(setting.vehicle, calibration=parameters.calibration, period=PERIOD),
        vehicle=setting.vehicle,
        path=setting.path,
        desired_speed=scenario.ego.speed_mps,
        deviation_limit=scenario.ego.deviation_limit_m,
    )
    return Laid(chain, frame, alignment, start)


def seeds_of(setting: Setting) -> list[np.random.SeedSequence]:
    """Return the seeds of the car and of the radar."""
    return np.random.SeedSequence(setting.scenario.seed).spawn(2)


class Operator:
    """Engages once, as soon as the gateway is ready, and never again."""

    def __init__(self) -> None:
        self._engaged = self._ready = False

    def act(self) -> Act | None:
        """Return what is done before a tick."""
        return Act.ENGAGE if self._ready and not self._engaged else None

    def saw(self, state: ArmingState) -> None:
        """Take note of the gateway's state after a tick."""
        self._engaged |= state is ArmingState.ENGAGED
        self._ready = state is ArmingState.READY


class Lockstep:
    """One drive with the hardware-free car. Making it starts SUMO; `close` it in any case."""

    def __init__(self, setting: Setting, working: FilePath, alter: Callable[[Fix], Fix | None] = unaltered) -> None:
        """Put everything together; raises ConfigError where something in the setting is not usable.

        `alter` injects faults into the receiver: from a fix to another one, or to None for a lost packet.
        """
        self.controller = setting.controller(working)
        put = chain_of(setting, self.controller)
        self._chain, self._alignment, start = put.chain, put.alignment, put.start
        self.epoch, self.laid = EPOCH, laid(put.lot, put.alignment, EPOCH)
        begin = (start.x, start.y, start.heading)
        self._car = Car(car_parameters(setting), begin, put.lot, EPOCH, seeds_of(setting)[0], alter)
        self._setting = setting
        self._world = open_world(setting)
        self._street = Street(self._world)
        self._ending = Ending(setting.path.length, setting.scenario.after_stop_s)
        self._operator = Operator()

    def close(self) -> None:
        """End the simulation."""
        self._world.close()

    def ticks(self, record: Record) -> Iterator[tuple[Acted, Pose]]:
        """Tick after tick, for ever: what it came to and where the car really was, on the street."""
        heard = CarOutput([], [])
        for tick in count():
            acted, truth = self._tick(tick, tick * PERIOD, heard, record)
            heard = self._car.step((tick + 1) * PERIOD, acted.frames)
            yield acted, truth

    def run(self, record: Record, watch: Watch) -> Run:
        """Drive to the end and return how it went; everything else is in the record."""
        last = round(self._setting.scenario.duration_s / PERIOD) - 1
        for tick, (acted, truth) in enumerate(self.ticks(record)):
            now, contact = tick * PERIOD, bool(self._street.contacts)
            watch(tick, now, truth.speed, acted.station)
            outcome = self._ending.step(now, truth.speed, acted.station, acted.verdict.state, contact)
            if outcome is None and tick >= last:
                outcome = Outcome.TIMEOUT
            if outcome is not None:
                return self._run(outcome, acted)
        raise AssertionError("ticks never end by themselves")

    def _run(self, outcome: Outcome, acted: Acted) -> Run:
        return Run(
            outcome=outcome,
            reasons=acted.verdict.reasons,
            cleared=self._world.cleared,
            warnings=self._world.warnings,
            text=self._chain.failure or self._street.detail,
        )

    def _tick(self, tick: int, now: float, heard: CarOutput, record: Record) -> tuple[Acted, Pose]:
        for time, said in groupby(heard.reports, key=itemgetter(0)):
            record.saw_frames(time, CAR_BUS, [frame for _time, frame in said])
        for time, data in heard.ncom:
            record.received_pose(time, data)
            self._chain.receive(time, data)
        reports = [frame for _time, frame in heard.reports]
        street = self._street
        acted = self._chain.act(tick, now, street.actors, reports, self._operator.act(), street.found)
        record.saw_frames(now, CAR_BUS, acted.frames)
        self._operator.saw(acted.verdict.state)
        seen = street.actors.ids
        if acted.scan is not None:
            record.scanned(tick, acted.detections, [seen[row] for row in acted.scan.actor_rows])
        truth = self._alignment.apply(self._car.truth())
        asked = self._chain.front_bumper_at((tick + 1) * PERIOD)
        report = street.advance(asked)
        record.ticked(tick_row(tick, now, acted, self._chain, truth, self._setting.path, asked, report, street))
        if report is not None:
            record.snapshot(tick + 1, street.actors)
        return acted, truth
