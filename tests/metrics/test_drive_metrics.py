"""Gap, time to collision and deviations against closed forms and shapely."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pyarrow as pa
import pytest
import shapely

from tests import vehicles
from vve_sumo.metrics import drive_metrics
from vve_sumo.path import Path
from vve_sumo.record.record import SCHEMAS
from vve_sumo.values import TickRow

CAR = vehicles.FUSION.vehicle
KINDS = {"int": 0, "float": 0.0, "bool": False, "str": ""}


def ticks_of(rows: list[dict[str, float]]) -> pa.Table:
    plain = {f.name: KINDS[str(f.type)] for f in dataclasses.fields(TickRow)}
    return pa.Table.from_pylist([plain | {"tick": i} | row for i, row in enumerate(rows)], SCHEMAS["ticks"])


def actors_of(rows: list[dict[str, object]]) -> pa.Table:
    plain = {"heading_rad": 0.0, "speed_mps": 0.0, "length_m": 4.0, "width_m": 2.0, "y_m": 0.0}
    return pa.Table.from_pylist([plain | row for row in rows], SCHEMAS["actors"])


def straight() -> Path:
    x = np.arange(0.0, 301.0, 2.0)
    return Path.from_points(x, np.zeros_like(x))


def test_gap_and_time_to_collision_of_a_car_ahead_are_the_closed_form() -> None:
    """Rear axle at 10 m, 8 m/s; a 4 m car centred at 60 m going 3 m/s: gap 60 - 2 - 10 - (wheelbase + overhang)."""
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "station_m": 10.0}])
    actors = actors_of([{"tick": 0, "actor": "lead", "x_m": 60.0, "speed_mps": 3.0}])
    seen = drive_metrics.ahead(ticks, actors, straight(), CAR)
    gap = 60.0 - 2.0 - 10.0 - CAR.rear_axle_to_bumper
    assert seen.gap[0] == pytest.approx(gap, abs=1e-9)
    assert drive_metrics.time_to_collision(seen)[0] == pytest.approx(gap / 5.0, abs=1e-9)
    assert seen.actor == ["lead"]


def test_the_nearest_in_the_strip_counts_and_neighbours_do_not() -> None:
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "station_m": 10.0}])
    actors = actors_of(
        [
            {"tick": 0, "actor": "far", "x_m": 90.0},
            {"tick": 0, "actor": "near", "x_m": 60.0},
            {"tick": 0, "actor": "beside", "x_m": 40.0, "y_m": 3.5},
            {"tick": 0, "actor": "behind", "x_m": 0.0},
            {"tick": 3, "actor": "another time", "x_m": 30.0},
        ]
    )
    assert drive_metrics.ahead(ticks, actors, straight(), CAR).actor == ["near"]


def test_a_car_that_pulls_away_has_no_time_to_collision() -> None:
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "station_m": 10.0}])
    actors = actors_of([{"tick": 0, "actor": "lead", "x_m": 60.0, "speed_mps": 9.0}])
    assert np.isnan(drive_metrics.time_to_collision(drive_metrics.ahead(ticks, actors, straight(), CAR))).all()


def test_nothing_to_measure_is_not_a_number() -> None:
    ticks = ticks_of([{"true_x_m": math.nan, "x_m": math.nan, "lateral_deviation_m": math.nan}])
    measured = drive_metrics.measure(ticks, actors_of([]), straight(), CAR)
    assert math.isnan(measured.stop_gap_m)
    assert math.isnan(measured.min_ttc_s)


def test_a_drive_that_broke_before_its_first_tick_has_no_figures() -> None:
    """The street may have been looked at by then."""
    actors = actors_of([{"tick": 0, "actor": "lead", "x_m": 60.0}])
    measured = drive_metrics.measure(ticks_of([]), actors, straight(), CAR)
    assert math.isnan(measured.min_gap_m)
    assert math.isnan(measured.stop_distance_m)


def test_actors_belong_to_the_tick_of_their_number_where_ticks_were_missed() -> None:
    ticks = ticks_of([{"tick": number, "true_x_m": 10.0, "station_m": 10.0} for number in (3, 4, 7)])
    actors = actors_of([{"tick": number, "actor": "lead", "x_m": 50.0 + number} for number in (3, 4, 5, 7)])
    assert drive_metrics.index_of_tick(ticks, actors).tolist() == [0, 1, -1, 2]
    gap = drive_metrics.ahead(ticks, actors, straight(), CAR).gap + CAR.rear_axle_to_bumper
    assert gap == pytest.approx([41.0, 42.0, 45.0], abs=1e-9)


def test_around_a_bend_the_gap_counts_along_the_path() -> None:
    """On a circle of 50 m, a small box at 90 degrees ahead is a quarter of the circumference away, not the chord."""
    angles = np.linspace(0.0, math.pi, 120)
    path = Path.from_points(50.0 * np.sin(angles), 50.0 - 50.0 * np.cos(angles))
    ticks = ticks_of([{"true_x_m": 0.0, "true_speed_mps": 8.0, "station_m": 0.0}])
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
    gap = drive_metrics.ahead(ticks, actors, path, CAR).gap[0]
    # The outer rear corner of the box is 50.25 m from the centre and 0.25 m before the foot of its own middle.
    quarter = 50.0 * (math.pi / 2 - math.atan2(0.25, 49.75))
    assert gap == pytest.approx(quarter - CAR.rear_axle_to_bumper, abs=0.01)


def test_on_a_straight_street_the_gap_is_shapelys_distance() -> None:
    random = np.random.default_rng(4)
    for _ in range(200):
        x, heading = random.uniform(30.0, 120.0), random.uniform(-0.3, 0.3)
        ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "station_m": 10.0}])
        actors = actors_of([{"tick": 0, "actor": "lead", "x_m": x, "heading_rad": heading}])
        box = shapely.affinity.rotate(shapely.box(x - 2.0, -1.0, x + 2.0, 1.0), math.degrees(heading), "center")
        front = shapely.LineString([(10.0 + CAR.rear_axle_to_bumper, -50.0), (10.0 + CAR.rear_axle_to_bumper, 50.0)])
        gap = drive_metrics.ahead(ticks, actors, straight(), CAR).gap[0]
        assert gap == pytest.approx(shapely.distance(front, box), abs=1e-6)


def test_extremes_are_those_of_the_truth() -> None:
    rows = [
        {"true_speed_mps": 5.0, "true_acceleration_mps2": 1.0, "lateral_deviation_m": 0.02, "acceleration_mps2": -9.0},
        {"true_speed_mps": 4.0, "true_acceleration_mps2": -2.5, "lateral_deviation_m": -0.07, "true_x_m": 1.0},
    ]
    measured = drive_metrics.measure(ticks_of(rows), actors_of([]), straight(), CAR)
    assert measured.max_lateral_deviation_m == pytest.approx(0.07)
    assert measured.max_deceleration_mps2 == pytest.approx(2.5)
    assert measured.max_speed_mps == pytest.approx(5.0)


def test_the_figures_of_a_drive_with_a_leader_are_the_closed_form() -> None:
    """Two ticks: closing in on a car that crosses at 60 degrees, then at rest behind it."""
    gap = 60.0 - 10.0 - CAR.rear_axle_to_bumper
    half = 2.0 * math.cos(math.pi / 3) + 1.0 * math.sin(math.pi / 3)  # of the turned box, along the path
    rows = [
        {"true_x_m": 10.0, "true_speed_mps": 8.0, "station_m": 10.0},
        {"true_x_m": 40.0, "true_speed_mps": 0.0, "station_m": 40.0},
    ]
    lead = {"actor": "lead", "x_m": 60.0, "heading_rad": math.pi / 3, "speed_mps": 4.0}
    actors = actors_of([{"tick": 0, **lead}, {"tick": 1, **lead, "speed_mps": 0.0}])
    measured = drive_metrics.measure(ticks_of(rows), actors, straight(), CAR)
    assert measured.min_ttc_s == pytest.approx((gap - half) / (8.0 - 2.0), abs=1e-9)
    assert measured.stop_gap_m == pytest.approx(gap - half - 30.0, abs=1e-9)


def test_a_drive_that_ends_under_way_has_no_stop_gap() -> None:
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "station_m": 10.0}])
    actors = actors_of([{"tick": 0, "actor": "lead", "x_m": 60.0}])
    assert math.isnan(drive_metrics.measure(ticks, actors, straight(), CAR).stop_gap_m)


def test_what_stands_beside_the_bumper_is_not_ahead() -> None:
    """A box whose middle lies between the ego's middle and its bumper is; one behind the ego's middle is not."""
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "station_m": 10.0}])
    middle = 10.0 + CAR.rear_axle_to_bumper - CAR.length / 2.0
    for x, names in ((middle + 0.5, ["lead"]), (middle - 0.5, [""])):
        actors = actors_of([{"tick": 0, "actor": "lead", "x_m": x}])
        assert drive_metrics.ahead(ticks, actors, straight(), CAR).actor == names


def test_the_deceleration_needed_is_what_stops_at_the_last_moment() -> None:
    """Braked with it from now on, a follower comes to the leader's speed just where the gap ends: integrated."""
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "station_m": 10.0}])
    actors = actors_of([{"tick": 0, "actor": "lead", "x_m": 60.0, "speed_mps": 3.0}])
    seen = drive_metrics.ahead(ticks, actors, straight(), CAR)
    needed = drive_metrics.deceleration_to_avoid(seen)[0]
    time = np.linspace(0.0, 5.0 / needed, 100_001)
    closed = np.trapezoid(5.0 - needed * time, time)
    assert closed == pytest.approx(seen.gap[0], rel=1e-9)


