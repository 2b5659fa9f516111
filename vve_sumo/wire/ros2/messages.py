"""What of our values stands in which field of which ROS 2 message.

Frames and units are those of REP 103 and REP 105: x ahead, y left, z up in `base_link`, which is the middle of the rear
axle on the ground; x east, y north, z up in `map`, which is the virtual road's map. A variance of UNKNOWN_VARIANCE says
that an axis is not measured at all. Knows values and fields; it must not know what carries a message.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from vve_sumo.body_kinds import BODY_KINDS
from vve_sumo.path import ReferencePath
from vve_sumo.pose.nmea_encoder import LEAP_SECONDS
from vve_sumo.sensors.drawing import Mounting
from vve_sumo.values import Actors, Fix, FixQuality, Floats, Pose
from vve_sumo.wire.ros2.types import make

#: topics and types of what goes out; the last message of a latched one is given to who comes later
TOPICS: Final[Mapping[str, str]] = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/path": "nav_msgs/msg/Path",
    "/fix": "sensor_msgs/msg/NavSatFix",
    "/imu": "sensor_msgs/msg/Imu",
    "/radar/points": "sensor_msgs/msg/PointCloud2",
    "/bodies": "visualization_msgs/msg/MarkerArray",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/path/ahead": "nav_msgs/msg/Path",
    "/path/speed": "geometry_msgs/msg/TwistStamped",
    "/odom": "nav_msgs/msg/Odometry",
}
LATCHED: Final = frozenset({"/tf_static", "/path"})
MAP, ODOM, BASE, RADAR, GNSS = "map", "odom", "base_link", "radar", "gnss"
_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
#: of GNSS time 0, 1980-01-06, as Unix time [s]
GNSS_EPOCH: Final = 315_964_800
MICROSECONDS: Final = 1_000_000  #: in a second
#: of an axis that nothing measures [of the axis' unit, squared]
UNKNOWN_VARIANCE: Final = 1e6
PATH_STEP: Final = 1.0  #: between the poses of a path [m]
#: NavSatStatus.status of each quality: no fix, a fix, one with satellites' corrections, one with a base station's
STATUS: Final = {
    FixQuality.NONE: -1,
    FixQuality.UNKNOWN: -1,
    FixQuality.SINGLE: 0,
    FixQuality.DIFFERENTIAL: 2,
    FixQuality.PPP: 1,
    FixQuality.RTK_FLOAT: 2,
    FixQuality.RTK_FIXED: 2,
}
SERVICE_GPS: Final = 1
#: NavSatFix.position_covariance_type
COVARIANCE_UNKNOWN, COVARIANCE_APPROXIMATED = 0, 1
#: DiagnosticStatus.level
OK, WARN, ERROR = 0, 1, 2
#: Marker.type, Marker.action
CUBE, ADD, DELETE_ALL = 1, 0, 3
#: colours of bodies: of people, and of everything else (Okabe and Ito's)
PERSON, OTHER = (0.835, 0.369, 0.0, 0.9), (0.0, 0.447, 0.698, 0.9)
WHITE: Final = (0.0, 0.0, 0.0, 0.0)


def unix_nanoseconds(time: float) -> int:
    """Return the Unix time [ns], in whole microseconds, of a GNSS time [s since 1980-01-06, no leap seconds]."""
    return 1000 * (round(time * MICROSECONDS) + (GNSS_EPOCH - LEAP_SECONDS) * MICROSECONDS)


def stamp(nanoseconds: int) -> Any:
    """Return a Unix time [ns] as builtin_interfaces/Time."""
    return make("builtin_interfaces/msg/Time", *divmod(nanoseconds, 1_000_000_000))


def clock(at: int) -> Any:
    """Return rosgraph_msgs/Clock of a Unix time [ns]."""
    return make("rosgraph_msgs/msg/Clock", stamp(at))


def odometry(at: int, pose: Pose, fix: Fix | None = None) -> Any:
    """Return nav_msgs/Odometry: pose of `base_link` in `odom`, twist in `base_link`.

    Variances are those of the receiver's `fix`; zeros, which ROS takes for unknown, where it says none or is None.
    """
    place, turn, moves = (math.nan,) * 3 if fix is None else (fix.position_sigma, fix.heading_sigma, fix.velocity_sigma)
    known = math.isfinite(place)
    covariance = _diagonal(place, place, None, None, None, turn) if known else np.zeros(36)
    twist = make("geometry_msgs/msg/Twist", vector_of(pose.speed, pose.lateral_speed), vector_of(z=pose.yaw_rate))
    of_twist = _diagonal(moves, moves, None, None, None, 0.0) if math.isfinite(moves) else np.zeros(36)
    return make(
        "nav_msgs/msg/Odometry",
        header_of(at, ODOM),
        BASE,
        make("geometry_msgs/msg/PoseWithCovariance", pose_of(pose.x, pose.y, pose.heading), covariance),
        make("geometry_msgs/msg/TwistWithCovariance", twist, of_twist),
    )


def transforms(at: int, pose: Pose) -> Any:
    """Return tf2_msgs/TFMessage of `/tf`: `base_link` in `odom`."""
    return make("tf2_msgs/msg/TFMessage", [_transform(at, ODOM, BASE, pose.x, pose.y, pose.heading)])


def sense_refusal(name: str) -> str:
    """Return why a sensor's name cannot be that of topics and of a frame; empty where it can."""
    if not _NAME.fullmatch(name):
        return f"sensor {name!r} cannot be a topic of ROS 2, expected letters, digits and underscores"
    if name in (MAP, ODOM, BASE, RADAR, GNSS):
        return f"sensor {name!r} cannot be a frame, the ROS 2 bridge has another of that name"
    return ""


