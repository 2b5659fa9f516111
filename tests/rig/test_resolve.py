"""What a rig means: units and signs, defaults, alignments, and the fence around the shipped lot."""

from __future__ import annotations

import dataclasses
import datetime
import math
from pathlib import Path
from typing import Any

import pytest

from tests import vehicles
from tests.conftest import REPOSITORY
from tests.rig import test_edit as edited
from tests.rig.test_load import DAY, SIMULATED, real, simulated
from vve_sumo.config_file import UNITS
from vve_sumo.drive.resolved_scenario import resolve_scenario
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment
from vve_sumo.plant.injected_faults import FaultClock, Shape
from vve_sumo.rig import resolve
from vve_sumo.rig.load import load, parse
from vve_sumo.rig.schema import Rig, RigCalibration, RigLimits, RigVehicle
from vve_sumo.scenario.load import load as load_scenario
from vve_sumo.values import Point, Pose, Vehicle
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.interface import DEFAULT
from vve_sumo.vehicle.limits import EmergencyBraking, Envelope, Limits


def rig(**tables: dict[str, Any]) -> Rig:
    table = real()
    for name, change in tables.items():
        table[name] = table.get(name, {}) | change
    return parse(table, Path("mine.toml"))


def test_a_rig_that_says_nothing_of_its_car_has_the_fusion() -> None:
    plain = rig()
    assert resolve.vehicle_of(plain) == vehicles.FUSION.vehicle
    assert resolve.calibration_of(plain) == vehicles.FUSION.calibration
    assert resolve.limits_of(plain) == Limits(speed=plain.limits.speed_mps)
    assert resolve.interface_of(plain) == DEFAULT
    assert resolve.steering_wheel_bias_of(plain) == 0.0


def test_a_rig_brings_the_model_that_it_names_and_its_own_measurements() -> None:
    ours = rig(vehicle={"model": "lincoln_mkz", "brake_lag_s": 0.02}, calibration={"steering_wheel_bias_deg": 1.5})
    model = resolve.model_of(ours)
    assert model.vehicle == dataclasses.replace(vehicles.MKZ.vehicle, brake_lag=0.02)
    assert model.calibration == vehicles.MKZ.calibration
    assert model.simulated == vehicles.MKZ.simulated
    assert model.measured == vehicles.MKZ.measured
    assert (model.name, model.rig, model.interface) == ("lincoln_mkz", "Fusion, template", DEFAULT)
    assert model.steering_wheel_bias == pytest.approx(math.radians(1.5))
    assert (model.mounting, model.limits) == (resolve.mounting_of(ours), resolve.limits_of(ours))


