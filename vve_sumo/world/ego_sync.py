"""Holds the ego in SUMO exactly where it is told to be, and proves it after every step.

`moveToXY` alone misplaces, mis-speeds, drops, re-routes or hangs; the calls around it and the checks after it are
here. Must not know where the poses come from, nor what the breach of the contract stops.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import libsumo

from vve_sumo.values import Point, Pose, Vehicle
from vve_sumo.world.lanes import Lanes
from vve_sumo.world.simulation import SUMO_ERRORS

EGO = "ego"
EGO_TYPE = "ego_car"

#: moveToXY: exact place, any edge, may leave the network; lanes are looked for so far away [m].
KEEP_ROUTE_EXACT = 2
MATCH_THRESHOLD = 20.0

#: Neither safe-speed rules nor limits nor right of way change the speed that is set.
SPEED_MODE = 32

#: SUMO's word for "no value".
INVALID = -1073741824.0

#: Largest |asked - had| of the contract: [m], [rad], [m/s].
TOLERANCE = 1e-6

#: No road car is faster [m/s]; a larger speed is a broken pose.
MAX_SPEED = 100.0

#: How far outside the network's bounding box a pose may lie [m].
SURROUNDINGS = 1000.0

#: What followers assume of the ego's brakes [m/s2]: SUMO's passenger-car value. Followers that are told 9 keep 29 m
#: where they would keep 18 m at 15 m/s.
DECELERATION = 4.5

#: SUMO warns of an ego that brakes harder [m/s2]; noise of measured speeds would, many times a second.
NO_WARNING_BELOW = 1e6


#: The ego may drive so many times a lane's limit. Not more than needed: every vehicle's look behind reaches as far as
#: the greatest factor of all would brake, and at 100 SUMO's step took four times as long.
SPEED_FACTOR = 5.0


@dataclass(frozen=True, slots=True)
class EgoSyncReport:
    """Whether SUMO has the ego where it was asked to, after one step."""

    time: float  #: drive time of the step [s]
    position_error: float  #: |asked front bumper - SUMO's| [m]; NaN when SUMO has no ego
    heading_error: float  #: |asked - SUMO's| [rad]; NaN when SUMO has no ego
    speed_error: float  #: |asked, at least 0, - SUMO's| [m/s]; NaN when SUMO has no ego
    lane: str  #: lane that SUMO maps the ego to; "" is none
    on_road: bool  #: whether it is mapped to a lane
    faults: tuple[str, ...]  #: reason codes; empty is "the contract held"
    detail: str = ""  #: SUMO's words, where it gave any


@dataclass(frozen=True, slots=True)
class Bounds:
    """Where a pose may lie at all."""

    x_min: float  #: [m]
    y_min: float  #: [m]
    x_max: float  #: [m]
    y_max: float  #: [m]

    def fault(self, pose: Pose) -> str:
        """Return the reason code of why SUMO must not see this pose, "" where it may."""
        if pose.point is not Point.FRONT_BUMPER:
            return "pose_not_front_bumper"
        if not all(map(math.isfinite, (pose.x, pose.y, pose.heading, pose.speed))):
            return "pose_not_finite"
        inside = self.x_min <= pose.x <= self.x_max and self.y_min <= pose.y <= self.y_max
        if not inside or abs(pose.speed) > MAX_SPEED:
            return "pose_out_of_bounds"
        return ""


def network_bounds() -> Bounds:
    """Return the running network's bounding box with its surroundings."""
    (x_min, y_min), (x_max, y_max) = libsumo.simulation.getNetBoundary()
    return Bounds(x_min - SURROUNDINGS, y_min - SURROUNDINGS, x_max + SURROUNDINGS, y_max + SURROUNDINGS)


def compass(heading: float) -> float:
    """Return SUMO's angle [deg, clockwise from +y, 0 to 360] of a heading [rad]."""
    return math.degrees(math.remainder(0.5 * math.pi - heading, math.tau)) % 360.0


def heading_of(angle: float) -> float:
    """Return the heading [rad, -pi to pi] of SUMO's angle [deg]."""
    return math.remainder(0.5 * math.pi - math.radians(angle), math.tau)


def make_type(name: str, length: float, width: float) -> None:
    """Make a vehicle type that is moved from outside; lengths in metres."""
    types = libsumo.vehicletype
    types.copy("DEFAULT_VEHTYPE", name)
    types.setLength(name, length)
    types.setWidth(name, width)
    types.setDecel(name, DECELERATION)
    types.setApparentDecel(name, DECELERATION)
    types.setEmergencyDecel(name, NO_WARNING_BELOW)
    types.setSpeedDeviation(name, 0.0)
    # Neither warns about nor clips a speed that the real car really has.
    types.setMaxSpeed(name, MAX_SPEED)
    types.setSpeedFactor(name, SPEED_FACTOR)


