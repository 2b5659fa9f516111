"""One drive of a hunt: pipeline, tick, gateway and simulated vehicle as in a drive, on a road without SUMO.

Everything is in this process and without a clock, so a fork of the process goes on with the same drive.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from vve_sumo.controller import Controller
from vve_sumo.drive.assembly import PoseInput, build_pipeline, seed_of
from vve_sumo.drive.lockstep import car_parameters
from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH, ResolvedScenario
from vve_sumo.drive.standstill_cause import StandstillClassifier
from vve_sumo.drive.termination import Outcome, TerminationMonitor
from vve_sumo.drive.tick import CarInput, DueTick, EgoTick, NoRecord, Tick
from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.frames import Alignment, Placement
from vve_sumo.hunt.brains import BEHAVIOURS, Behaviour, TurningBrain
from vve_sumo.hunt.empty_road import EmptyRoad
from vve_sumo.hunt.episode import KEYS, Action, RoadConditions
from vve_sumo.hunt.truth import TruthSample, WitnessedInterface
from vve_sumo.live.wording import phase
from vve_sumo.lot.fallback import deferred_fallback_path
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.injected_faults import KINDS, START_SPEED, VALUES
from vve_sumo.pose.receivers.port import standard
from vve_sumo.pose.trust import DRIVE
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.schema import Rig
from vve_sumo.timing import PERIOD
from vve_sumo.values import EGO, Actors, ArmingState, Frame, GatewayStatus, Pose, Setpoint
from vve_sumo.vehicle.arming import COMMANDING, WAITING
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import load

#: how long a nominal operator waits with the go, and with the end of the drive once the car is at rest [s]
GO_AFTER, END_AFTER = 1.0, 2.0


@dataclass(frozen=True, slots=True)
class HuntSetup:
    """What all episodes of a hunt have in common: a scenario in a rig's lot, with the rig's car."""

    resolved: ResolvedScenario  #: with the rig's car
    rig: Rig
    working: Path

    def on(self, road: RoadConditions, seed: int) -> ResolvedScenario:
        """Return the scenario with other road conditions and another seed."""
        scenario = self.resolved.scenario
        car = scenario.ego.car.model_copy(
            update={
                "grade_percent": road.grade_percent,
                "mass_factor": road.mass_factor,
                "brake_gain_factor": road.brake_gain_factor,
            }
        )
        ego = scenario.ego.model_copy(update={"car": car})
        weather = scenario.weather.model_copy(update={"friction": road.friction})
        return replace(
            self.resolved, scenario=scenario.model_copy(update={"ego": ego, "weather": weather, "seed": seed})
        )


class HuntOperator:
    """Engages when the gateway is ready, says go after a while, and ends the drive when the car has come to rest.

    Keys of an episode come on top.
    """

    def __init__(self) -> None:
        self.keys: list[tuple[float, OperatorCommand]] = []  #: drive time [s] and command, in order of time
        self.engaged = False  #: the gateway has commanded the car
        self.went = False  #: a go was given and not refused
        self._waiting_since: float | None = None
        self._resting_since: float | None = None
        self._moved = self._ended = False

    def command(self, now: float, status: GatewayStatus | None, speed: float) -> OperatorCommand | None:
        """Return the command of a tick, by the newest status and the car's true speed [m/s]."""
        if self.keys and self.keys[0][0] <= now:
            return self.keys.pop(0)[1]
        if status is None:
            return None
        if status.state is ArmingState.READY and not self.engaged:
            return OperatorCommand.ENGAGE
        if status.state is ArmingState.FAULT and not self.engaged:
            return OperatorCommand.DISARM
        if status.state is ArmingState.ENGAGED and not self.went:
            return self._go(now, status)
        return self._end(now, status, speed)

    def _go(self, now: float, status: GatewayStatus) -> OperatorCommand | None:
        if WAITING not in status.reasons:
            self._waiting_since = None
            return None
        if self._waiting_since is None:
            self._waiting_since = now
        return OperatorCommand.GO if now - self._waiting_since >= GO_AFTER else None

    def _end(self, now: float, status: GatewayStatus, speed: float) -> OperatorCommand | None:
        self._moved |= speed > 0.5
        if not (self._moved and speed < 0.05 and status.state is ArmingState.ENGAGED):
            self._resting_since = None
            return None
        if self._resting_since is None:
            self._resting_since = now
        if self._ended or now - self._resting_since < END_AFTER:
            return None
        self._ended = True
        return OperatorCommand.END

    def observe(self, command: OperatorCommand | None, status: GatewayStatus) -> None:
        """Take note of a tick's command and the gateway's answer."""
        self.went &= status.state in COMMANDING
        self.engaged |= status.state in COMMANDING
        if command is OperatorCommand.GO and status.state is ArmingState.ENGAGED:
            self.went |= "go_too_early" not in status.reasons


