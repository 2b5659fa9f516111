"""What of the traffic the radar could have detected at a scan: who is hidden behind whom, and who was missed.

Uses the radar's own geometry, without its noise and its chance. Knows neither records nor pages.
"""

from __future__ import annotations

import enum
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from vve_sumo.sensors.echo import Antenna, Mount, antenna_at, echoes
from vve_sumo.sensors.radar import RadarConfig
from vve_sumo.sensors.visibility import Sector
from vve_sumo.values import Actors, Floats, Point, Pose, Vehicle


class Why(enum.StrEnum):
    """Why an actor inside the field of view has no return in a scan."""

    OCCLUDED = "occluded"  #: other actors hide it, wholly
    MISSED = "missed"  #: it was in sight, and the scan did not detect it


class FieldOfView(NamedTuple):
    """The radar's field of view and where its antenna is mounted."""

    sectors: tuple[Sector, ...]
    mount: Mount
    vehicle: Vehicle

    @classmethod
    def of(cls, config: RadarConfig, vehicle: Vehicle) -> FieldOfView:
        """Return the field of view of a radar on a vehicle."""
        sectors = tuple(Sector(mode.range_max, float(np.tan(mode.half_angle))) for mode in config.modes)
        return cls(sectors, config.mount, vehicle)

    def antenna(self, x: float, y: float, heading: float) -> Antenna:
        """Return where the antenna is, from the rear axle's place in the map [m] and heading [rad]."""
        pose = Pose(0.0, Point.REAR_AXLE, x, y, heading, 0.0, 0.0, 0.0, 0.0, 0.0)
        return antenna_at(pose, self.mount, self.vehicle)


def unseen(antenna: Antenna, actors: Actors, detected: Collection[str], view: FieldOfView) -> dict[str, Why]:
    """Return the actors inside the field of view that a scan did not detect, each with the reason.

    An actor is inside where the radar would see it if it were alone; actors outside are left out.
    """
    visible = {actors.ids[echo.row] for echo in echoes(antenna, actors, view.sectors)[0]}
    found = {name: Why.MISSED for name in actors.ids if name in visible and name not in detected}
    for row in _near(antenna, actors, view):
        name = actors.ids[row]
        if name not in visible and name not in detected and echoes(antenna, _alone(actors, row), view.sectors)[0]:
            found[name] = Why.OCCLUDED
    return found


def _near(antenna: Antenna, actors: Actors, view: FieldOfView) -> list[int]:
    """Return the rows of the actors that may reach into the field of view, by circles around them."""
    east, north, radius = actors.x - antenna.x, actors.y - antenna.y, 0.5 * (actors.length + actors.width)
    ahead = east * np.cos(antenna.heading) + north * np.sin(antenna.heading)
    farthest = max(sector.range_max for sector in view.sectors)
    rows: list[int] = np.flatnonzero((ahead > -radius) & (np.hypot(east, north) < farthest + radius)).tolist()
    return rows


def return_points(
    x: Floats | float, y: Floats | float, heading: Floats | float, range_: Floats, azimuth: Floats
) -> tuple[Floats, Floats]:
    """Return where detections lie in the map [m], from the pose of the middle of the front bumper at their scans."""
    return x + range_ * np.cos(heading + azimuth), y + range_ * np.sin(heading + azimuth)


def _alone(actors: Actors, row: int) -> Actors:
    one = slice(row, row + 1)
    columns = (actors.x, actors.y, actors.heading, actors.speed, actors.length, actors.width)
    sections = (actors.radar_cross_section, actors.lateral_speed)
    return Actors(actors.time, (actors.ids[row],), *(column[one] for column in (*columns, *sections)))
