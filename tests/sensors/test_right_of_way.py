"""What the sense of right of way says is what the street's junctions say."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.sensors.scenes import BUMPER, FUSION, actors, rear_axle
from vve_sumo.junctions import Junction
from vve_sumo.sensors.guarded import GuardedSensor
from vve_sumo.sensors.port import configured
from vve_sumo.sensors.street import Street
from vve_sumo.values import RightOfWay
from vve_sumo.world.junctions import junctions

STOP = (220.0, 150.0)  #: the middle of the junction with stop signs, by the network file


@pytest.fixture(scope="module")
def street(repository: Path) -> tuple[Junction, ...]:
    return junctions(repository / "networks" / "side_streets.net.xml", (-1e6, -1e6, 1e6, 1e6))


def sensor(street: tuple[Junction, ...], **settings: float) -> GuardedSensor:
    kind = configured("right_of_way", settings)
    return GuardedSensor("mine", kind, FUSION, np.random.default_rng(1), Street(junctions=street))


def output(one: GuardedSensor) -> RightOfWay:
    assert isinstance(one.output, RightOfWay)
    return one.output


def test_its_rows_are_the_junctions_ways_in_range(street: tuple[Junction, ...]) -> None:
    mine = sensor(street, range_m=60.0)
    columns = mine.step(0.0, rear_axle(221.75, 100.0, 0.5 * math.pi), actors([]))
    assert mine.faults == (), mine.text
    said, (stop,) = output(mine), [one for one in street if one.id == "stop"]
    assert set(said.junction.tolist()) == {street.index(stop)}
    assert said.control.tolist() == [way.control for way in stop.ways]
    pairs = [(row, prior) for row, way in enumerate(stop.ways) for prior in way.prior]
    assert list(zip(said.own.tolist(), said.prior.tolist(), strict=True)) == pairs
    for row, way in enumerate(stop.ways):
        points = slice(int(said.first[row]), int(said.first[row + 1]))
        assert list(zip(said.x[points].tolist(), said.y[points].tolist(), strict=True)) == list(way.points)
    # The rows of the record: the three ways from the lane that the car is on.
    assert columns is not None
    ids, _way, control, ahead, left, heading, prior = columns
    assert list(ids) == ["stop"] * 3
    assert control.tolist() == [2, 2, 2]
    assert ahead.tolist() == pytest.approx([138.9 - 100.0 - BUMPER] * 3, abs=0.02)
    assert left.tolist() == pytest.approx([0.0] * 3, abs=0.01)
    assert heading.tolist() == pytest.approx([0.0] * 3, abs=1e-6)
    assert sorted(prior.tolist()) == [1, 5, 6]


def test_far_junctions_are_not_known_and_an_empty_street_is_no_fault(street: tuple[Junction, ...]) -> None:
    far, empty = sensor(street, range_m=30.0), sensor(())
    for mine in (far, empty):
        columns = mine.step(0.0, rear_axle(221.75, 60.0, 0.5 * math.pi), actors([]))
        assert mine.faults == (), mine.text
        assert columns is not None
        assert len(columns[0]) == len(output(mine).junction) == len(output(mine).own) == 0


def test_its_arrays_stay_the_same_while_the_car_is_among_the_same_junctions(street: tuple[Junction, ...]) -> None:
    mine, before = sensor(street), None
    for tick in range(50):
        mine.step(0.02 * tick, rear_axle(221.75, 100.0 + 0.1 * tick, 0.5 * math.pi), actors([]))
        assert before is None or output(mine).x is before.x
        before = output(mine)
    assert before is not None
    assert before.time == pytest.approx(0.8)
