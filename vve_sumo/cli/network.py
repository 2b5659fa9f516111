"""`vve-sumo network`: networks from OpenStreetMap or OpenDRIVE, their edges and their traffic."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from vve_sumo.cli.parser import OF_FILES, Commands, Parser, add_command, add_subcommands, names
from vve_sumo.errors import ConfigError

EXIT_CODES = OF_FILES

SUMMARY = "build networks and their traffic"
BUILD_TEXT = """\
Turn an OpenStreetMap extract into a SUMO network with a projection of its own centre and the rules of a country, or an
OpenDRIVE file (.xodr) into one with the file's lanes, speed limits, signals and place.
Needs netconvert: pip install 'vve-sumo[network]'.
"""
EDGES_TEXT = "List the edges whose street name contains a text: name, length, lanes, and start and end in the map [m]."
DEMAND_TEXT = """Write a SUMO route file with seeded traffic: random traffic that starts immediately and does not run
out, or traffic that passes counting places as often as vehicles were counted there. Counts are a CSV file with the
columns edge, begin_s, end_s, vehicles; vve-sumo network picture shows the edges' names.

examples:
  vve-sumo network demand linden --level light --out light.rou.xml
  vve-sumo network demand linden --counts counts.csv --path linden_loop --out counted.rou.xml"""


def arguments(parser: Parser) -> None:
    """Add the command's arguments."""
    inner = add_subcommands(parser)
    _add_build(inner)
    _add_edges(inner)
    _add_picture(inner)
    _add_demand(inner)


def _add_build(inner: Commands) -> None:
    build = add_command(
        inner, "build", "turn an OpenStreetMap extract or OpenDRIVE into a SUMO network", BUILD_TEXT, EXIT_CODES
    )
    build.add_argument(
        "source",
        type=Path,
        metavar="MAP",
        help=".osm, .osm.xml or .osm.xml.gz, already cut to the area, or .xodr or .xodr.gz",
    )
    build.add_argument("--out", type=Path, required=True, metavar="NET", help="network file to write (.net.xml)")
    build.add_argument(
        "--origin",
        type=latitude_longitude,
        metavar="LAT,LON",
        help="centre of the projection in degrees (default: the middle of the extract; of OpenDRIVE: the middle of the "
        "network, in place of the file's georeference or where it has none)",
    )
    build.add_argument(
        "--signals",
        type=names,
        default=(),
        metavar="NODE,NODE",
        help="OpenStreetMap nodes with a traffic signal that the extract does not contain",
    )
    build.add_argument(
        "--rules",
        choices=("us", "eu", "uk"),
        help="of the streets, of OpenStreetMap: us: minor roads yield to major ones; eu: of equal streets who comes "
        "from the right goes first; uk: traffic on the left; with the usual speed limits of a town (default: us)",
    )
    build.add_argument(
        "--speeds", type=Path, metavar="TYP", help="SUMO type map of speed limits (default: those of the rules)"
    )
    build.set_defaults(run=_build)


def _add_edges(inner: Commands) -> None:
    edges = add_command(inner, "edges", "list the edges of streets, to choose those of a path", EDGES_TEXT, EXIT_CODES)
    edges.add_argument("network", help="name or .net.xml file")
    edges.add_argument("street", nargs="?", default="", help="part of a street's name (default: all)")
    edges.set_defaults(run=_edges)


def _add_picture(inner: Commands) -> None:
    picture = add_command(
        inner,
        "picture",
        "draw a network with its edges' names, to choose those of a path",
        "Draw the network from above. The name of every edge stands on the right of its lanes, with an arrow in the\n"
        "driving direction; vve-sumo path record takes these names. Print the names for which there was no room.\n\n"
        "examples:\n"
        "  vve-sumo network picture linden --out linden.svg\n"
        "  vve-sumo network picture linden 'Cleveland' --out cleveland.png   the part with these streets, larger\n",
        EXIT_CODES,
    )
    picture.add_argument("network", help="name or .net.xml file")
    picture.add_argument("street", nargs="?", default="", help="part of a street's name: draw what is around it")
    picture.add_argument("--out", type=Path, required=True, metavar="FILE", help=".png, .svg or .pdf file to write")
    picture.set_defaults(run=_picture)


