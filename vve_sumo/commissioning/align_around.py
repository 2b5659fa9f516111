"""Lays the meeting with an obstacle or actor of a scenario into a rig's lot, at the fastest speed that fits there.

The ego starts from rest on a part of its path: the approach to speed, the meeting, and beyond it the room to stop. What
fits is decided by `lot.fit` and the geofence alone. The module sends no frame and moves nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np

from vve_sumo import workspace
from vve_sumo.commissioning.align import AlignmentResult, AlignmentSite, start_values
from vve_sumo.commissioning.event_stretch import EventStretch, event_stretch, refuse_event
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.rolling_start import require_start_from_rest
from vve_sumo.drive.run import resolve_by_name, table_by_name
from vve_sumo.drive.several_egos import require_one_ego
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment
from vve_sumo.lot.fit import fit_whole
from vve_sumo.network_tools.path_file import part_of, write_part
from vve_sumo.path_feasibility import MIN_PATH_LENGTH, refuse_tight_bend
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.rig.schema import Rig
from vve_sumo.scenario import overrides
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.part import ScenarioPart, on_part
from vve_sumo.values import Floats

FIRST_STEP: Final = 1.0  #: by which the search comes down from the highest speed [m/s]
SPEED_STEP: Final = 0.25  #: the fastest speed that fits is found to this [m/s]
MIN_SPEED: Final = 2.0  #: slower is no drive of a road's scenario [m/s]

#: what speaks against a meeting that the search laid nowhere; it is a search, and no proof
NO_PLACE: Final = "no place was found in the lot"

Notify = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class EventInLot:
    """A meeting that fits into a lot."""

    stretch: EventStretch
    speed: float  #: of the ego [m/s]
    site: AlignmentSite  #: the scenario on the stretch alone, and the lot
    part: ScenarioPart  #: the same scenario as a table; it names the path by the whole one's name
    result: AlignmentResult


class EventSite:
    """A scenario whose meetings are laid into a rig's lot, at one speed after the other."""

    def __init__(self, scenario: str, rig: str, working: Path) -> None:
        """Find rig and scenario by name; raises ConfigError for what is missing or wrong, and for a rolling start."""
        self.rig_file = workspace.find("rig", rig, working)
        self.rig: Rig = rigs.load(self.rig_file, working)
        self.file, self._table = table_by_name(scenario, working)
        resolved = resolve_by_name(scenario, working)
        require_one_ego(resolved, "a lot is one real car's")
        require_start_from_rest(resolved, "a drive with a rig starts from rest")
        self._resolved = resolved.with_rig(self.rig, working, live=True)
        self._geofence = meaning.geofence_of(self.rig, Alignment())
        bounds = overrides.speed_bounds(self._table)
        self.slowest = max(MIN_SPEED, float(bounds.get("min", MIN_SPEED)))
        self.fastest_allowed = min(self.rig.limits.speed_mps, float(bounds.get("max", math.inf)))
        if self.slowest > self.fastest_allowed:
            raise ConfigError(
                f"{self.file}: drives at {self.slowest:g} m/s or faster, but limits.speed_mps of {self.rig_file} is "
                f"{self.rig.limits.speed_mps:g} m/s"
            )

    @property
    def resolved(self) -> ResolvedScenario:
        """The whole scenario at its own speed, with the rig's car."""
        return self._resolved

    @property
    def own_speed(self) -> float:
        """The scenario's own speed, or the nearest one that scenario and rig allow [m/s]."""
        return min(max(self._resolved.scenario.ego.speed_mps, self.slowest), self.fastest_allowed)

    def obstacle_to(self, event: str, speed: float, called: str = "") -> str:
        """Return why a meeting is none at a speed [m/s], wherever it is driven; empty where it is one.

        The speed is `called` by its number unless by something else. Raises ConfigError as `event_stretch`, and for a
        speed that the scenario does not allow.
        """
        return self._why_not(event_stretch(self._at_speed(speed), event), called or f"{speed:.2f} m/s")

    def tried(self, event: str, speed: float) -> EventInLot | None:
        """Return how the meeting fits at a speed [m/s]; None where it does not, or is none.

        Raises ConfigError as `obstacle_to` and `on_part`.
        """
        resolved = self._at_speed(speed)
        stretch = event_stretch(resolved, event)
        path = part_of(resolved.path, stretch.begin, stretch.end)
        if self._why_not(stretch, "") or _span(np.array(path.points)) > _span(self._geofence.lot.outline):
            return None
        bumper, table = resolved.vehicle.rear_axle_to_bumper, overrides.with_speed(self._table, speed)
        part = on_part(resolved.scenario, table, stretch.begin, stretch.end, resolved.scenario.ego.path, bumper)
        whole = self._with_settings(part.table, replace(self._resolved, path=path))
        site = AlignmentSite(whole, self.rig, self.rig_file, self._geofence)
        found = fit_whole(path, self._geofence, speed, site.resolved.corridor)
        if found is None:
            return None
        return EventInLot(stretch, speed, site, part, AlignmentResult(found.alignment, 0.0, found, searched=True))

    def fastest(self, event: str, highest: float, notify: Notify) -> EventInLot | None:
        """Return the meeting at the fastest speed up to `highest` [m/s] that fits, to SPEED_STEP; None for none.

        The search comes down from `highest` in steps of FIRST_STEP, for what fits at a speed may not fit at a slower
        one: a car that is hardly faster than who cuts in comes up to it late. `notify` is called with a line before
        each search.
        """

        def tried(speed: float) -> EventInLot | None:
            notify(f"searching at {speed:.2f} m/s")
            return self.tried(event, speed)

        high = highest
        for low in self.steps(highest):
            if (best := tried(low)) is not None:
                break
            high = low
        else:
            return None
        while high - low > SPEED_STEP:
            middle = 0.5 * (low + high)
            if (found := tried(middle)) is not None:
                best, low = found, middle
            else:
                high = middle
        return best

    def steps(self, highest: float) -> list[float]:
        """Return the speeds at which the search comes down from `highest` to the slowest one [m/s]."""
        count = max(math.ceil((highest - self.slowest) / FIRST_STEP - 1e-9), 0)
        return [*(highest - FIRST_STEP * number for number in range(count)), min(self.slowest, highest)]

    def why_none(self, event: str, highest: float) -> str:
        """Return why a meeting fits at no speed up to `highest` [m/s], by the speeds at which it was searched for.

        Speeds that follow each other share a reason: that of `obstacle_to`, or that the search found no place.
        """
        reasons = [(speed, self.obstacle_to(event, speed, "that speed") or NO_PLACE) for speed in self.steps(highest)]
        spans = ([speed for speed, _ in those] for _, those in groupby(reasons, key=itemgetter(1)))
        said = dict(reasons)
        return "; ".join(f"{_span_of(speeds)}: {said[speeds[0]]}" for speeds in spans)

    def _why_not(self, stretch: EventStretch, called: str) -> str:
        """Return why a stretch is no meeting; the speed is named as it is `called`."""
        if not stretch.at_speed:
            return f"the path has no room to get to {called} before it"
        if not stretch.contact and event_stretch(self._resolved, stretch.event).contact:
            return f"an ego that keeps {called} never touches it, there is nothing to brake for"
        if stretch.end - stretch.begin < MIN_PATH_LENGTH:
            return f"its part of the path is shorter than {MIN_PATH_LENGTH:g} m"
        return ""

    def _at_speed(self, speed: float) -> ResolvedScenario:
        return self._with_settings(overrides.with_speed(self._table, speed), self._resolved)

    def _with_settings(self, table: dict[str, Any], resolved: ResolvedScenario) -> ResolvedScenario:
        """Return a resolved scenario with the settings of a table, and the rig's car as it has."""
        scenario = parse(table, self.file)
        ego = scenario.ego.model_copy(update={"vehicle": self._resolved.scenario.ego.vehicle})
        return replace(resolved, scenario=scenario.model_copy(update={"ego": ego}))


