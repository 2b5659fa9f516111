"""The street as a drive holds it: place the ego, step, read the actors, ask for contact.

Puts the other modules of this room together; must not know controllers, wire formats or clocks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import libsumo

from vve_sumo.errors import ConfigError, SimulationError
from vve_sumo.geometry import Box, behind_bumper, overlap
from vve_sumo.values import Actors, ActorState, Pose, Vehicle
from vve_sumo.world.ego_sync import DECELERATION, EGO, EgoSync, EgoSyncReport, heading_of, make_type
from vve_sumo.world.lanes import Lanes, read_lanes
from vve_sumo.world.obstacles import OBSTACLE_PROXY_TYPE, Obstacle, Obstacles
from vve_sumo.world.proxies import EGO_PROXY_TYPE, ProxyVehicles
from vve_sumo.world.scenario_actors import ScenarioActors, box_of
from vve_sumo.world.simulation import SUMO_ERRORS, Simulation
from vve_sumo.world.standoff import STANDING, Standoff
from vve_sumo.world.step_time import StepTimeBudget
from vve_sumo.world.surroundings import Surroundings, table

#: Room that traffic needs around the ego when it enters a moving street [m]: SUMO's standstill gap.
ENTRY_GAP = 2.5


class World:
    """A SUMO street with one external ego. Per tick: `place`, `play`, `step`, then read.

    The drive places the ego and steps once before its first tick; from then on `actors` is what the ego has
    around it at the time of the pose placed last.
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
    ) -> None:
        """Start SUMO, let its traffic run for `warm_up` [s] without the ego, and wait for the first pose.

        `period` is the tick [s], a multiple of 1 ms; `route` the edges that the ego means to follow, if known;
        `range_of_interest` [m] reaches from the ego's front bumper to an actor's centre. With a `clock` [s] the
        steps are timed and the traffic is held within what a live tick has room for. Raises ConfigError where a
        file, an obstacle, the route or a number is not usable, SimulationError where SUMO breaks.
        """
        if not (math.isfinite(warm_up) and warm_up >= 0.0):
            raise ConfigError(f"warm_up: 0 s or more expected, got {warm_up}")
        self._vehicle, self._period = vehicle, period
        self._clock, self._step_time_budget = clock, StepTimeBudget() if clock else None
        self._simulation = Simulation(network, demand, seed, period)
        try:
            self._furnish(network, vehicle, obstacles, route, range_of_interest)
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
        self._playing: Sequence[ActorState] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What SUMO complained about so far, a line each, without the ghosts' overlaps: they are meant to overlap."""
        return tuple(line for line in self._simulation.warnings if EGO_PROXY_TYPE not in line)

    @property
    def cleared(self) -> tuple[str, ...]:
        """Vehicles taken off the street because they could not have avoided the ego, or a player, that entered."""
        return self._cleared

    @property
    def standoffs(self) -> tuple[str, ...]:
        """Vehicles taken off the street because they and the ego waited for each other, nose to nose."""
        return self._standoffs

    @property
    def ghost_lanes(self) -> tuple[str, ...]:
        """Lanes whose traffic sees the ego through a ghost now, because its body left its own line of lanes."""
        return self._proxies.lanes

    @property
    def step_time_budget(self) -> StepTimeBudget | None:
        """What the steps took and what was done about it; None without a clock."""
        return self._step_time_budget

    def place(self, pose: Pose) -> None:
        """Have the ego's front bumper at `pose`, the pose it has at the next tick.

        A pose that is not finite, out of bounds or not the front bumper's becomes a fault of the coming report
        and the ego stands where it was. Raises ConfigError where the first pose lies in an obstacle.
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

    def play(self, players: Sequence[ActorState]) -> None:
        """Have exactly these actors of the scenario on the street at the next tick, beside all others.

        They go wherever they are put; of traffic that is in the way where one appears, or could not stop behind it,
        the street is cleared. One whose numbers are not finite is left out.
        """
        self._playing = players

    def step(self) -> EgoSyncReport:
        """Let the street reach the next tick and compare SUMO's ego with the one asked for.

        Never raises: whatever SUMO says is a fault of the report.
        """
        begun = self._clock() if self._clock else 0.0
        moving = self._ego_sync.ready()
        error = ""
        try:
            if self._body is not None and self._pose is not None:
                self._proxies.place(self._body, self._pose.speed if moving else 0.0, self._ego_sync.lane)
            for entered in self._players.place(self._playing):
                self._cleared += _clear(box_of(entered), entered.speed, self._hidden())
            self._players.show()
            self._end_standoffs()
            if self._ego_sync.entered():
                self._surroundings.watch()
            self._simulation.step()
        except (SimulationError, *SUMO_ERRORS) as problem:
            error = str(problem)
        self._steps += 1
        try:
            self._snapshot = self._look()
            if self._clock and self._step_time_budget and self._pose:
                self._step_time_budget.step(self._clock() - begun, self._pose.x, self._pose.y, self._hidden())
        except SUMO_ERRORS as problem:
            # What was seen last is better than an empty street; the fault stops the car.
            error = error or str(problem)
        return self._ego_sync.check(self._time(), error)

    def actors(self) -> Actors:
        """Return everything with a body near the ego, without the ego; the same table until the next step.

        Vehicles by name (lying on a lane or not, parked ones too), persons on foot, obstacles, players. Empty before
        the ego entered.
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
        # What is farther off than both boxes are long and wide needs no closer look.
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
        self, network: Path, vehicle: Vehicle, obstacles: Sequence[Obstacle], route: Sequence[str], reach: float
    ) -> None:
        boxes = [math.hypot(vehicle.length, vehicle.width)]
        boxes += [math.hypot(o.length, o.width) for o in obstacles if math.isfinite(o.length * o.width)]
        lanes = Lanes(read_lanes(), 0.5 * max(boxes))
        if problem := lanes.gap(route):
            raise ConfigError(f"{network}: {problem}")
        make_type(EGO_PROXY_TYPE, vehicle.length, vehicle.width)
        make_type(OBSTACLE_PROXY_TYPE, vehicle.length, vehicle.width)
        self._ego_sync = EgoSync(lanes, vehicle, route)
        self._proxies = ProxyVehicles(lanes)
        self._obstacles = Obstacles(obstacles, lanes)
        self._players = ScenarioActors(lanes)
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
        """Take drivers off the street that wait for the ego in its way; raises SUMO's errors."""
        if self._pose is None or self._body is None or self._snapshot is None:
            return
        stands = abs(self._pose.speed) < STANDING
        drivers = self._surroundings.standing(self._snapshot, self._body) if stands else ()
        for name in self._standoff.over(self._snapshot.time, self._body, self._pose.speed, drivers):
            # One that was in the way of a player, too, is gone already; SUMO raises where it is to go twice.
            if name not in self._cleared:
                libsumo.vehicle.remove(name)
                self._standoffs += (name,)

    def _hidden(self) -> frozenset[str]:
        return self._proxies.ids | self._players.ids | self._obstacles.stand_ins | {EGO}

    def _time(self) -> float:
        return self._start + (self._steps - 1) * self._period

    def _look(self) -> Actors:
        if self._pose is None:
            return table(self._start, ())
        x, y, players = self._pose.x, self._pose.y, self._players.seen()
        return self._surroundings.snapshot(self._time(), x, y, self._hidden(), players)


def _clear(body: Box, speed: float, keep: frozenset[str]) -> tuple[str, ...]:
    """Take every vehicle off the street that overlaps the entering ego or could not stop behind it."""
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
