"""The virtual road of a drive: places the ego, steps SUMO, reads the actors, tests for contact.

Combines the other modules of this package; must not know controllers or wire formats.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

import libsumo

from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.geometry import Box, behind_bumper, overlap
from vve_sumo.values import Actors, ActorState, Pose, SignalChange, Vehicle
from vve_sumo.world.ego_sync import DECELERATION, EGO, EgoSync, EgoSyncReport, heading_of, make_type
from vve_sumo.world.loaded_road import LoadedRoad, RoadSource
from vve_sumo.world.obstacles import OBSTACLE_PROXY_TYPE, Obstacle, Obstacles
from vve_sumo.world.proxies import EGO_PROXY_TYPE, ProxyVehicles
from vve_sumo.world.scenario_actors import ScenarioActors, box_of
from vve_sumo.world.signal_states import SignalStates
from vve_sumo.world.simulation import SUMO_ERRORS
from vve_sumo.world.standoff import STANDING, Standoff
from vve_sumo.world.step_time import StepTimeBudget
from vve_sumo.world.surroundings import Surroundings, table

#: Gap that traffic needs to an ego that enters among moving vehicles [m]: SUMO's standstill gap.
ENTRY_GAP = 2.5

#: SUMO's warning of a vehicle that was moved farther than it can drive: where from, where to, how far [m]
MOVED: Final = re.compile(r"moved by TraCI from (\S+),(\S+) to (\S+),(\S+) \(dist (\S+)\)")
#: A move along a bent lane is longer than the straight line between its places, within one step by less than this [m].
MOVE_TOLERANCE: Final = 5.0


class World:
    """A SUMO road with one external ego. Per tick: `place`, `set_actors`, `step`, then read.

    `step` brings the road to the time of the pose placed last; `actors` are those around the ego at that time.
    """

    def __init__(
        self,
        network: Path,
        *,
        demand: Sequence[Path] = (),
        seed: int,
        period: float,
        vehicle: Vehicle,
        obstacles: Sequence[Obstacle] = (),
        warm_up: float = 0.0,
        range_of_interest: float = 220.0,
        route: Sequence[str] = (),
        clock: Callable[[], float] | None = None,
        loaded: LoadedRoad | None = None,
    ) -> None:
        """Start SUMO, let its traffic run for `warm_up` [s] without the ego, and wait for the first pose.

        `period` is the tick [s], a multiple of 1 ms; `route` the edges that the ego will follow, if known;
        `range_of_interest` [m] reaches from the ego's front bumper to an actor's centre. With a `clock` [s] the
        steps are timed, and traffic is limited so that they fit into a live tick. SUMO is not started where the
        process of which this one is a fork has `loaded` the road. Raises ConfigError where a file, an obstacle, the
        route or a number is not usable, SimulationError where SUMO fails.
        """
        if not (math.isfinite(warm_up) and warm_up >= 0.0):
            raise ConfigError(f"warm_up: 0 s or more expected, got {warm_up}")
        self._vehicle, self._period = vehicle, period
        self._clock, self._step_time_budget = clock, StepTimeBudget() if clock else None
        source = RoadSource(network, tuple(demand), seed, period)
        if loaded is not None:
            loaded.inherit(source)
        road = loaded or LoadedRoad(source)
        self._simulation = road.simulation
        try:
            self._furnish(road, vehicle, obstacles, route, range_of_interest)
            self._warm_up(warm_up)
        except BaseException as error:
            self._simulation.close()
            if isinstance(error, SUMO_ERRORS):
                raise SimulationError(f"{network}: SUMO refused the street's furniture: {error}") from error
            raise
        self._body: Box | None = None
        self._pose: Pose | None = None
        self._start, self._steps = 0.0, 0
        self._snapshot: Actors | None = None
        self._cleared: tuple[str, ...] = ()
        self._standoff = Standoff()
        self._standoffs: tuple[str, ...] = ()
        self._asked: Sequence[ActorState] = ()
        self._signals = SignalStates()

    @property
    def signals(self) -> tuple[SignalChange, ...]:
        """What the signals showed since the ego's first pose, change by change."""
        return tuple(self._signals.changes)

    @property
    def signals_now(self) -> Mapping[str, str]:
        """What each signal shows, SUMO's letter for each of its links; nothing before the ego's first pose."""
        return self._signals.shown

    @property
    def warnings(self) -> tuple[str, ...]:
        """SUMO's warnings so far, one line each.

        Without those about proxies, which overlap on purpose, and without moves that did not happen.
        """
        return tuple(line for line in self._simulation.warnings if EGO_PROXY_TYPE not in line and is_true(line))

    @property
    def cleared(self) -> tuple[str, ...]:
        """Vehicles taken off the road because they could not have avoided the entering ego or scenario actor."""
        return self._cleared

    @property
    def standoffs(self) -> tuple[str, ...]:
        """Vehicles taken off the road because they and the ego waited for each other."""
        return self._standoffs

    @property
    def proxy_lanes(self) -> tuple[str, ...]:
        """Lanes on which traffic sees a proxy of the ego now."""
        return self._proxies.lanes

    @property
    def step_time_budget(self) -> StepTimeBudget | None:
        """Step times and the measures taken; None without a clock."""
        return self._step_time_budget

    def place(self, pose: Pose) -> None:
        """Have the ego's front bumper at `pose`, its pose at the next tick.

        A pose that is not finite, out of bounds or not the front bumper's becomes a fault of the coming report,
        and the ego stands where it was. Raises ConfigError where the ego's first pose overlaps an obstacle, and
        SimulationError where SUMO cannot clear the road for it.
        """
        if not self._ego_sync.place(pose):
            return
        self._body = behind_bumper(pose.x, pose.y, pose.heading, self._vehicle.length, self._vehicle.width)
        if self._pose is None:
            self._start, self._steps = pose.time, 0
            self._check_entry(self._body)
            try:
                self._cleared = _clear(self._body, pose.speed, self._hidden())
            except SUMO_ERRORS as problem:
                raise SimulationError(f"SUMO does not let the ego in: {problem}") from problem
        self._pose = pose

    def set_actors(self, actors: Sequence[ActorState]) -> None:
        """Have exactly these actors of the scenario on the road at the next tick, besides traffic and obstacles.

        They may be put anywhere. Where one enters, traffic that overlaps it or could not stop behind it is taken off
        the road. An actor whose numbers are not finite is left out.
        """
        self._asked = actors

    def step(self) -> EgoSyncReport:
        """Step the road to the next tick and compare SUMO's ego with the requested pose.

        SUMO's errors are not raised: they are faults of the report.
        """
        begun = self._clock() if self._clock else 0.0
        moving = self._ego_sync.ready()
        error = ""
        try:
            if self._body is not None and self._pose is not None:
                self._proxies.place(self._body, self._pose.speed if moving else 0.0, self._ego_sync.lane)
            for entered in self._scenario_actors.place(self._asked):
                self._cleared += _clear(box_of(entered), entered.speed, self._hidden())
            self._scenario_actors.show()
            self._end_standoffs()
            if self._ego_sync.entered():
                self._surroundings.watch()
            self._simulation.step()
        except (SimulationError, *SUMO_ERRORS) as problem:
            error = str(problem)
        self._steps += 1
        try:
            self._snapshot = self._look()
            if self._pose:
                self._signals.look(self._time())
            if self._clock and self._step_time_budget and self._pose:
                self._step_time_budget.step(self._clock() - begun, self._pose.x, self._pose.y, self._hidden())
        except SUMO_ERRORS as problem:
            # The last snapshot stays, which is better than an empty road; the fault stops the car.
            error = error or str(problem)
        return self._ego_sync.check(self._time(), error)

    def actors(self) -> Actors:
        """Return all actors near the ego, without the ego; the same table until the next step.

        Rows are vehicles by name (on a lane or not, parked ones too), persons on foot, obstacles, scenario actors.
        Empty before the ego entered.
        """
        if self._snapshot is None:
            self._snapshot = self._look()
        return self._snapshot

    def contacts(self) -> tuple[str, ...]:
        """Return the names of actors whose box overlaps the ego's."""
        if self._body is None:
            return ()
        seen, body = self.actors(), self._body
        if not seen.ids:
            return ()
        columns = (seen.x, seen.y, seen.heading, seen.length, seen.width)
        rows = zip(seen.ids, *(column.tolist() for column in columns), strict=True)
        # Beyond the sum of both boxes' lengths and widths an overlap is impossible.
        reach = body.length + body.width
        return tuple(
            name
            for name, x, y, heading, length, width in rows
            if max(abs(x - body.x), abs(y - body.y)) < reach + length + width
            and overlap(body, Box(x, y, heading, length, width))
        )

    def close(self) -> None:
        """End the simulation; the process may start another."""
        self._simulation.close()

    def __enter__(self) -> World:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _furnish(
        self, road: LoadedRoad, vehicle: Vehicle, obstacles: Sequence[Obstacle], route: Sequence[str], reach: float
    ) -> None:
        boxes = [math.hypot(vehicle.length, vehicle.width)]
        boxes += [math.hypot(o.length, o.width) for o in obstacles if math.isfinite(o.length * o.width)]
        lanes = road.lanes.reaching(0.5 * max(boxes))
        if problem := lanes.gap(route):
            raise ConfigError(f"{road.source.network}: {problem}")
        make_type(EGO_PROXY_TYPE, vehicle.length, vehicle.width)
        make_type(OBSTACLE_PROXY_TYPE, vehicle.length, vehicle.width)
        self._ego_sync = EgoSync(lanes, vehicle, route)
        self._proxies = ProxyVehicles(lanes)
        self._obstacles = Obstacles(obstacles, lanes)
        self._scenario_actors = ScenarioActors(lanes)
        self._surroundings = Surroundings(reach, self._obstacles.declared)

    def _warm_up(self, duration: float) -> None:
        if self._obstacles.declared:
            self._obstacles.enter()
            self._simulation.step()
            self._obstacles.settle()
        if duration > self._period:
            self._simulation.run_until(duration)

    def _check_entry(self, body: Box) -> None:
        for declared, box in self._obstacles.declared:
            if overlap(body, box):
                raise ConfigError(f"obstacle {declared.id}: it stands where the ego starts")

    def _end_standoffs(self) -> None:
        """Take drivers off the road whose standoff with the ego lasted too long; raises SUMO's errors."""
        if self._pose is None or self._body is None or self._snapshot is None:
            return
        stands = abs(self._pose.speed) < STANDING
        drivers = self._surroundings.standing(self._snapshot, self._body) if stands else ()
        for name in self._standoff.over(self._snapshot.time, self._body, self._pose.speed, drivers):
            # A driver who was also in the way of an entering actor is gone already; SUMO raises on a second removal.
            if name not in self._cleared:
                libsumo.vehicle.remove(name)
                self._standoffs += (name,)

    def _hidden(self) -> frozenset[str]:
        return self._proxies.ids | self._scenario_actors.ids | self._obstacles.proxies | {EGO}

    def _time(self) -> float:
        return self._start + (self._steps - 1) * self._period

    def _look(self) -> Actors:
        if self._pose is None:
            return table(self._start, ())
        x, y, seen = self._pose.x, self._pose.y, self._scenario_actors.seen()
        return self._surroundings.snapshot(self._time(), x, y, self._hidden(), seen)


