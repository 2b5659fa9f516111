"""The common part of every suite: test track, run-up to a steady speed, entry of targets, the car's two loads.

Knows no standard's table. The controller under test is the shipped one; with `comfort` off, the emergency layer alone
brakes for a target.
"""

from __future__ import annotations

from typing import Any

from vve_sumo.scenario.schema import Scenario
from vve_sumo.vehicle.model import VehicleModel

KMH = 1.0 / 3.6  #: a km/h [m/s]
LANE_WIDTH = 4.0  #: of the test track [m]
#: tuning for tests of emergency braking: the comfort layer does not brake
AEB = {"comfort": False}

TARGET = "target"  #: the actor of a row that has one
WIDTH = 1.8  #: of the cars that stand beside the path [m]
SPEEDING_UP = 1.5  #: of the shipped controller [m/s2]
SETTLING = 4.0  #: time of steady driving between the run-up and the entry of a target, margin included [s]
ROLLING = 2.0  #: time between a rolling start and the entry of a target [s]
FOREMOST = 6.0  #: s of the front bumper at the start, rounded up [m]
#: time at rest after which a row ends [s]
AT_REST = 0.3


def loads(car: VehicleModel) -> dict[str, float]:
    """Return the true mass over the declared one, by load; declared is the car with its occupants, here unladen."""
    return {"laden": car.laden_factor, "unladen": 1.0}


def entry_s(speed: float) -> float:
    """Where the front bumper is when the car has been steady at `speed` [m/s] for two seconds or more [m]."""
    return speed * speed / (2.0 * SPEEDING_UP) + SETTLING * speed + FOREMOST


def scenario(title: str, speed: float, *, lasts: float, rolling: bool = False, **tables: Any) -> Scenario:
    """Return a scenario on the test track at `speed` [m/s] that ends `lasts` [s] after its target enters at most.

    A `rolling` start is at that speed, ROLLING before the target enters.
    """
    run_up = ROLLING if rolling else speed / SPEEDING_UP + SETTLING + 3.0
    ego = {
        "path": "test_track",
        "speed_mps": speed,
        "lot": {"latitude_deg": 40.0041, "longitude_deg": -83.0186, "heading_deg": 85.0},
        "car": tables.pop("car", {}),
    } | tables.pop("ego", {})
    if rolling:
        start = entry_s(speed) - FOREMOST - ROLLING * speed
        ego |= {"initial_speed_mps": speed, "initial_s_m": start}
    table: dict[str, Any] = {
        "title": title,
        "duration_s": run_up + lasts,
        "after_stop_s": AT_REST,
        "road": {"network": "test_track"},
        "ego": ego,
    }
    return Scenario.model_validate(table | tables)


def target(speed: float, ahead: float, **keys: Any) -> dict[str, Any]:
    """Return an actor that enters `ahead` [m] of the car once the car is steady at `speed` [m/s]."""
    return {"id": TARGET, "ahead_m": ahead, "enters": {"ego_at_m": entry_s(speed)}} | keys


def gate(speed: float, ahead: float, gap: float) -> list[dict[str, Any]]:
    """Return two cars that stand `ahead` [m] of the car on both sides of its path, `gap` [m] apart."""
    offset = 0.5 * (gap + WIDTH)
    left = target(speed, ahead, width_m=WIDTH, offset_m=offset)
    return [left, target(speed, ahead, width_m=WIDTH, offset_m=-offset) | {"id": "other"}]


def end_when_passed(speed: float, ahead: float) -> dict[str, Any]:
    """Return the trigger that ends a row early: a contact, or the car past the target's position at entry."""
    return {"contact": True, "ego_at_m": entry_s(speed) + ahead + 20.0}


def max_impact(limit: float) -> dict[str, Any]:
    """Return the criteria of a row that allows an impact speed [m/s]; 0 allows no contact."""
    return {"impact_speed_mps": {"max": limit}, "collision": None if limit > 0.0 else False}


def time_to_brake(speed: float) -> float:
    """Return the time allowed from full speed to rest, with a margin [s]."""
    return speed / 3.0 + 6.0


def requirement_text(limit_kmh: float, demand: float = 0.0) -> str:
    """Return the text of a row's allowed impact and its least braking demand [m/s2]; 0 demands none."""
    impact = f"impact <= {limit_kmh:g} km/h" if limit_kmh > 0.0 else "no contact"
    return f"{impact}, demand >= {demand:g} m/s²" if demand > 0.0 else impact