def test_a_model_beside_the_rig_is_found_again_from_anywhere(tmp_path: Path) -> None:
    text = (REPOSITORY / "vehicles" / "lincoln_mkz.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text.replace("mass_kg = 2080.0", "mass_kg = 2100.0"), encoding="utf-8")
    table = real() | {"vehicle": {"model": "mine.toml"}}
    ours = parse(table, tmp_path / "rig.toml")
    assert ours.vehicle.model == str(tmp_path / "mine.toml")
    assert resolve.vehicle_of(ours).mass == 2100.0
    assert resolve.model_of(ours).name == "mine"


def test_every_declared_quantity_has_its_key() -> None:
    def bare(keys: list[str]) -> set[str]:
        units = sorted(UNITS, key=len, reverse=True)
        return {next((key.removesuffix(unit) for unit in units if key.endswith(unit)), key) for key in keys}

    said = {field.name for field in dataclasses.fields(Vehicle)} - {"steering_limit", "steering_rate_limit"}
    said |= {"steering_wheel_limit", "steering_wheel_rate_limit", "model"}
    assert bare(list(RigVehicle.model_fields)) == said
    measured = {field.name for field in dataclasses.fields(Calibration)} - {"mass", "brake_torque_limit"}
    assert bare(list(RigCalibration.model_fields)) == measured | {"date", "steering_wheel_bias"}
    limits = {field.name for field in dataclasses.fields(Limits)} - {"comfort", "emergency"}
    for prefix, nested in (("comfort", Envelope), ("emergency", EmergencyBraking)):
        limits |= {f"{prefix}_{field.name}" for field in dataclasses.fields(nested)}
    assert bare(list(RigLimits.model_fields)) == limits


def test_units_and_signs() -> None:
    changed = rig(
        vehicle={
            "steering_wheel_limit_deg": 450.0,
            "steering_wheel_rate_limit_radps": 7.5,
            "mass_kg": 1700.0,
            "steering_ratio": 15.0,
        },
        calibration={"steering_wheel_bias_deg": -3.0, "drag_area_m2": 0.7},
        mounting={"forward_m": 1.5, "left_m": -0.2, "heading_misalignment_deg": 2.0},
        limits={"comfort_deceleration_mps2": 3.0, "emergency_jerk_mps3": 20.0, "critical_deceleration_mps2": 5.0},
    )
    vehicle, limits, mounting = resolve.vehicle_of(changed), resolve.limits_of(changed), resolve.mounting_of(changed)
    assert vehicle.steering_limit == pytest.approx(math.pi / 6.0)
    assert vehicle.steering_rate_limit == pytest.approx(0.5)
    assert (vehicle.steering_ratio, vehicle.wheelbase) == (15.0, vehicles.FUSION.vehicle.wheelbase)
    assert resolve.steering_wheel_bias_of(changed) == pytest.approx(math.radians(-3.0))
    # Clockwise in the file, counter-clockwise inside.
    assert (mounting.forward, mounting.left) == (1.5, -0.2)
    assert mounting.heading_misalignment == pytest.approx(-math.radians(2.0))
    assert (limits.comfort.deceleration, limits.emergency.jerk, limits.critical_deceleration) == (3.0, 20.0, 5.0)
    assert limits.comfort.acceleration == Limits().comfort.acceleration
    calibration = resolve.calibration_of(changed)
    assert (calibration.mass, calibration.drag_area) == (1700.0, 0.7)


def test_a_heavier_car_gets_a_brake_gain_in_proportion_unless_it_was_measured() -> None:
    heavy = {"vehicle": {"mass_kg": 3380.0}, "limits": {"critical_deceleration_mps2": 2.9}}
    doubled = resolve.calibration_of(rig(**heavy))
    assert doubled.brake_gain == pytest.approx(1100.0)
    measured = resolve.calibration_of(rig(**heavy, calibration={"brake_gain_kgm": 900.0}))
    assert measured.brake_gain == 900.0


STORED = edited.STORED | {"origin": [40.004, -83.018], "rotation_deg": 30.0, "x_m": 100.0, "y_m": -50.0}


def test_a_stored_alignment_counts_from_its_own_origin() -> None:
    stored = rig(alignment=STORED)
    alignment = resolve.alignment_of(stored, "linden")
    assert alignment is not None
    assert (alignment.rotation, alignment.x, alignment.y) == (pytest.approx(math.pi / 6.0), 100.0, -50.0)
    assert resolve.frame_of(stored).to_map(math.radians(40.004), math.radians(-83.018)) == pytest.approx((0.0, 0.0))
    with pytest.raises(ConfigError, match=r"alignment\.network: made for 'linden', but the drive is in 'campus'"):
        resolve.alignment_of(stored, "campus")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"x_m": 3.0}, "alignment: x_m says nothing for kind 'matched_start'"),
        (STORED | {"lot_points": [[40.0, -83.0]]}, "alignment: lot_points says nothing for kind 'stored'"),
        ({k: v for k, v in STORED.items() if k != "origin"}, "alignment: origin is missing, kind 'stored' needs it"),
        (STORED | {"origin": [48.0, 11.0]}, "alignment.origin.0: lies"),
        (STORED | {"rotation_deg": math.nan}, "alignment.rotation_deg: "),
        (STORED | {"residual_m": 3.0}, "alignment.residual_m: "),
    ],
)
def test_alignments_that_are_none(change: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        rig(alignment=change)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def pairs(mirror: float) -> dict[str, Any]:
    """Three corners of the example's lot, and the same places turned by 90 deg on the virtual road, mirrored or not."""
    frame = resolve.frame_of(rig())
    lot = [[40.0030, -83.0200], [40.0030, -83.0180], [40.0045, -83.0180]]
    places = [frame.to_map(math.radians(a), math.radians(b)) for a, b in lot]
    street = [[10.0 - mirror * y, 20.0 + x] for x, y in places]
    made = {"kind": "surveyed_pairs", "network": "linden", "date": DAY, "residual_m": 0.1}
    return made | {"lot_points": lot, "street_points_m": street}


def test_surveyed_pairs_give_the_alignment_and_mirrored_ones_are_refused() -> None:
    alignment = resolve.alignment_of(rig(alignment=pairs(1.0)), "linden")
    assert alignment is not None
    assert alignment.rotation == pytest.approx(math.pi / 2.0, abs=1e-6)
    assert max(alignment.residuals) < 1e-3
    with pytest.raises(ConfigError, match=r"mine\.toml: alignment: surveyed pairs: one side is mirrored"):
        rig(alignment=pairs(-1.0))


@pytest.mark.thorough
def test_the_shipped_lot_holds_the_whole_of_the_papers_drive() -> None:
    file = REPOSITORY / "scenarios" / "parked_car.toml"
    resolved = resolve_scenario("parked_car", load_scenario(file), file, REPOSITORY)
    shipped = load(SIMULATED)
    start = shipped.car_start
    assert start is not None
    frame = resolve.frame_of(shipped)
    latitude, longitude = math.radians(start.latitude_deg), math.radians(start.longitude_deg)
    x, y = frame.to_map(latitude, longitude)
    heading = math.radians(90.0 - start.heading_deg) + frame.convergence(latitude, longitude)
    begin = resolved.path.at(0.0)

    def at(x: float, y: float, heading: float) -> Pose:
        return Pose(0.0, Point.REAR_AXLE, x, y, heading, 0.0, 0.0, 0.0, 0.0, 0.0)

    alignment = Alignment.from_matched_start(at(x, y, heading), at(begin.x, begin.y, begin.heading))
    geofence = resolve.geofence_of(shipped, alignment)
    assert geofence.along(resolved.path, shipped.limits.speed_mps) is None
    assert geofence.along(resolved.path, 40.0) is not None
    lot = load_scenario(file).ego.lot
    assert (start.latitude_deg, start.longitude_deg, start.heading_deg) == (
        lot.latitude_deg,
        lot.longitude_deg,
        lot.heading_deg,
    )


def test_the_fence_counts_with_the_slope_and_the_tested_watchdog() -> None:
    def first_refused(**tables: dict[str, Any]) -> float:
        geofence = resolve.geofence_of(rig(**tables), Alignment())
        (low_x, low_y), (high_x, high_y) = geofence.lot.outline.min(axis=0), geofence.lot.outline.max(axis=0)
        x, y = 0.5 * (low_x + high_x), 0.5 * (low_y + high_y)
        while not geofence.check(Pose(0.0, Point.REAR_AXLE, x, y, 0.0, 8.0, 0.0, 0.0, 0.0, 0.0), 0.0, None):
            x += 0.1
        return float(high_x - x)

    test = {"date": datetime.date(2026, 5, 1), "armed": True}
    strong = first_refused(watchdog_test=test | {"deceleration_mps2": 5.9, "delay_s": 0.1})
    weak = first_refused(watchdog_test=test | {"deceleration_mps2": 1.5, "delay_s": 0.1})
    assert weak - strong > 64.0 / 3.0 - 64.0 / 4.72 - 3.0
    steep = first_refused(watchdog_test=test | {"deceleration_mps2": 5.9, "delay_s": 0.1}, lot={"grade_percent": 8.0})
    assert steep > strong + 3.0
    # 0.2 of 9.8 m/s2 in place of 2.4, whatever was measured elsewhere.
    slippery = first_refused(watchdog_test=test | {"deceleration_mps2": 5.9, "delay_s": 0.1}, lot={"friction": 0.2})
    assert slippery > strong + 64.0 / (2.0 * 1.96) - 64.0 / 4.8 - 0.5
    # 0.4 m/s faster when the brakes set in.
    jumping = first_refused(
        watchdog_test=test | {"deceleration_mps2": 5.9, "delay_s": 0.1}, limits={"comfort_jerk_mps3": 20.0}
    )
    assert jumping > strong + 8.0 * 0.3 / 2.4


def test_faults_become_what_the_car_knows() -> None:
    faults = resolve.faults_of(
        parse(simulated() | {"faults": [{"kind": "pose_jump", "at_s": 8.0, "for_s": 2.0, "value": 5.0}]}, SIMULATED)
    )
    assert [(fault.kind, fault.at, fault.duration, fault.value) for fault in faults] == [("pose_jump", 8.0, 2.0, 5.0)]


def test_a_faults_shape_and_clock_are_the_rigs() -> None:
    wanted = [
        {"kind": "pose_rtk_lost", "at_s": 0.0, "for_s": 3.0, "shape": "flapping", "period_s": 0.1, "from_start": True},
        {"kind": "brakes_weak", "at_s": 1.0, "shape": "ramp"},
    ]
    flapping, ramp = resolve.faults_of(parse(simulated() | {"faults": wanted}, SIMULATED))
    assert (flapping.shape, flapping.period, flapping.clock) == (Shape.FLAPPING, 0.1, FaultClock.DRIVE)
    assert (ramp.shape, ramp.clock) == (Shape.RAMP, FaultClock.MOVED)
