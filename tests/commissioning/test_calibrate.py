"""A short drive finds the parameters that the simulated vehicle was given, and a rig file gets them, dated."""

from __future__ import annotations

import datetime
import itertools
import json
import math
import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests import vehicles
from tests.conftest import REPOSITORY
from tests.isolated import isolated
from tests.vehicle.calibration_drive import SPEED, CalibrationDrive
from vve_sumo.cli import main
from vve_sumo.cli.calibrate import conclude
from vve_sumo.commissioning import calibrate
from vve_sumo.controller import load
from vve_sumo.errors import ConfigError
from vve_sumo.plant.car import CarParameters
from vve_sumo.rig import load as rigs
from vve_sumo.rig.resolve import model_of

DATE = "2026-02-03"

#: how well each number has to be found: absolute
WITHIN = {
    "brake_gain": 0.005 * 657.6,
    "brake_delay": 0.005,
    "brake_lag": 0.005,
    "drive_force_limit": 0.005 * 5909.0,
    "drive_delay": 0.005,
    "drive_lag": 0.005,
    "creep_force": 0.02 * 545.0,
    "creep_speed": 0.05,
    "rolling_resistance": 0.0005,
    "drag_area": 0.02,
    "steering_ratio": 0.005 * 15.5,
    "steering_wheel_bias": math.radians(0.05),
    "steering_delay": 0.005,
    "steering_lag": 0.005,
    "wheel_radius": 0.0005 * 0.33,
    "heading_misalignment": math.radians(0.03),
    "acceleration_bias": 0.005,
}


def car(**geometry: float) -> CarParameters:
    """A car that is not as declared: heavier, weaker brakes, both zeros off, and `geometry` as the vehicle's truth."""
    believed = vehicles.parameters(
        mass_factor=1.1,
        brake_gain_factor=0.92,
        steering_wheel_bias=math.radians(2.0),
        heading_misalignment=math.radians(-0.2),
    )
    return replace(believed, vehicle=replace(believed.vehicle, **geometry))


OTHER = {
    "steering_ratio": 15.5,
    "steering_delay": 0.06,
    "steering_lag": 0.11,
    "brake_delay": 0.05,
    "brake_lag": 0.06,
    "wheel_radius": 0.33,
}


def truth(parameters: CarParameters) -> dict[str, float]:
    """What there is to find: forces for the declared mass, times from command to effect."""
    vehicle, believed, heavier = parameters.vehicle, parameters.calibration, parameters.mass_factor
    measured = parameters.imperfections
    return {
        "brake_gain": believed.brake_gain * heavier / parameters.brake_gain_factor / measured.brake_gain_factor,
        "brake_delay": vehicle.brake_delay,
        "brake_lag": vehicle.brake_lag,
        "drive_force_limit": believed.drive_force_limit / heavier,
        "drive_delay": parameters.throttle_delay,
        "drive_lag": believed.drive_lag,
        "creep_force": believed.creep_force / heavier,
        "creep_speed": believed.creep_speed,
        "rolling_resistance": believed.rolling_resistance,
        "drag_area": believed.drag_area / heavier,
        "steering_ratio": vehicle.steering_ratio,
        "steering_wheel_bias": parameters.steering_wheel_bias,
        "steering_delay": vehicle.steering_delay,
        "steering_lag": vehicle.steering_lag,
        "wheel_radius": vehicle.wheel_radius,
        "heading_misalignment": parameters.heading_misalignment,
        "acceleration_bias": 0.0,
    }


@pytest.mark.thorough
@pytest.mark.parametrize(("geometry", "seed"), [({}, 1), (OTHER, 2)], ids=["declared", "other"])
def test_finds_the_parameters_that_the_car_was_given(geometry: dict[str, float], seed: int, tmp_path: Path) -> None:
    parameters = car(**geometry)
    drive = CalibrationDrive(parameters, seed)
    duration = drive.run()
    # It keeps to its lot: one lane's width, 300 m, a minute and a half, and never a rest before the end.
    assert duration < 90.0
    assert max(map(abs, drive.d)) < 0.5
    assert max(drive.speeds) < 1.01 * SPEED
    end = drive.path.project(*drive.position)
    assert 250.0 < end.s < 300.0
    assert drive.speeds[-1] == 0.0
    found = calibrate.calibrate([drive.write(tmp_path)]).identified.estimates
    wanted = truth(parameters)
    assert found.keys() == wanted.keys() == calibrate.QUANTITIES.keys()
    for name, estimate in found.items():
        assert estimate.good, (name, estimate)
        assert estimate.value == pytest.approx(wanted[name], abs=WITHIN[name]), name


