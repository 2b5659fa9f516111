"""`vve-sumo align`: finds how a scenario's path lies in a rig's lot, shows it, stores it on confirmation."""

from __future__ import annotations

import argparse
import datetime
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from vve_sumo.cli.console import notify
from vve_sumo.cli.parser import Parser, add_speed
from vve_sumo.errors import ConfigError, RigError

if TYPE_CHECKING:
    from vve_sumo.commissioning.align import AlignmentResult, AlignmentSite
    from vve_sumo.commissioning.align_around import EventInLot, EventSite

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
the rig file. With --fit or --around the simulated vehicle of a rig then stands at the path's start.

--around lays the meeting with an obstacle or actor into the lot instead of the path's start: the ego starts from rest
before it, with the way that it needs to get to speed, and beyond it has the room to stop. The fastest speed that fits
is computed. --write-scenario writes the scenario on that part of its path; that is driven then.

examples:
  vve-sumo align --rig ours                     align the path's start with the standing car
  vve-sumo align --rig ours --pairs places.csv   by points surveyed in the lot and on the road
  vve-sumo align --rig ours --fit --picture lot.png   no car needed: the alignment with the largest clearance
  vve-sumo align --rig ours --fit --write-shortened-path short.csv   write the part of the path that fits
  vve-sumo align cut_in --rig ours --around cutter   how fast the meeting with the actor `cutter` can be driven here
  vve-sumo align cut_in --rig ours --around cutter --speed '27 km/h' --write-scenario scenarios/mine.toml --write
  vve-sumo drive mine --rig ours                drives it, by the alignment that the rig has for this scenario
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
    method.add_argument(
        "--around",
        metavar="EVENT",
        help="lay the meeting with this obstacle or actor of the scenario into the lot, by the same search; its id",
    )
    add_speed(parser)
    parser.add_argument(
        "--write-scenario",
        type=Path,
        metavar="FILE",
        help="with --around: write the scenario on the part of its path that is driven (.toml), its path beside it",
    )
    parser.add_argument(
        "--named",
        action="store_true",
        help="store the alignment for this scenario alone, as [alignments.SCENARIO]; with --around it always is, for "
        "the scenario that is written",
    )
    parser.add_argument(
        "--write-shortened-path",
        type=Path,
        metavar="CSV",
        help="with --fit: write the part that fits of a path that is too long",
    )
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw lot, path, corridor and start as a PNG file")
    parser.add_argument(
        "--write",
        action="store_true",
        help="change the rig file without asking; --fit and --around change it only with this",
    )


def run(arguments: argparse.Namespace) -> int:
    """Find how the path lies in the lot, show it, and store it after confirmation; return the exit code, 0.

    `--write` confirms beforehand; the result of `--fit` and `--around` is stored with `--write` only. Raises RigError
    where the path leaves the lot.
    """
    from vve_sumo.commissioning import align

    if arguments.around is not None:
        return _around(arguments)
    shortened: Path | None = arguments.write_shortened_path
    if shortened is not None and not arguments.fit:
        raise ConfigError("--write-shortened-path: expected --fit, which finds where the path may end")
    if arguments.write_scenario is not None:
        raise ConfigError("--write-scenario: expected --around, which finds the part of the path")
    site = align.site_of(arguments.scenario, arguments.rig, Path.cwd(), arguments.speed)
    result = _alignment_result(site, arguments)
    _show(site, result, arguments.picture)
    fits = result.whole
    if shortened is not None and not fits:
        length = align.cut(site, result, shortened).length
        print(f"the first {length:.0f} m of the path written to {shortened}")
        for line in align.beyond(site, length):
            print(line)
        fits = True
    if not fits:
        advice = (
            "--write-shortened-path writes the part that fits, --around lays an event of the scenario into the lot"
            if arguments.fit
            else "--fit searches for an alignment that fits"
        )
        raise RigError(
            f"{site.rig_file}: the path does not fit the lot with this alignment, nothing was stored; {advice}"
        )
    if arguments.write or (not arguments.fit and _confirmed()):
        name = site.resolved.name
        _store(site, result, name if arguments.named or name in site.rig.alignments else None)
    return 0


