"""Holds what a live drive is, before any of its processes runs."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.record.layout import FURTHER_EGOS
from vve_sumo.rig.schema import Rig


@dataclass(frozen=True, slots=True)
class DrivePlan:
    """A live drive before any of its processes runs."""

    resolved: ResolvedScenario
    scenario_file: Path
    rig: Rig
    rig_file: Path
    folder: Path
    working: Path
    shadow: bool
    t0: float  #: monotonic second of drive time 0
    operator: str | None = None  #: who is at the console; None where nobody said
    driver: str | None = None  #: who sits behind the wheel
    view: bool = False  #: whether a page in a browser shows the drive
    foxglove: bool = False  #: whether that page's process serves topics for Foxglove and Lichtblick, too
    rehearsal: tuple[str, ...] = ()  #: of a rig on simulated wires, what differs from its file; empty for none
    further: tuple[
        DrivePlan, ...
    ] = ()  #: of each further real car, in the order of their ids; their egos are simulated

    @property
    def cars(self) -> tuple[DrivePlan, ...]:
        """The plan of every real car, that of [ego] first."""
        return (self, *self.further)

    @property
    def ego(self) -> str:
        """Id of the ego whose car this is."""
        return self.resolved.ego_id

    @property
    def simulated(self) -> tuple[ResolvedScenario, ...]:
        """The scenario of each simulated ego, alone."""
        real = {one.ego for one in self.further}
        return tuple(one for one in self.resolved.others if one.ego_id not in real)

    def folder_of(self, ego: str) -> Path:
        """Return the folder of a further ego's record."""
        return self.folder / FURTHER_EGOS / ego

    def clock(self) -> float:
        """Drive time [s]."""
        return time.monotonic() - self.t0