def _add_demand(inner: Commands) -> None:
    demand = add_command(inner, "demand", "write seeded traffic for a network", DEMAND_TEXT, EXIT_CODES)
    demand.add_argument("network", help="name or .net.xml file")
    how = demand.add_mutually_exclusive_group(required=True)
    how.add_argument("--level", choices=("light", "moderate", "heavy"), help="how much random traffic")
    how.add_argument(
        "--counts",
        type=Path,
        metavar="CSV",
        help="file of counts; needs SUMO's tools: pip install 'vve-sumo[network]'",
    )
    demand.add_argument(
        "--seed", type=int, default=43211, metavar="N", help="seed of the random traffic (default: 43211)"
    )
    demand.add_argument(
        "--clear",
        type=names,
        default=(),
        metavar="EDGE,EDGE",
        help="edges on which no vehicle is inserted or removed: those of the ego's path",
    )
    demand.add_argument("--path", metavar="NAME", help="path whose edges stay clear, a name under routes/ or a file")
    demand.add_argument(
        "--unhindered",
        metavar="NAME",
        help="path on which nobody has the right of way over the ego: other traffic avoids the junctions where the ego "
        "would have to yield, signals included",
    )
    demand.add_argument(
        "--drivers",
        choices=("comfortable", "brisk"),
        default="comfortable",
        help="braking of the other drivers: comfortable, as in the shipped traffic, or brisk, as by SUMO's defaults "
        "(default: comfortable)",
    )
    demand.add_argument("--out", type=Path, required=True, metavar="ROU", help="route file to write (.rou.xml)")
    demand.set_defaults(run=_demand)


def latitude_longitude(text: str) -> tuple[float, float]:
    """Return the degrees of a place such as 40.004,-82.971."""
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected degrees such as 40.004,-82.971, got {text!r}") from None
    return latitude, longitude


def _build(arguments: argparse.Namespace) -> int:
    """Build a network from a map; return the exit code, 0."""
    from vve_sumo.network_tools.build import RULES, build_network
    from vve_sumo.network_tools.opendrive import is_opendrive
    from vve_sumo.workspace import shared_file

    if is_opendrive(arguments.source):
        return _build_opendrive(arguments)
    rules = RULES[arguments.rules or "us"]
    speeds = arguments.speeds or shared_file("networks", rules.speeds, Path.cwd())
    built = build_network(
        arguments.source,
        arguments.out,
        speeds=speeds,
        rules=rules,
        origin=arguments.origin,
        signals=arguments.signals,
    )
    for warning in built.warnings:
        print(f"netconvert: {warning}", file=sys.stderr)
    print(f"network written to {arguments.out}; it keeps the attribution and licence of its map data")
    return 0


def _build_opendrive(arguments: argparse.Namespace) -> int:
    """Build a network from an OpenDRIVE file and say what of it the network has; return the exit code, 0."""
    from vve_sumo.network_tools.opendrive import build_opendrive

    refused = {"--signals": arguments.signals, "--speeds": arguments.speeds, "--rules": arguments.rules}
    for option, given in refused.items():
        if given:
            raise ConfigError(f"{option}: is for OpenStreetMap extracts; {arguments.source} states its own")
    built = build_opendrive(arguments.source, arguments.out, arguments.origin)
    for warning in built.warnings:
        print(f"netconvert: {warning}", file=sys.stderr)
    content = built.content
    others = ", ".join(f"{count} {kind}" for kind, count in content.left_out.items())
    print(f"{content.roads} roads with {content.lanes} lanes for cars; left out: {others or 'none'}")
    print(f"{content.lights} lights at {built.signals} junctions with signals; left out: {content.signs} signs")
    if content.crossings:
        print(f"left out: {content.crossings} crosswalks: SUMO's traffic does not know them")
    print(f"network written to {arguments.out}; it keeps the licence of its map data")
    return 0


