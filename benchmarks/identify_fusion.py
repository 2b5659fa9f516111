"""Identifies the Ford Fusion's numbers from decoded recordings of its bus and prints each with its residual.

Usage: python -m benchmarks.identify_fusion [FOLDER] [--smoke], where FOLDER holds tidy_collision_assist_activated.csv
and tidy_lkast_activated.csv (decoded from repository autti/veloz, branch 20170214); without one, those beside this
checkout. Prints; changes nothing. It takes seconds, so `--smoke` leaves nothing out.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter

from tests.conftest import SHARED_DATA
from vve_sumo.plant.actuators import Lagged
from vve_sumo.plant.car import STEP, chassis
from vve_sumo.plant.dynamics import Dynamics
from vve_sumo.rig.car_parameters import parameters
from vve_sumo.vehicle.load import load
from vve_sumo.workspace import shipped_root

Floats = NDArray[np.float64]

FUSION = load(shipped_root() / "vehicles" / "ford_fusion.toml")

KMH = 1.0 / 3.6
PLATEAU = (3.20, 3.95)  # of the braking: torque within 2 % [s]
BRAKING = (2.42, 4.12)  # [s]
FULL_THROTTLE = ((0.2, 0.6), (0.8, 1.2), (1.4, 1.8))  # [s]
PEDAL_RELEASED, FORCE_GONE = 2.235, 2.433  # half of each [s]; read off the recording
WHEELS = ("wheel_rl_radps", "wheel_rr_radps")  # the rear ones aren't driven


def column(log: pd.DataFrame, name: str) -> Floats:
    return log[name].to_numpy(dtype=float)


def updates(log: pd.DataFrame, name: str) -> tuple[Floats, Floats]:
    """Times and values at which a held column changed."""
    values = column(log, name)
    changed = np.r_[0, np.flatnonzero(np.diff(values)) + 1]
    return column(log, "t")[changed], values[changed]


def slope(times: Floats, values: Floats, window: tuple[float, float]) -> float:
    inside = (times > window[0]) & (times < window[1])
    return float(np.polyfit(times[inside], values[inside], 1)[0])


def mean(log: pd.DataFrame, name: str, window: tuple[float, float]) -> float:
    times = column(log, "t")
    return float(column(log, name)[(times > window[0]) & (times < window[1])].mean())


def wheel_radius(log: pd.DataFrame) -> float:
    rear = sum(column(log, wheel) for wheel in WHEELS) / len(WHEELS)
    return float(np.median(column(log, "v_over_ground_kmh") * KMH / rear))


def brake_delay_and_lag(log: pd.DataFrame) -> tuple[float, float, float]:
    """Dead time and lag [s] from requested to actual torque, and the residual's root mean square [N m]."""
    step = 0.001
    times = np.arange(*BRAKING, step)
    asked_at, asked = updates(log, "brk_tq_req_arb_Nm")
    given_at, given = updates(log, "brk_tq_act_Nm")
    inside = (given_at > BRAKING[0]) & (given_at < BRAKING[1])

    def residual(guess: Floats) -> float:
        share = -math.expm1(-step / max(float(guess[1]), 1e-4))
        delayed = np.interp(times - guess[0], asked_at, asked)
        torque = lfilter([share], [1.0, share - 1.0], delayed)
        return float(np.sqrt(np.mean((np.interp(given_at[inside], times, torque) - given[inside]) ** 2)))

    best = minimize(residual, np.array([0.012, 0.018]), method="Nelder-Mead")
    return float(best.x[0]), float(best.x[1]), float(best.fun)


def steering_gain(log: pd.DataFrame, lag: float, offset: bool) -> tuple[float, float]:
    """Fit yaw rate = gain * speed * pinion angle `lag` seconds earlier; return 1/gain [m] and the residual [rad/s]."""
    times, speed = column(log, "t"), column(log, "v_over_ground_kmh") * KMH
    pinion = np.radians(column(log, "pinion_deg_rel"))
    turned = np.interp(times - lag, times, pinion - pinion[0])
    yaw_rate = column(log, "yaw_rate_radps")
    terms = np.c_[speed * turned, speed] if offset else np.c_[speed * turned]
    solution = np.linalg.lstsq(terms, yaw_rate, rcond=None)[0]
    return 1.0 / float(solution[0]), float(np.sqrt(np.mean((terms @ solution - yaw_rate) ** 2)))


