"""The simulated vehicle with a drive's faults injected into its outputs and its inputs.

It works the same in lockstep and in real time, without a clock or I/O.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from vve_sumo.frames import MapFrame
from vve_sumo.plant.car import STEPS_PER_SECOND, Car, CarOutput, CarParameters
from vve_sumo.plant.fault_injector import FaultInjector
from vve_sumo.plant.injectable import require_injectable
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.plant.receiver import unaltered
from vve_sumo.pose.receivers.port import Receiver, standard
from vve_sumo.values import Fix, Frame, Pose
from vve_sumo.vehicle.interface import HANDS_OFF, Measured


class FaultInjectedCar:
    """A `Car` (see there for the arguments) and its `FaultInjector`, stepped together; the driver is the injector's.

    `alter` comes before the injector: the injector alters the fix that `alter` returns. Raises ConfigError for a fault
    that cannot be injected through the car's interface or its receiver, which is the standard one without another.
    """

    def __init__(
        self,
        parameters: CarParameters,
        start: tuple[float, float, float],
        lot: MapFrame,
        epoch: float,
        seeds: np.random.SeedSequence,
        faults: Iterable[InjectedFault],
        fault_seeds: np.random.SeedSequence,
        alter: Callable[[Fix], Fix | None] = unaltered,
        receiver: Receiver | None = None,
    ) -> None:
        self._alter, self._seeds, self._interface = alter, fault_seeds, parameters.interface
        self._receiver = standard() if receiver is None else receiver
        self.inject(faults)
        self.car = Car(parameters, start, lot, epoch, seeds, self._on_fix, self._on_measured, self._receiver)
        self.driver_inputs = HANDS_OFF  #: what the driver truly does in the newest step
        self._steps = 0

    def inject(self, faults: Iterable[InjectedFault]) -> None:
        """Inject `faults` in place of those before; raises ConfigError as the constructor does."""
        faults = tuple(faults)
        require_injectable(faults, self._interface, self._receiver)
        self._injector = FaultInjector(faults, self._seeds, self._interface, self._receiver)

    def step(self, until: float, frames: Sequence[Frame]) -> CarOutput:
        """Take in `frames`, advance to drive time `until` [s], a multiple of 5 ms; return the output until then."""
        output, last = CarOutput([], []), round(until * STEPS_PER_SECOND)
        while self._steps < last:
            step_output = self._step(frames)
            output.reports.extend(step_output.reports)
            output.packets.extend(step_output.packets)
            frames = ()
        return output

    @property
    def speed(self) -> float:
        """True speed of the rear axle [m/s], forward positive."""
        return self.car.speed

    def truth(self) -> Pose:
        """True pose of the rear axle in the lot map."""
        return self.car.truth()

    def _on_fix(self, fix: Fix) -> Fix | None:
        altered = self._alter(fix)
        return None if altered is None else self._injector.on_fix(altered)

    def _on_measured(self, time: float, measured: Measured) -> Measured:
        return self._injector.on_measured(time, measured)

    def _step(self, frames: Sequence[Frame]) -> CarOutput:
        injector, car, now = self._injector, self.car, self._steps / STEPS_PER_SECOND
        commands = injector.on_commands(now, frames)
        injector.on_car(now, car)
        self.driver_inputs = injector.driver(now)
        self._steps += 1
        until = self._steps / STEPS_PER_SECOND
        output = car.step(until, commands, self.driver_inputs)
        injector.moves(until, car.speed)
        return CarOutput(
            injector.on_reports(until, output.reports, car.interface), injector.on_packets(until, output.packets)
        )
