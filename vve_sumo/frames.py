"""Frames: geodetic, projected, map and body, as inverse pairs, and the placement of a fix on the virtual road.

Knows geometry and projections; must not know receivers' bytes, trust, SUMO or the controller. Headings in maps are
counter-clockwise from the map's +x; a fix's heading is counter-clockwise from *true* east; what lies between is the
convergence. Maps are transverse Mercator planes on the WGS84 ellipsoid (conformal: headings turn, shapes keep).
"""

from __future__ import annotations

import cmath
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import pyproj
from pyproj.enums import TransformDirection
from pyproj.exceptions import ProjError

from vve_sumo.errors import ConfigError
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.values import Fix, Point, Pose

PROJECTIONS: Final = frozenset({"tmerc", "etmerc", "utm"})
SEMI_MAJOR: Final = 6_378_137.0  #: of WGS84 [m]; GRS80 shares it
SECOND_ECCENTRICITY: Final = 0.00673949674228  #: of WGS84, squared
SEMI_MAJOR_LIMIT: Final = 0.5  #: an ellipsoid off by more is another datum [m]
SPREAD_LIMIT: Final = 1.0  #: surveyed points closer to their middle than this fix no rotation [m, root mean square]
NORTHWARD: Final = 1e-4  #: from the natural origin, to see where the map has north [rad]
NORTH_TOLERANCE: Final = 1e-6  #: of that direction [rad]
SCALE_LIMIT: Final = 0.01  #: two surveys of one place that differ by more differ in their units or places

#: what a PROJ string says of heights, which play no part: a geoid's grid is a file that PROJ need not have
_OF_HEIGHTS: Final = re.compile(r"(?:^|\s)\+?(?:geoidgrids|geoid_crs|vunits|vto_meter)=\S+")

Pair = tuple[float, float]

# Found once, for every pose: looking them up in their class costs a call.
_INVERSE: Final = TransformDirection.INVERSE
_REAR_AXLE: Final = Point.REAR_AXLE


def wrap_angle(angle: float) -> float:
    """Return the same angle between -pi and pi."""
    return angle if -math.pi <= angle <= math.pi else math.remainder(angle, math.tau)


class MapFrame:
    """Geodetic coordinates to map metres and back.

    `projection` is a PROJ string of a transverse Mercator projection in metres on WGS84 or GRS80 (`+proj=tmerc ...` or
    `+proj=utm ...`, as in a SUMO network's `projParameter`); `offset` is added to the projected x and y (SUMO's
    `netOffset`). Raises ConfigError for any other projection. Heights play no part, nor does what the string says of
    them (`+geoidgrids`, `+vunits`): distances are those on the ellipsoid, 4e-5 shorter than on the ground at 250 m.
    """

    def __init__(self, projection: str, offset: Pair = (0.0, 0.0)) -> None:
        self.projection = projection
        self.offset = offset
        opened, self._meridian = _open_projection(projection)
        self._project = opened.transform
        self._x, self._y = offset
        if not math.isfinite(self._x + self._y):
            raise ConfigError(f"map offset {offset!r}: expected two finite numbers [m]")

    def to_map(self, latitude: float, longitude: float) -> Pair:
        """Return map x, y [m] of WGS84 latitude, longitude [rad]; not finite where the projection has no answer."""
        x, y = self._project(longitude, latitude, radians=True)
        return x + self._x, y + self._y

    def to_geodetic(self, x: float, y: float) -> Pair:
        """Return WGS84 latitude, longitude [rad] of map x, y [m]."""
        longitude, latitude = self._project(x - self._x, y - self._y, radians=True, direction=_INVERSE)
        return latitude, longitude

    def convergence(self, latitude: float, longitude: float) -> float:
        """Return what must be *added* to a heading counter-clockwise from true east to count from the map's +x [rad].

        Grid bearing is true azimuth minus convergence, so the counter-clockwise heading gains it; it is positive east
        of the central meridian in the northern hemisphere, where the meridians lean left. Series in the longitude
        difference from Redfearn (1948), as in the Ordnance Survey's "A guide to coordinate systems in Great Britain",
        annex C; within 1e-6 deg of PROJ up to 4 deg from the central meridian.
        """
        sine, cosine = math.sin(latitude), math.cos(latitude)
        away = math.remainder(longitude - self._meridian, math.tau)
        square = (away * cosine) ** 2
        eta = SECOND_ECCENTRICITY * cosine * cosine
        tangent = (sine / cosine) ** 2
        third = (1.0 + 3.0 * eta + 2.0 * eta * eta) / 3.0
        return away * sine * (1.0 + square * (third + square * (2.0 - tangent) / 15.0))


