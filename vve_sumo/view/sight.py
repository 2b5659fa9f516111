"""What of the traffic a sensor could have seen at a reading: who is hidden behind whom, and who was missed.

Plane geometry in the field of view that the sensor declares. Knows neither records nor pages.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Collection
from dataclasses import fields
from typing import Final

import numpy as np

from vve_sumo.sensors.drawing import FieldOfView
from vve_sumo.sensors.echo import Antenna, echoes
from vve_sumo.sensors.visibility import Sector
from vve_sumo.values import Actors

#: fields of `Actors` that have an entry an actor, beside the names
_COLUMNS: Final = tuple(field.name for field in fields(Actors) if field.name not in ("time", "ids"))


class MissReason(enum.StrEnum):
    """Why an actor inside the field of view is in no row of a reading."""

    OCCLUDED = "occluded"  #: other actors hide it, wholly
    MISSED = "missed"  #: it was in sight, and the reading has no row of it


class FieldOfViewCheck:
    """A field of view, and what is inside from a place."""

    def __init__(self, view: FieldOfView) -> None:
        self._frame = view.frame
        self._sectors = [Sector(sector.range_m, math.tan(sector.half_angle_rad)) for sector in view.sectors]
        self._farthest = max(sector.range_max for sector in self._sectors)

    def undetected(
        self, pose: tuple[float, float, float], actors: Actors, detected: Collection[str]
    ) -> dict[str, MissReason]:
        """Return the actors inside the field of view that a reading did not detect, each with the reason.

        `pose` is x, y [m] and heading [rad] of the rear axle in the map. An actor is inside where it would be in sight
        if it were alone; actors outside are left out.
        """
        origin = self._origin(*pose)
        visible = {actors.ids[echo.row] for echo in echoes(origin, actors, self._sectors)[0]}
        found = {name: MissReason.MISSED for name in actors.ids if name in visible and name not in detected}
        for row in self._near(origin, actors):
            name = actors.ids[row]
            if name not in visible and name not in detected and echoes(origin, _alone(actors, row), self._sectors)[0]:
                found[name] = MissReason.OCCLUDED
        return found

    def _origin(self, x: float, y: float, heading: float) -> Antenna:
        frame, cos, sin = self._frame, math.cos(heading), math.sin(heading)
        at = x + frame.x_m * cos - frame.y_m * sin, y + frame.x_m * sin + frame.y_m * cos
        return Antenna(*at, heading + frame.yaw_rad, 0.0, 0.0)

    def _near(self, origin: Antenna, actors: Actors) -> list[int]:
        """Return the rows of the actors that may reach into the field of view, by circles around them."""
        east, north, radius = actors.x - origin.x, actors.y - origin.y, 0.5 * (actors.length + actors.width)
        ahead = east * np.cos(origin.heading) + north * np.sin(origin.heading)
        near = (ahead > -radius) & (np.hypot(east, north) < self._farthest + radius)
        rows: list[int] = np.flatnonzero(near).tolist()
        return rows


def _alone(actors: Actors, row: int) -> Actors:
    one = slice(row, row + 1)
    columns = {name: getattr(actors, name)[one] for name in _COLUMNS}
    return Actors(actors.time, (actors.ids[row],), **columns)
