"""The lockstep shell: runs simulated vehicles, virtual road and pipelines on one simulated clock, as fast as possible.

Time is `tick * PERIOD`; nothing here reads a real clock. The wire formats are the real ones: the simulated vehicle
sends pose bytes and CAN frames, and the gateway answers with CAN frames.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Final, Protocol

from vve_sumo.drive.assembly import LotAlignment, PoseInput, build_pipeline, seed_of
from vve_sumo.drive.brain import ExternalController
from vve_sumo.drive.people_on_road import PeopleOnRoad
from vve_sumo.drive.pipeline import Pipeline, TickResult
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH, ResolvedScenario
from vve_sumo.drive.rolling_start import RollingController, RollingStart, require_start_from_rest, roll
from vve_sumo.drive.shared_prefix import Variants
from vve_sumo.drive.simulated_people import everybody_simulated
from vve_sumo.drive.standstill_cause import StandstillClassifier
from vve_sumo.drive.termination import DriveEnd, Outcome, TerminationMonitor, end_reason
from vve_sumo.drive.tick import CarInput, CompletedTick, DueTick, EgoTick, NoRecord, Tick, TickRecorder
from vve_sumo.drive.virtual_road import EgoSurroundings, VirtualRoad, open_world, pose_at_rest, scenario_engine
from vve_sumo.frames import Alignment, MapFrame, Placement, local_frame
from vve_sumo.frozen import fast_frozen
from vve_sumo.lot.fallback import deferred_fallback_path
from vve_sumo.metrics.lead_vehicle import lead_vehicle_now
from vve_sumo.people.person import People
from vve_sumo.people.reports import encode
from vve_sumo.plant.car import Car, CarOutput, CarParameters
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.receiver import unaltered
from vve_sumo.pose.receivers.port import standard
from vve_sumo.pose.trust import DRIVE
from vve_sumo.record.writer import MemoryRecorder
from vve_sumo.rig.car_parameters import perturbed
from vve_sumo.scenario.schema import EndTrigger
from vve_sumo.timing import PERIOD
from vve_sumo.values import EGO, Actors, ArmingState, Fix, Frame, GatewayStatus, Pose, Setpoint
from vve_sumo.vehicle.arming import WAITING
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway, GatewayOutput
from vve_sumo.vehicle.interface import load
from vve_sumo.vehicle.model import VehicleModel
from vve_sumo.world.loaded_road import LoadedRoad

#: called once a tick with the tick's number, drive time [s], speed [m/s] and distance along the path [m]
TickCallback = Callable[[int, float, float, float], None]

CAR_BUS: Final = "can0"  #: name of the car's bus in the record


def drive_end(
    ego: str, outcome: Outcome, reasons: tuple[str, ...], failure: str, road: VirtualRoad
) -> DriveEnd:  # fmt: skip
    """Return how an ego's drive ended, with the removed vehicles and SUMO's warnings.

    The text is the last `failure` of the controller, a sensor or the drive-by-wire interface; without one, SUMO's last
    error message about the ego.
    """
    text = failure or road.around[ego].detail
    return DriveEnd(
        outcome, reasons, road.removed_at_entry, road.warnings, text, road.removed_after_standoff, road.signals
    )


def car_parameters(resolved: ResolvedScenario) -> CarParameters:
    """Return the simulated vehicle as the scenario perturbs it."""
    return perturbed(resolved.model, resolved.scenario.ego.car, resolved.scenario.weather.friction)


def gateway_of(model: VehicleModel) -> Gateway:
    """Return the gateway of a vehicle for a drive that is not live."""
    return Gateway(
        model.vehicle,
        model.calibration,
        model.limits,
        period=PERIOD,
        interface=load(model.interface),
        wheel_bias=model.steering_wheel_bias,
    )


def simulated_car(
    resolved: ResolvedScenario, parts: LockstepParts, alter: Callable[[Fix], Fix | None] = unaltered
) -> Car | FaultInjectedCar:
    """Return the simulated vehicle of a lockstep drive at rest, with the scenario's faults."""
    begin = 0.0 if parts.rolling is None else parts.rolling.begin
    start, frame = (parts.start.x, parts.start.y, parts.start.heading), parts.frame
    parameters, seed = car_parameters(resolved), resolved.scenario.seed
    vehicle_seed = seed_of(seed, "vehicle", resolved.ego_id)
    if not resolved.faults:
        return Car(parameters, start, frame, DEFAULT_EPOCH, vehicle_seed, alter, begin=begin)
    return FaultInjectedCar(
        parameters,
        start,
        frame,
        DEFAULT_EPOCH,
        vehicle_seed,
        resolved.faults,
        seed_of(seed, "faults", resolved.ego_id),
        alter,
    )