class EgoSync:
    """Holds the ego: `place`, let SUMO step, `check`."""

    def __init__(self, lanes: Lanes, vehicle: Vehicle, route: Sequence[str] = ()) -> None:
        """Prepare the ego; it enters the street at the first pose.

        `route` are the edges that the ego means to follow, in order; without it a plausible way onward is
        assumed, because traffic at a junction yields only to an ego whose route goes on beyond it.
        """
        make_type(EGO_TYPE, vehicle.length, vehicle.width)
        self._lanes = lanes
        self._bounds = network_bounds()
        self._intended = tuple(route)
        self._reached = 0
        self._faults: list[str] = []
        self._target: tuple[float, float, float, float] | None = None
        self._placed = self._known = self._entered = self._held = False
        self._lane, self._route = "", ""

    @property
    def lane(self) -> str:
        """Lane that SUMO mapped the ego to at the last step; "" is none."""
        return self._lane

    def place(self, pose: Pose) -> bool:
        """Ask SUMO to have the ego's front bumper at `pose` when the coming step ends.

        A pose that SUMO must not see is a fault of the coming report; the ego then stands, at speed 0, where it
        was placed last, so that traffic keeps seeing it. Returns whether the pose was taken.
        """
        if fault := self._bounds.fault(pose):
            self._faults.append(fault)
            self._hold()
            return False
        self._held = False
        self._apply(float(pose.x), float(pose.y), math.remainder(pose.heading, math.tau), max(float(pose.speed), 0.0))
        return True

    def ready(self) -> bool:
        """Return whether the ego moves; where nobody placed it for the coming step it stands, with a fault."""
        if not self._placed and not self._faults:
            self._faults.append("ego_not_placed")
            self._hold()
        return not self._held

    def entered(self) -> bool:
        """Return, once for each time, that the ego came onto the street (again)."""
        entered, self._entered = self._entered, False
        return entered

    def check(self, time: float, error: str = "") -> EgoSyncReport:
        """Compare what SUMO has with what it was asked for; `error` is what its step said, if it failed."""
        faults, self._faults, self._placed = self._faults, [], False
        errors = (math.nan, math.nan, math.nan)
        if error:
            faults.append("sumo_error")
        try:
            errors = self._errors()
            if self._known:
                self._keep_route()
        except SUMO_ERRORS as problem:
            error = error or str(problem)
            self._known, self._lane = False, ""
        names = ("ego_sync_position", "ego_sync_heading", "ego_sync_speed")
        if math.isnan(errors[0]):
            faults.append("ego_lost" if self._target else "ego_absent")
        else:
            faults += [name for name, value in zip(names, errors, strict=True) if not value <= TOLERANCE]
        return EgoSyncReport(time, *errors, self._lane, self._lane != "", tuple(dict.fromkeys(faults)), error)

    def _hold(self) -> None:
        self._held = True
        if self._target is not None:
            x, y, heading, _ = self._target
            self._apply(x, y, heading, 0.0)

    def _apply(self, x: float, y: float, heading: float, speed: float) -> None:
        self._target, self._placed = (x, y, heading, speed), True
        try:
            if not self._known:
                self._enter(x, y, speed)
            libsumo.vehicle.moveToXY(EGO, "", -1, x, y, compass(heading), KEEP_ROUTE_EXACT, MATCH_THRESHOLD)
            libsumo.vehicle.setSpeed(EGO, speed)
        except SUMO_ERRORS:
            self._known = False
            self._faults.append("sumo_error")

    def _enter(self, x: float, y: float, speed: float) -> None:
        lane, _ = self._lanes.nearest(x, y)
        # The speed at departure is what the first step reports; set later it would show as 0 and a jump.
        libsumo.vehicle.add(EGO, self._lanes.route(lane.id), EGO_TYPE, departSpeed=f"{speed}")
        libsumo.vehicle.setSpeedMode(EGO, SPEED_MODE)
        libsumo.vehicle.setLaneChangeMode(EGO, 0)
        self._known, self._entered, self._route = True, True, ""

    def _errors(self) -> tuple[float, float, float]:
        if self._target is None or not self._known:
            return math.nan, math.nan, math.nan
        x, y, heading, speed = self._target
        has_x, has_y = libsumo.vehicle.getPosition(EGO)
        if has_x == INVALID:
            return math.nan, math.nan, math.nan
        turn = math.remainder(heading_of(libsumo.vehicle.getAngle(EGO)) - heading, math.tau)
        error = abs(libsumo.vehicle.getSpeed(EGO) - speed)
        if error > TOLERANCE:
            # Near the end of a lane that its route cannot leave, SUMO zeroes the speed ("emergency stop") before it
            # applies the pose. Nobody has seen that speed yet.
            libsumo.vehicle.setPreviousSpeed(EGO, speed)
            error = abs(libsumo.vehicle.getSpeed(EGO) - speed)
        return math.hypot(has_x - x, has_y - y), abs(turn), error

    def _keep_route(self) -> None:
        """Give the ego its way past the next junction again wherever SUMO replaced or used up its route."""
        lane, route = libsumo.vehicle.getLaneID(EGO), libsumo.vehicle.getRouteID(EGO)
        if lane == self._lane and route == self._route:
            return
        self._lane = lane
        if lane:
            edges = libsumo.vehicle.getRoute(EGO)
            here = edges[max(libsumo.vehicle.getRouteIndex(EGO), 0)]
            ahead = self._ahead(here, lane)
            if edges[-len(ahead) :] != ahead:
                libsumo.vehicle.setRoute(EGO, ahead)
                route = libsumo.vehicle.getRouteID(EGO)
        self._route = route

    def _ahead(self, here: str, lane: str) -> tuple[str, ...]:
        """Edges from the present one onward: the intended ones where the ego is on its way."""
        inside = lane.startswith(":")
        beyond = self._lanes.exit_edge(lane)
        for i in (*range(self._reached, len(self._intended)), *range(self._reached)):
            rest = self._intended[i:]
            if rest[0] == here and (not inside or rest[1:2] == (beyond,)):
                self._reached = i
                return rest + self._lanes.onward_from(rest[-1])[1:]
        return (here, *self._lanes.onward_from(beyond)) if inside else self._lanes.onward(lane)
