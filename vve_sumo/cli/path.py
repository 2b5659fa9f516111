"""`vve-sumo path`: the ego's path, recorded in a network or cut from a longer one."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from vve_sumo.cli.parser import OF_FILES, Commands, Parser, add_command, add_subcommands, names

EXIT_CODES = OF_FILES

SUMMARY = "record the ego's path, or cut a part of one"


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    inner = add_subcommands(parser)
    _add_cut(inner)
    record = add_command(
        inner,
        "record",
        "record a path from edge to edge as latitude and longitude",
        "Let a SUMO car drive through the network and write its smoothed track as CSV for the ego's rear axle.\n"
        "An edge whose name begins with a minus is given as --from=-21405924#2.",
        EXIT_CODES,
    )
    record.add_argument("network", help="name or .net.xml file")
    record.add_argument("--from", dest="start", required=True, metavar="EDGE", help="edge to start on")
    record.add_argument("--to", dest="end", required=True, metavar="EDGE", help="edge to end on")
    record.add_argument("--via", type=names, default=(), metavar="EDGE,EDGE", help="edges to pass, in order")
    record.add_argument(
        "--from-position", type=float, default=0.0, metavar="M", help="start position on the first edge (default: 0)"
    )
    record.add_argument(
        "--to-position", type=float, metavar="M", help="end position on the last edge (default: its end)"
    )
    record.add_argument(
        "--tolerance",
        type=float,
        default=0.3,
        metavar="M",
        help="largest deviation of the smoothed path from the lane centre (default: 0.3)",
    )
    record.add_argument(
        "--vehicle",
        default="ford_fusion",
        metavar="NAME",
        help="vehicle that has to follow the path (default: ford_fusion)",
    )
    record.add_argument("--out", type=Path, required=True, metavar="CSV", help="file to write")
    record.set_defaults(run=run)


def _add_cut(inner: Commands) -> None:
    cut = add_command(
        inner,
        "cut",
        "cut a part of a path into a path file of its own",
        "Write the part of a path between two distances along it, in metres on the ground, as a path file of its own.\n"
        "What a scenario places by distances along the path then counts from the new start.\n\n"
        "example:\n  vve-sumo path cut linden_17th --from 540 --to 660 --out part.csv\n",
        EXIT_CODES,
    )
    cut.add_argument("path", help="name under routes/ or a .csv file")
    cut.add_argument("--from", dest="start", type=float, required=True, metavar="N", help="distance of the new start")
    cut.add_argument("--to", dest="end", type=float, required=True, metavar="N", help="distance of the new end")
    cut.add_argument("--out", type=Path, required=True, metavar="CSV", help="file to write")
    cut.set_defaults(run=_cut)


def _cut(arguments: argparse.Namespace) -> int:
    """Cut a part of a path and write it; return the exit code, 0."""
    from vve_sumo.network_tools.path_file import cut_path
    from vve_sumo.workspace import find

    source = find("path", arguments.path, Path.cwd())
    part = cut_path(source, arguments.start, arguments.end, arguments.out)
    print(f"{part.length:.2f} m of {source.name} written to {arguments.out}")
    return 0


def run(arguments: argparse.Namespace) -> int:
    """Record a path from edge to edge and write it; return the exit code, 0."""
    from vve_sumo.network_tools.survey import record_path
    from vve_sumo.vehicle.load import load
    from vve_sumo.workspace import find

    max_curvature = load(find("vehicle", arguments.vehicle, Path.cwd())).vehicle.tightest_curvature
    survey = record_path(
        find("network", arguments.network, Path.cwd()),
        arguments.start,
        arguments.end,
        arguments.out,
        via=arguments.via,
        start_position=arguments.from_position,
        end_position=arguments.to_position,
        tolerance=arguments.tolerance,
        tightest=max_curvature,
    )
    radius = f"{1.0 / survey.curvature:.1f} m" if survey.curvature > 1e-6 else "none"
    print(f"{survey.length:.0f} m of path ({survey.points} points, tightest bend {radius}) written to {arguments.out}")
    if survey.curvature > max_curvature:
        print(
            f"warning: {arguments.vehicle} turns no tighter than {1.0 / max_curvature:.1f} m and will cut the bend",
            file=sys.stderr,
        )
    return 0