def _edges(arguments: argparse.Namespace) -> int:
    """List the edges of streets; return the exit code, 0."""
    from vve_sumo.workspace import find
    from vve_sumo.world.network import Roads

    roads = Roads(find("network", arguments.network, Path.cwd()))
    matching = [edge for edge in roads.edges if arguments.street.lower() in edge.getName().lower()]
    if not matching:
        raise ConfigError(f"no street of {arguments.network} has {arguments.street!r} in its name")
    for edge in sorted(matching, key=lambda edge: (edge.getName(), edge.getID())):
        (x, y), (end_x, end_y) = edge.getShape()[0][:2], edge.getShape()[-1][:2]
        ends = f"({x:.0f}, {y:.0f}) to ({end_x:.0f}, {end_y:.0f})"
        print(
            f"{edge.getID():<16} {edge.getName():<28} {edge.getLength():7.1f} m  {edge.getLaneNumber()} lane(s)  {ends}"
        )
    return 0


def _picture(arguments: argparse.Namespace) -> int:
    """Draw a network with its edges' names; return the exit code, 0."""
    from vve_sumo.plotting.network import DrawnEdge, around_street, draw
    from vve_sumo.workspace import find
    from vve_sumo.world.network import Roads

    file = find("network", arguments.network, Path.cwd())
    edges = [
        DrawnEdge(edge.getID(), edge.getName(), shape, edge.getLaneNumber(), edge.allows("passenger"))
        for edge, shape in Roads(file).shapes()
    ]
    if arguments.street:
        edges = around_street(edges, arguments.street)
        if not edges:
            raise ConfigError(f"no street of {arguments.network} has {arguments.street!r} in its name")
    what = f"{file.name}: {arguments.street}" if arguments.street else file.name
    unnamed = draw(edges, arguments.out, f"{what}, names of edges")
    print(f"{len(edges)} edges drawn into {arguments.out}")
    if unnamed:
        print(f"no room for the names of {len(unnamed)} short edges: {' '.join(unnamed)}")
    return 0


def _demand(arguments: argparse.Namespace) -> int:
    """Write seeded traffic for a network; return the exit code, 0."""
    from vve_sumo.network_tools.demand import write_demand
    from vve_sumo.workspace import find

    if arguments.counts is not None:
        return _counted_demand(arguments)
    drawn = write_demand(
        find("network", arguments.network, Path.cwd()),
        arguments.out,
        level=arguments.level,
        seed=arguments.seed,
        clear=(*arguments.clear, *_edges_of(arguments.path)),
        unhindered=_edges_of(arguments.unhindered),
        drivers=arguments.drivers,
    )
    print(f"{arguments.level} traffic of {drawn.vehicles} vehicles written to {arguments.out}")
    return 0


def _counted_demand(arguments: argparse.Namespace) -> int:
    """Write traffic by counts, and say what it has where they were made; return the exit code, 0."""
    from vve_sumo.network_tools.counted_demand import CLOSE, write_counted_demand
    from vve_sumo.workspace import find

    reached = write_counted_demand(
        find("network", arguments.network, Path.cwd()),
        arguments.counts,
        arguments.out,
        seed=arguments.seed,
        clear=(*arguments.clear, *_edges_of(arguments.path)),
        unhindered=_edges_of(arguments.unhindered),
        drivers=arguments.drivers,
    )
    print(f"{'edge':<20} {'from [s]':>9} {'to [s]':>9} {'counted':>8} {'written':>8} {'GEH':>6}")
    for one in reached:
        edge, begin, end, vehicles = one.counted
        print(f"{edge:<20} {begin:>9g} {end:>9g} {vehicles:>8} {one.vehicles:>8} {one.geh:>6.2f}")
    close = sum(one.geh < CLOSE for one in reached)
    print(f"{close} of {len(reached)} counts have a GEH below {CLOSE:g}; traffic written to {arguments.out}")
    return 0


def _edges_of(path: str | None) -> tuple[str, ...]:
    """Return the edges that a path's file names."""
    if path is None:
        return ()
    from vve_sumo.drive.path_in_network import EDGES_PREFIX
    from vve_sumo.workspace import find

    file = find("path", path, Path.cwd())
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    edges = next((tuple(line[len(EDGES_PREFIX) :].split()) for line in lines if line.startswith(EDGES_PREFIX)), ())
    if not edges:
        raise ConfigError(f"{file}: expected a line {EDGES_PREFIX!r} that names the edges of the path, got none")
    return edges