class EpisodeDrive:
    """One drive, ticked from outside."""

    def __init__(self, course: HuntSetup, road: RoadConditions, seed: int) -> None:
        """Build the drive; raises ConfigError where something in the scenario is not usable."""
        resolved, rig = course.on(road, seed), course.rig
        self.resolved, self.rig = resolved, rig
        frame, lot = meaning.frame_of(rig), resolved.scenario.ego.lot
        at = rig.car_start or lot
        latitude, longitude = math.radians(at.latitude_deg), math.radians(at.longitude_deg)
        x, y = frame.to_map(latitude, longitude)
        heading = math.radians(90.0 - at.heading_deg) + frame.convergence(latitude, longitude)
        begin = resolved.path.at(0.0)
        self.alignment = Alignment.from_matched_start(
            pose_at_rest(x, y, heading), pose_at_rest(begin.x, begin.y, begin.heading)
        )
        placement = Placement(frame, self.alignment, resolved.model.mounting, DEFAULT_EPOCH)
        geofence = meaning.geofence_of(rig, self.alignment)
        pose = PoseInput(standard().decoder(), DRIVE, placement, DEFAULT_EPOCH, geofence=geofence)
        # The gateway is in this process: a fallback path is computed when a stop or the geofence needs it.
        pipeline = build_pipeline(resolved, pose, course.working, fallback=deferred_fallback_path, around=self._around)
        model = resolved.model
        self.parameters = car_parameters(resolved)
        self._witness = WitnessedInterface(load(model.interface))
        self.gateway = Gateway(
            model.vehicle,
            model.calibration,
            model.limits,
            period=PERIOD,
            interface=self._witness,
            wheel_bias=model.steering_wheel_bias,
        )
        self._car = FaultInjectedCar(
            self.parameters,
            (x, y, heading),
            frame,
            DEFAULT_EPOCH,
            seed_of(seed, "vehicle"),
            (),
            seed_of(seed, "faults"),
        )
        self.road = EmptyRoad(resolved)
        self._ego = EgoTick(EGO, pipeline, resolved.path, self, NoRecord())
        self._tick = Tick([self._ego], self.road)
        self._termination = TerminationMonitor(resolved.path.length, resolved.scenario.after_stop_s)
        self._standstill_classifier = StandstillClassifier(resolved.scenario, resolved.path, resolved.vehicle)
        self.operator = HuntOperator()
        self._operator_command: OperatorCommand | None = None
        self._status: GatewayStatus | None = None
        self._reports: list[Frame] = []
        self._frames: Sequence[Frame] = ()
        self._actions: tuple[tuple[str, float, float, float], ...] = ()
        self.number = 0  #: of the next tick
        self.moved = math.nan  #: drive time at which the car first moved [s]
        self.outcome: Outcome | None = None  #: that the drive would have by now
        self.ended_because: tuple[str, ...] = ()  #: reasons of the gateway at that outcome
        self.s = math.nan  #: distance along the path [m]
        self.requested_acceleration = math.nan  #: acceleration that the setpoint asks for [m/s2]

    def _around(self, own: Controller) -> Controller:
        self._brain = TurningBrain(own)
        return self._brain

    @property
    def now(self) -> float:
        """Drive time of the next tick [s]."""
        return self.number * PERIOD

    def begin(self, actions: Sequence[Action]) -> None:
        """Let a timeline of actions set in with the next tick."""
        now = self.now
        self._car.inject([one.fault(now) for one in actions if one.kind in KINDS])
        self._brain.behaviours = [
            Behaviour(one.kind, now + one.after, now + one.end) for one in actions if one.kind in BEHAVIOURS
        ]
        self.operator.keys = sorted(
            ((now + one.after, KEYS[one.kind]) for one in actions if one.kind in KEYS), key=lambda key: key[0]
        )
        self._actions = tuple((one.kind, now + one.after, now + one.end, _value_of(one)) for one in actions)

    def faults(self) -> tuple[str, ...]:
        """Return no reason codes: this shell has no faults of its own."""
        return ()

    def hand_over(self, now: float, setpoint: Setpoint | None) -> GatewayStatus:
        """Run one gateway step on what reaches it of a setpoint, and on the car's newest reports."""
        self._operator_command = self.operator.command(now, self._status, self._car.speed)
        sent = self._brain.sent(now, setpoint)
        output = self.gateway.step(now, sent, self._reports, self._operator_command)
        self.operator.observe(self._operator_command, output.status)
        self._status, self._frames = output.status, output.frames
        self.requested_acceleration = math.nan if setpoint is None else setpoint.acceleration
        return output.status

    def step(self) -> TruthSample:
        """Run a tick and return what is true at it."""
        number, now = self.number, self.now
        truth = self._car.truth()
        due = DueTick(number, now, now + PERIOD)
        done = self._tick.step(due, {EGO: CarInput(self.gateway.monitor.measured_steering)})[EGO]
        self.s = done.result.s
        self._watch_for_the_end(now, truth, done.actors)
        sample = self._sample(now, truth)
        came = self._car.step((number + 1) * PERIOD, self._frames)
        self._reports = [frame for _time, frame in came.reports]
        for time, data in came.packets:
            self._ego.receive(time, data)
        self.number += 1
        if math.isnan(self.moved) and abs(truth.speed) > START_SPEED:
            self.moved = now
        return sample

    def _watch_for_the_end(self, now: float, truth: Pose, actors: Actors) -> None:
        assert self._status is not None
        ahead = partial(self._standstill_classifier.classify, self.alignment.apply(truth), self.s, actors)
        contact = bool(self.road.around[EGO].contacts)
        outcome = self._termination.step(
            now, truth.speed, self.s, self._status.state, self._status.reasons, contact, ahead
        )
        if self.outcome is None and outcome is not None:
            self.outcome, self.ended_because = outcome, tuple(self._status.reasons)

    def _sample(self, now: float, truth: Pose) -> TruthSample:
        status, command, car = self._status, self._witness.command, self._car
        assert status is not None and command is not None  # noqa: PT018
        interface = car.car.interface
        words: dict[str, Any] = {
            "state": status.state,
            "reasons": status.reasons,
            "engaged": self.operator.engaged,
            "went": self.operator.went,
            "gear": self.gateway.monitor.gear,
        }
        return TruthSample(
            time=now,
            pose=truth,
            driver=car.driver_inputs,
            driver_brake_torque=interface.driver_brake_torque,
            gear=interface.gear,
            enabled=interface.enabled,
            command=command,
            state=status.state,
            reasons=status.reasons,
            phase=phase(words),
            operator_command=self._operator_command,
            went=self.operator.went,
            due=self._due(now),
        )

    def _due(self, now: float) -> dict[str, float]:
        due: dict[str, float] = {}
        for kind, begin, end, value in self._actions:
            if begin <= now < end:
                due[kind] = min(due.get(kind, value), value)
        return due


def _value_of(action: Action) -> float:
    """Return an action's value, or its kind's default; NaN where the kind takes none."""
    usual = VALUES[action.kind][0] if action.kind in VALUES else math.nan
    return usual if math.isnan(action.value) else action.value