def static_transforms(
    at: int, bumper: float, mounting: tuple[float, float], senses: Mapping[str, Mounting] | None = None
) -> Any:
    """Return tf2_msgs/TFMessage of `/tf_static`: `odom` in `map`, which is where it is, and the sensors in `base_link`.

    `bumper` is from the rear axle to the front bumper [m], where a scan counts from; `mounting` is the receiver's
    output point ahead and left of the rear axle [m]; `senses` are the frames of further sensors by their names.
    """
    frames = [
        _transform(at, MAP, ODOM, 0.0, 0.0, 0.0),
        _transform(at, BASE, RADAR, bumper, 0.0, 0.0),
        _transform(at, BASE, GNSS, *mounting, 0.0),
    ]
    for name, one in (senses or {}).items():
        frames.append(_transform(at, BASE, name, one.x_m, one.y_m, one.yaw_rad, one.z_m))
    return make("tf2_msgs/msg/TFMessage", frames)


def nav_sat_fix(at: int, fix: Fix) -> Any:
    """Return sensor_msgs/NavSatFix of the receiver's output point, degrees and metres; altitude NaN where unknown."""
    sigma, known = fix.position_sigma, math.isfinite(fix.position_sigma)
    covariance = np.diag([sigma**2, sigma**2, UNKNOWN_VARIANCE]).ravel() if known else np.zeros(9)
    return make(
        "sensor_msgs/msg/NavSatFix",
        header_of(at, GNSS),
        make("sensor_msgs/msg/NavSatStatus", STATUS[fix.quality] if fix.locked else -1, SERVICE_GPS),
        math.degrees(fix.latitude),
        math.degrees(fix.longitude),
        fix.altitude,
        covariance,
        COVARIANCE_APPROXIMATED if known else COVARIANCE_UNKNOWN,
    )


def imu(at: int, fix: Fix) -> Any:
    """Return sensor_msgs/Imu of the receiver's unit, turned into the axes of `base_link`.

    Its orientation is from true east, north, up; nose-up pitch is a negative turn about y (REP 103). Pitch and roll
    that the receiver does not say count as level, with UNKNOWN_VARIANCE. Of the acceleration the forward axis alone is
    measured, gravity's share in it; of the turning the vertical axis.
    """
    pitch, roll = (0.0 if math.isnan(angle) else angle for angle in (fix.pitch, fix.roll))
    turn = 0.0 if math.isnan(fix.heading_sigma) else fix.heading_sigma
    levels = [0.0 if math.isfinite(angle) else UNKNOWN_VARIANCE for angle in (fix.roll, fix.pitch)]
    unmeasured = [UNKNOWN_VARIANCE, UNKNOWN_VARIANCE]
    return make(
        "sensor_msgs/msg/Imu",
        header_of(at, BASE),
        _quaternion(fix.heading, -pitch, roll),
        np.diag([*levels, turn**2]).ravel(),
        vector_of(z=fix.yaw_rate),
        np.diag([*unmeasured, 0.0]).ravel(),
        vector_of(fix.acceleration),
        np.diag([0.0, *unmeasured]).ravel(),
    )


def markers(at: int, actors: Actors) -> Any:
    """Return visualization_msgs/MarkerArray of the bodies' boxes in `map`, after one that takes the former away.

    The namespace of a box is the body's name, its text the kind.
    """
    columns = (actors.x, actors.y, actors.heading, actors.length, actors.width, actors.height, actors.kind)
    rows = zip(actors.ids, *(column.tolist() for column in columns), strict=True)
    boxes = [_box(at, name, x, y, heading, (length, width, height), kind)
             for name, x, y, heading, length, width, height, kind in rows]  # fmt: skip
    former = _marker(at, "", CUBE, DELETE_ALL, pose_of(0.0, 0.0, 0.0), (0.0, 0.0, 0.0), WHITE, "")
    return make("visualization_msgs/msg/MarkerArray", [former, *boxes])


