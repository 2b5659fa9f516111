"""The drive for a calibration: its preconditions, its plan, and whether it was completed.

`calibrate` identifies the car from its record.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from vve_sumo import workspace
from vve_sumo.drive.verify import alterations
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.live import session
from vve_sumo.live.plan import DrivePlan
from vve_sumo.rig.connections import Brain

SCENARIO: Final = "calibration"
#: of a part, and where that is chosen
SHORT_SCENARIO, PART = "calibration_short", "controller.tuning.part"


def rig_file_of(rig: str, working: Path, *, write: bool) -> Path:
    """Return a rig's file; with `write`, raises ConfigError where it lies outside of the working folder."""
    rig_file = workspace.find("rig", rig, working)
    if write and not rig_file.resolve().is_relative_to(working.resolve()):
        raise ConfigError(
            f"{rig_file}: is not yours to write; lay out a workspace with vve-sumo init and copy it there"
        )
    return rig_file


def refuse_altered(record: Path) -> None:
    """Raise ConfigError for a record that is not as its drive left it."""
    if altered := alterations(record):
        raise ConfigError(f"{record}: {altered[0]}: no car is calibrated by an altered record")


def plan(rig: str, working: Path, out: Path | None, part: str | None = None) -> DrivePlan:
    """Return the plan of the calibration drive or of a part, driven by its own controller, without outgoing wires.

    Raises ConfigError or RigError as `session.plan`, and ConfigError for an external controller that commands the car.
    """
    scenario, values = (SCENARIO, None) if part is None else (SHORT_SCENARIO, {PART: part})
    plan = session.plan(scenario, rig, working, out=out, seed=None, controller=None, shadow=False, values=values)
    if plan.rig.brain.kind == "external":
        raise ConfigError(
            f"{plan.rig_file}: brain.kind is 'external', expected 'own': the gateway has to command the car"
        )
    return replace(plan, rig=plan.rig.model_copy(update={"brain": Brain(), "outputs": ()}))


def refuse_cut_short(summary: Mapping[str, Any], folder: Path) -> None:
    """Raise RigError for a calibration drive that did not come to its end."""
    if summary["outcome"] not in ("stopped", "arrived"):
        reasons = ", ".join(summary["reasons"]) or "see summary.json"
        raise RigError(f"the calibration drive ended as {summary['outcome']} ({reasons}): {folder}")
