"""Aligns the path with the lot by a standing car, by surveyed pairs or by a search; stored in the rig file.

It listens, computes and writes; it sends no frame and moves nothing but the simulated vehicle's clock.
"""

from __future__ import annotations

import contextlib
import datetime
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from vve_sumo import workspace
from vve_sumo.csv_numbers import CsvNumbers
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.drive.virtual_road import pose_at_rest
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment, Pair, Placement
from vve_sumo.live import assembly, start_simulated_vehicle
from vve_sumo.live.alignment import lot_alignment
from vve_sumo.lot.fit import CorridorExcess, Fit, corridor_excess, fit, measured, shortened
from vve_sumo.lot.geofence import Geofence
from vve_sumo.network_tools.path_file import write_part
from vve_sumo.path import ReferencePath
from vve_sumo.path_feasibility import refuse_tight_bend
from vve_sumo.plotting.alignment import PathInLot
from vve_sumo.rig import edit
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.lock import rig_lock
from vve_sumo.rig.schema import Rig

#: largest residual of surveyed pairs where the rig states none [m]: half of a lane's spare width
RESIDUAL_LIMIT: Final = 0.20
LOT_COLUMNS: Final = ("lot_latitude_deg", "lot_longitude_deg")
STREET_COLUMNS: Final = ("street_x_m", "street_y_m")
GEODETIC_COLUMNS: Final = ("street_latitude_deg", "street_longitude_deg")


@dataclass(frozen=True, slots=True)
class AlignmentSite:
    """A path and the lot that it is to lie in."""

    resolved: ResolvedScenario
    rig: Rig
    rig_file: Path
    geofence: Geofence  #: with the lot's map as the virtual road's

    @property
    def speed(self) -> float:
        """Speed of the scenario's ego [m/s]."""
        return self.resolved.scenario.ego.speed_mps

    def fits(self, alignment: Alignment) -> Fit | None:
        """Return how the path lies under an alignment; None where not even its start is inside."""
        return measured(self.resolved.path, self.geofence, self.speed, alignment, self.resolved.corridor)

    def excess(self, alignment: Alignment) -> CorridorExcess | None:
        """Return where the declared corridor leaves the lot under an alignment, up to where the path itself does."""
        return corridor_excess(self.resolved.path, self.geofence, self.speed, alignment, self.resolved.corridor)

    def path_in_lot(self, result: AlignmentResult) -> PathInLot:
        """Return how the path lies in the lot under an alignment, for a picture."""
        return PathInLot(
            path_name=self.resolved.scenario.ego.path,
            lot_name=self.rig_file.stem,
            path=self.resolved.path,
            speed=self.speed,
            vehicle=self.resolved.vehicle,
            geofence=self.geofence,
            alignment=result.alignment,
            fit=result.fit,
            corridor=self.resolved.corridor,
        )


@dataclass(frozen=True, slots=True)
class AlignmentResult:
    """An alignment that was found, and how the path lies under it."""

    alignment: Alignment
    residual: float  #: worst error of the points that it was made from [m]
    fit: Fit | None
    evidence: tuple[str, ...] = ()  #: what the alignment is based on, a line each
    searched: bool = False  #: whether a search chose the place, so that nobody stands there yet

    @property
    def whole(self) -> bool:
        """Whether the car can stop inside the lot from everywhere on the path."""
        return self.fit is not None and self.fit.whole


def site_of(scenario: str, rig: str, working: Path, speed: float | None = None) -> AlignmentSite:
    """Find rig and scenario by name; raises ConfigError for what is missing, wrong or too fast for the lot.

    `speed` [m/s] takes the place of the scenario's, as `overrides.with_speed` says.
    """
    rig_file = workspace.find("rig", rig, working)
    loaded = rigs.load(rig_file, working)
    resolved = resolve_by_name(scenario, working, speed=speed)
    try:
        resolved = assembly.scenario_with_rig(resolved, loaded, working)
    except ConfigError as error:
        raise ConfigError(f"{workspace.find('scenario', scenario, working)}: {error}") from None
    return AlignmentSite(resolved, loaded, rig_file, meaning.geofence_of(loaded, Alignment()))


