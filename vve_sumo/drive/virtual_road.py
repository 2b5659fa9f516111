"""The street as a shell drives it: starts the world from a setting, places the ego, remembers what the next tick sees.

Every shell uses it, lockstep, playback and live; it knows no car and no controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from vve_sumo.drive.resolved_scenario import PERIOD, ResolvedScenario
from vve_sumo.frames import Alignment, MapFrame
from vve_sumo.path import Path
from vve_sumo.scenario import schema
from vve_sumo.scenario.engine import ScenarioEngine
from vve_sumo.values import Actors, Point, Pose
from vve_sumo.world.ego_sync import EgoSyncReport
from vve_sumo.world.obstacles import MapSpot, Obstacle
from vve_sumo.world.surroundings import table
from vve_sumo.world.world import World

#: A car that is faster has been driven off [m/s].
MOVING = 0.5


def obstacles_of(setting: ResolvedScenario) -> tuple[Obstacle, ...]:
    """Return the scenario's obstacles, laid beside the path."""
    wanted = setting.scenario.obstacles
    return tuple(Obstacle(one.id, spot_of(one, setting.path), one.length_m, one.width_m) for one in wanted)


def spot_of(wanted: schema.Obstacle, path: Path) -> MapSpot:
    """Return where the middle of an obstacle lies that the scenario places beside a path."""
    at = path.at(wanted.at_m)
    x, y = at.x - wanted.offset_m * math.sin(at.heading), at.y + wanted.offset_m * math.cos(at.heading)
    return MapSpot(x, y, at.heading + math.radians(wanted.turned_deg))


def cast_of(setting: ResolvedScenario) -> ScenarioEngine:
    """Return the scenario's actors, none of them on the street yet."""
    scenario = setting.scenario
    return ScenarioEngine(scenario.actors, setting.path, setting.lines, setting.recordings, setting.vehicle)


def standing(x: float, y: float, heading: float) -> Pose:
    """Return the pose of a rear axle at rest."""
    return Pose(0.0, Point.REAR_AXLE, x, y, heading, 0.0, 0.0, 0.0, 0.0, 0.0)


def open_world(setting: ResolvedScenario, clock: Callable[[], float] | None = None) -> World:
    """Start SUMO with the setting's street, traffic and obstacles; raises ConfigError as World does.

    With a `clock` [s] the traffic is held within what a live tick has room for.
    """
    return World(
        setting.network.path,
        demand=setting.demand,
        seed=setting.scenario.seed,
        period=PERIOD,
        vehicle=setting.vehicle,
        obstacles=obstacles_of(setting),
        warm_up=setting.scenario.street.warm_up_s,
        route=setting.route,
        clock=clock,
    )


def laid(frame: MapFrame, alignment: Alignment, epoch: float) -> dict[str, Any]:
    """Return what ties a drive to time and earth, for the record: time 0, the lot's map, its place on the street."""
    return {
        "epoch_gnss_s": epoch,
        "lot_projection": frame.projection,
        "lot_to_street": {"rotation_rad": alignment.rotation, "x_m": alignment.x, "y_m": alignment.y},
    }


class VirtualRoad:
    """The world as a shell drives it: waits for the first pose, remembers what the next tick is to know."""

    def __init__(self, world: World, cast: ScenarioEngine) -> None:
        self._world, self._cast = world, cast
        self._began: float | None = None
        self.actors: Actors = table(0.0, ())
        self.contacts: tuple[str, ...] = ()  #: actors that the ego touches
        self.found: tuple[str, ...] = ()  #: reason codes for the next tick
        self.detail = ""  #: SUMO's words about its last breach of the anchor's contract

    @property
    def cleared(self) -> tuple[str, ...]:
        """Vehicles taken off the street where the ego, or an actor of the scenario, entered it."""
        return self._world.cleared

    @property
    def standoffs(self) -> tuple[str, ...]:
        """Vehicles taken off the street because they and the ego waited for each other."""
        return self._world.standoffs

    @property
    def warnings(self) -> tuple[str, ...]:
        """What SUMO complained about so far."""
        return self._world.warnings

    @property
    def fits(self) -> bool:
        """Whether the street's steps were measured and leave a live tick its time; true where nobody measures."""
        headroom = self._world.headroom
        return headroom is None or headroom.fits

    @property
    def load(self) -> dict[str, Any]:
        """What the street's steps took and what was done about it, for the summary; empty where nobody measures."""
        headroom = self._world.headroom
        return {} if headroom is None else headroom.summary

    def close(self) -> None:
        """End the simulation."""
        self._world.close()

    def advance(self, asked: Pose | None, *, waits: bool = False) -> EgoSyncReport | None:
        """Place the ego and the actors, let SUMO step, look around; None while there is no pose: then SUMO waits too.

        The scenario's actors begin with the first pose; where the drive `waits` for the operator's go, with that, or
        as soon as the car moves.
        """
        if asked is None:
            return None
        self._world.place(asked)
        if self._began is None and (not waits or asked.speed > MOVING):
            self._began = asked.time
        if self._began is not None:
            self._world.play(self._cast.step(asked.time - self._began, asked))
        report = self._world.step()
        self.actors = self._world.actors()
        self.contacts = self._world.contacts()
        self.found = report.faults + (("virtual_contact",) if self.contacts else ())
        self.detail = report.detail or self.detail
        return report
