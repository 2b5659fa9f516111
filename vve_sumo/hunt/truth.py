"""What is true at one tick of an episode, and what the gateway asks of the car: all that an invariant may judge by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from vve_sumo.values import ArmingState, Frame, Pose
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.interface import (
    ActuationCommand,
    Commanded,
    DriverInputs,
    Gear,
    InterfaceFacts,
    Malformed,
    Report,
    SimulatedInterface,
    VehicleInterface,
)


class WitnessedInterface:
    """A `VehicleInterface` that keeps the last command that it was asked to encode."""

    def __init__(self, interface: VehicleInterface) -> None:
        self._interface = interface
        self.command: ActuationCommand | None = None

    @property
    def facts(self) -> InterfaceFacts:
        """Return the interface's facts."""
        return self._interface.facts

    def encode(self, command: ActuationCommand) -> tuple[Frame, ...]:
        """Keep the command and return its frames."""
        self.command = command
        return self._interface.encode(command)

    def decode(self, frame: Frame) -> tuple[Report, ...] | Malformed:
        """Return the reports in a frame."""
        return self._interface.decode(frame)

    def commanded(self, frame: Frame) -> Commanded | None:
        """Return what a frame commands."""
        return self._interface.commanded(frame)

    def simulated(self, duration: float) -> SimulatedInterface:
        """Return the simulated DBW controller."""
        return self._interface.simulated(duration)


class TruthSample(NamedTuple):
    """One tick; no value of it is a report's, apart from the gateway's own state and reasons."""

    time: float  #: drive time [s]
    pose: Pose  #: of the rear axle in the lot's map
    driver: DriverInputs
    driver_brake_torque: float  #: that the driver's foot asks for [N m]
    gear: Gear  #: engaged
    enabled: tuple[bool, bool, bool]  #: whether brake, throttle and steering act on commands
    command: ActuationCommand  #: that the gateway sent last
    state: ArmingState
    reasons: Sequence[str]
    phase: str  #: on the operator's screen
    operator_command: OperatorCommand | None  #: that the operator gave in this tick
    went: bool  #: a go was given and not refused
    due: Mapping[str, float]  #: kinds of actions that are due now, with the least value; NaN for a kind without