@dataclass(frozen=True, slots=True)
class LockstepParts:
    """The pipeline and the gateway of an ego in lockstep, and how its lot lies on the virtual road."""

    pipeline: Pipeline
    gateway: Gateway
    frame: MapFrame  #: the lot's
    alignment: Alignment
    start: Pose  #: of the rear axle in the lot, of the standing car
    rolling: RollingStart | None  #: None for a start from rest

    def roll(self, resolved: ResolvedScenario, operator: ScriptedOperator) -> None:
        """Bring pipeline, gateway and operator to drive time 0, with a simulated vehicle of their own."""
        if self.rolling is not None:
            car = simulated_car(resolved, self)
            roll(self.rolling, self.pipeline, self.gateway, car, operator)


def assemble(
    resolved: ResolvedScenario,
    working: Path,
    brain: ExternalController | None = None,
    variants: Variants | None = None,
) -> LockstepParts:
    """Build an ego's pipeline and gateway, the same for a drive with SUMO and for the replay of a record."""
    lot = resolved.scenario.ego.lot
    frame = local_frame(math.radians(lot.latitude_deg), math.radians(lot.longitude_deg))
    start, begin = pose_at_rest(0.0, 0.0, math.radians(90.0 - lot.heading_deg)), resolved.path.at(0.0)
    alignment = Alignment.from_matched_start(start, pose_at_rest(begin.x, begin.y, begin.heading))
    placement = Placement(frame, alignment, resolved.model.mounting, DEFAULT_EPOCH)
    pose = PoseInput(standard().decoder(), DRIVE, placement, DEFAULT_EPOCH)
    rolling = RollingStart.of(resolved)
    if brain is not None and brain.publisher is not None:
        require_start_from_rest(resolved, "an external controller is asked from drive time 0 on")
    if resolved.faults:
        require_start_from_rest(resolved, "the times of injected faults count from when the car drives off")
    if rolling is not None:
        stands = resolved.path.at(rolling.stands_at)
        start = alignment.inverse().apply(pose_at_rest(stands.x, stands.y, stands.heading))
    around = None if rolling is None else partial(RollingController, rolling=rolling)
    # The gateway is in this process and cannot outlive the tick: a fallback path is computed when a stop needs it.
    pipeline = build_pipeline(resolved, pose, working, brain, deferred_fallback_path, around, variants)
    return LockstepParts(pipeline, gateway_of(resolved.model), frame, alignment, start, rolling)


class ScriptedOperator:
    """Engages once, as soon as the gateway is ready, and says go while the gateway waits for it.

    It disarms to acknowledge a fault only before the first engagement, when nothing has been commanded yet.
    """

    def __init__(self) -> None:
        self._engaged = False
        self._next: OperatorCommand | None = None

    def next_command(self) -> OperatorCommand | None:
        """Return the operator command for the next tick, None for none."""
        return self._next

    def observe(self, status: GatewayStatus) -> None:
        """Choose the next command by the gateway's status at a tick."""
        self._engaged |= status.state is ArmingState.ENGAGED
        if status.state is ArmingState.READY and not self._engaged:
            self._next = OperatorCommand.ENGAGE
        elif status.state is ArmingState.ENGAGED and WAITING in status.reasons:
            self._next = OperatorCommand.GO
        elif status.state is ArmingState.FAULT and not self._engaged:
            self._next = OperatorCommand.DISARM
        else:
            self._next = None


@fast_frozen
@dataclass(frozen=True, slots=True)
class LockstepTick:
    """One tick of one ego of a lockstep drive."""

    result: TickResult
    output: GatewayOutput
    truth: Pose  #: true pose of the rear axle on the virtual road
    actors: Actors  #: that the tick's sensors saw