def local_frame(latitude: float, longitude: float) -> MapFrame:
    """Return a plane map centred on a place [rad], for the few kilometres around it."""
    where = f"+lat_0={math.degrees(latitude):.9f} +lon_0={math.degrees(longitude):.9f}"
    return MapFrame(f"+proj=tmerc {where} +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")


def _open_projection(projection: str) -> tuple[pyproj.Transformer, float]:
    """Return what projects radians to metres, and the longitude of the projection's natural origin [rad]."""
    try:
        opened = pyproj.Proj(_OF_HEIGHTS.sub(" ", projection))
        # Calling `opened` itself does the same in twice the time.
        transformer = pyproj.Transformer.from_pipeline(opened.srs)
        plane = _plane(opened.crs)
        axes, ellipsoid = plane.axis_info, plane.ellipsoid
    except ProjError as error:
        raise ConfigError(f"projection {projection!r}: not understood by PROJ ({error})") from None
    if opened.name not in PROJECTIONS:
        raise ConfigError(f"projection {projection!r}: expected +proj=tmerc or +proj=utm, got {opened.name or 'none'}")
    if any(axis.unit_conversion_factor != 1.0 for axis in axes):
        raise ConfigError(f"projection {projection!r}: expected metres, got {axes[0].unit_name}")
    if ellipsoid is None or not abs(ellipsoid.semi_major_metre - SEMI_MAJOR) <= SEMI_MAJOR_LIMIT or _shifts(opened.crs):
        shifted = " with a shift of datum" if _shifts(opened.crs) else ""
        raise ConfigError(f"projection {projection!r}: expected the WGS84 ellipsoid, got {ellipsoid}{shifted}")
    latitude, meridian = _natural_origin(plane)
    if not _points_north(transformer, latitude, meridian):
        raise ConfigError(f"projection {projection!r}: expected north up along its central meridian, east of Greenwich")
    return transformer, meridian


def _plane(crs: pyproj.CRS) -> pyproj.CRS:
    """Return the projected reference system in one that adds heights or a way to WGS84 to it."""
    if crs.is_compound:
        return _plane(crs.sub_crs_list[0])
    return crs.source_crs if crs.is_bound and crs.source_crs is not None else crs


def _shifts(crs: pyproj.CRS) -> bool:
    """Whether the reference system says that it lies elsewhere than WGS84 (`+towgs84`)."""
    return crs.is_bound and crs.coordinate_operation is not None and any(crs.coordinate_operation.towgs84)


def _natural_origin(plane: pyproj.CRS) -> tuple[float, float]:
    """Return latitude and longitude of the projection's natural origin [rad]."""
    operation = plane.coordinate_operation
    assert operation is not None  # every projected reference system has one
    parameters: Iterable[Any] = operation.params  # pyproj declares their values as numbers, and gives text
    named = {parameter.name: math.radians(float(parameter.value)) for parameter in parameters}
    return named["Latitude of natural origin"], named["Longitude of natural origin"]


def _points_north(transformer: pyproj.Transformer, latitude: float, meridian: float) -> bool:
    """Whether the map's +y is north along the central meridian, which the series of the convergence counts from."""
    north = -NORTHWARD if latitude > 0.0 else NORTHWARD  # either way, for a pole has no north
    (x, y), (to_x, to_y) = (transformer.transform(meridian, latitude + by, radians=True) for by in (0.0, north))
    return abs(math.atan2(to_x - x, (to_y - y) * math.copysign(1.0, north))) <= NORTH_TOLERANCE


