"""The metrics of a drive against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.metrics.tables import CAR, actors_of, drive_of, ticks_of
from vve_sumo.metrics.per_drive import PER_DRIVE, ego_sync_position_error, emergency_used, impact_speed


def test_nothing_to_measure_is_not_a_number() -> None:
    ticks = ticks_of([{"true_x_m": math.nan, "x_m": math.nan, "lateral_deviation_m": math.nan}])
    measured = PER_DRIVE.measure(drive_of(ticks, actors_of([])))
    assert math.isnan(measured["stop_gap_m"])
    assert math.isnan(measured["min_ttc_s"])


def test_a_drive_that_broke_before_its_first_tick_has_no_figures() -> None:
    """The virtual road may have been looked at by then."""
    actors = actors_of([{"tick": 0, "actor": "lead", "x_m": 60.0}])
    measured = PER_DRIVE.measure(drive_of(ticks_of([]), actors))
    assert math.isnan(measured["min_gap_m"])
    assert math.isnan(measured["stop_distance_m"])


def test_extremes_are_those_of_the_truth() -> None:
    rows = [
        {"true_speed_mps": 5.0, "true_acceleration_mps2": 1.0, "lateral_deviation_m": 0.02, "acceleration_mps2": -9.0},
        {"true_speed_mps": 4.0, "true_acceleration_mps2": -2.5, "lateral_deviation_m": -0.07, "true_x_m": 1.0},
    ]
    measured = PER_DRIVE.measure(drive_of(ticks_of(rows), actors_of([])))
    assert measured["max_lateral_deviation_m"] == pytest.approx(0.07)
    assert measured["max_deceleration_mps2"] == pytest.approx(2.5)
    assert measured["max_speed_mps"] == pytest.approx(5.0)


def test_the_figures_of_a_drive_with_a_leader_are_the_closed_form() -> None:
    """Two ticks: closing in on a car that crosses at 60 degrees, then at rest behind it."""
    gap = 60.0 - 10.0 - CAR.rear_axle_to_bumper
    half = 2.0 * math.cos(math.pi / 3) + 1.0 * math.sin(math.pi / 3)  # of the turned box, along the path
    # Its nearest corner lies beside the strip; the flank from there on does not.
    half -= (2.0 * math.sin(math.pi / 3) - 1.0 * math.cos(math.pi / 3) - 0.5 * CAR.width) / math.tan(math.pi / 3)
    rows = [
        {"true_x_m": 10.0, "true_speed_mps": 8.0, "s_m": 10.0},
        {"true_x_m": 40.0, "true_speed_mps": 0.0, "s_m": 40.0},
    ]
    lead = {"actor": "lead", "x_m": 60.0, "heading_rad": math.pi / 3, "speed_mps": 4.0}
    actors = actors_of([{"tick": 0, **lead}, {"tick": 1, **lead, "speed_mps": 0.0}])
    measured = PER_DRIVE.measure(drive_of(ticks_of(rows), actors))
    assert measured["strip_min_ttc_s"] == pytest.approx((gap - half) / (8.0 - 2.0), abs=1e-9)
    assert math.isnan(measured["min_ttc_s"])  # by then it has left the path: it goes sideways at 3.5 m/s
    assert measured["min_ttc_actor"] == ""
    assert measured["stop_gap_m"] == pytest.approx(gap - half - 30.0, abs=1e-9)


def test_a_drive_that_ends_under_way_has_no_stop_gap() -> None:
    ticks = ticks_of([{"true_x_m": 10.0, "true_speed_mps": 8.0, "s_m": 10.0}])
    actors = actors_of([{"tick": 0, "actor": "lead", "x_m": 60.0}])
    assert math.isnan(PER_DRIVE.measure(drive_of(ticks, actors))["stop_gap_m"])


def test_least_gap_and_greatest_deceleration_needed_are_those_of_the_whole_drive() -> None:
    """Closing at 5, then 2 m/s, then falling back, then overlapping: only what closes counts, overlap is a gap."""
    gaps, speeds = (20.0, 1.0, 0.5, -0.4), (8.0, 5.0, 2.0, 9.0)
    rows = [{"true_x_m": 10.0, "true_speed_mps": speed, "s_m": 10.0} for speed in speeds]
    at = [10.0 + CAR.rear_axle_to_bumper + gap + 2.0 for gap in gaps]
    boxes = [{"tick": tick, "actor": "lead", "x_m": x, "speed_mps": 3.0} for tick, x in enumerate(at)]
    measured = PER_DRIVE.measure(drive_of(ticks_of(rows), actors_of(boxes)))
    assert measured["strip_max_drac_mps2"] == pytest.approx(2.0**2 / (2.0 * 1.0), abs=1e-9)
    assert measured["min_gap_m"] == measured["strip_min_gap_m"] == pytest.approx(-0.4, abs=1e-9)
    nothing = PER_DRIVE.measure(drive_of(ticks_of(rows), actors_of([])))
    assert math.isnan(nothing["max_drac_mps2"])
    assert math.isnan(nothing["min_gap_m"])
    assert nothing["impact_speed_mps"] == 0.0


@pytest.mark.parametrize("heading", [0.0, 2.1])
def test_impact_speed_is_that_at_the_first_contact_along_the_egos_heading(heading: float) -> None:
    """Against vectors: the virtual road found the contact with what it held for the next tick, then others."""
    asked = {"requested_speed_mps": 7.0, "requested_heading_rad": heading}
    rows = [
        asked | {"contacts": ""},
        asked | {"contacts": "a+b"},
        asked | {"contacts": "c", "requested_speed_mps": 1.0},
    ]
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
    assert impact_speed(drive_of(ticks, actors)) == pytest.approx(expected, abs=1e-9)
    assert impact_speed(drive_of(ticks.slice(0, 1), actors)) == 0.0
    assert math.isnan(impact_speed(drive_of(ticks, actors.slice(0, 8))))


def test_the_emergency_layer_counts_only_where_somebody_obeyed() -> None:
    for states, used in ((["engaged"] * 3, True), (["disarmed"] * 3, False), (["stopping"] * 3, False)):
        rows = [{"emergency": asked, "state": state} for asked, state in zip((False, True, False), states, strict=True)]
        assert emergency_used(drive_of(ticks_of(rows), actors_of([]))) is used
    rows = [{"emergency": True, "state": "ready"}, {"emergency": False, "state": "engaged"}]
    assert emergency_used(drive_of(ticks_of(rows), actors_of([]))) is False


def test_the_greatest_error_of_sumos_ego_leaves_out_what_is_no_number() -> None:
    rows = [{"ego_sync_position_error_m": error} for error in (math.nan, 1.0, 3.0, 2.0)]
    assert ego_sync_position_error(drive_of(ticks_of(rows), actors_of([]))) == 3.0
    assert math.isnan(ego_sync_position_error(drive_of(ticks_of(rows[:1]), actors_of([]))))
