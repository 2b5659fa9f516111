"""The geofence: checks that the car would come to rest inside the lot if it were stopped now.

The swept areas of three fallback paths must all stay inside. Geometry and arithmetic only: the module commands nothing,
knows no gateway and no bus, and returns only a reason code.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from vve_sumo.frames import Alignment
from vve_sumo.laws import squared_speed_limits
from vve_sumo.lot.corridor import DeclaredCorridor, ParallelLine, line_offsets
from vve_sumo.lot.polygon import Lot
from vve_sumo.lot.swept_area import Body, Complexes, as_pairs, fan, relaxing, trail
from vve_sumo.lot.turning import Turning
from vve_sumo.path import EXTENSION, SAMPLE_SPACING, ReferencePath
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.values import DeferredFallbackPath, FallbackPath, Floats, Point, Pose, Vehicle, resolve_fallback_path

GEOFENCE_BREACH: Final = ("geofence_breach",)
#: a fallback path with more knots is refused [-]; the gateway takes no more than 64
MAX_KNOTS: Final = 200
#: by how much a corner moves out at most where every side does by 1, and more than rounding can take from it
GROWN_CORNER: Final = 1.415
#: how fast and up to what setpoints may ask for more acceleration, where the limits say nothing else; ISO 15622
JERK, ACCELERATION = 5.0, 2.0  # [m/s3], [m/s2]
#: a shorter rise counts as 0 [s], its jerk would be too large to compute with
MIN_RISE_TIME: Final = 1e-6
# How a controller is taken to drive a path, in the look ahead before a drive only: lateral acceleration in bends,
# slowing down ahead of them, speeding up. The check at every tick takes the car's own speed, so a limit that lets a
# controller drive bends faster takes nothing from it.
LATERAL, SLOWING, SPEEDING_UP = 3.0, 1.5, 2.0  # [m/s2]


@dataclass(frozen=True, slots=True)
class StopModel:
    """The braking of the gateway or of the DBW controller's watchdog."""

    deceleration: float  #: lowest, on the level [m/s2], positive
    delay: float  #: from the last good setpoint to the first deceleration, dead times and lags included [s]
    rise: float = 0.0  #: from the first deceleration to the full one, linearly [s]
    drive_lag: float = 0.0  #: time constant with which the drive force fades once the throttle is closed [s]
    jerk: float = JERK  #: with which setpoints may ask for more acceleration until they expire [m/s3]
    acceleration: float = ACCELERATION  #: greatest that setpoints may ask for [m/s2]

    def distance(self, speed: float, acceleration: float = 0.0, downhill: float = 0.0) -> float:
        """Return the stopping distance [m] from `speed` [m/s, not negative], `downhill` being the slope; inf if never.

        Until the brakes set in, speed rises by the present acceleration, by what setpoints add to it, and by the
        slope's share b; the drive force of both fades with its lag. Setpoints add with `jerk`, and no more than the
        greatest `acceleration`: the present one is measured, and holds drag and slope too. Then
        v t + b t^2 / 2 - j t^3 / 6 while the deceleration rises to a, and v^2 / (2 (a - b)).
        """
        pull = GRAVITY * downhill
        gained = max(acceleration, 0.0) * (self.delay + self.drive_lag)
        adding = min(self.delay, self.acceleration / self.jerk)
        gained += self.jerk * adding * (self.delay - 0.5 * adding + self.drive_lag)
        start = speed + gained + pull * self.delay
        if not self.deceleration > pull:
            return math.inf
        rise = self.rise if self.rise > MIN_RISE_TIME else 0.0
        time, after = rise, start + (pull - 0.5 * self.deceleration) * rise
        if after < 0.0:
            # At rest before the deceleration has risen.
            jerk, after = self.deceleration / rise, 0.0
            time = (pull + math.sqrt(pull * pull + 2.0 * jerk * start)) / jerk
        risen = self.deceleration * time / rise if rise > 0.0 else 0.0
        rising = time * (start + time * (0.5 * pull - risen / 6.0))
        return start * self.delay + rising + after * after / (2.0 * (self.deceleration - pull))


class DrivenPlace(NamedTuple):
    """One place of a drive that keeps to its path, or to a line parallel to it inside a declared corridor."""

    s: float  #: along the path [m]
    pose: Pose  #: of the rear axle, in the virtual road's map
    steering: float  #: road-wheel angle that the line's curvature asks for [rad], left positive
    fallback_path: FallbackPath  #: the line itself
    d: float = 0.0  #: of the line from the path [m], left positive


def no_drift(_driven: float) -> float:
    """Return 0: a receiver that never drifts."""
    return 0.0