def move_point(pose: Pose, dx: float, dy: float, to: Point) -> Pose:
    """Return the pose of the point `to` of the same rigid body, `dx` forward and `dy` left of `pose.point` [m].

    Position and velocity move (v_to = v + omega x r). The acceleration keeps the term omega x v out, being the rate of
    change of the forward speed, and would change only with the angular acceleration, which a pose does not hold.
    Inverse: the same with `-dx`, `-dy`.
    """
    heading, yaw_rate = pose.heading, pose.yaw_rate
    x, y = _beside(pose.x, pose.y, heading, dx, dy)
    speed, lateral = pose.speed - yaw_rate * dy, pose.lateral_speed + yaw_rate * dx
    return Pose(pose.time, to, x, y, heading, speed, lateral, yaw_rate, pose.acceleration, pose.grade)


def _beside(x: float, y: float, heading: float, dx: float, dy: float) -> Pair:
    """Return the place `dx` forward and `dy` left of another one [m], seen along a heading [rad]."""
    cosine, sine = math.cos(heading), math.sin(heading)
    return x + cosine * dx - sine * dy, y + sine * dx + cosine * dy


@dataclass(frozen=True, slots=True)
class Alignment:
    """Rigid transform that lays the lot's map onto the virtual road's: turn about the lot's origin, then shift."""

    rotation: float = 0.0  #: road heading minus lot heading [rad], counter-clockwise
    x: float = 0.0  #: road x of the lot's origin [m]
    y: float = 0.0  #: road y of the lot's origin [m]
    residuals: tuple[float, ...] = ()  #: what each surveyed pair is off after the fit [m]

    @classmethod
    def from_matched_start(cls, lot_pose: Pose, road_pose: Pose) -> Alignment:
        """Return the alignment that lays the lot pose onto the virtual road pose of the same point.

        Raises ConfigError when the poses are of different points or not finite.
        """
        if lot_pose.point != road_pose.point:
            raise ConfigError(f"matched start: lot pose is of {lot_pose.point}, road pose of {road_pose.point}")
        rotation = wrap_angle(road_pose.heading - lot_pose.heading)
        turned = cmath.exp(1j * rotation) * complex(lot_pose.x, lot_pose.y)
        shift = complex(road_pose.x, road_pose.y) - turned
        if not cmath.isfinite(shift) or not math.isfinite(rotation):
            raise ConfigError("matched start: a pose holds a number that is not finite")
        return cls(rotation, shift.real, shift.imag)

    @classmethod
    def from_surveyed_pairs(cls, lot_points: Sequence[Pair], road_points: Sequence[Pair], limit: float) -> Alignment:
        """Return the least-squares alignment of two or more surveyed pairs; `limit` bounds every residual [m].

        With points as complex numbers about their means, the rotation is the argument of the sum of conj(lot) road
        (Procrustes in the plane). Raises ConfigError for too few, unequal, non-finite or coinciding points, for
        mirrored axes, for a scale off by more than `SCALE_LIMIT`, and for a residual above `limit`.
        """
        lot, road = _centred(lot_points, "lot"), _centred(road_points, "road")
        if len(lot_points) != len(road_points):
            raise ConfigError(f"surveyed pairs: {len(lot_points)} lot points but {len(road_points)} road points")
        product = sum(z.conjugate() * w for z, w in zip(lot, road, strict=True))
        turn = product / abs(product) if product else 1.0
        residuals = tuple(abs(turn * z - w) for z, w in zip(lot, road, strict=True))
        if misfit := _misfit(lot, road, residuals, limit):
            raise ConfigError(f"surveyed pairs: {misfit}")
        rotation = cmath.phase(turn)
        shift = _mean(road_points) - turn * _mean(lot_points)
        return cls(rotation, shift.real, shift.imag, residuals)

    def inverse(self) -> Alignment:
        """Return the alignment from the virtual road to the lot; residuals are not carried over."""
        cosine, sine = math.cos(self.rotation), math.sin(self.rotation)
        return Alignment(-self.rotation, -cosine * self.x - sine * self.y, sine * self.x - cosine * self.y)

    def apply(self, pose: Pose) -> Pose:
        """Return the lot pose in the virtual road's map."""
        cosine, sine = math.cos(self.rotation), math.sin(self.rotation)
        x, y = cosine * pose.x - sine * pose.y + self.x, sine * pose.x + cosine * pose.y + self.y
        return Pose(
            pose.time,
            pose.point,
            x,
            y,
            wrap_angle(pose.heading + self.rotation),
            pose.speed,
            pose.lateral_speed,
            pose.yaw_rate,
            pose.acceleration,
            pose.grade,
        )


