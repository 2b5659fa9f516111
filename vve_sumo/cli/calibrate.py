"""`vve-sumo calibrate`: identifies a car's parameters from short drives on its rig; writes the rig file."""

from __future__ import annotations

import argparse
import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.cli import live_drive
from vve_sumo.cli.console import notify
from vve_sumo.cli.parser import Parser, names
from vve_sumo.errors import ConfigError

if TYPE_CHECKING:
    from vve_sumo.commissioning.calibrate import Calibrated

EXIT_CODES = """exit codes:
  0  every parameter that a rig needs was identified
  1  a needed parameter is poor; nothing was written
  2  wrong use or configuration; nothing was written
  3  the rig is not ready, or the drive was cut short
  4  the simulation broke
  70  a defect of vve_sumo; its traceback says where
  130  interrupted from the keyboard
"""

SUMMARY = "identify a car's brakes, throttle, steering and delays from short drives"
TEXT = """\
Drive the calibration run on a rig (about 270 m straight ahead, 70 s) and fit brake and throttle maps,
steering ratio and bias, delays and the receiver's misalignment; each with its uncertainty and a verdict.
In a lot that is shorter, drive it in two parts (120 m each), and fit their records together.

examples:
  vve-sumo calibrate --rig simulated                  drive, fit, show
  vve-sumo calibrate --rig ours --write               also write the results, with the date, into rigs/ours.toml
  vve-sumo calibrate --rig ours --record runs/DIR     fit an existing record
  vve-sumo calibrate --rig ours --part pedals --out runs/pedals
  vve-sumo calibrate --rig ours --part steering --out runs/steering
  vve-sumo calibrate --rig ours --record runs/pedals runs/steering --write     fit both together
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("--rig", metavar="NAME", required=True, help="a name under rigs/ or a .toml file")
    parser.add_argument(
        "--record", type=Path, nargs="+", metavar="DIR", help="existing records to fit together, instead of driving"
    )
    parser.add_argument(
        "--part",
        choices=("pedals", "steering"),
        help="drive one part of it, on 120 m; then fit the records of both together",
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="record folder, absent or empty (default: under runs/)")
    live_drive.override_argument(parser)
    parser.add_argument("--write", action="store_true", help="change the rig file; comments stay")
    parser.add_argument(
        "--keep-values",
        type=names,
        default=(),
        metavar="KEY,KEY",
        help="poor parameters whose values in the rig file stay unchanged",
    )


def run(arguments: argparse.Namespace) -> int:
    """Drive unless a record is given, fit, show, and write the rig file with `--write`; return the exit code.

    Raises ConfigError before anything moves where the rig file may not be written or the record was altered, RigError
    where the drive was cut short.
    """
    from vve_sumo.commissioning import calibration_drive

    working = Path.cwd()
    rig_file = calibration_drive.rig_file_of(arguments.rig, working, write=arguments.write)
    if arguments.record is not None and arguments.part is not None:
        raise ConfigError("--part: is driven, and --record is not; leave one of them out")
    for record in arguments.record or ():
        calibration_drive.refuse_altered(record)
    folders = arguments.record if arguments.record is not None else [_drive(arguments, working)]
    today = datetime.date.today().isoformat()
    return conclude(folders, rig_file if arguments.write else None, today, arguments.keep_values)


def _drive(arguments: argparse.Namespace, working: Path) -> Path:
    from vve_sumo.commissioning import calibration_drive

    plan = calibration_drive.plan(arguments.rig, working, arguments.out, arguments.part)
    doctor = live_drive.examined(plan, arguments.override_doctor)  # before names are asked for
    plan = live_drive.named(plan, None, None)
    speed = plan.resolved.scenario.ego.speed_mps
    notify(
        f"calibration drive: {plan.resolved.path.length:.0f} m straight ahead at up to {speed:g} m/s, braking, "
        "coasting and steering gently in between; keep your foot over the brake"
    )
    calibration_drive.refuse_cut_short(live_drive.drive(plan, doctor), plan.folder)
    return plan.folder


def conclude(folders: Sequence[Path], rig_file: Path | None, date: str, keep_values: Sequence[str] = ()) -> int:
    """Fit, draw, show, and write into a rig's file where one is given; return the exit code.

    The exit code is 1 where a needed parameter is poor and no rig file was given; with one, that is a ConfigError.
    """
    from vve_sumo.commissioning.calibrate import calibrate, draw, put_into

    calibrated = calibrate(folders)
    _show(calibrated, draw(calibrated))
    if rig_file is None:
        return 1 if calibrated.poor else 0
    put_into(rig_file, calibrated, date, keep_values)
    print(f"written into {rig_file}, dated {date}")
    return 0


def _show(calibrated: Calibrated, picture: Path) -> None:
    from rich.console import Console
    from rich.table import Table

    from vve_sumo.commissioning.calibrate import NOTE, CalibrationRow, rows

    table = Table(title=f"Calibration from {', '.join(map(str, calibrated.folders))}", title_justify="left")
    for head in CalibrationRow._fields:
        table.add_column({"words": "", "uncertainty": "±"}.get(head, head))
    for row in rows(calibrated):
        colour = "red" if row.verdict.startswith("poor") else "green"
        table.add_row(*row[:-1], f"[{colour}]{row.verdict}[/{colour}]")
    console = Console(soft_wrap=True)
    console.print(table)
    console.print(NOTE, highlight=False, markup=False)
    console.print(f"picture: {picture}", highlight=False, markup=False)