def lone_steps(tick: int, time: float, next_tick: int, next_time: float) -> list[tuple[int, float]]:
    """Return number and drive time [s] of the ticks that were skipped between two that were not.

    In lockstep none is. At a skipped tick the gateway steps without a setpoint, as a real one does by its own timer.
    """
    skipped = [(number, time + (number - tick) * PERIOD) for number in range(tick + 1, next_tick)]
    return [step for step in skipped if step[1] < next_time]


class LockstepRecorder(TickRecorder, Protocol):
    """What records an ego of a lockstep drive: a record, or a client that sends to one."""

    def saw_frames(self, time: float, channel: str, frames: Iterable[Frame]) -> None:
        """Record CAN frames received or sent at one drive time [s]."""
        ...


class LockstepEgo:
    """One ego of a lockstep drive: its simulated vehicle, pipeline and gateway, and what ends its drive."""

    def __init__(
        self,
        ego: str,
        resolved: ResolvedScenario,
        working: Path,
        alter: Callable[[Fix], Fix | None],
        brain: ExternalController | None,
        variants: Variants | None = None,
    ) -> None:
        """Build everything but the virtual road; raises ConfigError where something in the scenario is not usable."""
        parts = assemble(resolved, working, brain, variants)
        self.id, self.brain = ego, brain
        self.pipeline, self.gateway, self._alignment = parts.pipeline, parts.gateway, parts.alignment
        self.lot = LotAlignment(parts.frame.projection, parts.alignment, DEFAULT_EPOCH)
        self._car, self._rolling = simulated_car(resolved, parts, alter), parts.rolling
        self._path, self._vehicle = resolved.path, resolved.vehicle
        self._termination = TerminationMonitor(resolved.path.length, resolved.scenario.after_stop_s)
        self._standstill_classifier = StandstillClassifier(
            resolved.scenario, resolved.path, resolved.vehicle, resolved.declared
        )
        self._end_trigger = None if resolved.scenario.end_trigger == EndTrigger() else resolved.scenario.end_trigger
        self._operator = ScriptedOperator()
        self.held: tuple[str, ...] = ()  #: reason codes that keep the ego from driving; the shell's, none in lockstep
        self._bus: _Bus
        self._tick: EgoTick
        self._truth: Pose  # at the tick under way

    def begin(self, record: LockstepRecorder) -> EgoTick:
        """Return what runs the ego's part of every tick, into a record."""
        self._bus = _Bus(self, self.gateway, self._operator, record)
        self._tick = EgoTick(self.id, self.pipeline, self._path, self._bus, record)
        return self._tick

    def input(self) -> CarInput:
        """Return what the coming tick takes from the simulated vehicle."""
        self._truth = self._alignment.apply(self._car.truth())
        return CarInput(self.gateway.monitor.measured_steering, self._truth)

    def ticked(self, done: CompletedTick) -> LockstepTick:
        """Return a tick that has run, with the gateway's step and the true pose."""
        return LockstepTick(done.result, self._bus.output, self._truth, done.actors)

    def drive(self, until: float, ticked: LockstepTick) -> None:
        """Let the simulated vehicle drive to a drive time [s] by the gateway's frames, and take in what it sent."""
        self._take(self._car.step(until, ticked.output.frames))

    def drive_alone(self, until: float) -> None:
        """Let the simulated vehicle drive to a drive time [s] by the newest frames, and take in what it sent."""
        self._take(self._car.step(until, self._bus.frames))

    def step_alone(self, now: float) -> None:
        """Run one gateway step without a setpoint at a drive time [s]."""
        self._bus.hand_over(now, None)

    def roll(self) -> None:
        """Bring the ego to drive time 0 where the scenario begins at speed; call it once, before the first tick."""
        if self._rolling is not None:
            self._take(roll(self._rolling, self.pipeline, self.gateway, self._car, self._operator))

    def finish(self, around: EgoSurroundings) -> None:
        """End the ego's record, while the ego may go on: the drives of other egos are not over."""
        self._tick.finish(around)
        self._bus.finish()

    def _take(self, came: CarOutput) -> None:
        self._bus.reported(came.reports)
        for time, data in came.packets:
            self._tick.receive(time, data)

    def end(
        self, now: float, ticked: LockstepTick, contact: bool, story: bool, last: bool
    ) -> tuple[Outcome, tuple[str, ...]] | None:
        """Return outcome and reason codes if the ego's drive is over at a tick, which may be the `last` allowed.

        `story`: whether the trigger of the scenario's stories that ends the drive has fired.
        """
        truth, s, status = ticked.truth, ticked.result.s, ticked.output.status
        ahead = partial(self._standstill_classifier.classify, truth, s, ticked.actors)
        outcome = self._termination.step(now, truth.speed, s, status.state, status.reasons, contact, ahead)
        if self._end_trigger is not None and (why := self._end_reason(self._end_trigger, ticked, contact)):
            return self._termination.unless_contact(Outcome.COMPLETED), (why, *status.reasons)
        if story:
            return self._termination.unless_contact(Outcome.COMPLETED), ("end_story", *status.reasons)
        if outcome is None and last:
            outcome = self._termination.unless_contact(Outcome.TIMEOUT)
        return None if outcome is None else (outcome, status.reasons)

    def _end_reason(self, end_trigger: EndTrigger, ticked: LockstepTick, contact: bool) -> str:
        """Return the reason code for which the scenario ends the drive at this tick, from the true pose; else empty."""
        truth, s = ticked.truth, ticked.result.s
        bumper = deviation = ttc = math.nan
        if math.isfinite(s):
            place = self._path.project(truth.x, truth.y, s)
            bumper, deviation = place.s + self._vehicle.rear_axle_to_bumper, place.d
        if end_trigger.ttc_s is not None:
            commanded = ticked.result.commanded_path
            lead = lead_vehicle_now(truth, s, ticked.actors, self._path, self._vehicle, commanded)
            ttc = float(lead.time_to_collision[0])
        return end_reason(end_trigger, contact, bumper, deviation, ttc)


