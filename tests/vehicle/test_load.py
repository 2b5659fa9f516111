"""Vehicle files: every number has its source, the shipped ones hold what is published, and what is wrong is named."""

from __future__ import annotations

import json
import math
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from vehiclemodels.parameters_vehicle1 import parameters_vehicle1
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.parameters_vehicle3 import parameters_vehicle3

from tests.complaints import complaint_of
from tests.conftest import REPOSITORY
from tests.vehicle.van import TOY, van_file
from tests.vehicles import FUSION, MKZ
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Mounting
from vve_sumo.values import Vehicle
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.interface import DEFAULT, InterfaceConfig
from vve_sumo.vehicle.load import load, parse
from vve_sumo.vehicle.model import SimulatedParameters, VehicleModel
from vve_sumo.vehicle.schema import ASSUMED

SHIPPED = sorted((REPOSITORY / "vehicles").glob("*.toml"))


def test_the_fusion_is_to_the_last_bit_what_was_identified_and_published() -> None:
    """No number of it may change by a rounding: the bytes on its bus would."""
    assert FUSION.vehicle == Vehicle(
        length=4.872,
        width=1.852,
        wheelbase=2.850,
        front_overhang=0.99,
        mass=1690.0,
        yaw_inertia=3000.0,
        front_axle_to_mass=1.27,
        cornering_stiffness_front=120_000.0,
        cornering_stiffness_rear=100_740.0,
        wheel_radius=0.3245,
        steering_ratio=14.8,
        steering_limit=math.radians(470.0) / 14.8,
        steering_rate_limit=8.7 / 14.8,
        steering_delay=0.04,
        steering_lag=0.08,
        brake_delay=0.025,
        brake_lag=0.015,
        brake_torque_limit=3250.0,
        deceleration_limit=5.9,
    )
    assert FUSION.calibration == Calibration(
        1690.0, 550.0, 3250.0, 6500.0, 120_000.0, 0.25, 600.0, 2.0, 0.012, 0.62, 0.02
    )
    assert FUSION.simulated == SimulatedParameters(2095.0, 1.5824, 0.55, 0.05)
    assert FUSION.mounting == Mounting(0.30, 0.20)


def test_the_mkz_is_the_car_that_apollo_describes() -> None:
    """What vehicle_param.pb.txt and lincoln.pb.txt say and the file does not repeat: edges, turning circle, loads."""
    car = MKZ.vehicle
    assert car.rear_axle_to_bumper == pytest.approx(3.89)
    assert car.rear_overhang == pytest.approx(1.043)
    assert 1.0 / car.tightest_curvature == pytest.approx(5.05386147161)
    assert car.mass == 4 * 520.0
    assert car.understeer_gradient == pytest.approx(0.0)
    axle = 0.5 * car.wheelbase
    assert car.yaw_inertia == pytest.approx(axle * axle * 1040.0 + axle * axle * 1040.0, rel=1e-4)


@pytest.mark.parametrize("model", [FUSION, MKZ], ids=lambda model: model.name)
def test_the_inertia_is_that_of_a_car(model: VehicleModel) -> None:
    """Yaw inertia over mass times both distances to the axles, against measured cars (CommonRoad's parameter sets)."""
    cars = [make() for make in (parameters_vehicle1, parameters_vehicle2, parameters_vehicle3)]
    measured = [car.I_z / (car.m * car.a * car.b) for car in cars]
    car, to_rear = model.vehicle, model.vehicle.wheelbase - model.vehicle.front_axle_to_mass
    ours = car.yaw_inertia / (car.mass * car.front_axle_to_mass * to_rear)
    assert 0.9 * min(measured) < ours < 1.1 * max(measured)


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_every_number_of_a_shipped_vehicle_says_where_it_is_from(file: Path) -> None:
    table = tomllib.loads(file.read_text(encoding="utf-8"))
    for name in ("vehicle", "calibration", "simulated", "measured"):
        sources = table[name].pop("sources")
        assert list(sources) == list(table[name]), "in the order of the numbers"
        assert not any(source.startswith("assumed") and not source.startswith(ASSUMED) for source in sources.values())


@pytest.mark.parametrize("model", [FUSION, MKZ], ids=lambda model: model.name)
def test_a_record_keeps_a_vehicle_to_the_last_bit(model: VehicleModel) -> None:
    assert VehicleModel.from_dict(json.loads(json.dumps(model.to_dict()))) == model