def _around(arguments: argparse.Namespace) -> int:
    """Lay an event of the scenario into the lot; return the exit code, 0."""
    from vve_sumo.commissioning import align
    from vve_sumo.commissioning.align_around import EventSite, refuse_unknown_event, write_scenario

    out: Path | None = arguments.write_scenario
    if arguments.write_shortened_path is not None:
        raise ConfigError("--write-shortened-path: expected --fit; with --around, --write-scenario writes the part")
    if arguments.write and out is None:
        raise ConfigError(
            "--write: with --around expected --write-scenario, for the scenario's whole path does not lie in the lot"
        )
    site = EventSite(arguments.scenario, arguments.rig, Path.cwd())
    if arguments.write:
        align.refuse_shipped(site.rig_file)
    refuse_unknown_event(site, arguments.around)
    found = _fastest(site, arguments.around, arguments.speed)
    stretch = found.stretch
    print(
        f"{arguments.around}: metres {stretch.begin:.0f} to {stretch.end:.0f} of {site.resolved.scenario.ego.path}, "
        f"from rest to {_spoken(found.speed)}, met from {stretch.meeting:.0f} m on"
    )
    for line in found.part.left_out:
        print(f"left out: {line}")
    _show(found.site, found.result, arguments.picture)
    if out is not None:
        path = write_scenario(found, site.resolved, out)
        print(f"scenario written to {out}, its path to {path}")
        if arguments.write:
            _store(found.site, found.result, out.stem)
    return 0


def _fastest(site: EventSite, event: str, asked: float | None) -> EventInLot:
    """Return the event at the speed that is asked for, or at the scenario's own where that fits; say the fastest.

    Raises RigError where the event does not fit at a speed that is asked for, or at none.
    """
    wanted = site.own_speed if asked is None else asked
    allowed = site.rig.limits.speed_mps
    if wanted > allowed:
        raise ConfigError(f"--speed: {wanted:g} m/s is more than limits.speed_mps of {site.rig_file}, {allowed:g} m/s")
    if asked is not None and (why := site.obstacle_to(event, asked)):
        raise ConfigError(f"--speed: {event}: {why}")
    notify(f"searching at {wanted:.2f} m/s")
    found = site.tried(event, wanted)
    at_limit = found is not None and wanted >= site.fastest_allowed
    fastest = found if at_limit else site.fastest(event, site.fastest_allowed, notify)
    if fastest is None:
        raise RigError(f"{site.rig_file}: the lot takes {event!r} at no speed from {site.slowest:g} m/s on")
    print(f"fastest that fits: {_spoken(fastest.speed)}")
    if found is None and asked is not None:
        raise RigError(f"{site.rig_file}: the lot does not take {event!r} at {_spoken(asked)}; nothing was written")
    return found or fastest


def _spoken(speed: float) -> str:
    return f"{speed:.2f} m/s ({3.6 * speed:.1f} km/h)"


def _show(site: AlignmentSite, result: AlignmentResult, picture: Path | None) -> None:
    from vve_sumo.commissioning import align

    for line in (*result.evidence, *align.description(site, result)):
        print(line)
    if picture is not None:
        _draw(site, result, picture)


def _store(site: AlignmentSite, result: AlignmentResult, name: str | None) -> None:
    from vve_sumo.commissioning import align

    today = datetime.date.today()
    align.store(site, result, today, name)
    print(f"stored in {site.rig_file}{'' if name is None else f' as alignments.{name}'}, dated {today}")


def _alignment_result(site: AlignmentSite, arguments: argparse.Namespace) -> AlignmentResult:
    from vve_sumo.commissioning import align

    if arguments.fit:
        notify("searching for an alignment; this takes longer when the path does not fit")
        return align.searched(site)
    if arguments.pairs is not None:
        return align.paired(site, arguments.pairs)
    return align.matched(site, notify)


def _draw(site: AlignmentSite, result: AlignmentResult, file: Path) -> None:
    from vve_sumo.plotting.alignment import draw

    draw(site.path_in_lot(result), file)
    print(f"picture: {file}")


def _confirmed() -> bool:
    """Ask at the keyboard; a closed standard input does not confirm."""
    print("Press Enter to store this alignment; anything else leaves the rig file unchanged: ", end="", flush=True)
    return sys.stdin.readline() == "\n"