def _mean(points: Sequence[Pair]) -> complex:
    return sum((complex(x, y) for x, y in points), 0j) / len(points)


def _spread(points: Sequence[complex]) -> float:
    """Root mean square distance from the middle [m]."""
    return math.sqrt(sum(abs(z) ** 2 for z in points) / len(points))


def _centred(points: Sequence[Pair], name: str) -> list[complex]:
    if len(points) < 2:
        raise ConfigError(f"surveyed pairs: expected two or more {name} points, got {len(points)}")
    if not all(math.isfinite(x) and math.isfinite(y) for x, y in points):
        raise ConfigError(f"surveyed pairs: a {name} point is not finite")
    middle = _mean(points)
    centred = [complex(x, y) - middle for x, y in points]
    if _spread(centred) < SPREAD_LIMIT:
        raise ConfigError(f"surveyed pairs: the {name} points lie on one spot (spread below {SPREAD_LIMIT} m)")
    return centred


def _misfit(lot: Sequence[complex], road: Sequence[complex], residuals: Sequence[float], limit: float) -> str:
    """What is wrong with the pairs, in words; empty when they fit."""
    refused = not max(residuals) <= limit
    turned = abs(sum(z.conjugate() * w for z, w in zip(lot, road, strict=True)))
    mirrored = abs(sum(z * w for z, w in zip(lot, road, strict=True)))
    if refused and mirrored > turned * (1.0 + 1e-9):
        return "one side is mirrored (x and y, or left and right, are swapped in one of the surveys)"
    scale = _spread(road) / _spread(lot)
    if abs(scale - 1.0) > SCALE_LIMIT:
        return f"road distances are {scale:.4f} times the lot's: other units, or other points"
    if refused:
        worst = max(range(len(residuals)), key=residuals.__getitem__)
        return f"pair {worst + 1} is off by {residuals[worst]:.3f} m after the fit, limit {limit} m"
    return ""


@dataclass(frozen=True, slots=True)
class Mounting:
    """Where the receiver's output point sits on the car and how its heading is turned."""

    forward: float  #: output point ahead of the rear axle [m]
    left: float  #: output point left of the rear axle [m]
    heading_misalignment: float = 0.0  #: receiver's heading minus the car's [rad], counter-clockwise, small


