"""The virtual road for a shell: starts the world, places the egos, and keeps what the next tick's sensors see.

The lockstep, playback and live shells use it; it knows no car and no controller.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from vve_sumo.drive.people_on_road import PeopleOnRoad
from vve_sumo.drive.resolved_scenario import ResolvedScenario
from vve_sumo.drive.shared_prefix import ActorEngine
from vve_sumo.drive.stations_on_road import StationsOnRoad
from vve_sumo.intersections import SignalPhase
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.engine import ScenarioEngine
from vve_sumo.scenario.road_users import ParkedObstacle
from vve_sumo.timing import PERIOD
from vve_sumo.values import EGO, Actors, ActorState, Point, Pose, SignalChange
from vve_sumo.world.ego_sync import Ego, EgoSyncReport
from vve_sumo.world.loaded_road import LoadedRoad, RoadSource
from vve_sumo.world.obstacles import MapSpot, Obstacle
from vve_sumo.world.surroundings import table
from vve_sumo.world.world import World

#: A car that is faster than this has driven off [m/s].
MOVING_SPEED: Final = 0.5


def no_signals(now: float) -> Mapping[str, SignalPhase]:
    """Return what the signals show at a drive time [s], where there are none or nobody asks."""
    return {}


def egos_of(resolved: ResolvedScenario) -> tuple[Ego, ...]:
    """Return the scenario's egos."""
    return tuple(Ego(one.ego_id, one.vehicle, tuple(one.route)) for one in resolved.egos)


def obstacles_of(resolved: ResolvedScenario) -> tuple[Obstacle, ...]:
    """Return the scenario's obstacles with their places in the map."""
    return tuple(
        Obstacle(one.id, obstacle_position(one, resolved.path), one.length_m, one.width_m, one.kind)
        for one in resolved.scenario.obstacles
    )


def obstacle_position(obstacle: ParkedObstacle, path: ReferencePath) -> MapSpot:
    """Return centre and heading, in the map, of an obstacle that the scenario places relative to a path."""
    at = path.at(obstacle.at_m)
    x, y = at.x - obstacle.offset_m * math.sin(at.heading), at.y + obstacle.offset_m * math.cos(at.heading)
    return MapSpot(x, y, at.heading + math.radians(obstacle.turned_deg))


def scenario_engine(resolved: ResolvedScenario) -> ScenarioEngine:
    """Return the engine of the scenario's actors, none of which is on the virtual road yet."""
    scenario = resolved.scenario
    return ScenarioEngine(
        scenario.actors,
        resolved.path,
        resolved.actor_paths,
        resolved.recordings,
        resolved.vehicle,
        scenario.end_trigger.when,
    )


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
        egos=egos_of(resolved),
        demand=source.demand,
        seed=source.seed,
        period=source.period,
        obstacles=obstacles_of(resolved),
        warm_up=resolved.scenario.road.warm_up_s,
        clock=clock,
        loaded=loaded,
    )


@dataclass(slots=True)
class EgoSurroundings:
    """What the virtual road keeps for the next tick of one ego."""

    actors: Actors = field(default_factory=lambda: table(0.0, ()))
    contacts: tuple[str, ...] = ()  #: actors that the ego touches
    faults: tuple[str, ...] = ()  #: reason codes for the next tick
    detail: str = ""  #: SUMO's last error message about the ego
    red_light: str = ""  #: the signal whose stop line the front bumper passed on red in the last step; empty for none
    stop_sign: str = ""  #: the lane past whose stop sign it went then, not having stood there; empty for none
    #: returns what the signals show at a drive time [s], and how long at least; nothing where no sensor sees signals
    signals: Callable[[float], Mapping[str, SignalPhase]] = no_signals


