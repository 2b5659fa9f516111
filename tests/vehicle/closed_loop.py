"""The whole pipeline without a street: simulated vehicle with its faults, pose pipeline, path follower, gateway.

As fast as it goes, and nothing in it is simpler than in a drive but the virtual road, which is empty.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import count
from typing import NamedTuple

import numpy as np

from controllers import follow_and_stop
from tests import vehicles
from vve_sumo.controller import Controller, Guarded
from vve_sumo.drive.lockstep import ScriptedOperator
from vve_sumo.drive.pipeline import Pipeline
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
from vve_sumo.frames import Alignment, Placement, local_frame
from vve_sumo.path import ReferencePath
from vve_sumo.plant.car import Car, CarOutput, CarParameters
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.injected_faults import START_SPEED, InjectedFault
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.predict import Predictor
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.sensors.guarded import GuardedSensor
from vve_sumo.sensors.radar_settings import RadarSettings
from vve_sumo.timing import PERIOD
from vve_sumo.values import Actors, ArmingState, ControlCommand, Frame, GatewayStatus, Observation, Pose
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway

LOT = local_frame(math.radians(40.0), math.radians(-82.98))
NOBODY = Actors.none(0.0)


def winding(length: float = 400.0, swing: float = 3.0, period: float = 80.0) -> ReferencePath:
    """A road that swings to both sides; its ends are straight on."""
    x = np.arange(0.0, length + 1.0, 1.0)
    ramp = np.clip(x / 40.0, 0.0, 1.0) ** 2
    return ReferencePath.from_points(x, ramp * swing * np.sin(math.tau * x / period))


def straight(length: float = 400.0) -> ReferencePath:
    """A straight road along x."""
    return ReferencePath.from_points(np.arange(0.0, length + 1.0, 10.0), np.zeros(int(length // 10) + 1))


class Ticked(NamedTuple):
    """One tick, seen from outside."""

    now: float  #: [s]
    status: GatewayStatus
    truth: Pose  #: at `now`
    deviation: float  #: true one, from the path, left positive [m]
    found: tuple[str, ...]  #: faults of the drive


class ClosedLoop:
    """A drive that begins in park at the path's start and goes on for as long as it is asked for ticks."""

    def __init__(
        self,
        path: ReferencePath,
        speed: float,
        faults: Iterable[InjectedFault] = (),
        parameters: CarParameters | None = None,
        seed: int = 1,
        controller: Controller | None = None,
        deviation_limit: float = math.inf,
        pipeline: type[Pipeline] = Pipeline,
    ) -> None:
        parameters = parameters or vehicles.parameters()
        vehicle, begin = parameters.vehicle, path.at(0.0)
        seeds = np.random.SeedSequence(seed).spawn(3)
        start = begin.x, begin.y, begin.heading
        faults = tuple(faults)
        self.car: Car | FaultInjectedCar = (
            FaultInjectedCar(parameters, start, LOT, DEFAULT_EPOCH, seeds[0], faults, seeds[2])
            if faults
            else Car(parameters, start, LOT, DEFAULT_EPOCH, seeds[0])
        )
        self.pipeline = pipeline(
            decoder=Decoder(),
            gate=TrustGate(DRIVE, DEFAULT_EPOCH),
            placement=Placement(LOT, Alignment(), parameters.receiver.mounting, DEFAULT_EPOCH),
            predictor=Predictor(),
            sensors={"radar": GuardedSensor("radar", RadarSettings(), vehicle, np.random.default_rng(seeds[1]))},
            controller=Guarded(controller or follow_and_stop.make(vehicle, {})),
            vehicle=vehicle,
            path=path,
            desired_speed=speed,
            deviation_limit=deviation_limit,
        )
        self.gateway = Gateway(vehicle, calibration=parameters.calibration, period=PERIOD)
        self.silent_from = math.inf  #: drive time from which the gateway gets no setpoint [s]
        self._path, self._operator = path, ScriptedOperator()
        self._s: float | None = None

    def ticks(self) -> Iterator[Ticked]:
        """Tick after tick, for ever."""
        heard = CarOutput([], [])
        for tick in count():
            now = tick * PERIOD
            ticked, frames = self._tick(tick, now, heard, self._operator.next_command())
            self._operator.observe(ticked.status)
            heard = self.car.step((tick + 1) * PERIOD, frames)
            yield ticked

    def _tick(
        self, tick: int, now: float, heard: CarOutput, command: OperatorCommand | None
    ) -> tuple[Ticked, tuple[Frame, ...]]:
        pipeline, gateway = self.pipeline, self.gateway
        for time, data in heard.packets:
            pipeline.receive(time, data)
        steering = gateway.monitor.measured_steering
        pipeline.see(now, NOBODY)
        decided = pipeline.decide(tick, now, steering)
        setpoint = decided.setpoint if now < self.silent_from else None
        output = gateway.step(now, setpoint, [frame for _time, frame in heard.reports], command)
        pipeline.prepare(now + PERIOD, steering)
        truth = self.car.truth()
        beside = self._path.project(truth.x, truth.y, self._s)
        self._s = beside.s
        return Ticked(now, output.status, truth, beside.d, decided.faults), output.frames


