"""A drive-by-wire interface under test: on a bench with its simulated other end, and between gateway and vehicle."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from tests import vehicles
from vve_sumo.commissioning import interface_bench as bench
from vve_sumo.commissioning.interface_bench import HELD, NEUTRAL, STANDING, SUBSYSTEMS
from vve_sumo.commissioning.interface_drive import Drive
from vve_sumo.values import ArmingState
from vve_sumo.vehicle.interface import HANDS_OFF, ActuationCommand, DriverInputs, InterfaceConfig

__all__ = ["CALIBRATION", "HELD", "NEUTRAL", "PERIOD", "STANDING", "SUBSYSTEMS", "Bench", "engaged_drive"]

PERIOD: Final = 0.02  # of the gateway [s]
#: How the bench's car turns an acceleration into pedals.
CALIBRATION: Final = vehicles.FUSION.calibration


class Bench(bench.Bench):
    """The bench, on which every report has to be understood while no fault is put on."""

    def __init__(self, config: InterfaceConfig) -> None:
        super().__init__(config, CALIBRATION)

    def run(self, seconds: float, command: ActuationCommand | None, driver: DriverInputs = HANDS_OFF) -> None:
        super().run(seconds, command, driver)
        assert self.fault is not None or not self.malformed, self.malformed

    def restore(self) -> None:
        super().restore()
        self.malformed = set()

    def engaged(self) -> Bench:
        """Enable everything, on the brakes."""
        self.run(0.1, NEUTRAL)
        self.run(0.3, HELD)
        assert all(self.enabled())
        return self


def engaged_drive(config: InterfaceConfig) -> Drive:
    """Return gateway and simulated vehicle on the interface, free to go."""
    drive = Drive(replace(vehicles.FUSION, interface=config))
    drive.engage()
    assert drive.state is ArmingState.ENGAGED, drive.reasons
    return drive
