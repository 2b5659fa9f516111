"""What a person is told: places by hand in a field that lies turned on the road."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from tests.people.persons import SETUP, report
from vve_sumo.body_kinds import number_of
from vve_sumo.geometry import Box
from vve_sumo.people.person import Person, PersonState
from vve_sumo.people.person_view import MAX_BODIES, PersonView, RoadCar, view_of
from vve_sumo.values import Actors

NOBODY = Actors.none(0.0)


def state(x: float = 10.0) -> PersonState:
    """Somebody who stands x m east of the anchor: at (1000, 2000 + x) on the road."""
    person = Person(SETUP)
    for k in range(10):
        person.receive(k + 0.2, report(float(k), x, 0.0, 0.5))
    return person.step(9.3)


def test_the_car_is_where_the_person_looks_for_it() -> None:
    """On the road it is 40 m to +y of the person and comes towards -y: in the field 40 m east, coming west."""
    car = RoadCar(Box(1000.0, 2050.0, -math.pi / 2, 5.0, 2.0), 10.0)
    view = view_of(SETUP, state(), car, NOBODY)
    assert (view.x, view.y) == pytest.approx((10.0, 0.0), abs=0.01)
    assert view.car is not None
    assert (view.car.body.x, view.car.body.y) == pytest.approx((50.0, 0.0), abs=0.01)
    assert math.cos(view.car.body.heading) == pytest.approx(-1.0)
    assert view.car.gap == pytest.approx(37.5, abs=0.01)
    assert view.car.arrives == pytest.approx(3.75, abs=0.01)


@pytest.mark.parametrize(("heading", "speed"), [(math.pi / 2, 10.0), (-math.pi / 2, 0.0), (0.0, 10.0)])
def test_a_car_that_does_not_come_nearer_does_not_arrive(heading: float, speed: float) -> None:
    view = view_of(SETUP, state(), RoadCar(Box(1000.0, 2050.0, heading, 5.0, 2.0), speed), NOBODY)
    assert view.car is not None
    assert view.car.arrives is None


def crowd(count: int) -> Actors:
    """Buses every 5 m to +y of the person, and the person's own body."""
    y = np.array([2010.0, *(2010.0 + 5.0 * k for k in range(1, count + 1))])
    ones = np.ones(count + 1)
    kind = np.full(count + 1, number_of("bus"), np.int8)
    ids = ("anna", *(f"bus.{k}" for k in range(count)))
    return Actors(
        0.0, ids, 1000.0 * ones, y, 0.0 * ones, 0.0 * ones, 12.0 * ones, 2.5 * ones, ones, 0.0 * ones, ones, kind
    )


def test_the_nearest_bodies_are_shown_without_the_persons_own() -> None:
    view = view_of(SETUP, state(), None, crowd(30))
    assert view.car is None
    assert [body.kind for body in view.bodies] == ["bus"] * min(MAX_BODIES, 16)
    assert [body.x for body in view.bodies] == pytest.approx([15.0 + 5.0 * k for k in range(16)], abs=0.01)


def test_somebody_of_whom_nothing_is_known_is_shown_nothing_and_no_nan() -> None:
    view = view_of(SETUP, Person(SETUP).step(0.0), RoadCar(Box(0.0, 0.0, 0.0, 5.0, 2.0), 1.0), crowd(3))
    assert (view.x, view.y, view.radius, view.age, view.distance, view.car, view.bodies) == (*(None,) * 6, ())
    assert view.faults == ("person_absent",)
    assert msgspec.convert(msgspec.to_builtins(view), PersonView) == view
