"""Shows the gateway's plausibility checks what real cars' sensors said of sound drives, and counts what they object to.

Usage: python -m benchmarks.false_alarms_recorded [FOLDER] [--smoke], where FOLDER holds the tidied recordings of
comma2k19, Boreas and a Ford Fusion; without one, those beside this checkout. It takes seconds, so `--smoke`
leaves nothing out. Prints; changes nothing.

What tests what: a check is only put to the test where its two sides come from different sensors.
* comma2k19, a minute: speed by the wheels and angle of the steering wheel against poses of satellites, camera and
  inertial sensors. There is no gyroscope on file, so the yaw rate is that of the poses' course: the heading is compared
  with itself, and the position's test is that of the way along.
* Boreas, 17 minutes with its stops: both pose files are samples of one solution of satellites, wheels and inertial
  sensors, so nothing in it is independent: speed and yaw rate of one file against positions and headings of the other
  test dead reckoning, its windows and its model, and not the sensors.
* Ford Fusion, 26 s: gyroscope against steering, wheels for the speed; there are no poses.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from tests.conftest import SHARED_DATA
from vve_sumo.values import Setpoint, Vehicle
from vve_sumo.vehicle.load import load
from vve_sumo.vehicle.plausibility import CarMotion, Plausibility
from vve_sumo.workspace import shipped_root

Floats = NDArray[np.float64]

FUSION = load(shipped_root() / "vehicles" / "ford_fusion.toml")

PERIOD = 0.02  # of the gateway [s]
STANDING = 0.05  # [m/s]
RAV4_WHEELBASE = 2.66  # [m]
FUSION_LOGS = ("car_50km", "car_60km", "collision_assist_activated", "lkast_activated")


@dataclass(frozen=True)
class Recorded:
    """A drive at the gateway's steps; NaN where nobody measured."""

    name: str
    vehicle: Vehicle
    speed: Floats  #: by the wheels [m/s]
    wheels: list[tuple[float, ...]]  #: as reported, to tell frozen ones
    yaw_rate: Floats  #: [rad/s]
    steering: Floats  #: road-wheel angle [rad]
    pose: tuple[Floats, Floats, Floats, Floats, Floats] | None  #: x, y, heading, speed, yaw rate


def smooth_slope(times: Floats, values: Floats, width: int) -> Floats:
    """Slope of a straight line through `width` samples around each."""
    kernel = np.arange(width) - (width - 1) / 2.0
    step = float(np.median(np.diff(times)))
    return np.convolve(values, kernel[::-1] / (step * (kernel**2).sum()), "same")


def newest(at: Floats, times: Floats, values: Floats) -> Floats:
    """The value last said."""
    return values[np.clip(np.searchsorted(times, at, "right") - 1, 0, len(values) - 1)]


def fitted(steering_wheel: Floats, speed: Floats, yaw_rate: Floats, vehicle: Vehicle) -> Floats:
    """Road-wheel angle: ratio and offset are those that fit the drive best, as a calibration has them."""
    wanted = yaw_rate / speed * (vehicle.wheelbase + vehicle.understeer_gradient * speed * speed)
    ratio, offset = np.polyfit(steering_wheel, wanted, 1)
    return ratio * steering_wheel + offset


def comma2k19(folder: Path) -> Recorded:
    """A Toyota RAV4 in town, 8 to 20 m/s."""
    can = pd.read_csv(folder / "comma2k19" / "tidy_can_83hz.csv")
    pose = pd.read_csv(folder / "comma2k19" / "tidy_pose_20hz.csv")
    speeds, angles = can.dropna(subset=["speed"]), can.dropna(subset=["steer_deg"])
    times = pose["t"].to_numpy()
    at = np.arange(times[0] + 0.5, times[-1] - 0.5, PERIOD)
    heading = np.unwrap(np.pi / 2.0 - np.radians(pose["course_deg"].to_numpy()))
    yaw_rate = np.interp(at, times, smooth_slope(times, heading, 5))
    ground = np.hypot(pose["ve"].to_numpy(), pose["vn"].to_numpy())
    ground_at = np.interp(at, times, ground)
    said = newest(at, speeds["t"].to_numpy(), speeds["speed"].to_numpy())
    speed = said * float(np.median(ground_at / said))
    vehicle = replace(FUSION.vehicle, wheelbase=RAV4_WHEELBASE, front_axle_to_mass=1.2)
    wheel = np.radians(newest(at, angles["t"].to_numpy(), angles["steer_deg"].to_numpy()))
    place = [np.interp(at, times, pose[name].to_numpy()) for name in ("east", "north")]
    return Recorded(
        "comma2k19 (RAV4)",
        vehicle,
        speed,
        [(one,) for one in said],
        yaw_rate,
        fitted(wheel, speed, yaw_rate, vehicle),
        (place[0], place[1], np.interp(at, times, heading), ground_at, yaw_rate),
    )


