"""Imports an OpenSCENARIO file into a workspace: its network, the paths, and a scenario for each set of values.

Everything is made and checked in a folder of its own first, so that a file that is refused leaves nothing behind.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from vve_sumo.bridges.openscenario.distributions import read_variation
from vve_sumo.bridges.openscenario.document import Document
from vve_sumo.bridges.openscenario.importer import Imported, read_scenario, roads_file
from vve_sumo.bridges.openscenario.road_map import RoadMap
from vve_sumo.bridges.openscenario.sweepable import parameters_of
from vve_sumo.bridges.scenario_import.lines import Points
from vve_sumo.bridges.scenario_import.workspace_files import (
    ORIGIN,
    Written,
    check_scenario,
    copy_all,
    refuse_existing,
    refuse_left_out,
    with_road,
    write_line,
    write_scenario,
)
from vve_sumo.network_tools.opendrive import build_opendrive
from vve_sumo.world.network import Network


def import_file(
    file: Path,
    folder: Path,
    name: str,
    *,
    ego: str | None = None,
    partial: bool = False,
    given: Mapping[str, str] | None = None,
    origin: tuple[float, float] | None = None,
) -> Written:
    """Import a scenario file, or one that varies a scenario's parameters, into a workspace's folder.

    Raises ConfigError and writes nothing where something is not taken, unless it is `partial`: then that is left out.
    """
    varied = read_variation(file)
    sets = [one | dict(given or {}) for one in varied.sets]
    numbers = [""] if len(sets) == 1 else [f"_{n:03d}" for n in range(1, len(sets) + 1)]
    names = [f"{name}{number}" for number in numbers]
    of_roads = [roads_file(Document(varied.file, one)) for one in sets]
    roads = {one: RoadMap(one) for one in dict.fromkeys(of_roads)}
    networks = {one: name if n == 1 else f"{name}_roads_{n}" for n, one in enumerate(roads, 1)}
    for network in networks.values():
        refuse_existing(folder, network, names)

    def come_to(given: Mapping[str, str], of: Path) -> Imported:
        return read_scenario(varied.file, networks[of], ego=ego, given=given, roads=roads[of])

    found = [come_to(one, of) for one, of in zip(sets, of_roads, strict=True)]
    left_out = list(dict.fromkeys(problem for one in found for problem in one.problems))
    refuse_left_out(left_out, partial)

    def again(values: Mapping[str, str]) -> Imported:
        return come_to(sets[0] | dict(values), of_roads[0])

    warnings: list[str] = []
    with tempfile.TemporaryDirectory() as made:
        aside = Path(made)
        lines: dict[Path, dict[str, Points]] = {of: {} for of in roads}
        for one, own, of in zip(found, names, of_roads, strict=True):
            table = with_road(_shared(one, lines[of]), networks[of])
            # Of many sets, each scenario is one; what a sweep would vary is varied already.
            if len(sets) == 1 and (parameters := parameters_of(one, again)):
                table["parameters"] = parameters
            write_scenario(aside, own, table, varied.file)
        for of, network in networks.items():
            built = _network(roads[of], aside / "networks" / f"{network}.net.xml", origin)
            warnings += built.warnings
            _write_lines(aside, lines[of], built.network, roads[of], file)
        for own in names:
            check_scenario(aside, own)
        copy_all(aside, folder)
    notes = list(dict.fromkeys(note for one in found for note in one.notes))
    return Written(names, left_out, notes, tuple(dict.fromkeys(warnings)))


def _write_lines(aside: Path, lines: Mapping[str, Points], network: Network, roads: RoadMap, file: Path) -> None:
    frame, (x0, y0), (dx, dy) = network.frame(), network.offset, roads.shift
    for line, points in lines.items():
        write_line(aside, line, [(x + x0 + dx, y + y0 + dy) for x, y in points], frame, file)


class _Built(NamedTuple):
    network: Network
    warnings: tuple[str, ...]


def _network(roads: RoadMap, out: Path, origin: tuple[float, float] | None) -> _Built:
    place = origin if origin is not None or roads.georeferenced else ORIGIN
    if place is not None:
        roads.shift = (0.0, 0.0)
    built = build_opendrive(roads.file, out, place)
    return _Built(built.network, built.warnings)


def _shared(one: Imported, lines: dict[str, Points]) -> dict[str, Any]:
    """Return a scenario's table, its lines taken into those of all scenarios; the same line has one name."""
    names: dict[str, str] = {}
    for name in _paths(one.table):
        wanted, number = name, 1
        while lines.setdefault(wanted, one.lines[name]) != one.lines[name]:
            number += 1
            wanted = f"{name}_v{number}"
        names[name] = wanted
    renamed: dict[str, Any] = _renamed(one.table, names)
    return renamed


def _paths(table: Any) -> list[str]:
    """Return the names of the paths that a table uses, each once."""
    if isinstance(table, dict):
        own = [table["path"]] if "path" in table else []
        return list(dict.fromkeys(own + [name for value in table.values() for name in _paths(value)]))
    return [name for value in table for name in _paths(value)] if isinstance(table, list) else []


def _renamed(table: Any, names: Mapping[str, str]) -> Any:
    if isinstance(table, dict):
        return {key: names[one] if key == "path" else _renamed(one, names) for key, one in table.items()}
    return [_renamed(one, names) for one in table] if isinstance(table, list) else table
