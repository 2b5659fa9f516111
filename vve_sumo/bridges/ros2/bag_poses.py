"""A bag of ROS as a pose recording: NavSatFix for the places, Imu for the heading, Odometry for the speed where it is.

Bags of rosbag2 (a folder with SQLite or MCAP files, or one MCAP file) and of ROS 1 are read, by `rosbags` alone. It
writes the CSV that `vve-sumo drive --pose` plays.
"""

from __future__ import annotations

import bisect
import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from vve_sumo.errors import ConfigError

COLUMNS: Final = ("time_s", "latitude_deg", "longitude_deg", "altitude_m", "heading_deg", "speed_mps")
#: a heading or speed belongs to a fix that is no farther away in time [s]
NEAR: Final = 0.1
#: radius of the earth, for the speed between fixes where no odometry says it [m]
EARTH: Final = 6_371_000.0
TYPES: Final = {"fix": "sensor_msgs/msg/NavSatFix", "imu": "sensor_msgs/msg/Imu", "odom": "nav_msgs/msg/Odometry"}


@dataclass(frozen=True, slots=True)
class BagPoses:
    """What was read of a bag."""

    rows: int  #: fixes that were written
    left_out: int  #: fixes without a position, or without a heading near
    topics: dict[str, str]  #: topic that was read, by the key of TYPES


class _Fix(NamedTuple):
    time: float  # of its stamp [s since 1970]
    latitude: float  # [deg]
    longitude: float  # [deg]
    altitude: float  # [m]


def write_csv(bag: Path, out: Path, chosen: Mapping[str, str | None]) -> BagPoses:
    """Write the fixes of a bag as CSV; return what was read.

    `chosen` names the topics by the keys of TYPES; None is the only one of its type. Raises ConfigError in one line for
    what is no bag, for a topic that is missing or one of several, and where no fix has a heading.
    """
    fixes, headings, speeds, topics = _read(bag, chosen)
    rows = [*_rows(fixes, headings, speeds)]
    if not rows:
        raise ConfigError(f"{bag}: no fix of {topics['fix']} has a heading of {topics['imu']} within {NEAR:g} s")
    try:
        with out.open("x", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(COLUMNS)
            writer.writerows(rows)
    except FileExistsError:
        raise ConfigError(f"{out}: there already; choose another place with --csv") from None
    return BagPoses(len(rows), len(fixes) - len(rows), topics)


def _read(
    bag: Path, chosen: Mapping[str, str | None]
) -> tuple[list[_Fix], list[tuple[float, float]], list[tuple[float, float]], dict[str, str]]:
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ConfigError("a bag needs rosbags: pip install 'vve-sumo[ros2]'") from None
    fixes: list[_Fix] = []
    headings: list[tuple[float, float]] = []
    speeds: list[tuple[float, float]] = []
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_KILTED)) as reader:
            topics = _topics(bag, [(one.topic, one.msgtype) for one in reader.connections], chosen)
            wanted = [one for one in reader.connections if one.topic in topics.values()]
            for connection, _at, data in reader.messages(wanted):
                message: Any = reader.deserialize(data, connection.msgtype)
                if connection.topic == topics["fix"]:
                    fixes += _fix(message)
                elif connection.topic == topics["imu"]:
                    headings += _heading(message)
                else:
                    speeds += [(_time(message), message.twist.twist.linear.x)]
    except ConfigError:
        raise
    except FileNotFoundError:
        raise ConfigError(f"{bag}: no such bag") from None
    except (AnyReaderError, OSError, ValueError, KeyError, AssertionError) as error:
        raise ConfigError(f"{bag}: is no bag that can be read ({_line_of(error)})") from None
    return sorted(fixes), sorted(headings), sorted(speeds), topics


def _topics(bag: Path, found: Sequence[tuple[str, str]], chosen: Mapping[str, str | None]) -> dict[str, str]:
    topics: dict[str, str] = {}
    for key, kind in TYPES.items():
        of_kind = sorted({topic for topic, one in found if one == kind})
        named = chosen.get(key)
        if named is not None and named not in of_kind:
            raise ConfigError(f"{bag}: no topic {named} of {kind}; there are {', '.join(of_kind) or 'none'}")
        if named is None and len(of_kind) > 1:
            raise ConfigError(f"{bag}: {kind} is on {', '.join(of_kind)}; choose one with --{key}")
        if named is None and not of_kind:
            if key == "odom":
                continue
            raise ConfigError(f"{bag}: no topic of {kind}")
        topics[key] = named or of_kind[0]
    return topics


def _time(message: Any) -> float:
    return float(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)


def _fix(message: Any) -> Iterator[_Fix]:
    """Yield the fix of a message that has a position."""
    numbers = (message.latitude, message.longitude)
    if message.status.status >= 0 and all(map(math.isfinite, numbers)):
        yield _Fix(_time(message), *numbers, message.altitude)


def _heading(message: Any) -> Iterator[tuple[float, float]]:
    """Yield time and heading [rad, counter-clockwise from east] of a message that has an orientation."""
    turn = message.orientation
    norm = turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2
    if message.orientation_covariance[0] != -1.0 and math.isfinite(norm) and abs(norm - 1.0) < 0.01:
        yield _time(message), math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))


def _rows(
    fixes: Sequence[_Fix], headings: Sequence[tuple[float, float]], speeds: Sequence[tuple[float, float]]
) -> Iterator[tuple[str, ...]]:
    """Yield the cells of each fix that has a heading; times are GNSS' rate with Unix time's zero."""
    before: _Fix | None = None
    for fix in fixes:
        heading = _nearest(headings, fix.time)
        speed = _nearest(speeds, fix.time) if speeds else _along(before, fix, heading)
        if before is not None and fix.time <= before.time:
            continue
        before = fix
        if heading is None or speed is None or not math.isfinite(speed):
            continue
        clockwise = (90.0 - math.degrees(heading)) % 360.0
        altitude = f"{fix.altitude:.3f}" if math.isfinite(fix.altitude) else ""
        yield (
            f"{fix.time:.6f}",
            f"{fix.latitude:.10f}",
            f"{fix.longitude:.10f}",
            altitude,
            f"{clockwise:.6f}",
            f"{speed:.4f}",
        )


def _nearest(found: Sequence[tuple[float, float]], time: float) -> float | None:
    at = bisect.bisect_left(found, (time, -math.inf))
    near = [one for one in found[max(at - 1, 0) : at + 1] if abs(one[0] - time) <= NEAR]
    return min(near, key=lambda one: abs(one[0] - time))[1] if near else None


def _along(before: _Fix | None, fix: _Fix, heading: float | None) -> float | None:
    """Return the speed along the heading from the fix before [m/s]."""
    if before is None or heading is None or fix.time <= before.time:
        return None
    north = EARTH * math.radians(fix.latitude - before.latitude)
    east = EARTH * math.cos(math.radians(fix.latitude)) * math.radians(fix.longitude - before.longitude)
    return (east * math.cos(heading) + north * math.sin(heading)) / (fix.time - before.time)


def _line_of(error: Exception) -> str:
    lines = str(error).splitlines()
    return lines[0] if lines else type(error).__name__
