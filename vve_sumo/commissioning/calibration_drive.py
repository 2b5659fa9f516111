"""`vve-sumo calibrate`: the calibration drive on a rig, or a record of one, and what was found into the rig file.

Leads from command to drive to fits; how the car is found in the record is `drive.calibrate`'s business.
"""

from __future__ import annotations

import datetime
import sys
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import Final

from vve_sumo import workspace
from vve_sumo.commissioning.calibrate import calibrate_command
from vve_sumo.drive.verify import alterations
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.live import command

SCENARIO: Final = "calibration"


def calibrate(
    rig: str,
    *,
    record: FilePath | None,
    out: FilePath | None,
    write: bool,
    leave: Sequence[str],
    scenario: str = SCENARIO,
) -> int:
    """Run the command: drive where no `record` is given, fit, show, and with `write` change the rig file.

    Raises ConfigError before anything moves where the rig file may not be written or the record was altered, RigError
    where the drive was cut short.
    """
    working = FilePath.cwd()
    rig_file = workspace.find("rig", rig, working)
    if write and not rig_file.resolve().is_relative_to(working.resolve()):
        raise ConfigError(
            f"{rig_file}: is not yours to write; lay out a workspace with vve-sumo init and copy it there"
        )
    if record is not None and (altered := alterations(record)):
        raise ConfigError(f"{record}: {altered[0]}: no car is calibrated by an altered record")
    folder = record if record is not None else _drive(scenario, rig, working, out)
    return calibrate_command(folder, rig_file if write else None, datetime.date.today().isoformat(), leave)


def _drive(scenario: str, rig: str, working: FilePath, out: FilePath | None) -> FilePath:
    made = command.plan(scenario, rig, working, out=out, seed=None, controller=None, shadow=False)
    made = command.named(made, None, None)
    speed = made.setting.scenario.ego.speed_mps
    print(
        f"calibration drive: {made.setting.path.length:.0f} m straight ahead at up to {speed:g} m/s, braking, coasting "
        "and steering gently in between; keep your foot over the brake",
        file=sys.stderr,
    )
    summary = command.live(made)
    if summary["outcome"] not in ("stopped", "arrived"):
        why = ", ".join(summary["reasons"]) or "see summary.json"
        raise RigError(f"the calibration drive ended as {summary['outcome']} ({why}): {made.folder}")
    return made.folder
