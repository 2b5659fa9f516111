"""Holds an ego in SUMO exactly at the requested pose, and checks after every step that SUMO did so.

`moveToXY` alone may give the ego a wrong place or speed, drop or re-route it, or hang; the calls around it and the
checks after it are here. Must not know where the poses come from, nor what follows from a fault.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import libsumo

from vve_sumo.frozen import fast_frozen
from vve_sumo.values import Point, Pose, Vehicle
from vve_sumo.world.lanes import Lanes
from vve_sumo.world.simulation import SUMO_ERRORS

#: An ego's vehicle type in SUMO has this name with the ego's id after it.
EGO_TYPE: Final = "ego_car"

#: Flag of moveToXY for an exact place, on any edge or off the network; and its search distance for lanes [m].
KEEP_ROUTE_EXACT: Final = 2
MATCH_THRESHOLD: Final = 20.0

#: With this mode neither safe-speed rules nor limits nor right of way change the speed that is set.
SPEED_MODE: Final = 32

#: SUMO's number for "no value".
INVALID: Final = -1073741824.0

#: Largest difference between the requested and SUMO's value that is no fault: [m], [rad], [m/s].
TOLERANCE: Final = 1e-6

#: No road car is faster [m/s]; a larger speed is a broken pose.
MAX_SPEED: Final = 100.0

#: How far outside the network's bounding box a pose may lie [m].
SURROUNDINGS: Final = 1000.0

#: Deceleration that followers assume of the ego [m/s2]: SUMO's passenger-car value. With 9 instead, followers at
#: 15 m/s keep 29 m where they would keep 18 m.
DECELERATION: Final = 4.5

#: SUMO warns where the ego brakes harder than this [m/s2]; the noise of measured speeds would often exceed less.
NO_WARNING_BELOW: Final = 1e6


#: The ego may drive at so many times a lane's limit. The factor is no greater than needed: every vehicle looks behind
#: as far as the vehicle with the greatest factor needs to brake, and with 100 SUMO's step took four times as long.
SPEED_FACTOR: Final = 5.0


#: reason codes for errors of position, heading and speed that are above the tolerance
_ERROR_CODES = ("ego_sync_position", "ego_sync_heading", "ego_sync_speed")


@dataclass(frozen=True, slots=True)
class Ego:
    """A car that is moved from outside, as the virtual road is told of it."""

    id: str  #: SUMO's name of it, and its name among the actors around another ego
    vehicle: Vehicle
    #: Edges that it will follow, in order. Without them a plausible route onward is assumed, because traffic at a
    #: junction yields only to an ego whose route goes on beyond it.
    route: tuple[str, ...] = ()


@fast_frozen
@dataclass(frozen=True, slots=True)
class EgoSyncReport:
    """Whether SUMO has the ego at the requested pose, after one step."""

    time: float  #: drive time of the step [s]
    position_error: float  #: |requested front bumper - SUMO's| [m]; NaN when SUMO has no ego
    heading_error: float  #: |requested - SUMO's| [rad]; NaN when SUMO has no ego
    speed_error: float  #: |requested, at least 0, - SUMO's| [m/s]; NaN when SUMO has no ego
    lane: str  #: lane that SUMO maps the ego to; "" is none
    on_road: bool  #: whether it is mapped to a lane
    faults: tuple[str, ...]  #: reason codes; empty if SUMO's ego is as requested
    detail: str = ""  #: SUMO's error message, if any


@dataclass(frozen=True, slots=True)
class Bounds:
    """The rectangle in which a pose may lie."""

    x_min: float  #: [m]
    y_min: float  #: [m]
    x_max: float  #: [m]
    y_max: float  #: [m]

    def fault(self, pose: Pose) -> str:
        """Return the reason code for which SUMO must not be given this pose, "" for a good pose."""
        if pose.point is not Point.FRONT_BUMPER:
            return "pose_not_front_bumper"
        if not all(map(math.isfinite, (pose.x, pose.y, pose.heading, pose.speed))):
            return "pose_not_finite"
        inside = self.x_min <= pose.x <= self.x_max and self.y_min <= pose.y <= self.y_max
        if not inside or abs(pose.speed) > MAX_SPEED:
            return "pose_out_of_bounds"
        return ""


def network_bounds() -> Bounds:
    """Return the running network's bounding box, widened by SURROUNDINGS."""
    (x_min, y_min), (x_max, y_max) = libsumo.simulation.getNetBoundary()
    return Bounds(x_min - SURROUNDINGS, y_min - SURROUNDINGS, x_max + SURROUNDINGS, y_max + SURROUNDINGS)


def compass(heading: float) -> float:
    """Return SUMO's angle [deg, clockwise from +y, 0 to 360] of a heading [rad]."""
    return math.degrees(math.remainder(0.5 * math.pi - heading, math.tau)) % 360.0


def heading_of(angle: float) -> float:
    """Return the heading [rad, -pi to pi] of SUMO's angle [deg]."""
    return math.remainder(0.5 * math.pi - math.radians(angle), math.tau)


def type_name(ego: str) -> str:
    """Return the name of the vehicle type of the ego of an id."""
    return f"{EGO_TYPE}.{ego}"


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
    # SUMO shall neither warn about nor clip a speed of the real car.
    types.setMaxSpeed(name, MAX_SPEED)
    types.setSpeedFactor(name, SPEED_FACTOR)


