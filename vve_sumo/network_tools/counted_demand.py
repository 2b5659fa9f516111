"""Draws traffic that passes counting places as often as vehicles were counted there, by SUMO's `routeSampler.py`.

It runs before any drive and knows nothing of one. The same network, counts and arguments give the same file.
"""

from __future__ import annotations

import csv
import math
import os
import random
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from vve_sumo.errors import ConfigError
from vve_sumo.network_tools.build import attribution, sumo_home
from vve_sumo.network_tools.demand import (
    DRIVERS,
    SEED,
    TYPES,
    Choice,
    Places,
    Trip,
    travel_time,
    vehicle_types,
    write_trips,
)
from vve_sumo.world.network import Roads

COLUMNS: Final = ("edge", "begin_s", "end_s", "vehicles")
CLOSE: Final = 5.0  #: a GEH below this is close
ROUTES: Final = 3000  #: drawn, of which the counted traffic is made
ROUTES_OF_A_PLACE: Final = 30  #: of them at least through every counting place
MAX_DRAWS: Final = 300  #: attempts to draw these


class Count(NamedTuple):
    """What was counted at one place in one interval."""

    edge: str
    begin: float  #: [s]
    end: float  #: [s]
    vehicles: int


class Reached(NamedTuple):
    """A count beside what the traffic that was written has there: vehicles whose trip begins in the interval."""

    counted: Count
    vehicles: int

    @property
    def geh(self) -> float:
        """The statistic GEH of the two as flows in an hour.

        Federal Highway Administration, "Traffic Analysis Toolbox Volume III", 2004, table 4, asks for less than 5 at
        more than 85 % of the places.
        """
        hours = (self.counted.end - self.counted.begin) / 3600.0
        ours, theirs = self.vehicles / hours, self.counted.vehicles / hours
        return math.sqrt(2.0 * (ours - theirs) ** 2 / (ours + theirs)) if ours + theirs > 0.0 else 0.0