Change = Callable[[dict[str, Any]], object]


def put(table: str, key: str, value: object) -> Change:
    return lambda said: said[table].__setitem__(key, value)


def without(table: str, key: str) -> Change:
    return lambda said: said[table].pop(key)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda t: t["vehicle"]["sources"].pop("mass_kg"),
            "vehicle: mass_kg has no source, expected one under",
        ),
        (lambda t: t["vehicle"]["sources"].update(mass_lb="scales"), "sources.mass_lb: no number of this table"),
        (
            lambda t: t["simulated"]["sources"].update(track_m="assumed"),
            "simulated: sources.track_m: expected the reason after 'assumed: '",
        ),
        (lambda t: t["simulated"]["sources"].update(track_m="assumed: "), "expected the reason after 'assumed: '"),
        (without("measured", "wheel_jitter"), "key 'measured.wheel_jitter' is missing"),
        (lambda t: t["measured"]["sources"].pop("wheel_jitter"), "measured: wheel_jitter has no source"),
        (put("measured", "wheel_runout_rear_left", -0.001), "measured.wheel_runout_rear_left: "),
        (put("measured", "receiver_short_gaps", 0.6), "measured: receiver_short_gaps, receiver_gap_p95_s, "),
        (put("measured", "receiver_gap_max_s", 0.045), "whose shortest time between bursts would be 0.0164 s"),
        (
            lambda t: t["measured"].update(receiver_float_every_s=3600.0, receiver_float_time_s=0.0),
            "measured.receiver_float_time_s: expected more than 0",
        ),
        (without("calibration", "sources"), "key 'calibration.sources' is missing"),
        (lambda t: t.pop("drive_by_wire"), "key 'drive_by_wire' is missing"),
        (without("drive_by_wire", "settings"), "key 'drive_by_wire.settings' is missing"),
        (put("drive_by_wire", "interface", 3), "drive_by_wire.interface: expected a text in quotes, got 3"),
        (without("vehicle", "mass_kg"), "key 'vehicle.mass_kg' is missing"),
        (put("vehicle", "mass_lb", 3700.0), "unknown key 'vehicle.mass_lb', did you mean 'mass_kg'?"),
        (put("vehicle", "mass_kg", math.nan), "vehicle.mass_kg: "),
        (put("vehicle", "mass_kg", "heavy"), "vehicle.mass_kg: expected a number, got 'heavy'"),
        (put("vehicle", "length_m", 3.5), "vehicle: length_m is less than wheelbase_m and front_overhang_m together"),
        (put("vehicle", "front_axle_to_mass_m", 2.9), "vehicle: front_axle_to_mass_m is not less than wheelbase_m"),
        (
            put("vehicle", "deceleration_limit_mps2", 8.0),
            "vehicle.deceleration_limit_mps2: expected 5.91 or less, which brake_torque_limit_nm and "
            "calibration.brake_gain_kgm give, got 8",
        ),
        (
            put("simulated", "laden_mass_kg", 1600.0),
            "simulated.laden_mass_kg: expected vehicle.mass_kg, 1690, or more, got 1600",
        ),
    ],
)
def test_what_is_wrong_is_one_line_that_names_the_key(change: Change, words: str) -> None:
    table = tomllib.loads((REPOSITORY / "vehicles" / "ford_fusion.toml").read_text(encoding="utf-8"))
    change(table)
    assert words in complaint_of(parse, table)


def test_a_file_that_is_no_toml_is_named(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("mass = ", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"vehicle .*mine\.toml: not TOML"):
        load(tmp_path / "mine.toml")


def test_an_interface_beside_the_vehicles_file_is_found_from_anywhere(tmp_path: Path) -> None:
    shutil.copy(TOY, tmp_path / "wire.py")
    file = van_file(tmp_path, 'interface = "wire.py:make"\nsettings = { brake_nm = 6000.0 }')
    assert load(file).interface == InterfaceConfig(f"{tmp_path / 'wire.py'}:make", {"brake_nm": 6000.0})
    (tmp_path / "wire.py").unlink()
    assert load(file).interface.name == f"{Path('wire.py').resolve()}:make", "else it is of the working folder"


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_a_shipped_vehicle_names_its_wire(file: Path) -> None:
    assert "drive_by_wire" in tomllib.loads(file.read_text(encoding="utf-8"))
    assert load(file).interface == DEFAULT