class Lockstep:
    """One drive with simulated vehicles. The constructor starts SUMO; always call `close`."""

    def __init__(
        self,
        resolved: ResolvedScenario,
        working: Path,
        alter: Callable[[Fix], Fix | None] = unaltered,
        brain: ExternalController | None = None,
        loaded: LoadedRoad | None = None,
        variants: Variants | None = None,
    ) -> None:
        """Build the drive and start SUMO; raises ConfigError where something in the scenario is not usable.

        `alter` injects receiver faults: it returns the fix to send in place of the true one, None for a lost packet.
        An external controller `brain` drives the car of [ego] in place of the scenario's own. A road that is `loaded`
        is driven on. With `variants`, of which `resolved` is the first, all of them are driven as one until they
        differ; such scenarios have one ego.
        """
        self._phones = everybody_simulated(resolved)
        first = LockstepEgo(EGO, resolved, working, alter, brain, variants)
        self.egos = [first, *(LockstepEgo(one.ego_id, one, working, alter, None) for one in resolved.others)]
        self.lots: Sequence[LotAlignment] = [ego.lot for ego in self.egos]
        self.lot = self.lots[0]
        self.ended: dict[int, DriveEnd] = {}
        engine = scenario_engine(resolved) if variants is None else variants.engine(scenario_engine)
        self.road = VirtualRoad(open_world(resolved, loaded=loaded), engine)
        if variants is not None:
            variants.forked = self.road.inherit
        publisher = None if brain is None else brain.publisher
        if publisher is not None and publisher.needs_signals:
            publisher.signals = self.road.timed_signals()
        self._last = round(resolved.scenario.duration_s / PERIOD) - 1
        self._people = resolved.people

    def close(self) -> None:
        """End the simulation."""
        self.road.close()

    def ticks(self, *records: MemoryRecorder) -> Generator[Mapping[str, LockstepTick]]:
        """Yield one tick of all egos, by their ids, after the other without end; each has a record, in their order.

        Closing the iterator records the actors of SUMO's last step.
        """
        tick = Tick([ego.begin(record) for ego, record in zip(self.egos, records, strict=True)], self.road)
        people = PeopleOnRoad(People(self._people), records[0])
        if self._people:
            self.road.admit(people)
        try:
            for ego in self.egos:
                ego.roll()
            for number in count():
                due = DueTick(number, number * PERIOD, (number + 1) * PERIOD)
                cars, ticked = {}, {}
                for received, report in self._phones.until(due.time):
                    people.receive(received, encode(report))
                for ego in self.egos:
                    cars[ego.id] = ego.input()
                done = tick.step(due, cars)
                for ego in self.egos:
                    ticked[ego.id] = ego.ticked(done[ego.id])
                yield ticked
                for ego in self.egos:
                    ego.drive(due.next_time, ticked[ego.id])
        finally:
            tick.finish()

    def run(self, records: Sequence[MemoryRecorder], on_tick: TickCallback) -> list[DriveEnd]:
        """Drive to the end and return how the drive of each ego ended; everything else is in their records.

        `on_tick` is told of the car of [ego].
        """
        with closing(self.ticks(*records)) as ticks:
            ends = self._run(ticks, on_tick)
        overdue = next((ego.brain.overdue for ego in self.egos if ego.brain is not None and ego.brain.overdue), "")
        return [replace(ends[0], text=overdue), *ends[1:]] if overdue else ends

    def _run(self, ticks: Iterator[Mapping[str, LockstepTick]], on_tick: TickCallback) -> list[DriveEnd]:
        """Drive until the drives of all egos are over; one whose drive is over goes on unrecorded until then."""
        for number, ticked in enumerate(ticks):
            now, first = number * PERIOD, ticked[EGO]
            on_tick(number, now, first.truth.speed, first.result.s)
            for place, ego in enumerate(self.egos):
                if place in self.ended:
                    continue
                around = self.road.around[ego.id]
                story = ego.id == EGO and self.road.story_ended
                end = ego.end(now, ticked[ego.id], bool(around.contacts), story, number >= self._last)
                if end is not None:
                    failure = ego.pipeline.failure or ego.gateway.interface_error
                    self.ended[place] = drive_end(ego.id, *end, failure, self.road)
                    ego.finish(around)
            if len(self.ended) == len(self.egos):
                return [self.ended[place] for place in range(len(self.egos))]
        raise AssertionError("ticks never end by themselves")