def replay(log: pd.DataFrame, start: float) -> float:
    """Root mean square [m/s] by which the plant's speed differs when the log's pedal and actual torque drive it."""
    times, torque = column(log, "t"), column(log, "brk_tq_act_Nm")
    speed, pedal = column(log, "v_over_ground_kmh") * KMH, column(log, "accel_pedal_pct") * 0.01
    body = parameters(FUSION)
    calibration = body.calibration
    motion = Dynamics(chassis(body), (0.0, 0.0, 0.0), speed=float(np.interp(start, times, speed)))
    engine = Lagged(body.throttle_delay, calibration.drive_lag, STEP)
    for _ in range(1000):
        engine.step(float(np.interp(start, times, pedal)))
    errors = []
    for now in np.arange(start, float(times[-1]), STEP):
        drive = calibration.drive_force(engine.step(float(np.interp(now, times, pedal))), motion.speed)
        brake = calibration.brake_force(float(np.interp(now + 0.5 * STEP, times, torque)))
        motion.advance(STEP, 0.0, drive, brake)
        errors.append(motion.speed - float(np.interp(now + STEP, times, speed)))
    return float(np.sqrt(np.mean(np.square(errors))))


def print_braking(log: pd.DataFrame) -> None:
    times, speed = column(log, "t"), column(log, "v_over_ground_kmh") * KMH
    torque, deceleration = mean(log, "brk_tq_act_Nm", PLATEAU), -slope(times, speed, PLATEAU)
    calibration, middle = FUSION.calibration, mean(log, "v_over_ground_kmh", PLATEAU) * KMH
    drag = calibration.drag(middle) / calibration.mass
    radius = wheel_radius(log)
    print(f"wheel radius {radius:.4f} m (rear axle, braking recording)")
    print(f"plateau      {torque:.0f} N m, {deceleration:.3f} m/s2: gain {torque / deceleration:.1f} kg m")
    print(f"             {torque / (deceleration - drag):.1f} kg m with the assumed drag of {drag:.3f} m/s2 taken out")
    print(f"             mass {torque / deceleration / radius:.0f} kg (gain over radius)")
    delay, lag, residual = brake_delay_and_lag(log)
    print(f"brake        dead time {delay * 1e3:.1f} ms, lag {lag * 1e3:.1f} ms, residual {residual:.0f} N m rms")
    print(f"replay       {replay(log, 2.0):.3f} m/s rms from 2.0 s on, {replay(log, 0.0):.3f} from the start")


def print_throttle(log: pd.DataFrame) -> None:
    times, speed = column(log, "t"), column(log, "v_over_ground_kmh") * KMH
    calibration = FUSION.calibration
    for window in FULL_THROTTLE:
        middle = mean(log, "v_over_ground_kmh", window) * KMH
        force = calibration.mass * slope(times, speed, window) + calibration.drag(middle)
        print(f"full pedal   {middle:.1f} m/s: {force:.0f} N, {force * middle / 1e3:.0f} kW")
    print(f"release      half the force is gone {FORCE_GONE - PEDAL_RELEASED:.2f} s after half the pedal")


def print_steering(log: pd.DataFrame) -> None:
    vehicle = FUSION.vehicle
    speed = float((column(log, "v_over_ground_kmh") * KMH).mean())
    print(f"wheel radius {wheel_radius(log):.4f} m (rear axle, steering recording)")
    for lag, offset in ((0.0, True), (0.1, True), (0.0, False), (0.1, False)):
        length, residual = steering_gain(log, lag, offset)
        gradient = (length / vehicle.steering_ratio - vehicle.wheelbase) / speed**2
        print(
            f"steering     lag {lag:.1f} s, offset {'fitted' if offset else 'from start'}: "
            f"i_s(L + K V^2) {length:.1f} m, K {gradient:+.1e} rad s2/m, residual {residual:.4f} rad/s"
        )
    print(f"             declared K {vehicle.understeer_gradient:+.1e} rad s2/m")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    recordings = SHARED_DATA / "drives" / "ford_fusion"
    parser.add_argument("folder", type=Path, nargs="?", default=recordings, help="where the recordings lie")
    parser.add_argument("--smoke", action="store_true", help="as without: it takes seconds")
    folder = parser.parse_args().folder
    if not folder.is_dir():
        print(f"skipped: no recordings in {folder}")
        return
    braking = pd.read_csv(folder / "tidy_collision_assist_activated.csv")
    print_braking(braking)
    print_throttle(braking)
    print_steering(pd.read_csv(folder / "tidy_lkast_activated.csv"))


if __name__ == "__main__":
    main()
