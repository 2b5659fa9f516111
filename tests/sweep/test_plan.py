"""What a sweep's dataset begins with: here the vehicle, which a sweep may vary and the command line may replace."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.isolated import isolated
from vve_sumo.errors import ConfigError
from vve_sumo.record.hashes import hash_file
from vve_sumo.record.sweep_folder import SweepPlan
from vve_sumo.sweep.engine import run_one
from vve_sumo.sweep.job import Job
from vve_sumo.sweep.plan import job_of, query_of

FUSION, MKZ = (hash_file(REPOSITORY / "vehicles" / f"{name}.toml") for name in ("ford_fusion", "lincoln_mkz"))


def sweep(folder: Path, parameters: str) -> str:
    file = folder / "mine.toml"
    file.write_text(f'scenario = "parked_car"\n[parameters]\n{parameters}\n', encoding="utf-8")
    return str(file)


@pytest.mark.thorough
def test_the_vehicle_is_a_parameter_like_any_other(tmp_path: Path) -> None:
    query = query_of(sweep(tmp_path, "ego.vehicle = ['ford_fusion', 'lincoln_mkz']"), REPOSITORY, yes=False)
    assert query.plan.cells == 2
    assert query.plan.files_sha256["vehicle"] == sorted([FUSION, MKZ])
    with pytest.raises(ConfigError, match=r"parameters\.ego\.vehicle: ego\.vehicle: no vehicle named 'tank'"):
        query_of(sweep(tmp_path, "ego.vehicle = ['tank']"), REPOSITORY, yes=False)


@pytest.mark.thorough
def test_the_command_line_replaces_the_scenarios_vehicle(tmp_path: Path) -> None:
    file = sweep(tmp_path, "ego.speed_mps = [5.0]")
    assert query_of(file, REPOSITORY, yes=False).plan.files_sha256["vehicle"] == [FUSION]
    assert query_of(file, REPOSITORY, yes=False, vehicle="lincoln_mkz").plan.files_sha256["vehicle"] == [MKZ]
    with pytest.raises(ConfigError, match=r"parked_car\.toml: ego\.vehicle: no vehicle named 'tank'"):
        query_of(file, REPOSITORY, yes=False, vehicle="tank")


#: the car gains speed on this way, so that its mass shows
SHORT = "end_trigger.ego_at_m = [40.0]"
HEAVY = """
[vehicle]
mass_kg = 1800.0

[calibration]
brake_gain_kgm = 600.0

[limits]
"""


def rig(folder: Path) -> Path:
    """A rig whose car was measured: a heavier Fusion, with weaker brakes than its model declares."""
    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    file = folder / "ours.toml"
    file.write_text(text.replace("[limits]\n", HEAVY, 1), encoding="utf-8")
    return file


def drive_by_rig(folder: str, file: str) -> str:
    """Drive in lockstep as the rig says and return the record's hash; call it through `isolated`."""
    from vve_sumo.drive import run

    resolved = run.resolve_by_name("parked_car", REPOSITORY, rig=file, values={"end_trigger.ego_at_m": 40.0})
    return str(run.run(resolved, Path(folder), REPOSITORY).summary["record_sha256"])


@pytest.mark.thorough
def test_a_rigs_car_drives_a_sweep_as_it_drives_alone(tmp_path: Path) -> None:
    file = rig(tmp_path)
    query = query_of(sweep(tmp_path, SHORT), REPOSITORY, yes=False, rig=str(file))
    assert query.plan.rig == str(file)
    assert query.plan.files_sha256["rig"] == [hash_file(file)]
    assert len(query.notes) == 1
    assert query.notes[0].startswith(
        "this car brakes with 5.41 m/s2 at most, not with the declared 5.9: car 5.9, brakes "
    )
    job = job_of(query.plan, query.spec, next(iter(query.cells)), None)
    assert Job.from_json(job.to_json()) == job
    driven = run_one(job).figures["record_sha256"]
    assert driven == isolated(drive_by_rig, str(tmp_path / "record"), str(file))
    plain = query_of(sweep(tmp_path, SHORT), REPOSITORY, yes=False)
    assert (plain.plan.rig, plain.notes) == ("", ())
    fusion = job_of(plain.plan, plain.spec, next(iter(plain.cells)), None)
    assert run_one(fusion).figures["record_sha256"] != driven


@pytest.mark.thorough
def test_a_rigs_faults_are_injected_in_a_sweep_as_in_a_drive(tmp_path: Path) -> None:
    file = rig(tmp_path)
    text = file.read_text(encoding="utf-8")
    file.write_text(text + '\n[[faults]]\nkind = "steering_fault"\nat_s = 2.0\n', encoding="utf-8")
    query = query_of(sweep(tmp_path, SHORT), REPOSITORY, yes=False, rig=str(file))
    figures = run_one(job_of(query.plan, query.spec, next(iter(query.cells)), None)).figures
    assert figures["outcome"] == "fault"
    assert figures["record_sha256"] == isolated(drive_by_rig, str(tmp_path / "record"), str(file))


@pytest.mark.thorough
def test_a_sweep_of_a_rig_survives_its_folder(tmp_path: Path) -> None:
    query = query_of(sweep(tmp_path, "ego.speed_mps = [5.0]"), REPOSITORY, yes=False, rig=str(rig(tmp_path)))
    (tmp_path / "sweep.json").write_text(query.plan.text(), encoding="utf-8")
    assert SweepPlan.of(tmp_path) == query.plan
    written = json.loads(query.plan.text())
    del written["rig"]  # of a sweep from before
    (tmp_path / "sweep.json").write_text(json.dumps(written), encoding="utf-8")
    assert SweepPlan.of(tmp_path).rig == ""


def test_a_rig_brings_its_own_vehicle(tmp_path: Path) -> None:
    file = str(rig(tmp_path))
    with pytest.raises(ConfigError, match="--vehicle: a rig brings its own vehicle"):
        query_of(sweep(tmp_path, "ego.speed_mps = [5.0]"), REPOSITORY, yes=False, rig=file, vehicle="lincoln_mkz")
    with pytest.raises(ConfigError, match=r"mine\.toml: parameters\.ego\.vehicle: a rig brings its own vehicle"):
        query_of(sweep(tmp_path, "ego.vehicle = ['ford_fusion', 'lincoln_mkz']"), REPOSITORY, yes=False, rig=file)
    with pytest.raises(ConfigError, match=r"--rig: brain\.kind of \S+foreign\.toml is 'setpoints', expected 'own'"):
        query_of(sweep(tmp_path, "ego.speed_mps = [5.0]"), REPOSITORY, yes=False, rig="foreign")
    with pytest.raises(ConfigError, match="no rig named 'nobody'"):
        query_of(sweep(tmp_path, "ego.speed_mps = [5.0]"), REPOSITORY, yes=False, rig="nobody")
