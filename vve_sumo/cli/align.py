"""`vve-sumo align`: finds how a scenario's path lies in a rig's lot, shows it, stores it on confirmation."""

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
  3  the path does not fit, or the receiver reports no position; nothing was written
  70  a defect of vve_sumo; its traceback says where
  130  interrupted from the keyboard
"""

SUMMARY = "align a scenario's path with a rig's lot and store the alignment"
TEXT = """\
Find the alignment of the lot with the virtual road, report whether the path fits the lot, and write the alignment into
the rig file.

examples:
  vve-sumo align --rig ours                     align the path's start with the standing car
  vve-sumo align --rig ours --pairs places.csv   by points surveyed in the lot and on the road
  vve-sumo align --rig ours --fit --picture lot.png   no car needed: the alignment with the largest clearance
  vve-sumo align --rig ours --fit --write-shortened-path short.csv   write the part of the path that fits
"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    parser.add_argument("scenario", nargs="?", default="parked_car", help="name or .toml file (default: parked_car)")
    parser.add_argument("--rig", metavar="NAME", required=True, help="a name under rigs/ or a .toml file")
    method = parser.add_mutually_exclusive_group()
    method.add_argument(
        "--pairs",
        type=Path,
        metavar="FILE",
        help="CSV with lot_latitude_deg, lot_longitude_deg and street_x_m, street_y_m (or street_latitude_deg, "
        "street_longitude_deg), two rows or more",
    )
    method.add_argument("--fit", action="store_true", help="search the rotation and shift with the largest clearance")
    parser.add_argument(
        "--write-shortened-path",
        type=Path,
        metavar="CSV",
        help="with --fit: write the part that fits of a path that is too long",
    )
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw lot, path, corridor and start as a PNG file")
    parser.add_argument(
        "--write", action="store_true", help="change the rig file without asking; --fit changes it only with this"
    )


def run(arguments: argparse.Namespace) -> int:
    """Find how the path lies in the lot, show it, and store it after confirmation; return the exit code, 0.

    `--write` confirms beforehand; the result of `--fit` is stored with `--write` only. Raises RigError where the path
    leaves the lot.
    """
    from vve_sumo.commissioning import align

    shortened: Path | None = arguments.write_shortened_path
    if shortened is not None and not arguments.fit:
        raise ConfigError("--write-shortened-path: expected --fit, which finds where the path may end")
    site = align.site_of(arguments.scenario, arguments.rig, Path.cwd())
    result = _alignment_result(site, arguments)
    for line in (*result.evidence, *align.description(site, result)):
        print(line)
    if arguments.picture is not None:
        _draw(site, result, arguments.picture)
    fits = result.whole
    if shortened is not None and not fits:
        length = align.cut(site, result, shortened).length
        print(f"the first {length:.0f} m of the path written to {shortened}")
        for line in align.beyond(site, length):
            print(line)
        fits = True
    if not fits:
        advice = (
            "--write-shortened-path writes the part that fits"
            if arguments.fit
            else "--fit searches for an alignment that fits"
        )
        raise RigError(
            f"{site.rig_file}: the path does not fit the lot with this alignment, nothing was stored; {advice}"
        )
    if arguments.write or (not arguments.fit and _confirmed()):
        today = datetime.date.today()
        align.store(site, result, today)
        print(f"stored in {site.rig_file}, dated {today}")
    return 0


def _alignment_result(site: AlignmentSite, arguments: argparse.Namespace) -> AlignmentResult:
    from vve_sumo.commissioning import align

    if arguments.fit:
        notify("searching for an alignment; this takes longer when the path does not fit")
        return align.searched(site)
    if arguments.pairs is not None:
        return align.paired(site, arguments.pairs)
    return align.matched(site, notify)


def _draw(site: AlignmentSite, result: AlignmentResult, file: Path) -> None:
    from vve_sumo.plotting.alignment import PathInLot, draw

    drawn = PathInLot(
        path_name=site.resolved.scenario.ego.path,
        lot_name=site.rig_file.stem,
        path=site.resolved.path,
        speed=site.speed,
        vehicle=site.resolved.vehicle,
        geofence=site.geofence,
        alignment=result.alignment,
        fit=result.fit,
        corridor=site.resolved.corridor,
    )
    draw(drawn, file)
    print(f"picture: {file}")


def _confirmed() -> bool:
    """Ask at the keyboard; a closed standard input does not confirm."""
    print("Press Enter to store this alignment; anything else leaves the rig file unchanged: ", end="", flush=True)
    return sys.stdin.readline() == "\n"
