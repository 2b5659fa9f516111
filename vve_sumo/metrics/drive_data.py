"""A drive's tables as metrics read them: motion of the ego, lead vehicle, actors' boxes, last stop, each found once.

Knows the columns of a record's tables; neither files nor what any metric makes of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vve_sumo.geometry import Boxes, time_to_collision_2d, vehicle_boxes
from vve_sumo.metrics.approach import Approach, approach_of, brakings
from vve_sumo.metrics.lead_vehicle import BOX_COLUMNS, HORIZON, LeadVehicle, index_of_tick, lead_vehicle
from vve_sumo.metrics.slope import slope
from vve_sumo.metrics.stopping import MOVING, Episode, Stop, braking_episodes, commanded_deceleration, last_stop
from vve_sumo.metrics.tracking import WINDOW, Tracking, track
from vve_sumo.path import Path
from vve_sumo.values import Floats, Vehicle

if TYPE_CHECKING:
    import pyarrow as pa

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Motion:
    """How the rear axle moved: one entry a tick, NaN where nobody knows."""

    true: bool  #: whether this is the truth, which only a simulated vehicle has; else the pipeline's estimate
    time: Floats  #: drive time [s]
    x: Floats  #: map [m]
    y: Floats  #: map [m]
    heading: Floats  #: [rad] counter-clockwise from the map's +x
    speed: Floats  #: along the heading, forward positive [m/s]
    acceleration: Floats  #: rate of change of speed [m/s2]


class LeadMotion(NamedTuple):
    """The lead vehicle's own size and motion, one entry a tick; NaN where there is none."""

    length: Floats  #: [m]
    speed: Floats  #: along the path, away from the ego positive [m/s]
    acceleration: Floats  #: likewise [m/s2]


class ActorRows(NamedTuple):
    """The rows of the table of actors that belong to a tick of the record."""

    at: Indices  #: index of the tick
    code: Indices  #: number of the actor, an index of `names`
    names: list[str]
    boxes: Boxes  #: a row each


class DriveData:
    """The tables of a drive, and what several metrics need of them."""

    def __init__(self, ticks: pa.Table, actors: pa.Table, path: Path, vehicle: Vehicle, period: float) -> None:
        """`period` is a tick's [s]."""
        self.ticks, self.actors, self.path, self.vehicle, self.period = ticks, actors, path, vehicle, period

    def column(self, name: str) -> Floats:
        """Return a column of the ticks."""
        values: Floats = self.ticks[name].to_numpy()
        return values

    @cached_property
    def motion(self) -> Motion:
        """How the rear axle moved: the truth where there is one, else the estimate."""
        true = bool(np.isfinite(self.column("true_x_m")).any())
        prefix = "true_" if true else ""
        names = ("x_m", "y_m", "heading_rad", "speed_mps", "acceleration_mps2")
        return Motion(true, self.column("time_s"), *(self.column(f"{prefix}{name}") for name in names))

    @cached_property
    def ego_boxes(self) -> Boxes:
        """The ego's box at every tick."""
        motion = self.motion
        return vehicle_boxes(motion.x, motion.y, motion.heading, motion.speed, self.vehicle)

    @cached_property
    def lead(self) -> LeadVehicle:
        """What was ahead in the ego's strip, and its gap, tick by tick."""
        motion = self.motion
        return lead_vehicle(self.ticks, self.actors, self.path, self.vehicle, motion.x, motion.y, motion.speed)

    @cached_property
    def stop(self) -> Stop | None:
        """The last stop that was commanded; None where the drive holds none."""
        motion = self.motion
        return last_stop(self.ticks, motion.speed, motion.acceleration, self.vehicle.deceleration_limit)

    @cached_property
    def braking_episodes(self) -> list[Episode]:
        """Its braking episodes, trim among them."""
        motion = self.motion
        return braking_episodes(motion.time, commanded_deceleration(self.ticks), motion.speed)

    @cached_property
    def approach(self) -> Approach | None:
        """The approach of the last stop; None where the drive holds none."""
        stop, motion, lead = self.stop, self.motion, self.lead
        if stop is None:
            return None
        target = lead.actor[stop.rest]
        ahead = np.array([name == target != "" for name in lead.actor], bool)
        standing = ahead & (np.abs(motion.speed - lead.closing_speed) < MOVING)
        onsets = brakings(motion.time, commanded_deceleration(self.ticks), self.braking_episodes)
        return approach_of(stop, onsets, motion.time, motion.speed, motion.acceleration, standing)

    @cached_property
    def tracking(self) -> Tracking:
        """How well the ego kept to its path, tick by tick."""
        motion = self.motion
        return track(self.path, motion.x, motion.y, motion.heading, self.column("s_m"))

    @cached_property
    def actor_rows(self) -> ActorRows:
        """The actors' boxes."""
        at = index_of_tick(self.ticks, self.actors)
        rows = np.flatnonzero(at >= 0)
        names = self.actors["actor"].combine_chunks().dictionary_encode()
        boxes = Boxes(*(self.actors[column].to_numpy()[rows] for column in BOX_COLUMNS))
        code = names.indices.to_numpy()[rows].astype(np.int64)
        return ActorRows(at[rows], code, names.dictionary.to_pylist(), boxes)

    @cached_property
    def lead_motion(self) -> LeadMotion:
        """The lead vehicle's size and motion; its acceleration is the slope of its speed, also before it was ahead."""
        actors, time = self.actor_rows, self.motion.time
        numbers = {name: number for number, name in enumerate(actors.names)}
        wanted = np.array([numbers.get(name, -1) for name in self.lead.actor], np.int64)
        rows = np.flatnonzero(actors.code == wanted[actors.at])
        acceleration = np.full(len(actors.at), np.nan)
        for code in np.unique(actors.code[rows]):
            own = np.flatnonzero(actors.code == code)
            acceleration[own] = slope(time[actors.at[own]], actors.boxes.speed[own], self.period)
        at, boxes = actors.at[rows], actors.boxes.select(rows)
        along = np.cos(boxes.heading - self._path_heading(at, boxes))
        motion = LeadMotion(*(np.full(len(time), np.nan) for _ in LeadMotion._fields))
        motion.length[at] = boxes.length
        motion.speed[at] = boxes.speed * along
        motion.acceleration[at] = acceleration[rows] * along
        return motion

    def _path_heading(self, at: Indices, boxes: Boxes) -> Floats:
        """Return the path's heading [rad] at boxes that are ahead of the ego at these ticks."""
        own = self.column("s_m")[at]
        _, _, heading = self.path.project_many(boxes.x, boxes.y, own + 0.5 * HORIZON, 0.5 * HORIZON + 3.0 * WINDOW)
        return heading

    @cached_property
    def first_touch(self) -> tuple[Floats, list[str]]:
        """The least time to collision of boxes [s], tick by tick, and with whom; NaN and empty for none."""
        actors, ticks = self.actor_rows, self.ticks.num_rows
        times = time_to_collision_2d(self.ego_boxes.select(actors.at), actors.boxes)
        least, names = np.full(ticks, np.inf), [""] * ticks
        np.fmin.at(least, actors.at, times)
        rows = np.flatnonzero(np.isfinite(times) & (times == least[actors.at]))
        for at, code in zip(actors.at[rows].tolist(), actors.code[rows].tolist(), strict=True):
            names[at] = actors.names[code]
        return np.where(np.isfinite(least), least, np.nan), names