def test_least_gap_and_greatest_deceleration_needed_are_those_of_the_whole_drive() -> None:
    """Closing at 5, then 2 m/s, then falling back, then overlapping: only what closes counts, overlap is a gap."""
    gaps, speeds = (20.0, 1.0, 0.5, -0.4), (8.0, 5.0, 2.0, 9.0)
    rows = [{"true_x_m": 10.0, "true_speed_mps": speed, "station_m": 10.0} for speed in speeds]
    at = [10.0 + CAR.rear_axle_to_bumper + gap + 2.0 for gap in gaps]
    boxes = [{"tick": tick, "actor": "lead", "x_m": x, "speed_mps": 3.0} for tick, x in enumerate(at)]
    measured = drive_metrics.measure(ticks_of(rows), actors_of(boxes), straight(), CAR)
    assert measured.max_drac_mps2 == pytest.approx(2.0**2 / (2.0 * 1.0), abs=1e-9)
    assert measured.min_gap_m == pytest.approx(-0.4, abs=1e-9)
    nothing = drive_metrics.measure(ticks_of(rows), actors_of([]), straight(), CAR)
    assert math.isnan(nothing.max_drac_mps2)
    assert math.isnan(nothing.min_gap_m)
    assert nothing.impact_speed_mps == 0.0


