"""The tables of an ego's drive as metrics read them: motion, lead vehicle, actors' boxes, last stop, each found once.

Knows the columns of a record's tables; neither files nor what any metric makes of them.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vve_sumo.commanded_path import by_tick, curve
from vve_sumo.geometry import Boxes, time_to_collision_2d, vehicle_boxes
from vve_sumo.metrics.approach import StopApproach, approach_of, brakings
from vve_sumo.metrics.braked_for import last_stop_for
from vve_sumo.metrics.conflict import HORIZON as PREDICTED
from vve_sumo.metrics.conflict import Contacts, PredictedEgo, contacts
from vve_sumo.metrics.course import PredictedCourse, starts
from vve_sumo.metrics.drive_columns import ActorRows, Conflict, LeadMotion, Motion
from vve_sumo.metrics.lanes import LaneGraph, along_lanes, fronts
from vve_sumo.metrics.lead_vehicle import (
    BOX_COLUMNS,
    HORIZON,
    InStrip,
    LeadVehicle,
    in_strip,
    in_the_way,
    index_of_tick,
    lead_vehicle,
    own_s,
)
from vve_sumo.metrics.predicted_ways import Indices, PlacedWays, recorded_ways
from vve_sumo.metrics.ride_comfort import RideComfort, lateral_acceleration, ride_comfort, ride_of
from vve_sumo.metrics.routes import OWN_PATH, Routes
from vve_sumo.metrics.slope import slope
from vve_sumo.metrics.stopping import MOVING, BrakingEpisode, Stop, braking_episodes, commanded_deceleration, last_stop
from vve_sumo.metrics.string_stability import Amplification, settled_from, speed_amplification
from vve_sumo.metrics.tracking import WINDOW, Tracking, track
from vve_sumo.path import ReferencePath
from vve_sumo.values import EGO, CommandedPath, Floats, Vehicle

if TYPE_CHECKING:
    import pyarrow as pa

#: a car follows another while both go faster [m/s]
FOLLOWING_SPEED = 2.0
#: of one leader, for a disturbance and its answer to be seen [s]
MIN_FOLLOWED = 10.0


class DriveData:
    """The tables of an ego's drive, and what several metrics need of them.

    Any other ego of the same drive is one of the actors.
    """

    def __init__(
        self,
        ticks: pa.Table,
        actors: pa.Table,
        path: ReferencePath,
        vehicle: Vehicle,
        period: float,
        roads: pa.Table | None = None,
        commanded: pa.Table | None = None,
        ego: str = EGO,
    ) -> None:
        """`period` is a tick's [s]; `roads` are the lanes around the path, without which actors keep to no lane.

        `commanded` are the paths that commands carry, None for none. `ego` is the id of the ego whose tables, path and
        vehicle these are.
        """
        self.ego = ego
        self.ticks, self.actors, self.path, self.vehicle, self.period = ticks, actors, path, vehicle, period
        self.roads, self.commanded = roads, commanded

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
    def lateral_acceleration(self) -> Floats:
        """Across the heading, left positive, tick by tick [m/s2].

        Of the rear axle's true places where there is a truth; else speed times yaw rate as estimated, its slip left
        out.
        """
        motion = self.motion
        if motion.true:
            return lateral_acceleration(motion.time, motion.x, motion.y, motion.heading)
        return motion.speed * self.column("yaw_rate_radps")

    @cached_property
    def ride_comfort(self) -> RideComfort | None:
        """How the ride felt; None where the car never moved or its acceleration was not known throughout."""
        motion = self.motion
        ride = ride_of(motion.time, motion.speed, motion.acceleration, self.lateral_acceleration, self.period)
        return ride_comfort(ride) if ride else None

    @cached_property
    def ego_boxes(self) -> Boxes:
        """The ego's box at every tick."""
        motion = self.motion
        return vehicle_boxes(motion.x, motion.y, motion.heading, motion.speed, self.vehicle)

    @cached_property
    def s(self) -> Floats:
        """Where the rear axle was on the path, tick by tick [m]."""
        return own_s(self.path, self.motion.x, self.motion.y, self.column("s_m"))

    @cached_property
    def course(self) -> PredictedCourse:
        """Where the ego would go on from every tick."""
        motion, track, rate = self.motion, self.tracking, self.column("yaw_rate_radps")
        if motion.true:
            heading, known = motion.heading.copy(), np.isfinite(motion.heading)
            heading[known] = np.unwrap(heading[known])
            turned = slope(motion.time, heading, self.period)
            rate = np.where(np.isfinite(turned), turned, rate)
        place = motion.x, motion.y, motion.heading
        routes, route = self.routes
        s, deviation, along = self.s.copy(), track.lateral_deviation.copy(), track.path_heading.copy()
        own = np.flatnonzero((route != OWN_PATH) & np.isfinite(motion.x))
        own_place = motion.x[own], motion.y[own], np.zeros(len(own))
        s[own], deviation[own], along[own] = routes.search(route[own], *own_place, WINDOW)
        start = starts(s, *place, motion.speed, rate, along, deviation, route)
        return PredictedCourse(self.path, self.vehicle, start, routes)

    @cached_property
    def routes(self) -> tuple[Routes, Indices]:
        """The paths that the ego was to go along, the scenario's and the commanded ones, and which one at each tick."""
        route = np.full(self.ticks.num_rows, OWN_PATH)
        if self.commanded is None or self.commanded.num_rows == 0:
            return Routes.from_paths(self.path), route
        numbers: dict[CommandedPath, int] = {}
        paths, s = [], self.s
        index = {tick: at for at, tick in enumerate(self.ticks["tick"].to_pylist())}
        for tick, path in by_tick(self.commanded).items():
            if (at := index.get(tick)) is None:
                continue
            if path not in numbers:
                numbers[path] = len(numbers) + 1
                paths.append((curve(path), float(s[at])))
            route[at] = numbers[path]
        return Routes.from_paths(self.path, paths), route

    @cached_property
    def _in_strip(self) -> InStrip:
        return in_strip(self.ticks, self.actors, self.course, self.ego_boxes)

    @cached_property
    def strip_lead(self) -> LeadVehicle:
        """The nearest actor in the strip of the ego's width around the path, wherever it goes, and its gap."""
        return lead_vehicle(self._in_strip, self.actors, self.motion.speed)

    @cached_property
    def lead(self) -> LeadVehicle:
        """What was ahead in the ego's way, and its gap, tick by tick.

        Of what is in the strip before the path's end: what stands there or goes the ego's way, and what is or was in
        conflict with the ego. Crossing and oncoming traffic that the ego would not have met is left out.
        """
        conflicting = np.zeros(self.actors.num_rows, np.bool_)
        actors, met = self.actor_rows, np.isfinite(self.contacts.time)
        since = np.full(len(actors.names), len(self.s))
        np.minimum.at(since, actors.code[met], actors.at[met])
        conflicting[actors.rows] = actors.at >= since[actors.code]
        counted = in_the_way(self._in_strip, self.vehicle, conflicting)
        return lead_vehicle(counted, self.actors, self.motion.speed)

    @cached_property
    def predicted(self) -> PlacedWays:
        """The ways along which actors are expected to go on, and where each row of `actor_rows` is on its own."""
        actors, time = self.actor_rows, self.motion.time[self.actor_rows.at]
        middles = recorded_ways(time, actors.code, actors.boxes, PREDICTED)
        if self.roads is None:
            return middles
        ends = recorded_ways(time, actors.code, fronts(actors.boxes), PREDICTED)
        return along_lanes(LaneGraph.from_table(self.roads), middles, ends, actors.boxes, PREDICTED)

    @cached_property
    def contacts(self) -> Contacts:
        """What is predicted of the ego and each actor: an entry a row of `actor_rows`."""
        actors = self.actor_rows
        ego = PredictedEgo(self.course, self.motion.speed, self.ego_boxes)
        return contacts(ego, actors.at, actors.boxes, *self.predicted)

    @cached_property
    def conflict(self) -> Conflict:
        """What the ego and the actors come to by their predicted paths, tick by tick."""
        found, at = self.contacts, self.actor_rows.at
        time, names = self._first_of(found.time)
        deceleration = np.full(len(time), -np.inf)
        np.fmax.at(deceleration, at, found.deceleration)
        return Conflict(time, np.where(np.isfinite(deceleration), deceleration, np.nan), names)

    @cached_property
    def stop(self) -> Stop | None:
        """The last stop that was commanded; None where the drive holds none."""
        motion = self.motion
        return last_stop(self.ticks, motion.speed, motion.acceleration, self.vehicle.deceleration_limit)

    @cached_property
    def braking_episodes(self) -> list[BrakingEpisode]:
        """Its braking episodes, trim among them."""
        motion = self.motion
        return braking_episodes(motion.time, commanded_deceleration(self.ticks), motion.speed)

    @cached_property
    def approach(self) -> StopApproach | None:
        """The approach of the last stop; None where the drive holds none."""
        stop, motion, lead = self.stop, self.motion, self.lead
        if stop is None:
            return None
        target = last_stop_for(self)
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
        return ActorRows(rows, at[rows], code, names.dictionary.to_pylist(), boxes)

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
        along = np.cos(boxes.heading - self._course_heading(at, boxes))
        motion = LeadMotion(*(np.full(len(time), np.nan) for _ in LeadMotion._fields))
        motion.length[at] = boxes.length
        motion.speed[at] = boxes.speed * along
        motion.acceleration[at] = acceleration[rows] * along
        return motion

    @cached_property
    def behind_leader(self) -> NDArray[np.bool_]:
        """Whether the ego follows an actor that goes its way, tick by tick: both move, and there is a gap."""
        moving = (self.motion.speed > FOLLOWING_SPEED) & (self.lead_motion.speed > FOLLOWING_SPEED)
        behind: NDArray[np.bool_] = moving & (self.lead.gap > 0.0)
        return behind

    @cached_property
    def following(self) -> Indices:
        """The ticks of the longest time behind one leader, from when the ego has settled behind it.

        None where it never settles, or where what is left is shorter than MIN_FOLLOWED.
        """
        names = np.where(self.behind_leader, self.lead.actor, "")
        starts = np.flatnonzero(np.append(True, names[1:] != names[:-1])[: len(names)])
        stretches = [rows for rows in np.split(np.arange(len(names)), starts[1:]) if len(rows) and names[rows[0]]]
        longest = max(stretches, key=len, default=np.zeros(0, np.int64))
        gap, speed, time = self.lead.gap[longest], self.motion.speed[longest], self.motion.time[longest]
        settled = settled_from(time, gap, self.lead_motion.speed[longest], speed)
        longest, time = longest[settled:], time[settled:]
        return longest if len(time) and time[-1] - time[0] >= MIN_FOLLOWED else longest[:0]

    @cached_property
    def speed_amplification(self) -> Amplification:
        """How much larger the ego's disturbance is than its leader's, in the ticks of `following`."""
        rows = self.following
        return speed_amplification(self.lead_motion.speed[rows], self.motion.speed[rows])

    def _course_heading(self, at: Indices, boxes: Boxes) -> Floats:
        """Return the heading [rad] that the ego's course has at boxes that are ahead of the ego at these ticks."""
        near = np.full(len(at), 0.5 * HORIZON)
        return self.course.find(self.course.starts.select(at), boxes.x, boxes.y, near, 0.5 * HORIZON + 3.0 * WINDOW)[2]

    @cached_property
    def first_touch(self) -> tuple[Floats, list[str]]:
        """The least time to collision of boxes [s], tick by tick, and with whom; NaN and empty for none."""
        actors = self.actor_rows
        return self._first_of(time_to_collision_2d(self.ego_boxes.select(actors.at), actors.boxes))

    def _first_of(self, times: Floats) -> tuple[Floats, list[str]]:
        """Return the least of the times of all actors at each tick [s], and whose it is; NaN and empty for none."""
        actors, ticks = self.actor_rows, self.ticks.num_rows
        least, names = np.full(ticks, np.inf), [""] * ticks
        np.fmin.at(least, actors.at, times)
        rows = np.flatnonzero(np.isfinite(times) & (times == least[actors.at]))
        for at, code in zip(actors.at[rows].tolist(), actors.code[rows].tolist(), strict=True):
            names[at] = actors.names[code]
        return np.where(np.isfinite(least), least, np.nan), names