def _span_of(speeds: list[float]) -> str:
    """Return one speed, or the first and last of several, in words."""
    first, last = speeds[0], speeds[-1]
    return f"at {first:.2f} m/s" if len(speeds) == 1 else f"at {first:.2f} to {last:.2f} m/s"


def _span(points: Floats) -> float:
    """Return the greatest distance between two of some points (n, 2) [m]; what spans more than a lot is not in it."""
    apart = points[:, None] - points[None]
    return math.sqrt(float((apart * apart).sum(axis=2).max()))


def refuse_unknown_event(site: EventSite, event: str) -> None:
    """Raise ConfigError where the scenario has no obstacle and no actor of this id."""
    refuse_event(site.resolved, event)


def write_scenario(found: EventInLot, source: ResolvedScenario, out: Path) -> Path:
    """Write the scenario on its stretch into `out`, its path beside it; return the path's file.

    `source` is the whole scenario. The simulated car stands where the path begins in the lot. Raises ConfigError, and
    writes nothing, for a name that is none or taken, and for a bend that the car cannot follow.
    """
    if out.suffix != ".toml" or not out.stem.replace("-", "_").isidentifier():
        raise ConfigError(f"--write-scenario {out}: expected the name of a .toml file of letters, digits, - and _")
    path_file = out.with_suffix(".csv")
    if not out.parent.is_dir():
        raise ConfigError(f"--write-scenario {out}: expected an existing folder, got {out.parent}")
    if out.resolve() == source.file.resolve():
        raise ConfigError(f"--write-scenario {out}: is the scenario itself; expected another file")
    stretch, resolved = found.stretch, found.site.resolved
    whole = source.files["path"]
    what = f"{stretch.begin:.1f} to {stretch.end:.1f} m of {whole.name}"
    refuse_tight_bend(resolved.path, resolved.vehicle.tightest_curvature, what)
    table = found.part.table
    table["title"] = f"{source.scenario.title} (metres {stretch.begin:.0f} to {stretch.end:.0f} of its path)"
    if source.scenario.description:
        table["description"] = f"{source.scenario.description}\nPlaces in this text count along the whole path."
    table["ego"] = table["ego"] | {"path": path_file.name, "lot": start_values(found.site, found.result)}
    parse(table, out)
    note = f"Metres {stretch.begin:.2f} to {stretch.end:.2f} of {whole.name}, cut by vve-sumo align --around."
    write_part(resolved.path, resolved.map_frame, whole, note, path_file)
    out.write_text(_toml(table), encoding="utf-8")
    return path_file


def _toml(table: dict[str, Any]) -> str:
    import tomlkit

    return tomlkit.dumps(table)
