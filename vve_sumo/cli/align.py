"""`vve-sumo align`: where a scenario's path lies in a rig's lot, shown, agreed to and stored."""

from __future__ import annotations

import argparse
import datetime
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.cli.console import notify
from vve_sumo.cli.parser import Parser
from vve_sumo.errors import ConfigError, RigError

if TYPE_CHECKING:
    from vve_sumo.commissioning.align import AlignmentResult, AlignmentSite

EXIT_CODES = """exit codes:
  0  the path fits there; with --write it is in the rig file
  2  wrong use or configuration; nothing was written
  3  the path does not fit, or the receiver tells no place; nothing was written
  70  a defect of vve_sumo; its traceback says where
  130  interrupted from the keyboard
"""

SUMMARY = "lay a scenario's path into a rig's lot and store how"
TEXT = """\
Find how the lot lies on the virtual street, say whether the path fits, and write it into the rig file.

examples:
  vve-sumo align --rig ours                     the car stands at the path's start: make that the start
  vve-sumo align --rig ours --pairs places.csv   by places that were surveyed in the lot and on the street
  vve-sumo align --rig ours --fit --picture lot.png   no car needed: where the path has most room
  vve-sumo align --rig ours --fit --write-shortened-path short.csv   where it does not fit, the part that does
"""


def arguments(parser: Parser) -> None:
    """Add what the command takes."""
    parser.add_argument("scenario", nargs="?", default="parked_car", help="name or .toml file (default: parked_car)")
    parser.add_argument("--rig", metavar="NAME", required=True, help="a name under rigs/ or a .toml file")
    how = parser.add_mutually_exclusive_group()
    how.add_argument(
        "--pairs",
        type=Path,
        metavar="FILE",
        help="CSV with lot_latitude_deg, lot_longitude_deg and street_x_m, street_y_m (or street_latitude_deg, "
        "street_longitude_deg), two rows or more",
    )
    how.add_argument("--fit", action="store_true", help="search the turn and shift that leave most room")
    parser.add_argument(
        "--write-shortened-path", type=Path, metavar="CSV", help="with --fit: write what fits of a path too long"
    )
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw lot, path and start as a PNG file")
    parser.add_argument(
        "--write", action="store_true", help="change the rig file without asking; --fit changes it only with this"
    )


def run(arguments: argparse.Namespace) -> int:
    """Find how the path lies in the lot, show it, and store it where that was agreed to; return the exit code, 0.

    `--write` agrees beforehand; a search stores with it only. Raises RigError where what was to be stored does not
    keep the path inside the lot.
    """
    from vve_sumo.commissioning import align

    shortened: Path | None = arguments.write_shortened_path
    if shortened is not None and not arguments.fit:
        raise ConfigError("--write-shortened-path: only --fit finds where a path may end")
    site = align.site_of(arguments.scenario, arguments.rig, Path.cwd())
    result = _found(site, arguments)
    for line in (*result.evidence, *align.description(site, result)):
        print(line)
    if arguments.picture is not None:
        _draw(site, result, arguments.picture)
    whole = result.whole
    if shortened is not None and not whole:
        length = align.cut(site, result, shortened).length
        print(f"the first {length:.0f} m of the path written to {shortened}")
        for line in align.beyond(site, length):
            print(line)
        whole = True
    if not whole:
        advice = (
            "--write-shortened-path writes the part that fits"
            if arguments.fit
            else "--fit looks for a place where it does"
        )
        raise RigError(f"{site.rig_file}: the path does not fit the lot there, nothing is stored; {advice}")
    if arguments.write or (not arguments.fit and _agreed()):
        today = datetime.date.today()
        align.store(site, result, today)
        print(f"stored in {site.rig_file}, dated {today}")
    return 0


def _found(site: AlignmentSite, arguments: argparse.Namespace) -> AlignmentResult:
    from vve_sumo.commissioning import align

    if arguments.fit:
        notify("searching, which takes longer where the path does not fit")
        return align.searched(site)
    if arguments.pairs is not None:
        return align.paired(site, arguments.pairs)
    return align.matched(site, notify)


def _draw(site: AlignmentSite, result: AlignmentResult, file: Path) -> None:
    from vve_sumo.plotting.alignment import PathInLot, draw

    shown = PathInLot(
        path_name=site.resolved.scenario.ego.path,
        lot_name=site.rig_file.stem,
        path=site.resolved.path,
        speed=site.speed,
        vehicle=site.resolved.vehicle,
        geofence=site.geofence,
        alignment=result.alignment,
        fit=result.fit,
    )
    draw(shown, file)
    print(f"picture: {file}")


def _agreed() -> bool:
    """Ask whoever is at the keyboard; nobody there is no agreement."""
    print("Enter stores it, anything else leaves the rig as it is: ", end="", flush=True)
    return sys.stdin.readline() == "\n"
