"""A sensor that works in the slack of the tick: its reading comes out at the next tick, whoever called when."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.sensors.scenes import FUSION, actors, car, rear_axle
from vve_sumo.sensors.guarded import GuardedSensor
from vve_sumo.sensors.lidar import Lidar, LidarScan
from vve_sumo.sensors.port import configured

SCENE = actors([car(20.0, 2.0)])
PERIOD = 0.02


def guarded() -> GuardedSensor:
    return GuardedSensor("roof", configured("lidar", {}), FUSION, np.random.default_rng(1))


def readings(prepares: int) -> list[Any]:
    sensor, found = guarded(), []
    for tick in range(30):
        columns = sensor.step(PERIOD * tick, rear_axle(), SCENE)
        assert sensor.faults == ()
        for _ in range(prepares):
            sensor.prepare()
        found.append((tick, None if columns is None else [list(column) for column in columns], sensor.output.time))
    return found


def test_it_does_not_matter_when_and_how_often_it_was_prepared() -> None:
    once = readings(1)
    assert readings(0) == readings(3) == once
    assert [tick for tick, columns, _ in once if columns is not None] == [6, 11, 16, 21, 26]


def test_the_output_stays_what_it_was_until_the_next_tick() -> None:
    sensor = guarded()
    for tick in range(6):
        sensor.step(PERIOD * tick, rear_axle(), SCENE)
        before = sensor.output
        sensor.prepare()
        assert sensor.output is before
    assert sensor.step(PERIOD * 6, rear_axle(), SCENE) is not None


def test_a_failure_in_the_slack_is_a_fault_of_the_next_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    sensor = guarded()
    sensor.step(0.0, rear_axle(), SCENE)

    def fails(self: Lidar) -> LidarScan:
        raise RuntimeError("out of order")

    monkeypatch.setattr(sensor, "_preparing", lambda: fails(sensor._sensor))  # type: ignore[arg-type]
    sensor.prepare()
    assert sensor.faults == ()
    assert sensor.step(PERIOD, rear_axle(), SCENE) is None
    assert sensor.faults == ("sensor_raised",)
    assert "out of order" in sensor.text


@pytest.mark.parametrize("kind", ["lidar", "camera", "v2x"])
def test_a_pose_that_is_no_number_is_a_fault(kind: str) -> None:
    sensor = GuardedSensor("mine", configured(kind, {}), FUSION, np.random.default_rng(1))
    sensor.step(0.0, rear_axle(x=float("nan")), SCENE)
    assert sensor.faults == ("sensor_raised",)
