"""Writes a part of a path's file as a path file of its own: the same line, a point about every metre.

Knows files of positions and the cubic path; no network's content, no scenario and no lot.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

import numpy as np

from vve_sumo.csv_numbers import CsvNumbers
from vve_sumo.errors import ConfigError
from vve_sumo.frames import MapFrame, local_frame
from vve_sumo.path import ReferencePath
from vve_sumo.path_feasibility import MIN_PATH_LENGTH

#: latitude and longitude of the middle of the rear axle, WGS84
PATH_COLUMNS: Final = ("latitude_deg", "longitude_deg")
DECIMALS: Final = 10  #: of degrees in a path's file: 0.01 mm
#: by how much a typed end may exceed a path whose length is printed in centimetres [m]
END_TOLERANCE: Final = 0.005


def part_of(path: ReferencePath, begin: float, end: float) -> ReferencePath:
    """Return the part of a path between two distances along it [m], laid through a point about every metre."""
    points = [path.at(s) for s in np.linspace(begin, end, max(round(end - begin), 1) + 1).tolist()]
    return ReferencePath.from_points([point.x for point in points], [point.y for point in points])


def cut_path(source: Path, begin: float, end: float, out: Path) -> ReferencePath:
    """Write the part of a path's file between two distances along it [m] into `out`, and return that part.

    Distances are those on the ground, on a plane map about the path's first point. Raises ConfigError, and writes
    nothing, for distances that are not on the path, for a part shorter than MIN_PATH_LENGTH, and where `out` cannot be
    written or is the source.
    """
    table = CsvNumbers(source, "path")
    places = []
    for where, (latitude, longitude) in table.numbers(PATH_COLUMNS):
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            raise ConfigError(f"{where}: {latitude}, {longitude} is no place on Earth, in degrees")
        places.append((math.radians(latitude), math.radians(longitude)))
    if not places:
        raise ConfigError(f"{table.name}: expected two points or more, got none")
    frame = local_frame(*places[0])
    points = [frame.to_map(*place) for place in places]
    try:
        path = ReferencePath.from_points([x for x, _y in points], [y for _x, y in points])
    except ValueError as error:
        raise ConfigError(f"{table.name}: {error}") from None
    refuse_part(path, begin, end, table.name)
    part = part_of(path, begin, min(end, path.length))
    note = f"Metres {begin:g} to {end:g} of {source.name}, cut by vve-sumo path cut."
    write_part(part, frame, source, note, out)
    return part


def refuse_part(path: ReferencePath, begin: float, end: float, name: str) -> None:
    """Raise ConfigError, in messages `name`, where a path has no part between two distances along it [m]."""
    for key, s in (("--from", begin), ("--to", end)):
        if not 0.0 <= s <= path.length + END_TOLERANCE:
            raise ConfigError(f"{name}: {key} {s:g}: expected 0 to the path's length, {path.length:.2f} m")
    if not end - begin >= MIN_PATH_LENGTH:
        raise ConfigError(
            f"{name}: --to {end:g} is less than {MIN_PATH_LENGTH:g} m beyond --from {begin:g}; expected a longer part"
        )


def write_part(part: ReferencePath, frame: MapFrame, source: Path, note: str, out: Path) -> None:
    """Write a part of the path in the file `source` into `out`, with the source's comments and a `note` as the last.

    `frame` maps the part's points to places on Earth. Raises ConfigError where `out` is the source or has no folder.
    """
    if out.resolve() == source.resolve():
        raise ConfigError(f"--out {out}: is the path itself; expected another file")
    if not out.parent.is_dir():
        raise ConfigError(f"--out {out}: expected an existing folder, got {out.parent}")
    comments = [line for line in source.read_text(encoding="utf-8-sig").splitlines() if line.startswith("#")]
    points = (part.at(s) for s in np.linspace(0.0, part.length, max(round(part.length), 1) + 1).tolist())
    rows = [[math.degrees(angle) for angle in frame.to_geodetic(point.x, point.y)] for point in points]
    lines = [
        *comments,
        f"# {note}",
        ",".join(PATH_COLUMNS),
        *(f"{latitude:.{DECIMALS}f},{longitude:.{DECIMALS}f}" for latitude, longitude in rows),
    ]
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")
