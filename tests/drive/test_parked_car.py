"""The paper's drive over speeds, seeds and errors of the car: always stops, at the chosen gap, on the path."""

from __future__ import annotations

from typing import Any

import pytest

from tests.drive.street import MPH, drive_once, obstacle_s
from tests.exhaustive import with_slow
from tests.isolated import isolated

SPEEDS_MPH = (5, 10, 15, 20, 25, 30, 35, 40, 45)
SLOW_MPH = (5, 10, 15, 20)  #: that the path's first straight is long enough for
FIRST_BEND, NEXT_BEND = (140.0, 180.0), 250.0  #: of the two, both to the left and equally tight: s [m]
COMFORT = 3.5  #: [m/s2]


def at_speed(mph: float, seed: int) -> dict[str, Any]:
    """Return the changes for a drive at a speed: an obstacle far enough ahead, no traffic between."""
    speed = mph * MPH
    return {
        "seed": seed,
        "duration_s": 400.0,
        "road.demand": [],
        "ego.speed_mps": speed,
        "obstacles": [{"id": "parked_car", "at_m": obstacle_s(speed)}],
    }


def slowly(mph: float, seed: int, *, bend: bool) -> dict[str, Any]:
    """Return the changes for a slow drive on the path's first straight, or on that and through its first bend."""
    at = obstacle_s(mph * MPH, begin=(FIRST_BEND[1] if bend else 0.0) + 20.0)
    assert at < (NEXT_BEND if bend else FIRST_BEND[0])
    return at_speed(mph, seed) | {"obstacles": [{"id": "parked_car", "at_m": at}]}


def for_seed(seed: int) -> tuple[float, dict[str, Any]]:
    """Return speed [mph] and changes: every speed round a bend, then the slow ones in turns on the straight."""
    if seed >= len(SPEEDS_MPH):
        mph = SLOW_MPH[seed % len(SLOW_MPH)]
        return mph, slowly(mph, seed, bend=False)
    mph = SPEEDS_MPH[seed]
    return mph, slowly(mph, seed, bend=True) if mph <= 10 else at_speed(mph, seed)


def briefly(mph: float, seed: int) -> dict[str, Any]:
    """Return the changes for a drive on the path's first straight that is at its speed when it sees the obstacle."""
    at = FIRST_BEND[0] - 20.0
    assert (mph * MPH) ** 2 / 2.0 / 1.3 + 20.0 < at - 20.0
    return at_speed(mph, seed) | {"obstacles": [{"id": "parked_car", "at_m": at}]}


def check(summary: dict[str, Any], tolerance: float) -> None:
    """Assert what every stop before a parked car owes."""
    assert summary["outcome"] == "stopped", summary
    assert summary["collision"] is False
    assert summary["stop_gap_m"] == pytest.approx(5.0, abs=tolerance)
    assert summary["max_lateral_deviation_m"] <= 0.15
    assert summary["max_deceleration_mps2"] <= COMFORT or summary["emergency_used"]
    assert summary["ego_sync_position_error_m"] <= 1e-6
    assert summary["ego_sync_speed_error_mps"] <= 1e-6


@pytest.mark.parametrize("seed", with_slow(range(20), lambda seed: seed == 1))
def test_stops_at_the_gap_for_every_seed(seed: int) -> None:
    mph, changes = for_seed(seed)
    summary = isolated(drive_once, changes)
    check(summary, 0.5)
    assert summary["max_speed_mps"] == pytest.approx(mph * MPH, rel=0.05)
    assert not summary["emergency_used"]


@pytest.mark.thorough
@pytest.mark.parametrize(("speed", "seed"), with_slow([(5.0, 12), (5.0, 19), (13.4, 5)], lambda drive: drive[1] == 5))
def test_its_traffic_calls_for_no_emergency(speed: float, seed: int) -> None:
    """As shipped. With traffic that had the right of way over the path the first two met a car in a junction."""
    summary = isolated(drive_once, {"seed": seed, "ego.speed_mps": speed})
    check(summary, 0.5)
    assert not summary["emergency_used"]
    assert summary["failed"] == []


ERRORS = [
    pytest.param({"grade_percent": 3.0, "mass_factor": 1.15, "brake_gain_factor": 0.9}, id="uphill-heavy-weak"),
    pytest.param(
        {"grade_percent": -3.0, "mass_factor": 1.15, "brake_gain_factor": 0.9},
        id="downhill-heavy-weak",
        marks=pytest.mark.slow,
    ),
    pytest.param({"grade_percent": -3.0, "mass_factor": 0.85, "brake_gain_factor": 1.1}, id="downhill-light-strong"),
    pytest.param(
        {"grade_percent": 3.0, "mass_factor": 0.85, "brake_gain_factor": 1.1},
        id="uphill-light-strong",
        marks=pytest.mark.slow,
    ),
]


@pytest.mark.thorough
@pytest.mark.parametrize("mph", with_slow([5, 45], lambda mph: mph == 45))
@pytest.mark.parametrize("errors", ERRORS)
def test_stops_and_holds_with_a_car_that_is_not_as_declared(errors: dict[str, float], mph: int) -> None:
    """Grade, mass and brake gain at the corners of their ranges; sixty seconds at rest without rolling off."""
    changes = slowly(mph, 1, bend=False) | {"after_stop_s": 60.0} if mph == 5 else at_speed(mph, 1)
    check(isolated(drive_once, changes | {f"ego.car.{key}": value for key, value in errors.items()}), 0.7)


@pytest.mark.thorough
def test_the_emergency_layer_stops_without_contact_when_the_radar_sees_late() -> None:
    """Blind until 18 m at 25 mph: comfort braking would need 11.2^2 / 2 / 3.5 = 17.9 m and a standing start of it."""
    summary = isolated(drive_once, briefly(25, 3) | {"radar.range_limit_m": 18.0})
    assert summary["outcome"] == "stopped"
    assert summary["collision"] is False
    assert summary["emergency_used"] is True
    assert summary["max_deceleration_mps2"] > COMFORT
    assert summary["stop_gap_m"] > 0.3


@pytest.mark.thorough
def test_without_the_emergency_layer_the_same_drive_ends_in_contact() -> None:
    """The counter-proof that the layer is what stops the car."""
    summary = isolated(
        drive_once, briefly(25, 3) | {"radar.range_limit_m": 12.0, "controller.tuning": {"emergency": False}}
    )
    assert summary["outcome"] == "contact"
    assert summary["collision"] is True


@pytest.mark.thorough
def test_the_end_of_the_path_is_a_stop_line() -> None:
    """With nothing in the way the car comes to rest at the end of the path, not beyond it."""
    summary = isolated(drive_once, {"road.demand": [], "obstacles": [], "ego.speed_mps": 15.0})
    assert summary["outcome"] == "arrived"
    assert summary["max_lateral_deviation_m"] <= 0.15
    assert summary["max_deceleration_mps2"] <= COMFORT


@pytest.mark.slow
@pytest.mark.parametrize("steering", with_slow(["pure_pursuit", "stanley", "lqr"], lambda law: law == "stanley"))
def test_the_other_steering_laws_keep_the_path_too(steering: str) -> None:
    """Every shipped law drives the whole way within a lane's margin."""
    changes = at_speed(25, 2) | {"controller.tuning": {"steering": steering}}
    summary = isolated(drive_once, changes)
    assert summary["outcome"] == "stopped"
    assert summary["max_lateral_deviation_m"] <= 0.25