@pytest.mark.thorough
def test_the_phases_are_the_setpoints_notes(record: Path, notes: list[str]) -> None:
    phases = [note for note, _ in itertools.groupby(notes) if note]
    assert phases[:4] == ["creep", "accelerate_1", "coast_1", "brake_1"]
    assert phases[-2:] in (["straight", "stop"], ["stop", "hold"])
    assert {"brake_4", "steer_steps", "steer_sines"} <= set(phases)


@pytest.mark.thorough
def test_a_lot_that_is_too_short_cuts_the_plan_short_and_not_the_stop(tmp_path: Path) -> None:
    drive = CalibrationDrive(car(), 3, length=120.0)
    drive.run()
    assert drive.path.project(*drive.position).s < 120.0
    assert "steer_steps" not in drive.notes
    poor = calibrate.calibrate([drive.write(tmp_path)]).poor
    assert "steering_ratio" in poor
    assert "brake_gain" not in poor


@pytest.mark.thorough
def test_two_parts_in_a_short_lot_tell_together_what_the_whole_does(tmp_path: Path) -> None:
    parameters, folders = car(), []
    for part, seed in (("pedals", 4), ("steering", 5)):
        drive = CalibrationDrive(parameters, seed, length=120.0, part=part)
        drive.run()
        assert drive.path.project(*drive.position).s < 120.0
        assert max(map(abs, drive.d)) < 0.5
        folders.append(drive.write(tmp_path / part))
    assert "steering_ratio" in calibrate.calibrate(folders[:1]).poor
    both = calibrate.calibrate(folders)
    assert both.poor == {}
    wanted = truth(parameters)
    for found in (both, calibrate.calibrate(folders[::-1])):
        for name, estimate in found.identified.estimates.items():
            assert estimate.value == pytest.approx(wanted[name], abs=WITHIN[name]), name


@pytest.mark.thorough
def test_drives_of_cars_that_are_declared_otherwise_are_not_fitted_together(copy: Path, record: Path) -> None:
    file = copy / "scenario.json"
    other = json.loads(file.read_text())
    other["vehicle"]["wheelbase"] += 0.1
    file.write_text(json.dumps(other))
    with pytest.raises(ConfigError, match="declared otherwise"):
        calibrate.calibrate([record, copy])


def test_a_part_is_driven_and_no_record_is(rig: Path, capsys: Any, monkeypatch: Any) -> None:
    monkeypatch.chdir(rig.parent)
    assert main(["calibrate", "--rig", "ours.toml", "--part", "pedals", "--record", "runs/a"]) == 2
    assert "--part: is driven, and --record is not" in capsys.readouterr().err


@pytest.mark.parametrize(
    "tuning",
    [{"wheel_angle_deg": 90.0}, {"top_acceleration_m_s2": 3.0}, {"top_speed": 8.0}, {"part": "wheels"}],
)
def test_a_tuning_that_nobody_should_drive_is_refused(tuning: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="tuning key"):
        load("calibration_run", vehicles.parameters().vehicle, tuning, [REPOSITORY / "controllers"])


def shipped(folder: str) -> dict[str, Any]:
    """Drive the shipped scenario in lockstep and return its summary; call it through `isolated`."""
    from vve_sumo.drive import run as drives

    return drives.run(drives.resolve_by_name("calibration", REPOSITORY), Path(folder), REPOSITORY).summary


@pytest.mark.thorough
def test_the_shipped_scenario_passes_and_calibrates(tmp_path: Path) -> None:
    """The whole of lockstep, street and all; what the scenario says is wrong with the car is what comes out."""
    summary = isolated(shipped, str(tmp_path / "record"))
    assert summary["failed"] == []
    assert summary["outcome"] == "stopped"
    calibrated = calibrate.calibrate([tmp_path / "record"])
    assert calibrated.poor == {}
    wanted = truth(replace(car(), imperfections=vehicles.FUSION.measured))
    for name, estimate in calibrated.identified.estimates.items():
        assert estimate.value == pytest.approx(wanted[name], abs=WITHIN[name]), name