class Geofence:
    """Checks that every fallback path stays inside the lot.

    `alignment` maps the lot's map to the virtual road's. `gateway` is the gateway's stop, on the fallback path or at a
    held wheel angle; `watchdog` is that of the DBW controller, with a wheel angle anywhere between held and straight.
    `downhill` is the lot's worst slope, positive. `turning` is what setpoints may still do to the wheel before a stop
    begins; without it they hold it. `drift` gives the receiver's largest drift that is not noticed [m] over a way [m]:
    the ground that is checked grows by it.
    """

    def __init__(
        self,
        lot: Lot,
        vehicle: Vehicle,
        alignment: Alignment,
        *,
        gateway: StopModel,
        watchdog: StopModel,
        downhill: float = 0.0,
        turning: Turning | None = None,
        drift: Callable[[float], float] = no_drift,
    ) -> None:
        self.lot = lot
        self._to_lot = alignment.inverse()
        self._gateway, self._watchdog, self._downhill = gateway, watchdog, downhill
        self._body = Body.of(vehicle)
        self._turning, self._drift = turning, drift
        self._wheelbase, self._understeer = vehicle.wheelbase, vehicle.understeer_gradient
        self._tightest = vehicle.tightest_curvature

    def check(
        self,
        pose: Pose,
        steering: float,
        fallback_path: FallbackPath | DeferredFallbackPath | None,
        driven: float = 0.0,
        requested: tuple[float, float] | None = None,
    ) -> tuple[str, ...]:
        """Return ("geofence_breach",) unless the car comes to rest inside the lot from this pose, whoever stops it.

        `pose` is the rear axle's in the virtual road's map, `steering` the road-wheel angle that the car reports [rad,
        left positive], `fallback_path` the one that the setpoint carries, None for none; near an edge a deferred one is
        computed. `driven` is the way since the receiver was first compared with the car [m], `requested` the least and
        the greatest road-wheel angle that the latest setpoints asked for [rad], by default the reported one. A value
        that is not finite is a breach.
        """
        distances = self._distances(pose, steering + driven + sum(requested or ()))
        if distances is None:
            return GEOFENCE_BREACH
        placed, drift, farthest = self._to_lot.apply(pose), self._drift(driven), max(map(abs, distances))
        # No corner of the grown body is farther out than this. So a car in the open costs next to nothing.
        if self.lot.holds_disc(placed.x, placed.y, farthest + self._body.reach + GROWN_CORNER * drift):
            return ()
        body = self._body.grown(drift)
        if self.lot.holds_disc(placed.x, placed.y, farthest + body.reach):
            return ()
        way = resolve_fallback_path(fallback_path)
        shapes = self._shapes(body, pose.speed, distances, steering, way, requested)
        if shapes is None or not self.lot.holds(as_pairs(shapes, placed.x, placed.y, placed.heading)):
            return GEOFENCE_BREACH
        return ()

    def sweep(
        self, pose: Pose, steering: float, fallback_path: FallbackPath | None, driven: float = 0.0
    ) -> Floats | None:
        """Return the ground that `check` looks at, as rectangles in the map of `pose`, (n, 4, 2); None for no rest."""
        distances, body = self._distances(pose, steering), self._body.grown(self._drift(driven))
        shapes = None if distances is None else self._shapes(body, pose.speed, distances, steering, fallback_path, None)
        return None if shapes is None else as_pairs(shapes, pose.x, pose.y, pose.heading)

    def aligned(self, alignment: Alignment) -> Geofence:
        """Return the same geofence for another alignment."""
        other = copy(self)
        other._to_lot = alignment.inverse()
        return other

    def along(self, path: ReferencePath, speed: float, corridor: DeclaredCorridor = ()) -> float | None:
        """Return the first s [m] from which a drive of the path at `speed` [m/s] could not stop in the lot.

        None where it always could. The car is taken to keep to the path, to start from rest, and to slow down for
        bends as any controller must; beyond the end it rolls on straight. With a declared `corridor` it must be able to
        stop from every place in that too, where it heads along the path.
        """
        for place in self.driven(path, speed, corridor):
            if self.check(place.pose, place.steering, place.fallback_path, place.s):
                return place.s
        return None

    def driven(self, path: ReferencePath, speed: float, corridor: DeclaredCorridor = ()) -> list[DrivenPlace]:
        """Return the places that `along` checks: one a metre of the path, each followed by those beside it."""
        table = path.samples
        first = round(EXTENSION / SAMPLE_SPACING)
        count = math.ceil(path.length / SAMPLE_SPACING) + 1
        speeds = driven_speeds(table.curvature[first : first + count], speed)
        heading = np.arctan2(table.tangent_y, table.tangent_x)
        lines: dict[float, ParallelLine] = {}
        drive = []
        for row, v in enumerate(speeds, start=first):
            s, bend = float(table.s[row]), float(table.curvature[row])
            x, y = float(table.x[row]), float(table.y[row])
            pose = Pose(0.0, Point.REAR_AXLE, x, y, float(heading[row]), v, 0.0, v * bend, 0.0, 0.0)
            steering = self._steering(bend, v)
            reach = max(self._distances(pose, steering) or (0.0,))
            last = row + math.ceil(min(reach, EXTENSION) / SAMPLE_SPACING) + 2
            ahead = tuple(table.curvature[row:last].tolist())
            drive.append(DrivenPlace(s, pose, steering, FallbackPath(SAMPLE_SPACING, ahead)))
            for d in line_offsets(corridor, s):
                if d not in lines:
                    lines[d] = ParallelLine(path, d, self._tightest)
                drive.append(self._beside(pose, lines[d], row, s, d))
        return drive

    def _beside(self, pose: Pose, line: ParallelLine, row: int, s: float, d: float) -> DrivenPlace:
        """Return the place on a parallel line beside a pose on the path, at no more speed than its bend allows."""
        bend = float(line.bend[row])
        v = min(pose.speed, math.sqrt(LATERAL / abs(bend))) if bend else pose.speed
        beside = replace(pose, x=float(line.x[row]), y=float(line.y[row]), speed=v, yaw_rate=v * bend)
        steering = self._steering(bend, v)
        reach = max(self._distances(beside, steering) or (0.0,))
        return DrivenPlace(s, beside, steering, line.ahead(row, min(reach, EXTENSION)), d)

    def _steering(self, bend: float, speed: float) -> float:
        """Return the road-wheel angle [rad] that drives a curvature [1/m] at a speed [m/s]."""
        return math.atan(self._wheelbase * bend) + self._understeer * bend * speed * speed

    def _distances(self, pose: Pose, steering: float) -> tuple[float, float] | None:
        """Stopping distances of gateway and watchdog [m], negative where the car rolls backwards.

        None where the car does not come to rest, or a value is not finite.
        """
        speed, gaining, slope = abs(pose.speed), pose.acceleration, self._downhill
        gateway = self._gateway.distance(speed, gaining, slope)
        watchdog = self._watchdog.distance(speed, gaining, slope)
        if not math.isfinite(gateway + watchdog + pose.x + pose.y + pose.heading + steering):
            return None
        return math.copysign(gateway, pose.speed), math.copysign(watchdog, pose.speed)

    def _shapes(
        self,
        body: Body,
        speed: float,
        distances: tuple[float, float],
        steering: float,
        fallback_path: FallbackPath | None,
        requested: tuple[float, float] | None,
    ) -> Complexes | None:
        """Swept area of all fallback paths, in the rear axle's frame; None where `fallback_path` is invalid."""
        by_gateway, by_watchdog = distances
        turning, asked = self._turning, requested or (steering, steering)
        # A fallback path leads forwards: nobody leads a car that rolls backwards.
        way = fallback_path if by_gateway > 0.0 else None
        held = (steering, steering) if turning is None else turning.at_once(speed, steering, asked)
        low, high = self._bends(speed, *held)
        swept = [relaxing(body, min(low, 0.0), max(high, 0.0), by_watchdog)]
        if way is None and turning is not None:
            # Nobody leads the wheel back to where it was: it may be held wherever setpoints have turned it by then.
            swept.append(fan(body, *self._bends(speed, *turning.until_stop(speed, steering, asked)), by_gateway))
        elif abs(by_gateway) > abs(by_watchdog):
            swept.append(fan(body, *self._bends(speed, steering, steering), by_gateway))
        if way is not None:
            knots = _knots(way, by_gateway)
            if knots is None:
                return None
            ways = [knots]
            if turning is not None:
                ways += turning.led_astray(knots, way.spacing, speed, steering, asked)
            swept += [trail(body, bends, way.spacing) for bends in ways]
        return np.concatenate(swept)

    def _bends(self, speed: float, low: float, high: float) -> tuple[float, float]:
        """Least and greatest curvature [1/m] of wheels held between two angles [rad], from `speed` to rest."""
        # A held wheel angle turns the car tighter the slower it gets.
        wide = self._wheelbase + self._understeer * speed * speed
        return (
            math.tan(low) / (self._wheelbase if low < 0.0 else wide),
            math.tan(high) / (self._wheelbase if high > 0.0 else wide),
        )