@pytest.mark.parametrize("heading", [0.0, 2.1])
def test_impact_speed_is_that_at_the_first_contact_along_the_egos_heading(heading: float) -> None:
    """Against vectors: the street found the contact with what it held for the next tick, and after that others."""
    asked = {"asked_speed_mps": 7.0, "asked_heading_rad": heading}
    rows = [asked | {"contacts": ""}, asked | {"contacts": "a+b"}, asked | {"contacts": "c", "asked_speed_mps": 1.0}]
    turns = {"a": (math.pi / 2, 4.0), "b": (2.5, 3.0), "c": (0.0, 0.0), "beside": (math.pi, 30.0)}
    boxes = [
        {"tick": tick, "actor": name, "x_m": 0.0, "heading_rad": heading + turn, "speed_mps": speed if tick == 2 else 9}
        for tick in (0, 1, 2, 3)
        for name, (turn, speed) in turns.items()
    ]
    ego = 7.0 * np.array([math.cos(heading), math.sin(heading)])
    against = [
        ego - speed * np.array([math.cos(heading + turn), math.sin(heading + turn)])
        for turn, speed in (turns["a"], turns["b"])
    ]
    expected = max(abs(float(one @ ego)) / 7.0 for one in against)
    ticks, actors = ticks_of(rows), actors_of(boxes)
    assert drive_metrics.impact_speed(ticks, actors) == pytest.approx(expected, abs=1e-9)
    assert drive_metrics.impact_speed(ticks.slice(0, 1), actors) == 0.0
    assert math.isnan(drive_metrics.impact_speed(ticks, actors.slice(0, 8)))