class Placement:
    """From a fix of the output point to the pose of the rear axle on the virtual road, and back.

    `lot_frame` is the map plane of the lot, `alignment` lays it onto the virtual road's map; on the true place the
    lot's frame *is* the virtual road's and the alignment is `Alignment()`. `epoch` is the GNSS second of drive time 0.
    """

    def __init__(self, lot_frame: MapFrame, alignment: Alignment, mounting: Mounting, epoch: float) -> None:
        self._frame = lot_frame
        self._mounting = mounting
        self._epoch = epoch
        self._rotation = alignment.rotation
        self._cosine, self._sine = math.cos(alignment.rotation), math.sin(alignment.rotation)
        self._x, self._y = alignment.x, alignment.y

    def place(self, fix: Fix) -> Pose:
        """Return the rear axle's pose on the virtual road.

        Speeds are the true ones of the ground, not scaled to the map. Grade is the car's pitch, level where the
        receiver says none; gravity's share by pitch and the turning of the car axes (yaw rate times lateral speed)
        are taken out of the acceleration. Numbers of the fix that are not finite come out not finite.
        """
        mounting, yaw_rate = self._mounting, fix.yaw_rate
        lot_x, lot_y = self._frame.to_map(fix.latitude, fix.longitude)
        true_heading = fix.heading - mounting.heading_misalignment
        forward_x, forward_y = math.cos(true_heading), math.sin(true_heading)
        speed = forward_x * fix.velocity_east + forward_y * fix.velocity_north
        lateral = forward_x * fix.velocity_north - forward_y * fix.velocity_east
        grade = 0.0 if math.isnan(fix.pitch) else fix.pitch
        heading = wrap_angle(true_heading + self._frame.convergence(fix.latitude, fix.longitude) + self._rotation)
        output_x = self._cosine * lot_x - self._sine * lot_y + self._x
        output_y = self._sine * lot_x + self._cosine * lot_y + self._y
        x, y = _beside(output_x, output_y, heading, -mounting.forward, -mounting.left)
        speed, lateral_speed = speed + yaw_rate * mounting.left, lateral - yaw_rate * mounting.forward
        acceleration = fix.acceleration + yaw_rate * lateral - GRAVITY * math.sin(grade)
        time = fix.time - self._epoch
        return Pose(time, _REAR_AXLE, x, y, heading, speed, lateral_speed, yaw_rate, acceleration, grade)

    def unplace(self, pose: Pose) -> Fix:
        """Return the fix whose `place` is `pose`, which must be of the rear axle.

        What a pose does not say is NaN: altitude, roll, vertical speed, accuracies; status 0, position mode -1. The
        caller that plays a receiver replaces them.
        """
        latitude, longitude, heading, velocity_north, velocity_east, acceleration = self.output(pose)
        return Fix(
            time=pose.time + self._epoch,
            time_received=pose.time,
            latitude=latitude,
            longitude=longitude,
            altitude=math.nan,
            heading=heading,
            pitch=pose.grade,
            roll=math.nan,
            velocity_north=velocity_north,
            velocity_east=velocity_east,
            velocity_down=math.nan,
            yaw_rate=pose.yaw_rate,
            acceleration=acceleration,
        )

    def output(self, pose: Pose) -> tuple[float, float, float, float, float, float]:
        """Return what a perfect receiver outputs where the rear axle's pose is `pose`.

        These are latitude, longitude and heading [rad], the velocity north and east [m/s] and the forward acceleration
        [m/s2], in the senses of a `Fix`; the heading is between -pi and pi.
        """
        assert pose.point is _REAR_AXLE, f"expected a pose of the rear axle, got {pose.point}"
        mounting, yaw_rate = self._mounting, pose.yaw_rate
        output_x, output_y = _beside(pose.x, pose.y, pose.heading, mounting.forward, mounting.left)
        speed = pose.speed - yaw_rate * mounting.left
        lateral = pose.lateral_speed + yaw_rate * mounting.forward
        x, y = output_x - self._x, output_y - self._y
        lot_x, lot_y = self._cosine * x + self._sine * y, self._cosine * y - self._sine * x
        latitude, longitude = self._frame.to_geodetic(lot_x, lot_y)
        true_heading = pose.heading - self._rotation - self._frame.convergence(latitude, longitude)
        forward_x, forward_y = math.cos(true_heading), math.sin(true_heading)
        return (
            latitude,
            longitude,
            wrap_angle(true_heading + mounting.heading_misalignment),
            speed * forward_y + lateral * forward_x,
            speed * forward_x - lateral * forward_y,
            pose.acceleration - yaw_rate * lateral + GRAVITY * math.sin(pose.grade),
        )
