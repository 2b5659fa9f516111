"""Injects faults and the driver's actions at stated times, to test what a drive must survive.

It alters what passes between the simulated vehicle and the rest; it knows no gateway, no clock and no I/O.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from vve_sumo.plant.car import HEALTHY, ActuatorFaults, Car
from vve_sumo.plant.injected_faults import (
    DRIVER_ACTIONS,
    MAX_REPORT_AGE,
    POSE_KINDS,
    ROUNDING,
    Due,
    InjectedFault,
)
from vve_sumo.plant.receiver_faults import Forger, ReceiverFaults, WrongMinute
from vve_sumo.plant.sensor_faults import SensorFaults
from vve_sumo.pose.receivers.port import Receiver, standard
from vve_sumo.values import Fix, Frame
from vve_sumo.vehicle.interface import (
    HANDS_OFF,
    PEDAL_REST,
    ActuationCommand,
    BrakeState,
    DriverInputs,
    Gear,
    InterfaceConfig,
    Measured,
    SimulatedInterface,
    load,
)

MAX_GARBAGE_LENGTH: Final = 150  # bytes; about two packets

#: Kinds of fault of the car's actuators, and what each sets.
ACTUATOR_KINDS: Final = {
    "brakes_weak": "brake_share",
    "brakes_drag": "brake_drag",
    "drive_unasked": "stuck_throttle",
    "throttle_weak": "drive_share",
    "steering_weak": "steering_share",
}


class OldReports:
    """Sends reports again that are older, between the fresh ones."""

    def __init__(self, due: Due) -> None:
        self._due = due
        self._sent: dict[int, deque[tuple[float, Frame]]] = {}  # by identifier, the oldest first
        self._turns: dict[int, int] = {}  # reports since the fault began, by identifier

    def insert(self, time: float, frame: Frame) -> list[tuple[float, Frame]]:
        """Return time and frame of a report that is sent at `time`, with the old one that follows it."""
        if not self._due.ever("reports_old"):
            return [(time, frame)]
        sent = self._sent.setdefault(frame.id, deque())
        sent.append((time, frame))
        while sent[0][0] < time - MAX_REPORT_AGE:
            sent.popleft()
        age = self._due.value("reports_old", time)
        turn = self._turns[frame.id] = 0 if age is None else self._turns.get(frame.id, 0) + 1
        if age is None or turn % 2 == 0:
            return [(time, frame)]
        old = [before for when, before in sent if when <= time - age + ROUNDING]
        return [(time, frame), *((time, before) for before in old[-1:])]


class FaultInjector:
    """The faults of one drive; every method may be called at every step and does nothing while no fault is due.

    Times are drive times [s]. `seeds` are for the random bytes; `interface` and `receiver` are the car's, which is
    the standard one without another.
    """

    def __init__(
        self,
        faults: Iterable[InjectedFault],
        seeds: np.random.SeedSequence,
        interface: InterfaceConfig,
        receiver: Receiver | None = None,
    ) -> None:
        receiver = standard() if receiver is None else receiver
        self._due = due = Due(faults)
        self._random = np.random.Generator(np.random.PCG64(seeds))
        self._fixes, self._minute = ReceiverFaults(due), WrongMinute(due, receiver.encoder())
        self._forger = Forger(due, receiver)
        self._sensors, self._old = SensorFaults(due, self._random), OldReports(due)
        self._writer = load(interface)  # the other writer's
        kinds = self._writer.facts.reports.items()
        self._brake_reports = frozenset(number for number, reported in kinds if BrakeState in reported)
        self._packets = 0
        # What is injected at all: nothing else needs to be looked for in every step.
        self._packets_altered, self._driver_acts = due.ever(*POSE_KINDS), due.ever(*DRIVER_ACTIONS)
        self._car_fails = due.ever(*ACTUATOR_KINDS, "steering_stuck", "dbw_dropout")
        self._car_restored = False  # from what was injected before
        self._postponed: bytes | None = None  # packet that is sent after its successor
        self._delayed: deque[tuple[float, bytes]] = deque()  # moment of release and packet
        self._foreign: list[Frame] = []  # the other writer's frames that the DBW controller has not yet received

    def moves(self, time: float, speed: float) -> None:
        """Take note of the car's speed [m/s]; most faults' times count from when it first moves."""
        self._due.moves(time, speed)

    def on_fix(self, fix: Fix) -> Fix | None:
        """Return the fix to be sent in place of `fix`, or None; its `time_received` says when it was measured."""
        return self._fixes.alter(fix)

    def on_measured(self, time: float, measured: Measured) -> Measured:
        """Return what the car's own sensors say at `time` in place of what they `measured`."""
        return self._sensors.alter(time, measured)

    def on_packets(self, now: float, packets: Sequence[tuple[float, bytes]]) -> list[tuple[float, bytes]]:
        """Return what arrives by `now`, of `packets` (time of arrival and bytes) and of what was held back before."""
        for time, packet in packets:
            for piece in self._mangled(time, packet):
                # No packet overtakes the one before it: a network path is a queue.
                earliest = self._delayed[-1][0] if self._delayed else time
                self._delayed.append((max(earliest, self._release(time)), piece))
        arrived: list[tuple[float, bytes]] = []
        while self._delayed and self._delayed[0][0] <= now + ROUNDING:
            arrived.append(self._delayed.popleft())
        if not self._holding(now):
            arrived += [(now, piece) for _, piece in self._delayed]
            self._delayed.clear()
        return arrived

    def on_reports(
        self, now: float, reports: Sequence[tuple[float, Frame]], interface: SimulatedInterface
    ) -> list[tuple[float, Frame]]:
        """Return time and frame of all on the car's bus up to `now`, by the `reports` of the car's `interface`."""
        dead = self._due.value("bus_silent", now) is not None
        if dead or self._due.value("reports_stale", now) is not None:
            return []
        heard = []
        for time, frame in reports:
            if frame.id in self._brake_reports and (torque := self._due.value("another_writer", time)) is not None:
                written = self._written(torque)
                self._foreign += written
                # Before the report: a lockstep record tells them from the gateway's frames by that.
                heard += [(time, foreign) for foreign in written]
            heard += self._old.insert(time, interface.alter(time, frame, self._due.value))
        return heard

    def on_commands(self, now: float, commands: Sequence[Frame]) -> list[Frame]:
        """Return the frames that the DBW controller receives at `now`, from the `commands` on the bus."""
        foreign, self._foreign = self._foreign, []
        value = self._due.value
        lost = value("bus_silent", now) is not None or value("commands_lost", now) is not None
        return [] if lost else [*commands, *foreign]

    def driver(self, now: float) -> DriverInputs:
        """Return what the driver does at `now`."""
        if not self._driver_acts:
            return HANDS_OFF
        value = self._due.value
        brake = max(value("driver_touch", now) or PEDAL_REST, value("brake_override", now) or PEDAL_REST)
        throttle = value("throttle_override", now) or PEDAL_REST
        torque, lever = value("steering_override", now) or 0.0, value("gear_lever", now)
        gear = Gear.NONE if lever is None else Gear(int(lever))
        inputs = DriverInputs(brake, throttle, torque, gear=gear)
        return HANDS_OFF if inputs == HANDS_OFF else inputs

    def on_car(self, now: float, car: Car) -> None:
        """Make the car's modules and actuators fail while a fault is due, and restore them."""
        if self._car_restored and not self._car_fails:
            return
        self._car_restored = True
        value = self._due.value
        broken = value("dbw_dropout", now)
        car.interface.drop_out(None if broken is None else int(broken))
        wrong = {name: size for kind, name in ACTUATOR_KINDS.items() if (size := value(kind, now)) is not None}
        if value("steering_stuck", now) is not None:
            wrong["steering_share"] = 0.0
        car.actuator_faults = ActuatorFaults(**wrong) if wrong else HEALTHY

    def _mangled(self, time: float, packet: bytes) -> list[bytes]:
        """The packets that replace `packet`, in order."""
        if not self._packets_altered:
            return [packet]
        packet = self._minute.alter(time, packet)
        pieces = self._forger.surround(time, packet)
        if (period := self._due.value("pose_garbage", time)) is not None:
            self._packets += 1
            pieces = [self._garbage()] if self._packets % int(period) == 0 else [self._garbage(), *pieces]
        if self._due.value("pose_duplicates", time) is not None:
            pieces = [piece for piece in pieces for _ in range(2)]
        kept, self._postponed = self._postponed, None
        if self._due.value("pose_reordered", time) is None:
            return pieces if kept is None else [kept, *pieces]
        if kept is not None:
            return [*pieces, kept]
        self._postponed = pieces.pop()
        return pieces

    def _garbage(self) -> bytes:
        return self._random.bytes(int(self._random.integers(1, MAX_GARBAGE_LENGTH + 1)))

    def _holding(self, time: float) -> bool:
        return self._due.value("pose_late", time) is not None or self._due.value("pose_bursts", time) is not None

    def _release(self, time: float) -> float:
        """When a packet that arrived at `time` is released."""
        time += self._due.value("pose_late", time) or 0.0
        if (bursts := self._due.share("pose_bursts", time)) is not None:
            begun, period = bursts.began, bursts.value
            time = begun + math.ceil((time - begun) / period - ROUNDING) * period
        return time

    def _written(self, torque: float) -> list[Frame]:
        """The other writer's frames: brakes and straight steering, and throttle only where it shares their frame."""
        frames = self._writer.encode(ActuationCommand(torque, 0.0, 0.0, 0.0, Gear.NONE, enable=True, clear=False))
        commands = [(frame, self._writer.commanded(frame)) for frame in frames]
        return [
            frame
            for frame, command in commands
            if command is not None and not (math.isnan(command.brake_torque) and math.isnan(command.wheel_angle))
        ]