class VirtualRoad:
    """Steps the world once there is a pose, and keeps actors, contacts and faults of every ego for the next tick.

    The scenario's actors begin with the first pose. If the road `waits`, they begin when the operator says go or a
    car is faster than MOVING_SPEED.
    """

    def __init__(self, world: World, engine: ActorEngine, *, waits: bool = False) -> None:
        self._world, self._engine, self._waits = world, engine, waits
        self._began: float | None = None
        self._entered: set[str] = set()  # ids of the egos that have had a pose
        self._people: PeopleOnRoad | None = None
        self._stations: StationsOnRoad | None = None
        self.around = {ego: EgoSurroundings() for ego in world.egos}  #: by the ego's id

    @property
    def removed_at_entry(self) -> tuple[str, ...]:
        """Vehicles taken off the road where an ego, or an actor of the scenario, entered it."""
        return self._world.removed_at_entry

    @property
    def removed_after_standoff(self) -> tuple[str, ...]:
        """Vehicles taken off the road because they and an ego waited for each other."""
        return self._world.removed_after_standoff

    @property
    def story_ended(self) -> bool:
        """Whether the trigger of the scenario's stories that ends the drive has fired."""
        return self._engine.ended

    @property
    def signals(self) -> tuple[SignalChange, ...]:
        """What the traffic signals showed, change by change."""
        return self._world.signals

    @property
    def signals_now(self) -> Mapping[str, str]:
        """What each traffic signal shows, SUMO's letter for each of its links."""
        return self._world.signals_now

    def signal_changes(self, since: int) -> Sequence[SignalChange]:
        """Return what the signals showed from their change number `since` on, counted from 0."""
        return self._world.signal_changes(since)

    def timed_signals(self) -> Callable[[float], Mapping[str, SignalPhase]]:
        """Return what tells, for a drive time [s], what each signal shows and how long at least from then on."""
        return self._world.timed_signals()

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

    def inherit(self) -> None:
        """Go on in a fork of the process that has driven so far; SUMO ends with the fork."""
        self._world.inherit()

    def admit(self, people: PeopleOnRoad) -> None:
        """Have real people on the road; call it before the first step."""
        self._people = people

    def admit_stations(self, stations: StationsOnRoad) -> None:
        """Have real stations on the road; call it before the first step."""
        self._stations = stations

    def start_actors(self) -> None:
        """Let the scenario's actors begin: the operator said go."""
        self._waits = False

    @property
    def _people_faults(self) -> tuple[str, ...]:
        return () if self._people is None else self._people.faults

    def advance(self, poses: Mapping[str, Pose]) -> Mapping[str, EgoSyncReport]:
        """Place the egos, by id, and the actors, and let SUMO step once; return the report of each ego's placement.

        Without a pose of any ego SUMO does not step. An ego without a pose has no report: it has not entered yet.
        """
        if not poses:
            return {}
        if self._began is None and (not self._waits or any(pose.speed > MOVING_SPEED for pose in poses.values())):
            self._began = next(iter(poses.values())).time
        actors: tuple[ActorState, ...] | None = None
        # The engine of the scenario's actors knows one ego.
        if self._began is not None and (ego := poses.get(EGO)) is not None:
            actors = self._engine.step(ego.time - self._began, ego)
        if self._people is not None:
            # People are there from the first step on: whether they are is a condition for the drive to begin.
            actors = (actors or ()) + self._people.step(next(iter(poses.values())).time)
        if self._stations is not None:
            actors = (actors or ()) + self._stations.step(next(iter(poses.values())).time)
        if actors is not None:
            self._world.set_actors(actors)
        stepped, reports = self._world.step(poses), {}
        self._entered |= poses.keys()
        for name, report in stepped.items():
            if name not in self._entered:
                continue
            if name in poses:
                reports[name] = report
            around, contacts = self.around[name], self._world.contacts(name)
            around.actors, around.contacts = self._world.actors(name), contacts
            around.faults = report.faults + (("virtual_contact",) if contacts else ()) + self._people_faults
            around.detail = report.detail or around.detail
            around.red_light = self._world.red_light(name)
            around.stop_sign = self._world.stop_sign(name)
        return reports