def matched(site: AlignmentSite, notify: Callable[[str], None] = lambda line: None) -> AlignmentResult:
    """Make the place where the car stands the start of the path; raises RigError where it has no trusted fixes.

    `notify` is called with a line before waiting for the fixes.
    """
    rig, path, t0 = site.rig, site.resolved.path, time.monotonic()
    with contextlib.ExitStack() as stack:
        stack.enter_context(rig_lock(site.rig_file, rig))
        source, _car = start_simulated_vehicle.open_receiver(rig, t0, site.resolved.scenario.seed, stack, None)
        notify(assembly.waiting_for_fixes(rig))
        standing = assembly.standing_pose_of(rig, source, t0)
    begin = path.at(0.0)
    start = pose_at_rest(begin.x, begin.y, begin.heading)
    alignment = lot_alignment(standing, meaning.frame_of(rig), meaning.mounting_of(rig), start, None).alignment
    evidence = (
        f"{standing.fixes} fixes of the standing car, within {standing.spread:.3f} m and "
        f"{math.degrees(standing.turn):.3f} deg "
        "of their average"
    )
    return AlignmentResult(alignment, standing.spread, site.fits(alignment), (evidence,))


def paired(site: AlignmentSite, file: Path) -> AlignmentResult:
    """Align the surveyed places of a CSV file with their places on the virtual road.

    Raises ConfigError for what is no such file, for mirrored or scaled surveys, and for a pair that is off by too much.
    """
    lot, road = read_pairs(file, site)
    wanted = site.rig.alignment
    limit = wanted.residual_m if wanted.kind == "surveyed_pairs" and wanted.residual_m else RESIDUAL_LIMIT
    try:
        loose = Alignment.from_surveyed_pairs(lot, road, math.inf)
        scale = np.std(np.array(road) @ (1.0, 1.0j)) / np.std(np.array(lot) @ (1.0, 1.0j))
        alignment = Alignment.from_surveyed_pairs(lot, road, limit)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    evidence = (
        *(f"pair {number}: off by {residual:.3f} m" for number, residual in enumerate(loose.residuals, 1)),
        f"road distances are {scale:.5f} times the lot's",
    )
    return AlignmentResult(alignment, max(alignment.residuals), site.fits(alignment), evidence)


def read_pairs(file: Path, site: AlignmentSite) -> tuple[list[Pair], list[Pair]]:
    """Return the same places on the lot's map and on the virtual road's [m]; ConfigError names file and line."""
    table = CsvNumbers(file, "pairs")
    by_map = set(STREET_COLUMNS) <= set(table.header)
    columns = (*LOT_COLUMNS, *(STREET_COLUMNS if by_map else GEODETIC_COLUMNS))
    if not set(columns) <= set(table.header):
        raise ConfigError(
            f"{table.name}: expected a header with {', '.join(LOT_COLUMNS)} and {', '.join(STREET_COLUMNS)} "
            f"or {', '.join(GEODETIC_COLUMNS)}"
        )
    frame, lot, road = meaning.frame_of(site.rig), [], []
    for where, numbers in table.numbers(columns):
        if not all(map(math.isfinite, numbers)):
            raise ConfigError(f"{where}: expected four finite numbers, got {', '.join(map(str, numbers))}")
        latitude, longitude, one, other = numbers
        lot.append(frame.to_map(math.radians(latitude), math.radians(longitude)))
        there = (one, other)
        road.append(there if by_map else site.resolved.map_frame.to_map(math.radians(one), math.radians(other)))
    return lot, road


def searched(site: AlignmentSite) -> AlignmentResult:
    """Search the alignment that leaves the path the most room; raises ConfigError where not even its start fits."""
    try:
        found = fit(site.resolved.path, site.geofence, site.speed, site.resolved.corridor)
    except ConfigError as error:
        raise ConfigError(f"{site.rig_file}: {error}") from None
    turn, shift = math.degrees(found.alignment.rotation), (found.alignment.x, found.alignment.y)
    evidence = (
        f"most room: the lot turned by {turn:.3f} deg, its origin at ({shift[0]:.2f}, {shift[1]:.2f}) m on the road"
    )
    return AlignmentResult(found.alignment, 0.0, found, (evidence,), searched=True)


def description(site: AlignmentSite, result: AlignmentResult) -> Iterator[str]:
    """Return lines: how the path lies in the lot, and where the car has to stand at its start."""
    length, margin = site.resolved.path.length, site.rig.lot.margin_m
    what = f"{length:.0f} m of {site.resolved.scenario.ego.path} at up to {site.speed:.1f} m/s"
    if site.resolved.corridor:
        what += " with its corridor"
    excess = None if result.whole or not site.resolved.corridor else site.excess(result.alignment)
    if excess is not None:
        yield f"{what}: {excess.text()}"
    elif result.fit is None:
        yield f"{what}: not even the start lies inside the lot"
    elif result.fit.whole:
        yield f"{what}: fits, {result.fit.clearance:.1f} m clear of every edge beyond the margin of {margin:g} m"
    else:
        yield f"{what}: from {result.fit.last_s:.0f} m on, the car could not stop inside the lot"
    if result.fit is not None:
        yield _start(site, result.fit)


