"""Computes the fallback path: the curvature that brings the car from its pose back onto its path while it brakes.

A forward simulation of a rear axle that follows the path; knows neither the lot nor the brakes.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Final

from vve_sumo.laws import clamp
from vve_sumo.path import ReferencePath
from vve_sumo.values import DeferredFallbackPath, FallbackPath, Pose, Vehicle

MAX_INTERVALS: Final = 31  #: maximum number of intervals between knots
MIN_KNOT_SPACING: Final = 0.25  #: between knots [m]
DECELERATION: Final = 1.5  #: sets the default length, enough for any stop on a slope of a tenth [m/s2]
DELAY: Final = 0.5  #: before the deceleration sets in [s]
RESERVE: Final = 1.0  #: added to the stopping distance [m]
LATERAL_ACCELERATION: Final = 3.0  #: maximum on the fallback path [m/s2], ISO 11270
LATERAL_JERK: Final = 5.0  #: maximum on the fallback path [m/s3], ISO 11270
RETURN_TIME: Final = 0.8  #: the lateral deviation falls by about a factor e in this time [s]
MIN_RETURN_DISTANCE: Final = 3.0  #: or over this distance, where the car is slow [m]
MAX_DEVIATION: Final = 5.0  #: no fallback path for a larger lateral deviation [m]
MAX_HEADING_ERROR: Final = 1.0  #: no fallback path for a larger heading error [rad]
MIN_SPEED: Final = 0.5  #: lowest speed that converts rates per second to rates per metre [m/s]
MIN_SPEED_SQUARED: Final = MIN_SPEED * MIN_SPEED


def fallback_path(
    pose: Pose, steering: float, path: ReferencePath, s: float, vehicle: Vehicle, distance: float | None = None
) -> FallbackPath | None:
    """Return the fallback path of the rear axle from `pose` onto the `path`; None where there is no smooth one.

    `steering` is the road-wheel angle that the car reports [rad], at which the fallback path begins. `s` is that
    of the pose along the path [m]. `distance` is the length of the fallback path [m], by default longer than any stop
    of the gateway.

    The lateral deviation d obeys d'' + 2 d' / r + d / r^2 = 0 along the fallback path, critically damped with the
    return length r, as far as steering rate, lateral acceleration and lateral jerk allow at the remaining speed.
    """
    speed = max(pose.speed, 0.0)
    if distance is None:
        distance = speed * DELAY + speed * speed / (2.0 * DECELERATION) + RESERVE
    if not math.isfinite(pose.x + pose.y + pose.heading + speed + steering + s + distance):
        return None
    spacing = max(distance / MAX_INTERVALS, MIN_KNOT_SPACING)
    knots = _follow(pose, speed, steering, path, s, vehicle, spacing, math.ceil(distance / spacing - 1e-9))
    return None if knots is None else FallbackPath(spacing, knots)


def deferred_fallback_path(
    pose: Pose, steering: float, path: ReferencePath, s: float, vehicle: Vehicle
) -> DeferredFallbackPath:
    """Return what `fallback_path` returns for the same arguments, computed when it is first needed."""
    return DeferredFallbackPath(partial(fallback_path, pose, steering, path, s, vehicle))


def _follow(
    pose: Pose,
    speed: float,
    steering: float,
    path: ReferencePath,
    s: float,
    vehicle: Vehicle,
    spacing: float,
    count: int,
) -> tuple[float, ...] | None:
    """Curvature at `count` + 1 knots; the simulation advances from one to the next with their mean."""
    # This loop takes a good part of the tick's time, hence local names and as few calls as possible.
    cos, sin, sqrt, frenet_near = math.cos, math.sin, math.sqrt, path.frenet_near
    x, y, heading = pose.x, pose.y, pose.heading
    tightest = math.tan(vehicle.steering_limit) / vehicle.wheelbase
    answer = vehicle.steering_rate_limit / vehicle.wheelbase
    square, loss = speed * speed, 2.0 * DECELERATION * spacing
    bend = math.tan(steering) / (vehicle.wheelbase + vehicle.understeer_gradient * square)
    bend = clamp(bend, -tightest, tightest)
    knots = [bend]
    for _ in range(count):
        v = sqrt(square) if square > MIN_SPEED_SQUARED else MIN_SPEED
        # The next place under the present curvature, and the curvature wanted there.
        ahead = heading + 0.5 * bend * spacing
        s, d, turned, path_bend = frenet_near(
            s + spacing, x + spacing * cos(ahead), y + spacing * sin(ahead), heading + bend * spacing
        )
        if not (-MAX_DEVIATION < d < MAX_DEVIATION and -MAX_HEADING_ERROR < turned < MAX_HEADING_ERROR):
            return None
        length = max(RETURN_TIME * v, MIN_RETURN_DISTANCE)
        cosine = cos(turned)
        bend_wanted = path_bend * cosine / (1.0 - path_bend * d)
        bend_wanted -= (2.0 * sin(turned) / length + d / (length * length)) / cosine
        most = min(tightest, LATERAL_ACCELERATION / (v * v))
        change = spacing * min(answer / v, LATERAL_JERK / (v * v * v))
        bend_wanted = clamp(clamp(bend_wanted, -most, most), bend - change, bend + change)
        ahead = heading + 0.25 * (bend + bend_wanted) * spacing
        x, y = x + spacing * cos(ahead), y + spacing * sin(ahead)
        heading += 0.5 * (bend + bend_wanted) * spacing
        bend = bend_wanted
        knots.append(bend)
        square = square - loss if square > loss else 0.0
    return tuple(knots)