class _Bus:
    """The tick's shell of a lockstep drive: the gateway on the simulated vehicle's bus, with a scripted operator."""

    output: GatewayOutput  #: of the gateway's newest step
    frames: tuple[Frame, ...] = ()  #: of that step; none before the first

    def __init__(
        self, ego: LockstepEgo, gateway: Gateway, operator: ScriptedOperator, record: LockstepRecorder
    ) -> None:
        self._ego, self._gateway, self._operator, self._brain = ego, gateway, operator, ego.brain
        self._record: LockstepRecorder | NoRecord = record
        self._reports: list[Frame] = []

    def finish(self) -> None:
        """Record no more frames."""
        self._record = NoRecord()

    def reported(self, reports: Sequence[tuple[float, Frame]]) -> None:
        """Take the frames that the car sent since the last tick, with their drive times [s]."""
        sent: dict[float, list[Frame]] = {}
        for time, frame in reports:
            sent.setdefault(time, []).append(frame)
        for time, frames in sent.items():
            self._record.saw_frames(time, CAR_BUS, frames)
        self._reports = [frame for _time, frame in reports]

    def faults(self) -> tuple[str, ...]:
        """Return what holds the ego, or the brain's faults; any other failure of this shell ends the drive.

        Raises RigError where the brain is not there.
        """
        if self._brain is None:
            return self._ego.held
        self._brain.require_answer()
        return self._brain.faults

    def hand_over(self, now: float, setpoint: Setpoint | None) -> GatewayStatus:
        """Run one gateway step on the setpoint and the car's newest reports."""
        self.output = self._gateway.step(now, setpoint, self._reports, self._operator.next_command())
        self.frames = self.output.frames
        self._record.saw_frames(now, CAR_BUS, self.frames)
        self._operator.observe(self.output.status)
        if self._brain is not None and self._brain.publisher is not None:
            self._brain.publisher.state = self.output.status.state.value
        return self.output.status
