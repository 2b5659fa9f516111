"""Holds what a live drive is, before any of its processes runs."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from vve_sumo.drive.resolved_scenario import ResolvedScenario
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
    rehearsal: tuple[str, ...] = ()  #: of a rig on simulated wires, what differs from its file; empty for none

    def clock(self) -> float:
        """Drive time [s]."""
        return time.monotonic() - self.t0
