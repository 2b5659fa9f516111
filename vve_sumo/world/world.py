"""The virtual road of a drive: places the egos, steps SUMO, reads the actors around each, tests for contact.

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
from vve_sumo.intersections import SignalPhase
from vve_sumo.values import Actors, ActorState, Pose, SignalChange
from vve_sumo.world.ego_sync import DECELERATION, Ego, EgoSyncReport, heading_of, make_type
from vve_sumo.world.loaded_road import LoadedRoad, RoadSource
from vve_sumo.world.obstacles import OBSTACLE_PROXY_TYPE, Obstacle, Obstacles
from vve_sumo.world.placed_ego import PlacedEgo
from vve_sumo.world.proxies import EGO_PROXY_TYPE
from vve_sumo.world.red_lights import RedLights
from vve_sumo.world.scenario_actors import ScenarioActors, box_of
from vve_sumo.world.signal_states import SignalStates
from vve_sumo.world.simulation import SUMO_ERRORS
from vve_sumo.world.standoff import STANDING
from vve_sumo.world.step_time import StepTimeBudget
from vve_sumo.world.stop_signs import StopSigns
from vve_sumo.world.surroundings import Surroundings, table

#: Gap that traffic needs to an ego that enters among moving vehicles [m]: SUMO's standstill gap.
ENTRY_GAP: Final = 2.5

#: SUMO's warning of a vehicle that was moved farther than it can drive: where from, where to, how far [m]
MOVED: Final = re.compile(r"moved by TraCI from (\S+),(\S+) to (\S+),(\S+) \(dist (\S+)\)")
#: A move along a bent lane is longer than the straight line between its places, within one step by less than this [m].
MOVE_TOLERANCE: Final = 5.0


class World:
    """A SUMO road with external egos. Per tick: `set_actors`, `step`, then read.

    `step` brings the road to the time of the poses that it is given; `actors` are those around an ego at that time.
    Every ego is one of the actors around every other one. Egos are handled in the order of their ids.
    """

    def __init__(
        self,
        network: Path,
        *,
        egos: Sequence[Ego],
        seed: int,
        period: float,
        demand: Sequence[Path] = (),
        obstacles: Sequence[Obstacle] = (),
        warm_up: float = 0.0,
        range_of_interest: float = 220.0,
        clock: Callable[[], float] | None = None,
        loaded: LoadedRoad | None = None,
    ) -> None:
        """Start SUMO, let its traffic run for `warm_up` [s] without the egos, and wait for the first pose.

        `period` is the tick [s], a multiple of 1 ms; `range_of_interest` [m] reaches from an ego's front bumper to an
        actor's centre. With a `clock` [s] the steps are timed, and traffic is limited so that they fit into a live
        tick. SUMO is not started where the process of which this one is a fork has `loaded` the road. Raises
        ConfigError where a file, an ego's id or route, an obstacle or a number is not usable, SimulationError where
        SUMO fails.
        """
        if not (math.isfinite(warm_up) and warm_up >= 0.0):
            raise ConfigError(f"warm_up: 0 s or more expected, got {warm_up}")
        self._period = period
        self._clock, self._step_time_budget = clock, StepTimeBudget() if clock else None
        source = RoadSource(network, tuple(demand), seed, period)
        if loaded is not None:
            loaded.inherit(source)
        road = loaded or LoadedRoad(source)
        self._simulation = road.simulation
        try:
            self._furnish(road, egos, obstacles, range_of_interest)
            self._warm_up(warm_up)
        except BaseException as error:
            self._simulation.close()
            if isinstance(error, SUMO_ERRORS):
                raise SimulationError(f"{network}: SUMO refused the road's furniture: {error}") from error
            raise
        self._hidden_always = self._obstacles.proxies | frozenset(self._by_id)
        self._start, self._steps = 0.0, 0
        self._begun = False  # an ego has been placed
        self._removed_at_entry: tuple[str, ...] = ()
        self._removed_after_standoff: tuple[str, ...] = ()
        self._actor_states: Sequence[ActorState] = ()
        self._signals, self._red_lights, self._stop_signs = SignalStates(), RedLights(), StopSigns()

    @property
    def signals(self) -> tuple[SignalChange, ...]:
        """What the signals showed since the first pose, change by change."""
        return tuple(self._signals.changes)

    @property
    def signals_now(self) -> Mapping[str, str]:
        """What each signal shows, SUMO's letter for each of its links; nothing before the first pose."""
        return self._signals.states

    def signal_changes(self, since: int) -> Sequence[SignalChange]:
        """Return what the signals showed from their change number `since` on, counted from 0."""
        return self._signals.changes[since:]

    def timed_signals(self) -> Callable[[float], Mapping[str, SignalPhase]]:
        """Return what tells, for a drive time [s], what each signal shows and how long at least from then on."""
        self._signals.timed = True
        return self._signals.phases

    @property
    def warnings(self) -> tuple[str, ...]:
        """SUMO's warnings so far, one line each.

        Without those about proxies, which overlap on purpose, and without moves that did not happen.
        """
        return tuple(line for line in self._simulation.warnings if EGO_PROXY_TYPE not in line and is_true(line))

    @property
    def removed_at_entry(self) -> tuple[str, ...]:
        """Vehicles taken off the road because they could not have avoided an entering ego or scenario actor."""
        return self._removed_at_entry

    @property
    def removed_after_standoff(self) -> tuple[str, ...]:
        """Vehicles taken off the road because they and an ego waited for each other."""
        return self._removed_after_standoff

    @property
    def egos(self) -> tuple[str, ...]:
        """Ids of the egos, in order."""
        return tuple(self._by_id)

    @property
    def step_time_budget(self) -> StepTimeBudget | None:
        """Step times and the measures taken; None without a clock."""
        return self._step_time_budget

    def proxy_lanes(self, ego: str) -> tuple[str, ...]:
        """Return the lanes on which traffic sees a proxy of an ego now."""
        return self._by_id[ego].proxies.lanes

    def set_actors(self, actors: Sequence[ActorState]) -> None:
        """Have exactly these actors of the scenario on the road at the next tick, besides traffic and obstacles.

        They may be put anywhere. Where one enters, traffic that overlaps it or could not stop behind it is taken off
        the road. An actor whose numbers are not finite is left out.
        """
        self._actor_states = actors

    def step(self, placements: Mapping[str, Pose]) -> dict[str, EgoSyncReport]:
        """Step the road to the next tick and compare SUMO's egos with the poses of their front bumpers then, by id.

        An ego without a pose, or with one that is not finite, out of bounds or not the front bumper's, stands where it
        was, and its report has a fault. SUMO's errors are not raised: they are faults of the reports. Raises
        ConfigError where an ego's first pose overlaps an obstacle, SimulationError where SUMO cannot clear the road
        for it, KeyError for an ego that the road does not have.
        """
        begun = self._clock() if self._clock else 0.0
        for name in sorted(placements):
            self._place(self._by_id[name], placements[name])
        error = ""
        try:
            self._ready()
            self._simulation.step()
        except (SimulationError, *SUMO_ERRORS) as stepping:
            error = str(stepping)
        self._steps += 1
        now = self._start + (self._steps - 1) * self._period
        try:
            if self._begun:
                self._look(now)
                self._signals.update(now)
                self._look_for_lines_passed()
            if self._clock and self._step_time_budget and self._begun:
                places = [(ego.pose.x, ego.pose.y) for ego in self._egos if ego.pose is not None]
                self._step_time_budget.step(self._clock() - begun, places, self._hidden())
        except SUMO_ERRORS as problem:
            # The last snapshots stay, which is better than an empty road; the fault stops the cars.
            error = error or str(problem)
        reports = {}
        for ego in self._egos:
            reports[ego.id] = ego.sync.check(now, error)
        return reports

    def actors(self, ego: str) -> Actors:
        """Return all actors near an ego, without itself; the same table until the next step.

        Rows are vehicles by name (on a lane or not, parked ones too), persons on foot, obstacles, scenario actors,
        other egos. Empty before the ego entered.
        """
        return self._by_id[ego].snapshot

    def contacts(self, ego: str) -> tuple[str, ...]:
        """Return the names of actors whose box overlaps an ego's."""
        placed = self._by_id[ego]
        body = placed.body
        if body is None:
            return ()
        # Beyond the sum of both boxes' lengths and widths an overlap is impossible.
        reach = body.length + body.width
        return tuple(
            name
            for name, x, y, heading, _, length, width, *_ in placed.rows
            if max(abs(x - body.x), abs(y - body.y)) < reach + length + width
            and overlap(body, Box(x, y, heading, length, width))
        )

    def red_light(self, ego: str) -> str:
        """Return the signal whose line an ego's front bumper passed on red in the last step; empty for none."""
        return self._by_id[ego].red_light

    def stop_sign(self, ego: str) -> str:
        """Return the lane past whose stop sign an ego's front bumper went in the last step, not having stood there."""
        return self._by_id[ego].stop_sign

    def close(self) -> None:
        """End the simulation; the process may start another."""
        self._simulation.close()

    def inherit(self) -> None:
        """Go on in a fork of the process that ran it so far; SUMO ends with the fork."""
        self._simulation.inherit()

    def __enter__(self) -> World:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _furnish(self, road: LoadedRoad, egos: Sequence[Ego], obstacles: Sequence[Obstacle], reach: float) -> None:
        if len({ego.id for ego in egos}) < len(egos):
            raise ConfigError(f"egos: ids that differ expected, got {', '.join(ego.id for ego in egos)}")
        boxes = [math.hypot(ego.vehicle.length, ego.vehicle.width) for ego in egos]
        boxes += [math.hypot(o.length, o.width) for o in obstacles if math.isfinite(o.length * o.width)]
        lanes = road.lanes.reaching(0.5 * max(boxes))
        for ego in egos:
            if problem := lanes.gap(ego.route):
                raise ConfigError(f"{road.source.network}: {problem}")
        # Every proxy has a length of its own; its width is the widest ego's, in whatever order the egos are given.
        length, width = max(ego.vehicle.length for ego in egos), max(ego.vehicle.width for ego in egos)
        make_type(EGO_PROXY_TYPE, length, width)
        make_type(OBSTACLE_PROXY_TYPE, length, width)
        self._egos = tuple(PlacedEgo(lanes, ego) for ego in sorted(egos, key=lambda ego: ego.id))
        self._by_id = {ego.id: ego for ego in self._egos}
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

    def _place(self, ego: PlacedEgo, pose: Pose) -> None:
        """Request an ego's pose for the coming step; where it is the ego's first, make room for it."""
        enters = ego.pose is None
        if not ego.place(pose) or not enters:
            return
        if not self._begun:
            self._start, self._steps, self._begun = pose.time, 0, True
        assert ego.body is not None
        for declared, box in self._obstacles.declared:
            if overlap(ego.body, box):
                raise ConfigError(f"obstacle {declared.id}: it stands where the ego starts")
        try:
            self._removed_at_entry += _clear(ego.body, pose.speed, self._hidden())
        except SUMO_ERRORS as problem:
            raise SimulationError(f"SUMO does not let the ego in: {problem}") from problem

    def _ready(self) -> None:
        """Have everything where it belongs for the coming step; raises SUMO's errors."""
        for ego in self._egos:
            ego.moves = ego.sync.ready()
        for ego in self._egos:
            if ego.body is not None and ego.pose is not None:
                ego.proxies.place(ego.body, ego.pose.speed if ego.moves else 0.0, ego.sync.lane)
        for entered in self._scenario_actors.place(self._actor_states):
            self._removed_at_entry += _clear(box_of(entered), entered.speed, self._hidden())
        self._scenario_actors.show()
        for ego in self._egos:
            self._end_standoffs(ego)
            if ego.sync.entered():
                self._surroundings.watch(ego.id)

    def _look_for_lines_passed(self) -> None:
        """Note which egos passed a stop line on red, or a stop sign without a stop, in the step that was made."""
        for ego in self._egos:
            before, after = ego.looked_at, ego.pose
            ego.red_light = ego.stop_sign = ""
            if before is not None and after is not None:
                ego.red_light = self._red_lights.passed(before, after, ego.route, self._signals.states)
                ego.stop_sign = self._stop_signs.passed(ego.id, before, after, ego.route)
            ego.looked_at = after

    def _end_standoffs(self, ego: PlacedEgo) -> None:
        """Take drivers off the road whose standoff with an ego lasted too long; raises SUMO's errors."""
        if ego.pose is None or ego.body is None:
            return
        stands = abs(ego.pose.speed) < STANDING
        drivers = self._surroundings.standing(ego.snapshot, ego.body) if stands else ()
        for name in ego.standoff.over(ego.snapshot.time, ego.body, ego.pose.speed, drivers):
            # A driver who was in the way of an entering actor or of another ego is gone already; SUMO raises on a
            # second removal.
            if name not in self._removed_at_entry and name not in self._removed_after_standoff:
                libsumo.vehicle.remove(name)
                self._removed_after_standoff += (name,)

    def _hidden(self) -> frozenset[str]:
        """Return the names of the vehicles in SUMO that are no traffic."""
        hidden = self._hidden_always | self._scenario_actors.ids
        for ego in self._egos:
            hidden |= ego.proxies.ids
        return hidden

    def _look(self, now: float) -> None:
        """Take the snapshots of the egos that have entered, at drive time `now` [s]; raises SUMO's errors."""
        self._surroundings.read_actors(now, self._hidden(), self._scenario_actors.on_road())
        egos = [ego.row() for ego in self._egos if ego.pose is not None] if len(self._egos) > 1 else []
        for ego in self._egos:
            if ego.pose is not None:
                others = [row for row in egos if row[0] != ego.id] if egos else egos
                ego.rows = self._surroundings.around(ego.pose.x, ego.pose.y, others)
                ego.snapshot = table(now, ego.rows)


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