@pytest.fixture(scope="module")
def driven() -> CalibrationDrive:
    drive = CalibrationDrive(car(), 7)
    drive.run()
    return drive


@pytest.fixture(scope="module")
def notes(driven: CalibrationDrive) -> list[str]:
    return driven.notes


@pytest.fixture(scope="module")
def record(driven: CalibrationDrive, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return driven.write(tmp_path_factory.mktemp("calibration") / "record")


@pytest.fixture(scope="module")
def calibrated(record: Path) -> calibrate.Calibrated:
    """What the whole record tells."""
    return calibrate.calibrate([record])


@pytest.fixture
def copy(record: Path, tmp_path: Path) -> Path:
    """A record of one's own to spoil."""
    return Path(shutil.copytree(record, tmp_path / "copy"))


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    return Path(shutil.copyfile(REPOSITORY / "rigs" / "simulated.toml", tmp_path / "ours.toml"))


@pytest.mark.thorough
def test_the_command_draws_tells_and_writes_into_the_rig(copy: Path, rig: Path, capsys: Any) -> None:
    before = rig.read_text()
    assert conclude([copy], rig, DATE) == 0
    reported = capsys.readouterr().out
    assert "brake torque for 1 m/s²" in reported
    assert "poor" not in reported
    assert (copy / calibrate.PICTURE).read_bytes().startswith(b"\x89PNG")
    text = rig.read_text()
    said, day = tomllib.loads(text), datetime.date(2026, 2, 3)
    assert said["calibration"]["date"] == said["mounting"]["calibrated"] == day
    assert said["calibration"]["brake_gain_kgm"] == pytest.approx(657.6, rel=0.005)
    assert said["calibration"]["steering_wheel_bias_deg"] == pytest.approx(2.0, abs=0.05)
    assert said["mounting"]["heading_misalignment_deg"] == pytest.approx(0.2, abs=0.03)
    assert said["vehicle"]["steering_ratio"] == pytest.approx(14.8, rel=0.005)
    # All that stood there stands there still, comments too.
    kept = [line for line in before.splitlines() if line.strip()]
    assert [line for line in text.splitlines() if line in kept] == kept
    assert [file.name for file in rig.parent.glob("*ours*")] == [rig.name]


@pytest.mark.thorough
def test_a_second_calibration_replaces_the_first(calibrated: calibrate.Calibrated, rig: Path) -> None:
    calibrate.put_into(rig, calibrated, "2025-01-01")
    once = rig.read_text()
    calibrate.put_into(rig, calibrated, DATE)
    assert rig.read_text() == once.replace("2025-01-01", DATE)


def test_a_table_in_words(calibrated: calibrate.Calibrated) -> None:
    table = {row.words: row for row in calibrate.rows(calibrated)}
    assert table["steering wheel, straight on"].declared.startswith("0.0")
    assert table["steering wheel, straight on"].identified.startswith(("1.9", "2.0"))
    assert table["throttle: dead time"].declared == ""
    assert {row.verdict for row in table.values()} == {"good"}


def cut(record: Path, seconds: float) -> None:
    """Leave a record's first seconds, and a torn end."""
    log = record / "can.log"
    lines = log.read_text().splitlines(keepends=True)
    epoch = json.loads((record / "scenario.json").read_text())["epoch_gnss_s"]
    log.write_text("".join(line for line in lines if float(line[1:18]) - epoch < seconds))
    whole = (record / "pose.bin").read_bytes()
    (record / "pose.bin").write_bytes(whole[: round(seconds * 100) * 84 + 5])


@pytest.mark.thorough
def test_a_drive_that_was_cut_off_is_poor_and_stays_out_of_the_rig(copy: Path, rig: Path) -> None:
    """After 25 s there was no bend yet: the ratio is not known; the rest may be written where that is left."""
    cut(copy, 25.0)
    before = rig.read_bytes()
    calibrated = calibrate.calibrate([copy])
    assert "steering_ratio" in calibrated.poor
    assert "brake_gain" not in calibrated.poor
    assert conclude([copy], None, DATE) == 1
    with pytest.raises(ConfigError, match=r"steering_ratio is poor \(.*\): drive again, or leave it"):
        conclude([copy], rig, DATE)
    assert rig.read_bytes() == before
    calibrate.put_into(rig, calibrated, DATE, leave=tuple(calibrated.poor))
    said = tomllib.loads(rig.read_text())
    assert said["calibration"]["brake_gain_kgm"] == pytest.approx(657.6, rel=0.01)
    assert "steering_ratio" not in said["vehicle"]
    assert said["calibration"]["wheel_speed_tolerance"] == 0.01, "earned by the rolling radius, which is good"


def test_a_rolling_radius_that_is_left_earns_no_tolerance(calibrated: calibrate.Calibrated, rig: Path) -> None:
    calibrate.put_into(rig, calibrated, DATE, leave=("wheel_radius",))
    assert "wheel_speed_tolerance" not in tomllib.loads(rig.read_text()).get("calibration", {})


def test_what_would_not_load_is_not_written(calibrated: calibrate.Calibrated, rig: Path) -> None:
    estimates = calibrated.identified.estimates
    absurd = estimates | {"steering_ratio": replace(estimates["steering_ratio"], value=400.0)}
    wrong = replace(calibrated, identified=replace(calibrated.identified, estimates=absurd))
    before = rig.read_bytes()
    with pytest.raises(ConfigError, match=r"ours\.toml: vehicle\.steering_ratio"):
        calibrate.put_into(rig, wrong, DATE)
    assert rig.read_bytes() == before
    assert [file.name for file in rig.parent.glob("*ours*")] == [rig.name]


@pytest.mark.parametrize(
    ("was", "becomes", "complaint"),
    [
        ("left_m = 0.20", "left_m = -0.20", r"mounting\.left is -0\.2 there, but 0\.2 in the drive"),
        ('title = "', "title = ", "not TOML"),
    ],
)
def test_a_rig_that_did_not_drive_is_refused(
    calibrated: calibrate.Calibrated, rig: Path, was: str, becomes: str, complaint: str
) -> None:
    text = rig.read_text()
    assert was in text
    rig.write_text(text.replace(was, becomes))
    with pytest.raises(ConfigError, match=complaint):
        calibrate.put_into(rig, calibrated, DATE)
    assert rig.read_text() == text.replace(was, becomes)


@pytest.mark.parametrize("date", ["yesterday", "2026-13-01", ""])
def test_a_date_is_a_date(calibrated: calibrate.Calibrated, rig: Path, date: str) -> None:
    before = rig.read_bytes()
    with pytest.raises(ConfigError, match="expected YYYY-MM-DD"):
        calibrate.put_into(rig, calibrated, date)
    assert rig.read_bytes() == before


@pytest.mark.thorough
def test_the_rig_of_a_live_record_is_what_was_declared(copy: Path, rig: Path) -> None:
    """Another lever arm and a mass that the record's own rig states are the ones that count."""
    rig.write_text(rig.read_text().replace("[limits]", "[vehicle]\nmass_kg = 1859.0\n[limits]"))
    ours = rigs.load(rig)
    model = model_of(ours).to_dict()
    declared = {"rig": ours.model_dump(mode="json", exclude_unset=True), "rig_name": "ours", "vehicle_model": model}
    file = copy / "scenario.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | declared | {"vehicle": model.pop("vehicle")}))
    found = calibrate.calibrate([copy])
    assert found.declared.vehicle.mass == 1859.0
    # The car's true mass, 1.1 times the Fusion's: now the forces are the true ones.
    assert found.identified.estimates["drive_force_limit"].value == pytest.approx(6500.0, rel=0.005)


def spoil(folder: Path, name: str, text: str | None) -> None:
    if text is None:
        (folder / name).unlink()
    else:
        (folder / name).write_text(text)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("scenario.json", None, r"scenario\.json: cannot be read"),
        ("scenario.json", "{}", r"scenario\.json: not what a drive writes: no epoch_gnss_s"),
        ("can.log", None, r"can\.log: No such file"),
        ("can.log", "", "never engaged and in drive"),
        ("can.log", "no candump\n", "not a candump log"),
        ("pose.bin", None, r"pose\.bin: cannot be read"),
        ("pose.bin", "", r"pose\.bin: no fix with heading"),
    ],
)
def test_what_is_no_record_is_named(copy: Path, name: str, text: str | None, complaint: str) -> None:
    spoil(copy, name, text)
    with pytest.raises(ConfigError, match=complaint):
        calibrate.calibrate([copy])
