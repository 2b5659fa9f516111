"""The lot of a rig with a scenario's path in it, as the dossier shows it.

Searches, where nobody has said where the path lies; opens no receiver and writes nothing.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from vve_sumo import workspace
from vve_sumo.commissioning import align
from vve_sumo.commissioning.align import AlignmentSite
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment
from vve_sumo.live import assembly
from vve_sumo.plotting.alignment import PathInLot, path_in_lot
from vve_sumo.report.picture import DrawnPlot, picture_of
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning


class LotPicture(NamedTuple):
    """A picture, and what was shown."""

    picture: DrawnPlot | None
    lines: tuple[str, ...]  #: how the path lies in the lot; or why there is no picture


def lot_picture(scenario: str, rig: str, working: Path) -> LotPicture:
    """Return the lot of a rig with the path of a scenario; without a picture where the two do not go together."""
    try:
        site = _site(scenario, rig, working)
        result, how = _placed(site)
    except ConfigError as error:
        return LotPicture(None, (f"No picture: {error}.",))
    shown = PathInLot(
        path_name=site.resolved.scenario.ego.path,
        lot_name=site.rig_file.stem,
        path=site.resolved.path,
        speed=site.speed,
        vehicle=site.resolved.vehicle,
        geofence=site.geofence,
        alignment=result.alignment,
        fit=result.fit,
        corridor=site.resolved.corridor,
    )
    caption = (
        f"The lot as it was surveyed, the margin that is kept, and the ground that the car may cover on the path of "
        f"{scenario}, stops included. {how}"
    )
    picture = picture_of(path_in_lot(shown), "lot", "the lot from above, with fence and path", caption)
    return LotPicture(picture, (how, *align.description(site, result)))


def _site(scenario: str, rig: str, working: Path) -> AlignmentSite:
    """Return path and lot; a scenario that is too fast for the lot is taken at the rig's own limit."""
    rig_file = workspace.find("rig", rig, working)
    loaded, resolved = rigs.load(rig_file, working), resolve_by_name(scenario, working)
    ego = resolved.scenario.ego
    slowed = ego.model_copy(update={"speed_mps": min(ego.speed_mps, loaded.limits.speed_mps)})
    resolved = replace(resolved, scenario=resolved.scenario.model_copy(update={"ego": slowed}))
    resolved = assembly.scenario_with_rig(resolved, loaded, working)
    return AlignmentSite(resolved, loaded, rig_file, meaning.geofence_of(loaded, Alignment()))


def _placed(site: AlignmentSite) -> tuple[align.AlignmentResult, str]:
    """Return where the path lies in the lot, and how that is known."""
    stored = meaning.alignment_of(site.rig, site.resolved.scenario.road.network)
    if stored is not None:
        how = f"The path lies as it was {'surveyed' if site.rig.alignment.kind == 'surveyed_pairs' else 'aligned'}."
    elif site.rig.car_start is not None:
        stored, how = _from_the_start(site), "The path begins where the simulated vehicle stands."
    else:
        return align.searched(site), (
            "The path begins where the car will stand; shown is the place that leaves most room."
        )
    return align.AlignmentResult(stored, max(stored.residuals, default=0.0), site.fits(stored)), how


def _from_the_start(site: AlignmentSite) -> Alignment:
    """Return the alignment that lays the path's start to where the simulated vehicle stands."""
    start, frame, begin = site.rig.car_start, meaning.frame_of(site.rig), site.resolved.path.at(0.0)
    assert start is not None
    latitude, longitude = math.radians(start.latitude_deg), math.radians(start.longitude_deg)
    x, y = frame.to_map(latitude, longitude)
    heading = math.radians(90.0 - start.heading_deg) + frame.convergence(latitude, longitude)
    turn = begin.heading - heading
    cos, sin = math.cos(turn), math.sin(turn)
    return Alignment(turn, begin.x - (cos * x - sin * y), begin.y - (sin * x + cos * y))
