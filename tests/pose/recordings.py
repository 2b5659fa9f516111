"""Turns two public recordings into the CSV form that the package reads."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import pyproj

HEADER = ("time_s", "latitude_deg", "longitude_deg", "heading_deg", "speed_mps")
BOREAS_COURSE = 0.8164  #: course in ENU = this - heading of the lidar [rad], from the data's own description
STANDING = 0.3  #: below it a course says nothing [m/s]


def _rows(path: Path):
    with path.open(newline="") as file:
        yield from csv.DictReader(file)


def _write(out: Path, rows) -> Path:
    with out.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        writer.writerows(rows)
    return out


def boreas(data: Path, out: Path) -> Path:
    """9.64 Hz poses of a suburban drive (utiasASRL/pyboreas, CC BY 4.0): UTM to degrees, lidar heading to compass.

    Its "ENU" axes are those of the UTM grid: the directions of its velocities and of its position differences agree to
    0.02 deg, where true north would make it the convergence of 1.06 deg. So the convergence is added here.
    """
    utm = pyproj.Proj("+proj=utm +zone=17 +ellps=WGS84 +datum=WGS84 +units=m +no_defs")
    north = utm.get_factors(-79.466, 43.782).meridian_convergence  # the drive stays within 0.03 deg of it

    def rows():
        for row in _rows(data / "drives" / "boreas" / "boreas-2021-09-02-11-42_lidar_poses.csv"):
            longitude, latitude = utm(float(row["easting"]), float(row["northing"]), inverse=True)
            grid = math.degrees(math.pi / 2 - BOREAS_COURSE + float(row["heading"]))
            compass = (grid + north) % 360.0
            speed = math.hypot(float(row["vel_east"]), float(row["vel_north"]))
            yield float(row["GPSTime"]) / 1e6, repr(latitude), repr(longitude), compass, speed

    return _write(out, rows())


def comma2k19(data: Path, out: Path) -> Path:
    """20 Hz poses of a minute at 8 to 20 m/s (commaai/comma2k19, MIT); heading is the course, empty when standing."""

    def rows():
        for row in _rows(data / "drives" / "comma2k19" / "tidy_pose_20hz.csv"):
            speed = math.hypot(float(row["ve"]), float(row["vn"]))
            course = "" if speed < STANDING else float(row["course_deg"]) % 360.0
            yield float(row["gps_tow"]), row["lat"], row["lon"], course, speed

    return _write(out, rows())