def path(at: int, line: ReferencePath) -> Any:
    """Return nav_msgs/Path of the line that the rear axle shall follow, a pose every PATH_STEP along it, in `map`."""
    places = (line.at(s) for s in (*np.arange(0.0, line.length, PATH_STEP).tolist(), line.length))
    header = header_of(at, MAP)
    poses = [
        make("geometry_msgs/msg/PoseStamped", header, pose_of(place.x, place.y, place.heading)) for place in places
    ]
    return make("nav_msgs/msg/Path", header, poses)


def diagnostics(at: int, level: int, message: str, values: Mapping[str, str]) -> Any:
    """Return diagnostic_msgs/DiagnosticArray with the one status `vve_sumo: drive`."""
    pairs = [make("diagnostic_msgs/msg/KeyValue", key, value) for key, value in values.items()]
    status = make("diagnostic_msgs/msg/DiagnosticStatus", level, "vve_sumo: drive", message, "vve_sumo", pairs)
    return make("diagnostic_msgs/msg/DiagnosticArray", header_of(at, ""), [status])


def drive_status(at: int, state: str, reasons: Sequence[str], *, valid: bool, gap: float) -> Any:
    """Return the diagnostics of a tick: the gateway's state, the reasons in force, the gap [m], NaN for none.

    `valid` says whether anybody may drive by the tick.
    """
    level = OK if valid else ERROR
    values = {
        "state": state,
        "reasons": "+".join(reasons),
        "valid": str(valid).lower(),
        "gap_m": f"{gap:.3f}" if math.isfinite(gap) else "",
    }
    return diagnostics(at, level, state or ("valid" if valid else "invalid"), values)


def header_of(at: int, frame: str) -> Any:
    """Return std_msgs/Header of a Unix time [ns]."""
    return make("std_msgs/msg/Header", stamp(at), frame)


def vector_of(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Any:
    """Return geometry_msgs/Vector3."""
    return make("geometry_msgs/msg/Vector3", x, y, z)


def _quaternion(yaw: float, pitch: float = 0.0, roll: float = 0.0) -> Any:
    """Return the turn by yaw about z, then pitch about the new y, then roll about the new x [rad]."""
    (cy, sy), (cp, sp), (cr, sr) = ((math.cos(0.5 * a), math.sin(0.5 * a)) for a in (yaw, pitch, roll))
    return make(
        "geometry_msgs/msg/Quaternion",
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def pose_of(x: float, y: float, heading: float, z: float = 0.0) -> Any:
    """Return geometry_msgs/Pose of a place [m] and a turn about the vertical [rad]."""
    return make("geometry_msgs/msg/Pose", make("geometry_msgs/msg/Point", x, y, z), _quaternion(heading))


def _transform(at: int, parent: str, child: str, x: float, y: float, yaw: float, z: float = 0.0) -> Any:
    moved = make("geometry_msgs/msg/Transform", vector_of(x, y, z), _quaternion(yaw))
    return make("geometry_msgs/msg/TransformStamped", header_of(at, parent), child, moved)


def _diagonal(*sigmas: float | None) -> Floats:
    """Return a covariance of 6 by 6 from standard deviations; None is an axis that is not measured, NaN counts as 0."""
    known = [UNKNOWN_VARIANCE if s is None else 0.0 if math.isnan(s) else s * s for s in sigmas]
    return np.diag(known).ravel()


def _box(at: int, name: str, x: float, y: float, heading: float, size: Sequence[float], kind: int) -> Any:
    what = BODY_KINDS[kind]
    colour = PERSON if what in ("pedestrian", "child") else OTHER
    return _marker(at, name, CUBE, ADD, pose_of(x, y, heading, 0.5 * size[2]), size, colour, what)


def _marker(
    at: int, name: str, kind: int, action: int, pose: Any, size: Sequence[float], colour: Sequence[float], text: str
) -> Any:
    nothing, unsized = make("builtin_interfaces/msg/Duration", 0, 0), np.zeros(0, np.uint8)
    picture = make("sensor_msgs/msg/CompressedImage", header_of(0, ""), "", unsized)
    mesh = make("visualization_msgs/msg/MeshFile", "", unsized)
    return make(
        "visualization_msgs/msg/Marker",
        header_of(at, MAP),
        name,
        0,
        kind,
        action,
        pose,
        vector_of(*size),
        make("std_msgs/msg/ColorRGBA", *colour),
        nothing,
        False,
        [],
        [],
        "",
        picture,
        [],
        text,
        "",
        mesh,
        False,
    )