class EgoSync:
    """Holds one ego at its poses: per step `place`, let SUMO step, `check`."""

    def __init__(self, lanes: Lanes, ego: Ego) -> None:
        """Prepare an ego; it enters the virtual road at the first pose."""
        self._id, self._type = ego.id, type_name(ego.id)
        make_type(self._type, ego.vehicle.length, ego.vehicle.width)
        self._lanes = lanes
        self._bounds = network_bounds()
        self._intended = tuple(ego.route)
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
        """Request SUMO to have the ego's front bumper at `pose` when the coming step ends.

        A pose that `Bounds` refuses is a fault of the coming report. The ego then stands, at speed 0, where it was
        placed last, so that traffic keeps seeing it. Returns whether the pose was accepted.
        """
        if fault := self._bounds.fault(pose):
            self._faults.append(fault)
            self._hold()
            return False
        self._held = False
        self._apply(float(pose.x), float(pose.y), math.remainder(pose.heading, math.tau), max(float(pose.speed), 0.0))
        return True

    def ready(self) -> bool:
        """Return whether the ego moves; if it was not placed for the coming step it stands, with a fault."""
        if not self._placed and not self._faults:
            self._faults.append("ego_not_placed")
            self._hold()
        return not self._held

    def entered(self) -> bool:
        """Return whether the ego entered the virtual road, for the first time or again, since the last call."""
        entered, self._entered = self._entered, False
        return entered

    def check(self, time: float, error: str = "") -> EgoSyncReport:
        """Compare SUMO's ego with the requested pose; `error` is the message of SUMO's step if it failed."""
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
        if math.isnan(errors[0]):
            faults.append("ego_lost" if self._target else "ego_absent")
        elif not (errors[0] <= TOLERANCE and errors[1] <= TOLERANCE and errors[2] <= TOLERANCE):
            faults += [code for code, value in zip(_ERROR_CODES, errors, strict=True) if not value <= TOLERANCE]
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
            libsumo.vehicle.moveToXY(self._id, "", -1, x, y, compass(heading), KEEP_ROUTE_EXACT, MATCH_THRESHOLD)
            libsumo.vehicle.setSpeed(self._id, speed)
        except SUMO_ERRORS:
            self._known = False
            self._faults.append("sumo_error")

    def _enter(self, x: float, y: float, speed: float) -> None:
        lane, _ = self._lanes.nearest(x, y)
        # SUMO's first step reports the departure speed: without it the speed would jump from 0.
        libsumo.vehicle.add(self._id, self._lanes.route(lane.id), self._type, departSpeed=f"{speed}")
        libsumo.vehicle.setSpeedMode(self._id, SPEED_MODE)
        libsumo.vehicle.setLaneChangeMode(self._id, 0)
        self._known, self._entered, self._route = True, True, ""

    def _errors(self) -> tuple[float, float, float]:
        if self._target is None or not self._known:
            return math.nan, math.nan, math.nan
        x, y, heading, speed = self._target
        has_x, has_y = libsumo.vehicle.getPosition(self._id)
        if has_x == INVALID:
            return math.nan, math.nan, math.nan
        turn = math.remainder(heading_of(libsumo.vehicle.getAngle(self._id)) - heading, math.tau)
        error = abs(libsumo.vehicle.getSpeed(self._id) - speed)
        if error > TOLERANCE:
            # Near the end of a lane that the ego's route cannot leave, SUMO sets the speed to 0 ("emergency stop")
            # before it applies the pose. No vehicle has read that speed yet.
            libsumo.vehicle.setPreviousSpeed(self._id, speed)
            error = abs(libsumo.vehicle.getSpeed(self._id) - speed)
        return math.hypot(has_x - x, has_y - y), abs(turn), error

    def _keep_route(self) -> None:
        """Set the ego's route past the next junction again where SUMO replaced or used up the route."""
        lane, route = libsumo.vehicle.getLaneID(self._id), libsumo.vehicle.getRouteID(self._id)
        if lane == self._lane and route == self._route:
            return
        self._lane = lane
        if lane:
            edges = libsumo.vehicle.getRoute(self._id)
            here = edges[max(libsumo.vehicle.getRouteIndex(self._id), 0)]
            ahead = self._ahead(here, lane)
            if edges[-len(ahead) :] != ahead:
                libsumo.vehicle.setRoute(self._id, ahead)
                route = libsumo.vehicle.getRouteID(self._id)
        self._route = route

    def _ahead(self, edge: str, lane: str) -> tuple[str, ...]:
        """Return the edges from the present one onward: the intended ones where the ego is on its route."""
        inside = lane.startswith(":")
        beyond = self._lanes.exit_edge(lane)
        for i in (*range(self._reached, len(self._intended)), *range(self._reached)):
            rest = self._intended[i:]
            if rest[0] == edge and (not inside or rest[1:2] == (beyond,)):
                self._reached = i
                return rest + self._lanes.onward_from(rest[-1])[1:]
        return (edge, *self._lanes.onward_from(beyond)) if inside else self._lanes.onward(lane)
