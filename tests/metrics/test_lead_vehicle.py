"""The lead vehicle and its gap against closed forms and shapely."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from tests.metrics.tables import CAR, actors_of, lead_of, ticks_of
from vve_sumo.metrics.lead_vehicle import index_of_tick
from vve_sumo.path import ReferencePath


def test_gap_and_time_to_collision_of_a_car_ahead_are_the_closed_form() -> None:
    """Rear axle at 10 m, 8 m/s; a 4 m car centred at 60 m going 3 m/s: gap 60 - 2 - 10 - (wheelbase + overhang)."""
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "s_m": 10.0}])
    actors = actors_of([{"tick": 0, "actor": "lead", "x_m": 60.0, "speed_mps": 3.0}])
    lead = lead_of(ticks, actors)
    gap = 60.0 - 2.0 - 10.0 - CAR.rear_axle_to_bumper
    assert lead.gap[0] == pytest.approx(gap, abs=1e-9)
    assert lead.time_to_collision[0] == pytest.approx(gap / 5.0, abs=1e-9)
    assert lead.actor == ["lead"]


def test_the_nearest_in_the_strip_counts_and_neighbours_do_not() -> None:
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "s_m": 10.0}])
    actors = actors_of(
        [
            {"tick": 0, "actor": "far", "x_m": 90.0},
            {"tick": 0, "actor": "near", "x_m": 60.0},
            {"tick": 0, "actor": "beside", "x_m": 40.0, "y_m": 3.5},
            {"tick": 0, "actor": "behind", "x_m": 0.0},
            {"tick": 3, "actor": "another time", "x_m": 30.0},
        ]
    )
    assert lead_of(ticks, actors).actor == ["near"]


def test_a_car_that_pulls_away_has_no_time_to_collision() -> None:
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "s_m": 10.0}])
    actors = actors_of([{"tick": 0, "actor": "lead", "x_m": 60.0, "speed_mps": 9.0}])
    assert np.isnan(lead_of(ticks, actors).time_to_collision).all()


def test_actors_belong_to_the_tick_of_their_number_where_ticks_were_missed() -> None:
    ticks = ticks_of([{"tick": number, "true_x_m": 10.0, "s_m": 10.0} for number in (3, 4, 7)])
    actors = actors_of([{"tick": number, "actor": "lead", "x_m": 50.0 + number} for number in (3, 4, 5, 7)])
    assert index_of_tick(ticks, actors).tolist() == [0, 1, -1, 2]
    gap = lead_of(ticks, actors).gap + CAR.rear_axle_to_bumper
    assert gap == pytest.approx([41.0, 42.0, 45.0], abs=1e-9)


def test_around_a_bend_the_gap_counts_along_the_path() -> None:
    """On a circle of 50 m, a small box at 90 degrees ahead is a quarter of the circumference away, not the chord."""
    angles = np.linspace(0.0, math.pi, 120)
    path = ReferencePath.from_points(50.0 * np.sin(angles), 50.0 - 50.0 * np.cos(angles))
    ticks = ticks_of([{"true_x_m": 0.0, "true_speed_mps": 8.0, "s_m": 0.0}])
    actors = actors_of(
        [
            {
                "tick": 0,
                "actor": "lead",
                "x_m": 50.0,
                "y_m": 50.0,
                "heading_rad": math.pi / 2,
                "length_m": 0.5,
                "width_m": 0.5,
            }
        ]
    )
    gap = lead_of(ticks, actors, path).gap[0]
    # The outer rear corner of the box is 50.25 m from the centre and 0.25 m before the foot of its own middle.
    quarter = 50.0 * (math.pi / 2 - math.atan2(0.25, 49.75))
    assert gap == pytest.approx(quarter - CAR.rear_axle_to_bumper, abs=0.01)


@pytest.mark.thorough
def test_on_a_straight_street_the_gap_is_shapelys_distance() -> None:
    random = np.random.default_rng(4)
    for _ in range(200):
        x, heading = random.uniform(30.0, 120.0), random.uniform(-0.3, 0.3)
        ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "s_m": 10.0}])
        actors = actors_of([{"tick": 0, "actor": "lead", "x_m": x, "heading_rad": heading}])
        box = shapely.affinity.rotate(shapely.box(x - 2.0, -1.0, x + 2.0, 1.0), math.degrees(heading), "center")
        front = shapely.LineString([(10.0 + CAR.rear_axle_to_bumper, -50.0), (10.0 + CAR.rear_axle_to_bumper, 50.0)])
        gap = lead_of(ticks, actors).gap[0]
        strip = shapely.box(0.0, -CAR.width / 2.0, 200.0, CAR.width / 2.0)
        assert gap == pytest.approx(shapely.distance(front, box.intersection(strip)), abs=1e-6)


def test_what_stands_beside_the_bumper_is_not_ahead() -> None:
    """A box whose middle lies between the ego's middle and its bumper is; one behind the ego's middle is not."""
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "s_m": 10.0}])
    middle = 10.0 + CAR.rear_axle_to_bumper - CAR.length / 2.0
    for x, names in ((middle + 0.5, ["lead"]), (middle - 0.5, [""])):
        actors = actors_of([{"tick": 0, "actor": "lead", "x_m": x}])
        assert lead_of(ticks, actors).actor == names


def test_the_deceleration_needed_is_what_stops_at_the_last_moment() -> None:
    """Braked with it from now on, a follower comes to the leader's speed just where the gap ends: integrated."""
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "s_m": 10.0}])
    actors = actors_of([{"tick": 0, "actor": "lead", "x_m": 60.0, "speed_mps": 3.0}])
    lead = lead_of(ticks, actors)
    needed = lead.required_deceleration[0]
    time = np.linspace(0.0, 5.0 / needed, 100_001)
    closed = np.trapezoid(5.0 - needed * time, time)
    assert closed == pytest.approx(lead.gap[0], rel=1e-9)