def boreas(folder: Path) -> Recorded:
    """A car in a suburb with its stops, 0 to 17 m/s."""
    name = "boreas-2021-09-02-11-42_{}_poses.csv"
    lidar, radar = (pd.read_csv(folder / "boreas" / name.format(kind)) for kind in ("lidar", "radar"))
    begun = max(lidar["GPSTime"][0], radar["GPSTime"][0])
    times, other = ((file["GPSTime"].to_numpy() - begun) / 1e6 for file in (lidar, radar))
    at = np.arange(1.0, min(times[-1], other[-1]) - 1.0, PERIOD)
    heading = np.unwrap(0.8164 - lidar["heading"].to_numpy())
    east, north = lidar["vel_east"].to_numpy(), lidar["vel_north"].to_numpy()
    ahead = east * np.cos(heading) + north * np.sin(heading)
    left = north * np.cos(heading) - east * np.sin(heading)
    turning = smooth_slope(times, heading, 3)
    bending = np.abs(turning) > 0.1
    lever = float(np.polyfit(turning[bending], left[bending], 1)[0])  # of the solution's point ahead of the rear axle
    course = np.unwrap(radar["heading"].to_numpy())
    x, y = (radar[axis].to_numpy() - radar[axis][0] for axis in ("easting", "northing"))
    rear_x, rear_y = x - lever * np.cos(course), y - lever * np.sin(course)
    yaw_rate = np.interp(at, times, turning)
    place = [CubicSpline(other, values) for values in (rear_x, rear_y, course)]
    return Recorded(
        f"Boreas (lever {lever:.2f} m)",
        FUSION.vehicle,
        np.interp(at, times, ahead),
        [(one,) for one in at],  # nobody counted wheels
        yaw_rate,
        np.full(len(at), math.nan),
        (place[0](at), place[1](at), place[2](at), np.interp(at, times, ahead), place[2](at, 1)),
    )


def ford_fusion(folder: Path, log: str) -> Recorded:
    """The car of the plant's numbers, on straight roads and in a slight bend."""
    data = pd.read_csv(folder / "ford_fusion" / f"tidy_{log}.csv")
    times = data["t"].to_numpy()
    at = np.arange(times[0], times[-1], PERIOD)
    names = ("wheel_fl_radps", "wheel_fr_radps", "wheel_rl_radps", "wheel_rr_radps")
    wheels = np.stack([newest(at, times, data[name].to_numpy()) for name in names], axis=1)
    vehicle = FUSION.vehicle
    speed = vehicle.wheel_radius * wheels[:, 2:].mean(axis=1)
    yaw_rate = newest(at, times, data["yaw_rate_radps"].to_numpy())
    pinion = np.radians(newest(at, times, data["pinion_deg_rel"].to_numpy()))
    steering = fitted(pinion, speed, yaw_rate, vehicle) if np.ptp(pinion) > 0.05 else np.zeros(len(at))
    return Recorded(f"Ford Fusion, {log}", vehicle, speed, [tuple(row) for row in wheels], yaw_rate, steering, None)


def objections(recorded: Recorded) -> Counter[str]:
    """Steps at which each code was said."""
    checks, found = Plausibility(recorded.vehicle, FUSION.calibration), Counter[str]()
    for step, wheels in enumerate(recorded.wheels):
        now = step * PERIOD
        speed, yaw_rate, angle = (
            float(column[step]) for column in (recorded.speed, recorded.yaw_rate, recorded.steering)
        )
        setpoint = None
        if recorded.pose is not None:
            x, y, heading, ground, turning = (float(column[step]) for column in recorded.pose)
            setpoint = Setpoint(
                angle, 0.0, emergency=False, note="", sequence=step, time=now, expires=now + 0.1, speed=ground,
                yaw_rate=turning, x=x, y=y, heading=heading, grade=0.0, faults=(), fallback_path=None,
            )  # fmt: skip
        # What the wheels were told is not on file; the reported angle stands for it.
        steered = 0.0 if math.isnan(angle) else angle
        car = CarMotion(speed, yaw_rate, steered, wheels, steered, abs(speed) < STANDING)
        for code in checks.step(now, PERIOD, car, setpoint, setpoint is not None):
            if not (code == "steering_mismatch" and math.isnan(angle)):
                found[code] += 1
    return found


def main() -> None:
    """Read, compare, tell."""
    parser = argparse.ArgumentParser(description="what plausibility checks object to in sound drives")
    parser.add_argument("folder", type=Path, nargs="?", default=SHARED_DATA / "drives")
    parser.add_argument("--smoke", action="store_true", help="as without: it takes seconds")
    folder = parser.parse_args().folder
    if not folder.is_dir():
        print(f"skipped: no recordings in {folder}")
        return
    drives = [comma2k19(folder), boreas(folder), *(ford_fusion(folder, log) for log in FUSION_LOGS)]
    for recorded in drives:
        steps = len(recorded.wheels)
        fast = float(np.max(np.abs(recorded.speed)))
        found = objections(recorded)
        said = ", ".join(f"{code} {PERIOD * count:.2f} s" for code, count in sorted(found.items())) or "nothing"
        print(f"{recorded.name}: {steps * PERIOD:.1f} s, to {fast:.1f} m/s: {said}")


if __name__ == "__main__":
    main()