def _knots(fallback_path: FallbackPath, distance: float) -> Floats | None:
    """The path's curvature up to `distance` [m], its last one held beyond its end; None where it is invalid."""
    if not (fallback_path.spacing > 0.0 and fallback_path.curvature and distance <= MAX_KNOTS * fallback_path.spacing):
        return None
    knots = np.array(fallback_path.curvature[: MAX_KNOTS + 2], dtype=np.float64)
    wanted = math.ceil(distance / fallback_path.spacing) + 1
    held = np.concatenate((knots[:wanted], np.full(max(wanted - len(knots), 0), knots[-1])))
    return held if np.isfinite(held).all() else None


def driven_speeds(curvature: Floats, speed: float) -> list[float]:
    """Return the greatest speeds [m/s], one per SAMPLE_SPACING, of a drive from rest that asks for `speed`.

    Those of `laws.squared_speed_limits`, and v^2 <= v_last^2 + 2 speeding_up ds.
    """
    squares = squared_speed_limits(curvature.tolist(), speed, LATERAL, SLOWING, SAMPLE_SPACING)
    squares[0] = 0.0
    for row in range(1, len(squares)):
        squares[row] = min(squares[row], squares[row - 1] + 2.0 * SPEEDING_UP * SAMPLE_SPACING)
    return [math.sqrt(square) for square in squares]
