"""Whom the car braked for, against drives in which that is known because one actor alone can have been the reason."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.metrics.tables import CAR, PERIOD, actors_of, drive_of, ticks_of
from vve_sumo.metrics.braked_for import hardest_braking_for, last_stop_for
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.path import ReferencePath

CRUISE, SPEED = 3.0, 10.0  #: [s], [m/s]
BRAKING = 2.5  #: [m/s2]
BEGIN = 20.0  #: of the rear axle along the straight path [m]


def motion(deceleration: float = BRAKING) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return place [m], speed [m/s] and acceleration [m/s2] of a car that cruises, brakes to rest and stands."""
    time = np.arange(0.0, CRUISE + SPEED / deceleration + 1.0, PERIOD)
    braked = np.clip(time - CRUISE, 0.0, SPEED / deceleration)
    place = BEGIN + SPEED * np.minimum(time, CRUISE) + SPEED * braked - 0.5 * deceleration * braked**2
    acceleration = np.where((time >= CRUISE) & (braked < SPEED / deceleration), -deceleration, 0.0)
    return place, SPEED - deceleration * braked, acceleration


def drive(
    *others: dict[str, object],
    deceleration: float = BRAKING,
    path: ReferencePath | None = None,
    stands_for: float = 0.0,
) -> DriveData:
    """Return a drive: `others` are actors, whose x_m, y_m may be functions of the time [s] since braking began.

    The car stands for so many seconds at first.
    """
    place, speed, acceleration = motion(deceleration)
    speed[: round(stands_for / PERIOD)] = 0.0
    rows = [
        {
            "time_s": tick * PERIOD,
            "s_m": x,
            "true_x_m": x,
            "true_speed_mps": v,
            "true_acceleration_mps2": a,
            "granted_acceleration_mps2": a,
            "state": "engaged",
        }
        for tick, (x, v, a) in enumerate(zip(place.tolist(), speed.tolist(), acceleration.tolist(), strict=True))
    ]
    seen = [
        {"tick": tick}
        | {key: value(tick * PERIOD - CRUISE) if callable(value) else value for key, value in one.items()}
        for tick in range(len(rows))
        for one in others
    ]
    return drive_of(ticks_of(rows), actors_of(seen), path)


REST = motion()[0][-1] + CAR.rear_axle_to_bumper  #: of the front bumper [m]
PARKED: dict[str, object] = {"actor": "parked", "x_m": REST + 5.0 + 2.0}
FAR: dict[str, object] = {"actor": "far", "x_m": REST + 90.0}
#: crosses from the left at 15 m/s; 2.3 s after the braking began it is where the car would be had it not braked
CROSSER: dict[str, object] = {
    "actor": "crosser",
    "x_m": REST + 4.0,
    "y_m": lambda since: 15.0 * (2.3 - since),
    "heading_rad": -math.pi / 2.0,
    "speed_mps": 15.0,
}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("others", "name"),
    [
        ((PARKED,), "parked"),
        ((FAR, PARKED), "parked"),
        ((CROSSER,), "crosser"),
        ((FAR, CROSSER), "crosser"),
        ((FAR,), ""),  # 90 m beyond where the car stopped called for no braking of 2.5 m/s2
        ((), ""),
    ],
)
def test_the_actor_that_called_for_the_braking_is_named(others: tuple[dict[str, object], ...], name: str) -> None:
    assert last_stop_for(drive(*others)) == name
    assert hardest_braking_for(drive(*others)) == name


def test_one_who_was_on_a_collision_course_is_found_though_it_was_never_in_the_strip() -> None:
    """It comes to rest one metre beside the strip."""

    def beside(since: float) -> float:
        return max(15.0 * (2.3 - since), CAR.width / 2.0 + 2.0 + 1.0)

    stops_beside = CROSSER | {"y_m": beside}
    assert last_stop_for(drive(stops_beside)) == "crosser"


def follows(since: float) -> float:
    """Return the place [m] of a car that does what the car before it does, one second later, and ends 1 m behind it."""
    place = motion()[0]
    tick = min(max(round((CRUISE + since - 1.0) / PERIOD), 0), len(place) - 1)
    return float(place[tick]) + CAR.rear_axle_to_bumper - CAR.length - 1.0 - 2.0


FOLLOWER: dict[str, object] = {
    "actor": "follower",
    "x_m": follows,
    "speed_mps": lambda since: float(np.clip(SPEED - BRAKING * (since - 1.0), 0.0, SPEED)),
}
#: crosses from the left behind the end of the path, where the car would be after 4.5 s had it not braked
BEYOND: dict[str, object] = CROSSER | {"x_m": BEGIN + SPEED * 7.5, "y_m": lambda since: 15.0 * (4.5 - since)}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(("others", "name"), [((FOLLOWER,), ""), ((FOLLOWER, CROSSER), "crosser")])
def test_nobody_brakes_for_what_comes_from_behind(others: tuple[dict[str, object], ...], name: str) -> None:
    assert last_stop_for(drive(*others)) == name
    assert hardest_braking_for(drive(*others)) == name


def test_nobody_brakes_for_what_crosses_beyond_the_end_of_the_path() -> None:
    assert last_stop_for(drive(BEYOND)) == "crosser"
    x = np.arange(0.0, REST + 1.0 - CAR.rear_axle_to_bumper, 1.0)
    assert last_stop_for(drive(BEYOND, path=ReferencePath.from_points(x, np.zeros_like(x)))) == ""


def test_a_car_that_stood_just_before_it_braked_met_nobody_then() -> None:
    """Its speed was zero and the time to a collision infinite, whose product is not a number."""
    aside: dict[str, object] = {"actor": "aside", "x_m": REST, "y_m": 30.0}
    assert last_stop_for(drive(BEYOND, aside, stands_for=2.9)) == "crosser"


def test_a_car_that_hardly_slows_down_brakes_for_nobody() -> None:
    assert hardest_braking_for(drive(PARKED, deceleration=0.3)) == ""


def test_a_drive_without_a_known_motion_brakes_for_nobody() -> None:
    ticks = ticks_of([{"true_x_m": math.nan, "x_m": math.nan, "acceleration_mps2": math.nan}])
    nothing = drive_of(ticks, actors_of([]))
    assert (last_stop_for(nothing), hardest_braking_for(nothing)) == ("", "")
