"""Files of an imported scenario in a workspace: made and checked in a folder aside, then copied whole.

So a file that is refused leaves nothing behind. Knows tables, lines and networks; no format that is imported.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from vve_sumo.bridges.scenario_import.lines import Points
from vve_sumo.bridges.scenario_import.toml_text import toml_text
from vve_sumo.config_file import read
from vve_sumo.drive.resolved_scenario import resolve_scenario
from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame
from vve_sumo.scenario.load import parse

#: where the real car stands at the start, where a scenario here has to say it: as in the documentation's scenarios
LOT: Final = {"latitude_deg": 40.0041, "longitude_deg": -83.0186, "heading_deg": 85.0}
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


def refuse_existing(folder: Path, network: str, scenarios: Sequence[str]) -> None:
    """Raise ConfigError where a workspace has a file already that an import would write."""
    targets = [folder / "networks" / f"{network}.net.xml", *(folder / "scenarios" / f"{one}.toml" for one in scenarios)]
    there = next((target for target in targets if target.exists()), None)
    if there is not None:
        raise ConfigError(f"{there} exists; give another name with --out, or remove it")


def refuse_left_out(left_out: Sequence[str], partial: bool) -> None:
    """Raise ConfigError where something is not taken, unless the import may be `partial`."""
    if left_out and not partial:
        more = f" (and {len(left_out) - 1} more)" if len(left_out) > 1 else ""
        raise ConfigError(f"{left_out[0]}{more}; --partial leaves out what is not taken, and says so")


def with_road(table: dict[str, Any], network: str) -> dict[str, Any]:
    """Return a scenario's table with its network, where a reader looks for it."""
    plain = {key: value for key, value in table.items() if not isinstance(value, (dict, list))}
    return plain | {"road": {"network": network}} | {key: table[key] for key in table if key not in plain}


def write_scenario(folder: Path, name: str, table: dict[str, Any], file: Path) -> None:
    """Write a scenario's table, imported from a file, into a folder of a workspace's form."""
    note = f"# Imported from {file.name}; it keeps the licence of that file and of its roads."
    _write(folder / "scenarios" / f"{name}.toml", f"{note}\n{toml_text(table)}")


def write_line(folder: Path, name: str, points: Points, frame: MapFrame, file: Path) -> None:
    """Write the file of a line: WGS84, in driving order; `points` [m] are in the plane of `frame`."""
    rows = [",".join(f"{math.degrees(angle):.{DECIMALS}f}" for angle in frame.to_geodetic(x, y)) for x, y in points]
    head = [f"# A line of {file.name}, WGS84, in driving order.", "latitude_deg,longitude_deg"]
    _write(folder / "routes" / f"{name}.csv", "\n".join([*head, *rows]) + "\n")


def check_scenario(folder: Path, name: str) -> None:
    """Raise ConfigError where a scenario cannot be driven as it was written."""
    file = folder / "scenarios" / f"{name}.toml"
    try:
        resolve_scenario(name, parse(read(file, "scenario"), file), file, folder)
    except ConfigError as error:
        raise ConfigError(f"{name}: {str(error).removeprefix(f'{file}: ').replace(f'{folder}/', '')}") from None


def copy_all(aside: Path, folder: Path) -> None:
    """Copy what was made aside into a workspace's folder."""
    for kind in ("networks", "routes", "scenarios"):
        (folder / kind).mkdir(parents=True, exist_ok=True)
        for one in sorted((aside / kind).iterdir()):
            shutil.copyfile(one, folder / kind / one.name)


def _write(file: Path, text: str) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
