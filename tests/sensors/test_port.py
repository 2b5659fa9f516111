"""What any sensor must hold to, asked of each that is registered."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from vve_sumo.sensors.registry import SENSORS, SensorKind

from tests.sensors.scenes import FUSION, actors, car, rear_axle
from vve_sumo.scenario.schema import Scenario
from vve_sumo.sensors.port import Sensor

KINDS = {"float": np.float64, "int8": np.int8}
SCENE = actors([car(30.0, 0.0), car(18.0, 3.5, speed=4.0), car(60.0, -3.5)])


@pytest.fixture(params=sorted(SENSORS))
def kind(request: pytest.FixtureRequest) -> SensorKind:
    return SENSORS[request.param]


@pytest.fixture
def sensor(kind: SensorKind) -> Sensor:
    return kind.make(kind.settings(), FUSION, np.random.default_rng(1))


@pytest.mark.parametrize("name", SENSORS)
def test_a_scenario_has_a_table_of_its_name(name: str) -> None:
    assert Scenario.model_fields[name].annotation is SENSORS[name].settings
    assert Scenario.model_fields[name].default == SENSORS[name].settings()


def test_before_the_first_reading_the_output_is_empty_and_old(sensor: Sensor) -> None:
    assert sensor.output.time == -math.inf


def test_readings_are_dated_rows_of_the_table_and_outputs_stay_between_them(kind: SensorKind, sensor: Sensor) -> None:
    readings, before = 0, sensor.output
    for tick in range(100):
        now = 0.02 * tick
        reading = sensor.step(now, rear_axle(), SCENE)
        assert sensor.refused == 0
        if reading is None:
            assert sensor.output is before
            continue
        assert before.time < sensor.output.time <= now
        before, readings = sensor.output, readings + 1
        columns = reading.columns()
        assert len({len(column) for column in columns}) == 1
        for column, (_name, spelt, _meaning) in zip(columns, kind.table.columns, strict=True):
            assert (
                np.asarray(column).dtype == KINDS[spelt] if spelt in KINDS else all(isinstance(x, str) for x in column)
            )
    assert readings > 10


def test_the_same_chance_measures_the_same(kind: SensorKind) -> None:
    one, two = (kind.make(kind.settings(), FUSION, np.random.default_rng(5)) for _ in range(2))
    for tick in range(50):
        seen = [sensor.step(0.02 * tick, rear_axle(), SCENE) for sensor in (one, two)]
        columns = [None if reading is None else list(map(list, reading.columns())) for reading in seen]
        assert columns[0] == columns[1]


def test_an_actor_that_is_no_number_is_counted(sensor: Sensor) -> None:
    broken = replace(SCENE, x=np.array([math.nan, 18.0, 60.0]))
    assert max((sensor.step(0.02 * tick, rear_axle(), broken), sensor.refused)[1] for tick in range(10)) == 1