def _start(site: AlignmentSite, fit: Fit) -> str:
    """Describe where the rear axle is at the path's start, and what the receiver reports there."""
    frame = meaning.frame_of(site.rig)
    x, y, heading = fit.start
    latitude, longitude = frame.to_geodetic(x, y)
    bearing = heading - frame.convergence(latitude, longitude)
    seen = Placement(frame, Alignment(), meaning.mounting_of(site.rig), 0.0).unplace(pose_at_rest(x, y, heading))
    return (
        f"start: rear axle at {_place(latitude, longitude)}, heading {_compass(bearing)} deg; "
        f"the receiver then says {_place(seen.latitude, seen.longitude)}, heading {_compass(seen.heading)} deg"
    )


def _place(latitude: float, longitude: float) -> str:
    return f"{math.degrees(latitude):.8f}, {math.degrees(longitude):.8f}"


def _compass(heading: float) -> str:
    """A counter-clockwise heading from east as degrees clockwise from north."""
    return f"{(90.0 - math.degrees(heading)) % 360.0:.2f}"


def cut(site: AlignmentSite, result: AlignmentResult, out: Path) -> ReferencePath:
    """Write the part of the path that fits as a path of its own into `out`, and return it."""
    assert result.fit is not None  # of a search
    geofence = site.geofence.aligned(result.alignment)
    short = shortened(site.resolved.path, geofence, site.speed, result.fit.last_s, site.resolved.corridor)
    source = site.resolved.files["path"]
    refuse_tight_bend(short, site.resolved.vehicle.tightest_curvature, f"{source}: its first {short.length:.0f} m")
    note = f"The first {short.length:.0f} m of {source.name}, cut by vve-sumo align for {site.rig_file.name}."
    write_part(short, site.resolved.map_frame, source, note, out)
    return short


def beyond(site: AlignmentSite, length: float) -> list[str]:
    """Return a line for everything that the scenario has beyond this length of its path [m], each with its place."""
    scenario = site.resolved.scenario
    places = [("obstacle", one.id, one.at_m) for one in scenario.obstacles]
    places += [("actor", one.id, one.at_m) for one in scenario.actors if one.path is None and one.at_m is not None]
    places += [
        ("corridor", f"{number} {key}", at)
        for number, stretch in enumerate(scenario.ego.corridor)
        for key, at in (("begins", stretch.from_m), ("ends", stretch.to_m))
        if at is not None
    ]
    return [
        f"{kind} {name} at {at:g} m lies beyond it: give the scenario another place"
        for kind, name, at in places
        if at > length
    ]


def refuse_shipped(rig_file: Path) -> None:
    """Raise ConfigError for a rig file that ships with the package, unless its own folder is the working one."""
    shipped = workspace.shipped_root()
    if rig_file.resolve().parent == shipped / "rigs" and Path.cwd().resolve() != shipped:
        raise ConfigError(f"{rig_file} ships with the package: vve-sumo init lays out one of your own")


def store(site: AlignmentSite, result: AlignmentResult, today: datetime.date, name: str | None = None) -> None:
    """Write an alignment into the rig file; raises ConfigError where it would not load or ships with the package.

    With a `name` it becomes the alignment of the scenario of that name alone. What was found by a search is also where
    the rig's simulated vehicle stands, if it has one.
    """
    refuse_shipped(site.rig_file)
    table = "alignment" if name is None else f"alignments.{name}"
    origin = site.rig.alignment.origin or site.rig.lot.outline[0]
    values: dict[str, Any] = {
        "kind": "stored",
        "network": site.resolved.scenario.road.network,
        "date": today,
        "origin": list(origin),
        "rotation_deg": round(math.degrees(result.alignment.rotation), 9),
        "x_m": round(result.alignment.x, 5),
        "y_m": round(result.alignment.y, 5),
        "residual_m": round(result.residual, 4),
    }
    start = start_values(site, result) if result.searched and site.rig.car == "simulated" else {}
    if start and name is not None:
        values["start"], start = list(start.values()), {}
    changed = {(table, key): value for key, value in values.items()}
    changed |= {("car_start", key): value for key, value in start.items()}
    edit.put(site.rig_file, changed, emptied=(table,))


def start_values(site: AlignmentSite, result: AlignmentResult) -> dict[str, float]:
    """Return where the rear axle stands at the path's start, by the keys of `[car_start]`."""
    if result.fit is None:
        return {}
    place = meaning.place_in_degrees(meaning.frame_of(site.rig), *result.fit.start)
    return dict(zip(("latitude_deg", "longitude_deg", "heading_deg"), place, strict=True))
