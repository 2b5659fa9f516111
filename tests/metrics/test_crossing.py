"""Crossings made by hand, with times that can be read off; oblique ones against shapely's areas."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from tests.test_geometry import bodies
from vve_sumo.geometry import Boxes
from vve_sumo.metrics.crossing import encroachment, time_to_collision_zone

PERIOD = 0.02
TIME = np.arange(0.0, 12.0, PERIOD)


def car(passes: float, speed: float = 10.0) -> Boxes:
    """A car of 4 m by 2 m along x that has its middle at the origin at this time [s]."""
    return straight(passes, speed, 0.0, 4.0, 2.0)


def walker(passes: float, speed: float = 2.0) -> Boxes:
    """Somebody of 0.5 m by 0.5 m along y, likewise."""
    return straight(passes, speed, math.pi / 2, 0.5, 0.5)


def straight(passes: float, speed: float, heading: float, length: float, width: float) -> Boxes:
    way = speed * (TIME - passes)
    same = np.ones_like(TIME)
    columns = (way * math.cos(heading), way * math.sin(heading), heading * same, length * same, width * same)
    return Boxes(*columns, speed * same)


def test_the_car_passes_and_then_the_walker() -> None:
    """The area is 0.5 m of the car's way and 2 m of the walker's."""
    found = encroachment(TIME, car(3.003), TIME, walker(5.017))
    assert found.one_enters == pytest.approx(3.003 - 0.225, abs=1e-9)
    assert found.one_leaves == pytest.approx(3.003 + 0.225, abs=1e-9)
    assert found.other_enters == pytest.approx(5.017 - 0.625, abs=1e-9)
    assert found.other_leaves == pytest.approx(5.017 + 0.625, abs=1e-9)
    assert found.one_first
    assert found.time == pytest.approx(5.017 - 0.625 - 3.228, abs=1e-9)


def test_the_order_of_the_two_changes_no_time() -> None:
    one, other = car(6.0), walker(4.0)
    there, back = encroachment(TIME, one, TIME, other), encroachment(TIME, other, TIME, one)
    assert not there.one_first
    assert back.one_first
    assert there.time == pytest.approx(6.0 - 0.225 - 4.625, abs=1e-9)
    assert back.time == pytest.approx(there.time, abs=1e-12)


def test_both_in_the_area_at_once_is_negative() -> None:
    found = encroachment(TIME, car(4.0), TIME, walker(4.3))
    assert not found.one_first
    assert found.time == pytest.approx((4.0 - 0.225) - (4.3 + 0.625), abs=1e-9)
    assert found.time < 0.0


def test_no_common_area_an_endless_stay_and_instants_that_nobody_knows() -> None:
    beside = walker(4.0)._replace(x=np.full_like(TIME, 500.0))
    assert math.isnan(encroachment(TIME, car(4.0), TIME, beside).time)
    rests = car(3.0)._replace(x=np.minimum(car(3.0).x, -1.0))
    found = encroachment(TIME, rests, TIME, walker(8.0))
    assert math.isnan(found.one_leaves)
    assert math.isnan(found.time)
    assert found.other_enters == pytest.approx(8.0 - 0.625, abs=1e-9)
    late = car(3.0)
    late.x[:50] = math.nan
    assert encroachment(TIME, late, TIME, walker(5.0)).time == pytest.approx(5.0 - 0.625 - 3.225, abs=1e-9)


def test_oblique_ways_are_in_the_area_when_shapely_says_so() -> None:
    """To a tick: the area as the intersection of the unions of all places."""
    one, other = car(4.0, 6.0), straight(5.5, 3.0, 2.2, 1.0, 0.6)
    mine, theirs = bodies(one, np.zeros_like(TIME)), bodies(other, np.zeros_like(TIME))
    area = shapely.union_all(mine).intersection(shapely.union_all(theirs))
    found = encroachment(TIME, one, TIME, other)
    for enters, leaves, body in ((*found[:2], mine), (*found[2:], theirs)):
        inside = TIME[shapely.intersects(body, area)]
        assert inside[0] - PERIOD <= enters <= inside[0]
        assert inside[-1] <= leaves <= inside[-1] + PERIOD


def test_times_to_the_zone_of_a_right_angle() -> None:
    """At each instant: the way to the other's lane over the speed; past it the zone is never reached again."""
    found = time_to_collision_zone(car(3.0), walker(5.0))
    before = TIME < 2.0
    np.testing.assert_allclose(found.one_reaches[before], 3.0 - 0.225 - TIME[before], atol=1e-9)
    np.testing.assert_allclose(found.one_leaves[before], 3.0 + 0.225 - TIME[before], atol=1e-9)
    np.testing.assert_allclose(found.other_reaches[before], 5.0 - 0.625 - TIME[before], atol=1e-9)
    np.testing.assert_allclose(found.difference[before], -1.6, atol=1e-9)
    inside, past = round(3.1 / PERIOD), round(3.3 / PERIOD)
    assert found.one_reaches[inside] == 0.0
    assert found.one_leaves[inside] == pytest.approx(0.125, abs=1e-9)
    assert math.isinf(found.one_reaches[past])
    assert math.isinf(found.one_leaves[past])
    assert found.difference[past] == math.inf
    assert math.isnan(found.difference[-1])


def test_who_stands_reaches_no_zone_and_leaves_none() -> None:
    away = walker(3.0, 0.0)._replace(y=np.full_like(TIME, -5.0))
    found = time_to_collision_zone(car(3.0), away)
    assert np.isinf(found.other_reaches).all()
    found = time_to_collision_zone(car(3.0), walker(3.0, 0.0))
    assert (found.other_reaches == 0.0).all()
    assert np.isinf(found.other_leaves).all()
    unknown = walker(3.0)._replace(speed=np.full_like(TIME, math.nan))
    assert np.isnan(time_to_collision_zone(car(3.0), unknown).other_reaches).all()


def test_oblique_lanes_are_touched_when_shapely_says_so() -> None:
    random = np.random.default_rng(3)
    for _ in range(40):
        angle, way = random.uniform(0.3, 2.8), random.uniform(40.0, 60.0)
        one = Boxes(*(np.array(value) for value in (-way, 0.5, 0.1, 4.0, 2.0, 8.0)))
        other = Boxes(*(np.array(value) for value in (3.0, random.uniform(-9.0, 9.0), angle, 1.0, 0.7, 1.5)))
        found = time_to_collision_zone(one, other)
        lane = bodies(other._replace(length=np.array(1000.0)), np.array(0.0))
        for time in (found.one_reaches, found.one_leaves):
            body = bodies(one, time)
            assert shapely.distance(body, lane) < 1e-9
            assert shapely.intersection(body, lane).area < 1e-6
        assert shapely.intersects(bodies(one, 0.5 * (found.one_reaches + found.one_leaves)), lane)