class Slowing:
    """A controller that asks for steady braking from a drive time on, and steers as another one does."""

    def __init__(self, other: Controller, since: float, deceleration: float) -> None:
        self._other, self._since, self._deceleration = other, since, deceleration

    def step(self, observation: Observation) -> ControlCommand:
        setpoint = self._other.step(observation)
        if observation.time < self._since:
            return setpoint
        return replace(setpoint, acceleration=min(setpoint.acceleration, -self._deceleration))


@dataclass(frozen=True, slots=True)
class Came:
    """What came of a drive with a fault; times count from the fault's beginning."""

    noticed: float  #: until the gateway left ENGAGED [s]; inf never
    deviation: float  #: the true one's change when it did, in size [m]
    reasons: tuple[str, ...]  #: codes with which it did
    all_reasons: tuple[str, ...]  #: codes at the end
    speed: float  #: at the fault [m/s]
    way: float  #: driven from the fault to rest [m]; inf where it did not come to rest
    farthest: float  #: true deviation's greatest change, in size, until rest [m]
    began: float  #: drive time of the fault [s]
    let_go: float  #: fastest that the car was while the gateway said that it stood or let go [m/s]
    ended: str  #: the gateway's last state


def came_of(loop: ClosedLoop, at: float, seconds: float) -> Came:
    """Drive until the gateway is done, or `seconds` after a fault that begins `at` after the first motion [s]."""
    begun = math.inf
    first: Ticked | None = None
    noticed: Ticked | None = None
    way = farthest = let_go = speed = 0.0
    for ticked in loop.ticks():
        now, state = ticked.now, ticked.status.state
        if begun == math.inf and abs(ticked.truth.speed) > START_SPEED:
            begun = now + at
        if now < begun - PERIOD / 2:
            assert state is not ArmingState.STOPPING, f"stopped before its fault: {ticked.status.reasons}"
            assert now < 60.0, f"never moved: {ticked.status}"
            continue
        if first is None:
            first, speed = ticked, ticked.truth.speed
        way += ticked.truth.speed * PERIOD
        farthest = max(farthest, abs(ticked.deviation - first.deviation))
        if noticed is None and state is not ArmingState.ENGAGED:
            noticed = ticked
        if state not in (ArmingState.ENGAGED, ArmingState.STOPPING):
            let_go = max(let_go, abs(ticked.truth.speed))
        if loop.gateway.done or now > begun + seconds:
            rest = ticked.truth.speed == 0.0
            return Came(
                noticed=math.inf if noticed is None else noticed.now - begun,
                deviation=math.inf if noticed is None else abs(noticed.deviation - first.deviation),
                reasons=() if noticed is None else noticed.status.reasons,
                all_reasons=ticked.status.reasons,
                speed=speed,
                way=way if rest else math.inf,
                farthest=farthest,
                began=begun,
                let_go=let_go,
                ended=str(state),
            )
    raise AssertionError("ticks never end by themselves")
