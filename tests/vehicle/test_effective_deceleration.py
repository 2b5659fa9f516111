"""How hard a car brakes as it is driven: the least of all that is in the way, and which that is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.vehicle.van import DATASPEED, OWN_WIRE, van_file
from tests.vehicles import FUSION, MKZ
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.schema import Weather
from vve_sumo.vehicle.effective_deceleration import (
    DRY_FRICTION,
    effective_deceleration,
    limited_to,
    of_model,
)
from vve_sumo.vehicle.interface import CommandsStop, WhenCommandsStop, load
from vve_sumo.vehicle.limits import EmergencyBraking, Limits
from vve_sumo.vehicle.load import load as load_vehicle
from vve_sumo.vehicle.model import VehicleModel

FACTS = load(FUSION.interface).facts
figure = st.floats(0.5, 12.0)


@pytest.mark.parametrize("model", [FUSION, MKZ], ids=lambda model: model.name)
def test_the_shipped_cars_brake_as_declared_to_the_last_bit(model: VehicleModel) -> None:
    braking = of_model(model)
    assert limited_to(model, braking) == model
    assert braking.limiting.part == "car"
    assert braking.shortfall_text() == ""


def test_a_dry_road_is_the_scenarios() -> None:
    assert Weather().friction == DRY_FRICTION


@given(figure, figure, figure, st.floats(5.0, 12.0), st.floats(0.1, 1.0), st.floats(1.0, 2.0))
def test_the_least_holds_whichever_it_is(
    car: float, brakes: float, wire: float, gateway: float, friction: float, heavier: float
) -> None:
    gain = 550.0
    vehicle = replace(FUSION.vehicle, deceleration_limit=car, brake_torque_limit=gain * brakes)
    calibration = replace(FUSION.calibration, brake_torque_limit=gain * brakes)
    limits = Limits(emergency=EmergencyBraking(gateway, 30.0))
    facts = replace(FACTS, brake_torque_limit=gain * wire)
    braking = effective_deceleration(vehicle, calibration, limits, facts, friction=friction, mass_factor=heavier)
    # The same torque on a heavier car; friction is a share of the weight, whatever that is.
    allowed = {part: value / heavier for part, value in zip(("car", "brakes", "wire", "gateway"),
                                                            (car, brakes, wire, gateway), strict=True)}  # fmt: skip
    allowed["tyres"] = 9.80665 * friction
    assert braking.value == pytest.approx(min(allowed.values()))
    assert allowed[braking.limiting.part] == pytest.approx(min(allowed.values()))
    assert float(braking.rounded_down().split()[0]) <= braking.value + 1e-8
    assert (braking.shortfall_text() == "") == (braking.car.deceleration <= 1.02 * braking.value)


def test_a_weak_wire_is_named_and_planned_with(tmp_path: Path) -> None:
    heavy = load_vehicle(van_file(tmp_path, DATASPEED))
    braking = of_model(heavy)
    limited = limited_to(heavy, braking)
    assert limited.vehicle.deceleration_limit == pytest.approx(3412.0 / 868.0)
    assert limited == replace(heavy, vehicle=limited.vehicle)
    assert limited_to(limited, of_model(limited)) == limited
    said = braking.shortfall_text()
    assert said.startswith("this car brakes with 3.93 m/s2 at most, not with the declared 5.5: car 5.5, brakes 5.76")
    assert "least: Dataspeed DBW1 (dbw1_2024) takes 3412 N m" in said
    assert "\n" not in said


def test_the_right_wire_limits_nothing(tmp_path: Path) -> None:
    heavy = load_vehicle(van_file(tmp_path, OWN_WIRE))
    assert of_model(heavy).limiting.part == "car"
    assert of_model(heavy).shortfall_text() == ""


@pytest.mark.parametrize(
    ("action", "strength", "most"),
    [
        (WhenCommandsStop.RELEASES, {}, 0.0),
        (WhenCommandsStop.HOLDS, {}, 0.0),
        (WhenCommandsStop.BRAKES, {}, float("inf")),
        (WhenCommandsStop.BRAKES, {"deceleration": 2.0}, 2.0),
        (WhenCommandsStop.BRAKES, {"brake_torque": 1100.0}, 2.0),
        (WhenCommandsStop.BRAKES, {"brake_torque": 1100.0, "deceleration": 1.5}, 1.5),
    ],
)
def test_what_a_watchdog_gives_at_most(action: WhenCommandsStop, strength: dict[str, float], most: float) -> None:
    assert CommandsStop(action, "in words", **strength).largest_deceleration(550.0) == most


@pytest.mark.parametrize("wrong", [{"deceleration": 0.0}, {"brake_torque": -1.0}, {"deceleration": float("nan")}])
def test_a_watchdog_brakes_with_a_positive_number(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=r"^when_commands_stop: \w+ must be a positive number, got "):
        CommandsStop(WhenCommandsStop.BRAKES, "in words", **wrong)


@pytest.mark.parametrize("action", [WhenCommandsStop.RELEASES, WhenCommandsStop.HOLDS])
def test_what_does_not_brake_has_no_strength(action: WhenCommandsStop) -> None:
    with pytest.raises(ConfigError, match=rf"an interface that {action.value} has no deceleration"):
        CommandsStop(action, "in words", deceleration=2.5)


@pytest.mark.parametrize(
    ("change", "part", "least"),
    [
        ({"vehicle": {"deceleration_limit": 4.0}}, "car", 4.0),
        ({"vehicle": {"brake_torque_limit": 1100.0}}, "brakes", 2.0),
        ({"calibration": {"brake_torque_limit": 1100.0}}, "brakes", 2.0),
        ({"facts": {"brake_torque_limit": 1100.0}}, "wire", 2.0),
        ({"limits": {"emergency": EmergencyBraking(4.0, 30.0)}}, "gateway", 4.0),
        ({"friction": 0.3}, "tyres", 0.3 * 9.80665),
    ],
)
def test_each_part_can_be_the_least_and_says_why(change: dict[str, Any], part: str, least: float) -> None:
    figures: dict[str, Any] = {
        name: replace(whole, **change.get(name, {}))
        for name, whole in (
            ("vehicle", FUSION.vehicle), ("calibration", FUSION.calibration), ("limits", Limits()), ("facts", FACTS)
        )
    }  # fmt: skip
    friction = {"friction": change["friction"]} if "friction" in change else {}
    braking = effective_deceleration(*figures.values(), **friction)
    assert (braking.limiting.part, braking.value) == (part, pytest.approx(least))
    heavier = effective_deceleration(*figures.values(), **friction, mass_factor=1.25)
    assert heavier.value == pytest.approx(min(least / (1.0 if part == "tyres" else 1.25), 5.9 / 1.25))
    rest = braking.without_gateway()
    assert rest.value == pytest.approx(5.9 if part == "gateway" else least)
    assert [bound.part for bound in rest.others] == ["brakes", "wire", "tyres"]


def test_all_parts_stand_in_one_line() -> None:
    assert of_model(FUSION).in_words() == (
        "car 5.9, brakes 5.9, wire 6.2, gateway 9, tyres 8.82 m/s2; least: vehicle.deceleration_limit_mps2 is 5.9"
    )
    assert [bound.why for bound in of_model(FUSION).others] == [
        "vehicle.brake_torque_limit_nm is 3250, calibration.brake_gain_kgm 550",
        "Dataspeed DBW1 (dbw1_2024) takes 3412 N m, calibration.brake_gain_kgm 550",
        "limits.emergency_deceleration_mps2 is 9",
        "friction 0.9",
    ]
    assert of_model(FUSION).rounded_down() == f"5.9 m/s2 or less ({of_model(FUSION).in_words()})"


def test_a_fully_laden_model_on_a_slippery_road() -> None:
    assert of_model(FUSION, mass_factor=FUSION.laden_factor).value == pytest.approx(5.9 * 1690.0 / 2095.0)
    assert of_model(FUSION, friction=0.1).value == pytest.approx(0.980665)


@pytest.mark.parametrize(("declared", "noted"), [(1.02, False), (1.0201, True)])
def test_two_percent_are_rounding(declared: float, noted: bool) -> None:
    facts = replace(FACTS, brake_torque_limit=2750.0)
    vehicle = replace(FUSION.vehicle, deceleration_limit=5.0 * declared)
    assert bool(effective_deceleration(vehicle, FUSION.calibration, Limits(), facts).shortfall_text()) is noted