def read_counts(file: Path) -> list[Count]:
    """Return the counts in a CSV file with COLUMNS.

    Raises ConfigError naming file and line for a file that cannot be read, a missing column, numbers that are none,
    intervals without length, and one place counted twice at a time.
    """
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"counts {file}: cannot be read: {error}") from None
    rows = [(number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    header = [cell.strip() for cell in next(csv.reader([rows[0][1]]))] if rows else []
    if missing := [name for name in COLUMNS if name not in header]:
        raise ConfigError(f"counts {file}: no column {missing[0]}, expected a header with {', '.join(COLUMNS)}")
    found: list[Count] = []
    for number, line in rows[1:]:
        where = f"counts {file}, line {number}"
        row = dict(zip(header, next(csv.reader([line])), strict=False))
        one = _count(where, row)
        if any(o.edge == one.edge and o.begin < one.end and one.begin < o.end for o in found):
            raise ConfigError(
                f"{where}: edge {one.edge!r} is counted already in a part of {one.begin:g} to {one.end:g} s"
            )
        found.append(one)
    if not found:
        raise ConfigError(f"counts {file}: expected a line for each counting place, got none")
    return found


def _count(where: str, row: dict[str, str]) -> Count:
    try:
        begin, end, vehicles = float(row["begin_s"]), float(row["end_s"]), int(row["vehicles"])
    except (KeyError, ValueError):
        raise ConfigError(f"{where}: expected {', '.join(COLUMNS)}, vehicles a whole number, got {row}") from None
    if not (0.0 <= begin < end < math.inf and vehicles >= 0):
        raise ConfigError(f"{where}: expected 0 <= begin_s < end_s and vehicles of 0 or more, got {row}")
    return Count(row["edge"].strip(), begin, end, vehicles)


def write_counted_demand(
    network: Path,
    counts: Path,
    out: Path,
    *,
    seed: int = SEED,
    clear: Collection[str] = (),
    unhindered: Sequence[str] = (),
    drivers: str = DRIVERS[0],
) -> list[Reached]:
    """Write traffic that passes the places of a file of counts as often as it says; return what was reached there.

    Where the traffic comes from and goes to is drawn, as `write_demand` draws it; `clear`, `unhindered` and `drivers`
    are as there. Nobody drives before the first interval or sets out after the last. Raises ConfigError as
    `read_counts` and `write_demand` do, for an edge that the network does not have, and for one that no way leads
    through.
    """
    wanted, types = read_counts(counts), vehicle_types(drivers)
    drawn = random.Random(f"{seed} {counts.name}")
    roads = Roads(network)
    for name in (*clear, *(one.edge for one in wanted)):
        roads.edge(name)  # raises for an edge that the network does not have
    roads.close(roads.prior(unhindered))
    places = Places(roads, frozenset(clear))
    routes = [places.trip(drawn)[0] for _ in range(ROUTES)]
    for name in dict.fromkeys(one.edge for one in wanted):
        routes += _through(places, name, drawn, ROUTES_OF_A_PLACE)
    kinds = Choice(list(TYPES), [kind.share for kind in TYPES.values()])
    driven = _sampled(routes, wanted, seed)
    trips = [Trip(depart, kinds.draw(drawn), tuple(map(roads.edge, edges)), None) for depart, edges in driven]
    said = (
        f"traffic by the counts of {counts.name}, seed {seed}, by SUMO's routeSampler; where none counts it is drawn."
    )
    mean = sum(travel_time(trip.edges) for trip in trips) / max(len(trips), 1)
    write_trips(out, trips, types, " ".join((said, *attribution(network))), frozenset(clear), mean)
    return [Reached(one, sum(_passes(trip, one) for trip in trips)) for one in wanted]


def _through(places: Places, name: str, drawn: random.Random, number: int) -> list[tuple[Any, ...]]:
    """Return routes through an edge, from where trips begin to where they end."""
    edge, found = places.roads.edge(name), []
    for _ in range(MAX_DRAWS):
        start, end = places.entries.draw(drawn), places.exits.draw(drawn)
        there = (edge,) if start is edge else places.roads.fastest(start, edge)
        on = (edge,) if end is edge else places.roads.fastest(edge, end)
        way = (*there, *on[1:])
        if there and on and len({one.getID() for one in way}) == len(way):
            found.append(way)
        if len(found) == number:
            break
    if not found:
        raise ConfigError(f"{places.roads.network.path}: no way for a car through the counted edge {name!r}")
    return found


def _sampled(routes: Sequence[tuple[Any, ...]], wanted: Sequence[Count], seed: int) -> list[tuple[float, list[str]]]:
    """Return when [s] which of the routes is driven, as names of edges, by SUMO's sampler."""
    home = sumo_home()
    with tempfile.TemporaryDirectory() as scratch:
        given, counted, made = (Path(scratch) / name for name in ("routes.xml", "counts.xml", "made.xml"))
        root = ET.Element("routes")
        for number, edges in enumerate(routes):
            ET.SubElement(root, "route", id=str(number), edges=" ".join(edge.getID() for edge in edges))
        ET.ElementTree(root).write(given)
        data = ET.Element("data")
        for begin, end in sorted({(one.begin, one.end) for one in wanted}):
            interval = ET.SubElement(data, "interval", id="counts", begin=str(begin), end=str(end))
            for one in wanted:
                if (one.begin, one.end) == (begin, end):
                    ET.SubElement(interval, "edge", id=one.edge, entered=str(one.vehicles))
        ET.ElementTree(data).write(counted)
        command = [sys.executable, str(home / "tools" / "routeSampler.py"), "-r", str(given), "-d", str(counted)]
        command += ["-o", str(made), "--seed", str(seed), "--optimize", "full"]
        environment = os.environ | {"SUMO_HOME": str(home), "PYTHONHASHSEED": "0"}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if done.returncode != 0 or not made.is_file():
            reason = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise ConfigError(f"SUMO's routeSampler refused the counts: {reason}")
        vehicles = ET.parse(made).getroot().iter("vehicle")
        return sorted((float(one.attrib["depart"]), one[0].attrib["edges"].split()) for one in vehicles)


def _passes(trip: Trip, count: Count) -> bool:
    return count.begin <= trip.depart < count.end and any(edge.getID() == count.edge for edge in trip.edges)
