"""Imports an OpenSCENARIO file into a workspace: its network, the paths, and a scenario for each set of values.

Everything is made and checked in a folder of its own first, so that a file that is refused leaves nothing behind.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from vve_sumo.bridges.openscenario.distributions import read_variation
from vve_sumo.bridges.openscenario.document import Document
from vve_sumo.bridges.openscenario.importer import Imported, read_scenario, roads_of
from vve_sumo.bridges.openscenario.places import Points
from vve_sumo.bridges.openscenario.road_map import RoadMap
from vve_sumo.bridges.openscenario.sweepable import parameters_of
from vve_sumo.bridges.openscenario.toml_text import toml_text
from vve_sumo.config_file import read
from vve_sumo.drive.resolved_scenario import resolve_scenario
from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.opendrive import build_opendrive
from vve_sumo.scenario.load import parse
from vve_sumo.world.network import Network

#: where roads without a georeference lie on Earth: latitude, longitude of the middle of their network [deg]
ORIGIN: Final = (40.0041, -83.0186)
#: of a degree: a hundredth of a millimetre
DECIMALS: Final = 10


class Written(NamedTuple):
    """What an import wrote."""

    scenarios: list[str]  #: names
    left_out: list[str]  #: with file, line and element
    notes: list[str]
    warnings: tuple[str, ...]  #: netconvert's


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
    targets = [folder / "networks" / f"{name}.net.xml", *(folder / "scenarios" / f"{one}.toml" for one in names)]
    there = next((target for target in targets if target.exists()), None)
    if there is not None:
        raise ConfigError(f"{there} exists; give another name with --out, or remove it")
    roads = roads_of(Document(varied.file, sets[0]))
    found = [read_scenario(varied.file, name, ego=ego, given=one, roads=roads) for one in sets]
    left_out = list(dict.fromkeys(problem for one in found for problem in one.problems))
    if left_out and not partial:
        more = f" (and {len(left_out) - 1} more)" if len(left_out) > 1 else ""
        raise ConfigError(f"{left_out[0]}{more}; --partial leaves out what is not taken, and says so")

    def again(values: Mapping[str, str]) -> Imported:
        return read_scenario(varied.file, name, ego=ego, given=sets[0] | dict(values), roads=roads)

    with tempfile.TemporaryDirectory() as made:
        aside = Path(made)
        built = _network(roads, aside / "networks" / f"{name}.net.xml", origin)
        lines: dict[str, Points] = {}
        for one, own in zip(found, names, strict=True):
            table = _with_road(_shared(one, lines), name)
            # Of many sets, each scenario is one; what a sweep would vary is varied already.
            if len(sets) == 1 and (parameters := parameters_of(one, again)):
                table["parameters"] = parameters
            _write(aside / "scenarios" / f"{own}.toml", _text(table, varied.file))
        for line, points in lines.items():
            _write(aside / "routes" / f"{line}.csv", _path_text(points, built.network, roads, file))
        for own in names:
            _check(aside / "scenarios" / f"{own}.toml", own, aside)
        for kind in ("networks", "routes", "scenarios"):
            (folder / kind).mkdir(parents=True, exist_ok=True)
            for one_file in sorted((aside / kind).iterdir()):
                shutil.copyfile(one_file, folder / kind / one_file.name)
    notes = list(dict.fromkeys(note for one in found for note in one.notes))
    return Written(names, left_out, notes, built.warnings)


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


def _with_road(table: dict[str, Any], network: str) -> dict[str, Any]:
    """Return a scenario's table with its network, where a reader looks for it."""
    plain = {key: value for key, value in table.items() if not isinstance(value, (dict, list))}
    return plain | {"road": {"network": network}} | {key: table[key] for key in table if key not in plain}


def _text(table: dict[str, Any], file: Path) -> str:
    note = f"# Imported from {file.name}; it keeps the licence of that file and of its roads."
    return f"{note}\n{toml_text(table)}"


def _path_text(points: Points, network: Network, roads: RoadMap, file: Path) -> str:
    """Return the file of a line: WGS84, in driving order."""
    frame, (x0, y0) = network.frame(), network.offset
    shift = roads.shift
    rows = []
    for x, y in points:
        place = frame.to_geodetic(x + x0 + shift[0], y + y0 + shift[1])
        rows.append(",".join(f"{math.degrees(angle):.{DECIMALS}f}" for angle in place))
    head = [f"# A line of {file.name}, WGS84, in driving order.", "latitude_deg,longitude_deg"]
    return "\n".join([*head, *rows]) + "\n"


def _write(file: Path, text: str) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")


def _check(file: Path, name: str, folder: Path) -> None:
    """Raise ConfigError where a scenario cannot be driven as it was written."""
    try:
        resolve_scenario(name, parse(read(file, "scenario"), file), file, folder)
    except ConfigError as error:
        raise ConfigError(f"{name}: {str(error).removeprefix(f'{file}: ').replace(f'{folder}/', '')}") from None
