"""The virtual road for a shell: starts the world, places the ego, and keeps what the next tick's sensors see.

The lockstep, playback and live shells use it; it knows no car and no controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.path import ReferencePath
from vve_sumo.scenario import schema
from vve_sumo.scenario.engine import ScenarioEngine
from vve_sumo.timing import PERIOD
from vve_sumo.values import Actors, Point, Pose, SignalChange
from vve_sumo.world.ego_sync import EgoSyncReport
from vve_sumo.world.loaded_road import LoadedRoad, RoadSource
from vve_sumo.world.obstacles import MapSpot, Obstacle
from vve_sumo.world.surroundings import table
from vve_sumo.world.world import World

#: A car that is faster than this has driven off [m/s].
MOVING_SPEED = 0.5


def obstacles_of(resolved: ResolvedScenario) -> tuple[Obstacle, ...]:
    """Return the scenario's obstacles with their places in the map."""
    wanted = resolved.scenario.obstacles
    return tuple(Obstacle(one.id, obstacle_position(one, resolved.path), one.length_m, one.width_m) for one in wanted)


def obstacle_position(wanted: schema.ParkedObstacle, path: ReferencePath) -> MapSpot:
    """Return centre and heading, in the map, of an obstacle that the scenario places relative to a path."""
    at = path.at(wanted.at_m)
    x, y = at.x - wanted.offset_m * math.sin(at.heading), at.y + wanted.offset_m * math.cos(at.heading)
    return MapSpot(x, y, at.heading + math.radians(wanted.turned_deg))


def scenario_engine(resolved: ResolvedScenario) -> ScenarioEngine:
    """Return the engine of the scenario's actors, none of which is on the virtual road yet."""
    scenario = resolved.scenario
    return ScenarioEngine(scenario.actors, resolved.path, resolved.actor_paths, resolved.recordings, resolved.vehicle)


def pose_at_rest(x: float, y: float, heading: float) -> Pose:
    """Return the pose of a rear axle at rest."""
    return Pose(0.0, Point.REAR_AXLE, x, y, heading, 0.0, 0.0, 0.0, 0.0, 0.0)


def road_source(resolved: ResolvedScenario) -> RoadSource:
    """Return what a scenario's road is loaded from."""
    return RoadSource(resolved.network.path, resolved.demand, resolved.scenario.seed, PERIOD)


def open_world(
    resolved: ResolvedScenario, clock: Callable[[], float] | None = None, loaded: LoadedRoad | None = None
) -> World:
    """Start SUMO with the scenario's network, traffic and obstacles; raises ConfigError as World does.

    With a `clock` [s] the steps are timed, and traffic is limited so that they fit into a live tick. A road that is
    `loaded` is gone on with.
    """
    source = road_source(resolved)
    return World(
        source.network,
        demand=source.demand,
        seed=source.seed,
        period=source.period,
        vehicle=resolved.vehicle,
        obstacles=obstacles_of(resolved),
        warm_up=resolved.scenario.road.warm_up_s,
        route=resolved.route,
        clock=clock,
        loaded=loaded,
    )


class VirtualRoad:
    """Steps the world once there is a pose, and keeps actors, contacts and faults for the next tick.

    The scenario's actors begin with the first pose. If the road `waits`, they begin when the operator says go or the
    car is faster than MOVING_SPEED.
    """

    def __init__(self, world: World, engine: ScenarioEngine, *, waits: bool = False) -> None:
        self._world, self._engine, self._waits = world, engine, waits
        self._began: float | None = None
        self.actors: Actors = table(0.0, ())
        self.contacts: tuple[str, ...] = ()  #: actors that the ego touches
        self.faults: tuple[str, ...] = ()  #: reason codes for the next tick
        self.detail = ""  #: SUMO's last error message about the ego

    @property
    def cleared(self) -> tuple[str, ...]:
        """Vehicles taken off the road where the ego, or an actor of the scenario, entered it."""
        return self._world.cleared

    @property
    def standoffs(self) -> tuple[str, ...]:
        """Vehicles taken off the road because they and the ego waited for each other."""
        return self._world.standoffs

    @property
    def signals(self) -> tuple[SignalChange, ...]:
        """What the traffic signals showed, change by change."""
        return self._world.signals

    @property
    def signals_now(self) -> Mapping[str, str]:
        """What each traffic signal shows, SUMO's letter for each of its links."""
        return self._world.signals_now

    @property
    def warnings(self) -> tuple[str, ...]:
        """SUMO's warnings so far."""
        return self._world.warnings

    @property
    def step_time_fits(self) -> bool:
        """Whether SUMO's steps were measured and are short enough for a live tick; true without measurement."""
        budget = self._world.step_time_budget
        return budget is None or budget.fits

    @property
    def step_time_summary(self) -> dict[str, Any]:
        """SUMO's step times and the measures taken, for the summary; empty without measurement."""
        budget = self._world.step_time_budget
        return {} if budget is None else budget.summary

    def close(self) -> None:
        """End the simulation."""
        self._world.close()

    def start_actors(self) -> None:
        """Let the scenario's actors begin: the operator said go."""
        self._waits = False

    def advance(self, asked: Pose | None) -> EgoSyncReport | None:
        """Place the ego and the actors and let SUMO step; without a pose SUMO does not step, and None is returned."""
        if asked is None:
            return None
        self._world.place(asked)
        if self._began is None and (not self._waits or asked.speed > MOVING_SPEED):
            self._began = asked.time
        if self._began is not None:
            self._world.set_actors(self._engine.step(asked.time - self._began, asked))
        report = self._world.step()
        self.actors = self._world.actors()
        self.contacts = self._world.contacts()
        self.faults = report.faults + (("virtual_contact",) if self.contacts else ())
        self.detail = report.detail or self.detail
        return report
