"""The lot of a rig with a scenario's path in it, as the dossier shows it.

Lays the path lengthwise into the lot where nobody has said where it lies; opens no receiver and writes nothing.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from vve_sumo import workspace
from vve_sumo.commissioning import align
from vve_sumo.commissioning.align import AlignmentSite
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment
from vve_sumo.live import assembly
from vve_sumo.plotting.alignment import path_in_lot
from vve_sumo.report.picture import DrawnPlot, picture_of
from vve_sumo.rig import load as rigs
from vve_sumo.rig import resolve as meaning
from vve_sumo.values import Floats

POINTS: Final = 200  #: of a path whose axis is looked for


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
    caption = (
        f"The lot as it was surveyed, the margin that is kept, and the ground that the car may cover on the path of "
        f"{scenario}, stops included. {how}"
    )
    picture = picture_of(
        path_in_lot(site.path_in_lot(result)), "lot", "the lot from above, with fence and path", caption
    )
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
        return _lengthwise(site), (
            "The path begins where the car will stand; here it is laid lengthwise into the lot. vve-sumo align --fit "
            "searches for the place with most room."
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


def _lengthwise(site: AlignmentSite) -> align.AlignmentResult:
    """Return the path along the longer axis of the lot, middle on middle, in the direction that takes more of it.

    A search for the best place takes minutes where there is none.
    """
    path = site.resolved.path
    points = np.array([(one.x, one.y) for one in map(path.at, np.linspace(0.0, path.length, POINTS).tolist())])
    (lot_angle, lot_middle), (path_angle, path_middle) = _axis(site.geofence.lot.outline), _axis(points)
    results = []
    for turn in (path_angle - lot_angle, path_angle - lot_angle + math.pi):
        x, y = path_middle - _rotation(turn) @ lot_middle
        alignment = Alignment(turn, float(x), float(y))
        results.append(align.AlignmentResult(alignment, 0.0, site.fits(alignment)))
    return max(results, key=lambda one: (-1.0, 0.0) if one.fit is None else (one.fit.last_s, one.fit.clearance))


def _rotation(angle: float) -> Floats:
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def _axis(points: Floats) -> tuple[float, Floats]:
    """Return the direction of the longer axis of points [rad], and the middle of their extent along both axes [m]."""
    axes = np.linalg.svd(points - points.mean(axis=0))[2]
    angle = math.atan2(axes[0, 1], axes[0, 0])
    along = points @ _rotation(angle)
    return angle, _rotation(angle) @ (0.5 * (along.min(axis=0) + along.max(axis=0)))
