"""Stops of whole records: where they are, what was ahead, how they felt."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.analysis import made
from tests.metrics.test_stopping import Columns, braked
from vve_sumo import laws
from vve_sumo.analysis.braking import Stop, comfort, stop_of
from vve_sumo.analysis.run import Run
from vve_sumo.values import Floats

A, V, RISE = 4.0, 12.0, 0.5
START_S = 100.0


def record(folder: Path, columns: Columns, **changes: Any) -> Path:
    """A record of a car that brakes on the path from START_S on, and of a car that stands in its way at 180 m."""
    granted, speed, acceleration = columns
    time = made.PERIOD * np.arange(len(speed))
    x = START_S + np.concatenate(([0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * made.PERIOD)))
    rows = [
        row | {"granted_acceleration_mps2": g, "true_acceleration_mps2": a, "state": "engaged"}
        for row, g, a in zip(made.moving(time, x, speed), granted.tolist(), acceleration.tolist(), strict=True)
    ]
    made.write(folder, rows, **changes)
    made.put(folder, "actors", [made.BOX | {"tick": i, "actor": "parked", "x_m": 180.0} for i in range(len(rows))])
    return folder


def stop_in(run: Run) -> Stop:
    stop = stop_of(run)
    assert stop is not None
    return stop


def test_a_stop_has_its_times_and_the_gap_that_was_left(tmp_path: Path) -> None:
    run = Run(record(tmp_path / "record", braked(V, A, 0.1, RISE)))
    stop = stop_in(run)
    way = V * 1.0 + laws.stopping_distance(V, A, 0.1, RISE)
    gap = 180.0 - made.BOX["length_m"] / 2.0 - (START_S + way + run.vehicle.rear_axle_to_bumper)
    assert (stop.onset_s, stop.onset_speed, stop.demand) == pytest.approx((1.0, V, A))
    assert stop.rest_s == pytest.approx(1.0 + laws.stopping_time(V, A, 0.1, RISE), abs=made.PERIOD)
    assert stop.gap == pytest.approx(gap, abs=5e-3)
    assert stop.margin(5.0) == stop.gap - 5.0
    assert stop.margin() == stop.gap


def brute_jerk(acceleration: Floats, first: int, last: int) -> list[float]:
    """Slope of the best line through each tick's neighbourhood of ±0.1 s."""
    times = made.PERIOD * np.arange(-5, 6)
    return [float(np.polyfit(times, acceleration[i - 5 : i + 6], 1)[0]) for i in range(first, last + 1)]


def test_comfort_is_that_of_the_stop_and_of_its_jolt(tmp_path: Path) -> None:
    columns = braked(V, A, 0.1, RISE)
    run = Run(record(tmp_path / "record", columns))
    stop = stop_in(run)
    felt = comfort(run, stop)
    jerk = brute_jerk(columns[2], stop.onset, stop.rest + 5)
    assert felt.max_jerk_mps3 == pytest.approx(max(map(abs, jerk)))
    assert felt.max_jerk_mps3 > 2.0 * A / RISE  # of the jolt, which is no ramp
    assert felt.rms_jerk_mps3 == pytest.approx(np.sqrt(np.mean(np.square(jerk))))
    assert felt.max_deceleration_mps2 == pytest.approx(A)
    assert felt.mean_deceleration_mps2 == pytest.approx(A)
    assert felt.rms_acceleration_mps2 == pytest.approx(np.sqrt(np.mean(columns[2][stop.onset : stop.rest + 6] ** 2)))


def test_a_short_stop_is_averaged_with_what_lies_around_it(tmp_path: Path) -> None:
    run = Run(record(tmp_path / "record", braked(4.0, 8.0, lead_in=3.0)))
    assert comfort(run, stop_in(run)).mean_deceleration_mps2 == pytest.approx(2.0)


def test_a_drive_that_ends_before_its_rest_has_no_stop(tmp_path: Path) -> None:
    granted, speed, acceleration = braked(V, A)
    assert stop_of(Run(record(tmp_path / "record", (granted[:100], speed[:100], acceleration[:100])))) is None