def is_true(warning: str) -> bool:
    """Return whether a warning of SUMO may be true: false for a move whose distance is not that between its places.

    SUMO measures a move along the vehicle's route. On a route that is a loop, a place a millimetre behind the last one
    is found a whole loop farther on: a car that stands is said to have moved by kilometres, at 200 km/s.
    """
    moved = MOVED.search(warning)
    if moved is None:
        return True
    from_x, from_y, to_x, to_y, distance = map(float, moved.groups())
    return distance <= math.hypot(to_x - from_x, to_y - from_y) + MOVE_TOLERANCE


def _clear(body: Box, speed: float, keep: frozenset[str]) -> tuple[str, ...]:
    """Take every vehicle off the road that overlaps the entering body or could not stop behind it."""
    doomed = []
    vehicle = libsumo.vehicle
    for name in vehicle.getIDList():
        if name in keep:
            continue
        x, y = vehicle.getPosition(name)
        box = behind_bumper(x, y, heading_of(vehicle.getAngle(name)), vehicle.getLength(name), vehicle.getWidth(name))
        closing = max(0.0, vehicle.getSpeed(name) - speed * math.cos(box.heading - body.heading))
        stretched = box.stretched(ENTRY_GAP + 0.5 * closing * closing / DECELERATION)
        if overlap(stretched, body):
            doomed.append(name)
    for name in doomed:
        vehicle.remove(name)
    return tuple(doomed)
