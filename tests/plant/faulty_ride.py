"""A car with injected faults that shifts to drive and pulls away: what it said, and where it truly was."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests import vehicles
from tests.plant.test_car import EPOCH, LOT, START, commands
from vve_sumo.frames import Alignment, Placement
from vve_sumo.plant.car import STEP
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.injected_faults import START_SPEED, InjectedFault
from vve_sumo.pose.ncom import Decoder
from vve_sumo.pose.trust import DRIVE, TrustGate
from vve_sumo.values import Frame, Pose
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.interface import InterfaceConfig

AT, DURATION = 1.0, 0.5  # of the fault, from the first motion
PARAMETERS = vehicles.parameters(noise=0.0)
Packets = list[tuple[float, bytes]]


Course = Callable[[float], tuple[float, float, float]]  # of time: brake torque, throttle, angle of the steering wheel


def straight(now: float) -> tuple[float, float, float]:
    """Stand on the brakes, then pull away."""
    return (1500.0, 0.0, 0.0) if now < 1.0 else (0.0, 0.3, 0.0)


def lively(now: float) -> tuple[float, float, float]:
    """The same, then brake with a foot on the throttle, and turn the wheel to and fro."""
    swing = math.sin(3.0 * now)
    torque, throttle, _ = (400.0 + 100.0 * swing, 0.05 + 0.04 * swing, 0.0) if now > 2.4 else straight(now)
    return torque, throttle, 0.5 * swing


class Ride:
    """A car with injected faults that shifts to drive and pulls away straight, for some seconds."""

    def __init__(
        self,
        *faults: InjectedFault,
        seconds: float = 5.0,
        seed: int = 3,
        variant: codec.Variant = codec.Variant.DBW1_2024,
        course: Course = straight,
    ) -> None:
        self._course = course
        parameters = replace(PARAMETERS, interface=InterfaceConfig("dataspeed_dbw1", {"variant": variant.name.lower()}))
        seeds, others = np.random.SeedSequence(1), np.random.SeedSequence(seed)
        self._whole = FaultInjectedCar(parameters, START, LOT, EPOCH, seeds, faults, others)
        self.car = self._whole.car
        self.variant = variant
        self.began = math.inf  # when the car first moved
        self.packets: Packets = []
        self.frames: list[tuple[float, Frame]] = []
        self.enabled: list[tuple[float, tuple[bool, ...]]] = []
        self.truths: dict[float, Pose] = {}
        for step in range(round(seconds / STEP)):
            self._step(step)
        self.decoder = Decoder()
        self.fixes = [fix for time, data in self.packets for fix in self.decoder.feed(data, time)]

    def _step(self, step: int) -> None:
        now, until = step * STEP, (step + 1) / 200
        sent = commands(step // 4, self._course(now)) if step % 4 == 0 else []
        output = self._whole.step(until, sent)
        truth = self.car.truth()
        if truth.speed > START_SPEED:
            self.began = min(self.began, until)
        self.truths[round(until, 3)] = truth
        self.packets += output.packets
        self.frames += output.reports
        self.enabled.append((until, tuple(module.enabled for module in self.car.interface.controller.modules)))

    def during(self, time: float) -> bool:
        """Whether the fault is on."""
        return self.began + AT <= time < self.began + AT + DURATION

    def touched(self, time: float) -> bool:
        """Whether the fault, or what hangs over from it, may show; a little generous at both ends."""
        return self.began + AT - 0.02 <= time < self.began + AT + DURATION + 0.03

    def said(self, kind: type) -> list[tuple[float, object]]:
        """What the reports of one kind say."""
        said = [(time, codec.decode(frame, self.variant)) for time, frame in self.frames]
        return [(time, message) for time, message in said if isinstance(message, kind)]

    def untrusted(self) -> set[str]:
        """Reasons of the trust gate during the fault."""
        gate, reasons = TrustGate(DRIVE, EPOCH), set()
        for fix in self.fixes:
            reason = gate.step(fix.time_received, fix).reasons
            if self.touched(fix.time - EPOCH):
                reasons |= set(reason)
        return reasons


def fault(kind: str, value: float = math.nan) -> InjectedFault:
    return InjectedFault(kind, AT, DURATION, value)


def off(ride: Ride, pose: Pose) -> tuple[float, float]:
    """How far a pose lies from the truth of its time: ahead and to the left [m]."""
    truth = ride.truths[round(pose.time, 3)]
    cos, sin = math.cos(truth.heading), math.sin(truth.heading)
    x, y = pose.x - truth.x, pose.y - truth.y
    return cos * x + sin * y, cos * y - sin * x


def poses(ride: Ride) -> list[Pose]:
    """The fixes as poses of the rear axle in the lot."""
    placement = Placement(LOT, Alignment(), PARAMETERS.receiver.mounting, EPOCH)
    return [placement.place(fix) for fix in ride.fixes]
