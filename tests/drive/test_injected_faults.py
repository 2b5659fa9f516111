"""Faults of a rig act in a lockstep drive, stand in its record, and are refused where no car is simulated."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.drive.street import REPOSITORY
from tests.isolated import isolated
from vve_sumo import cli
from vve_sumo.drive.replay import recorded_scenario
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.drive.verify import alterations
from vve_sumo.record.reader import read_table
from vve_sumo.vehicle.dataspeed import layout

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "driven"

EMPTY_STREET: dict[str, Any] = {"road.demand": [], "duration_s": 12.0}

#: by name: the faults of a rig, and a reason code that the gateway must give
FAULTS: dict[str, tuple[str, str]] = {
    "module": ('kind = "steering_fault"\nat_s = 4.0', "steering_fault"),
    "driver": ('kind = "brake_override"\nat_s = 4.0\nfor_s = 2.0\nvalue = 0.26', "driver_override"),
    "writer": ('kind = "another_writer"\nat_s = 4.0\nfor_s = 3.0', "another_writer"),
    "silent": ('kind = "bus_silent"\nat_s = 4.0\nfor_s = 1.0', "wheel_speeds_stale"),
    "garbage": ('kind = "pose_garbage"\nat_s = 2.0\nfor_s = 3.0', ""),
    "old": ('kind = "reports_old"\nat_s = 4.0\nshape = "flapping"\nperiod_s = 0.5', "reports_inconsistent"),
    "rtk": ('kind = "pose_rtk_lost"\nat_s = 4.0\nshape = "flapping"\nperiod_s = 0.1', "pose_unsteady"),
    "early": ('kind = "brake_fault"\nat_s = 3.0\nfrom_start = true', "brake_fault"),
    "none": ("", ""),
}


def rig_of(folder: Path, fault: str) -> Path:
    """Write the rig of the simulated vehicle with a fault, and return its file."""
    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    file = folder / "mine.toml"
    file.write_text(text + (f"\n[[faults]]\n{fault}\n" if fault else ""), encoding="utf-8")
    return file


def drive(rig: str, folder: str) -> dict[str, Any]:
    """Drive with a rig's simulated vehicle and return the summary; call it through `isolated`."""
    from vve_sumo.drive.run import run

    resolved = resolve_by_name("parked_car", REPOSITORY, rig=rig, values=EMPTY_STREET)
    return run(resolved, Path(folder), REPOSITORY).summary


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Records by name, each with its fault."""
    records = {}
    for name, (fault, _code) in FAULTS.items():
        folder = tmp_path_factory.mktemp(name)
        isolated(drive, str(rig_of(folder, fault)), str(folder / "record"))
        records[name] = folder / "record"
    return records


def summary_of(folder: Path) -> dict[str, Any]:
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return summary


@pytest.mark.slow
def test_every_fault_changes_the_record(driven: dict[str, Path]) -> None:
    hashes = {name: summary_of(folder)["record_sha256"] for name, folder in driven.items()}
    assert len(set(hashes.values())) == len(FAULTS)
    motions = {
        name: tuple(read_table(folder, "ticks")["true_speed_mps"].to_pylist()) for name, folder in driven.items()
    }
    stopped = [name for name, (_fault, code) in FAULTS.items() if code]
    assert all(motions[name] != motions["none"] for name in stopped), "the car itself moves in another way"


def codes_under_way(folder: Path) -> set[str]:
    """Return the gateway's reason codes after the first seconds, when the car is engaged."""
    ticks = read_table(folder, "ticks")
    rows = zip(ticks["time_s"].to_pylist(), ticks["reasons"].to_pylist(), strict=True)
    return {code for time, joined in rows if time > 2.5 for code in joined.split("+")}


@pytest.mark.thorough
@pytest.mark.parametrize("name", [name for name, (_fault, code) in FAULTS.items() if code])
def test_the_gateway_names_the_fault(driven: dict[str, Path], name: str) -> None:
    assert FAULTS[name][1] in codes_under_way(driven[name])
    assert FAULTS[name][1] not in codes_under_way(driven["none"])


def test_a_fault_counts_from_the_first_motion_or_from_the_start(driven: dict[str, Path]) -> None:
    begun = {}
    for name in ("module", "early"):
        ticks = read_table(driven[name], "ticks")
        rows = zip(ticks["time_s"].to_pylist(), ticks["reasons"].to_pylist(), strict=True)
        begun[name] = next(time for time, codes in rows if FAULTS[name][1] in codes.split("+"))
    ticks = read_table(driven["module"], "ticks")
    rows = zip(ticks["time_s"].to_pylist(), ticks["true_speed_mps"].to_pylist(), strict=True)
    moved = next(time for time, speed in rows if speed > 0.5)
    assert begun["module"] == pytest.approx(moved + 4.0, abs=0.05)
    assert begun["early"] == pytest.approx(3.0, abs=0.05)


@pytest.mark.thorough
def test_the_same_seed_gives_the_same_bytes(driven: dict[str, Path], tmp_path: Path) -> None:
    isolated(drive, str(rig_of(tmp_path, FAULTS["garbage"][0])), str(tmp_path / "record"))
    for file in ("pose.bin", "can.log", "scenario.json"):
        assert (tmp_path / "record" / file).read_bytes() == (driven["garbage"] / file).read_bytes()
    assert summary_of(tmp_path / "record")["record_sha256"] == summary_of(driven["garbage"])["record_sha256"]
    assert (driven["garbage"] / "pose.bin").read_bytes() != (driven["none"] / "pose.bin").read_bytes()


def test_the_record_holds_the_faults_and_a_drive_without_them_no_key_of_them(driven: dict[str, Path]) -> None:
    scenario = json.loads((driven["old"] / "scenario.json").read_text(encoding="utf-8"))
    assert scenario["faults"] == [
        {
            "kind": "reports_old",
            "at_s": 4.0,
            "for_s": 3600.0,
            "value": None,
            "shape": "flapping",
            "period_s": 0.5,
            "from_start": False,
        }
    ]
    (fault,) = recorded_scenario(driven["old"], REPOSITORY).faults
    assert fault.to_dict() == scenario["faults"][0]
    assert "faults" not in json.loads((driven["none"] / "scenario.json").read_text(encoding="utf-8"))


@pytest.mark.thorough
@pytest.mark.parametrize("name", FAULTS)
def test_a_record_with_faults_is_whole_and_replays(driven: dict[str, Path], name: str) -> None:
    assert alterations(driven[name]) == []
    assert cli.main(["replay", str(driven[name])]) == 0


def test_the_frames_of_another_writer_are_told_from_the_gateways(driven: dict[str, Path]) -> None:
    """The gateway of a lockstep drive hears the foreign frames, and a replay must know them as heard."""
    from vve_sumo.drive.replay import read_car_frames
    from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH

    frames = read_car_frames(driven["writer"], DEFAULT_EPOCH)
    foreign = [frame for heard in frames.reports.values() for frame in heard if frame.id in layout.COMMAND_IDS]
    assert len(foreign) == pytest.approx(2 * 50 * 3, abs=4), "brakes and steering with each of 50 reports a second"
    sent = {len(frames) for frames in frames.commands.values()}
    assert sent <= {3, 4}, "brakes, throttle, steering and sometimes a gear, at every tick alike"


def test_another_controller_is_asked_on_a_record_with_faults(driven: dict[str, Path], tmp_path: Path) -> None:
    assert cli.main(["redrive", str(driven["module"]), "--controller", "follow_and_stop"]) == 0


def test_a_playback_refuses_a_rig_with_faults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rig_of(tmp_path, FAULTS["module"][0])
    (tmp_path / "drive.csv").write_text(
        "time_s,latitude_deg,longitude_deg,heading_deg,speed_mps\n0.0,40.0,-83.0,0.0,1.0\n", encoding="utf-8"
    )
    monkeypatch.chdir(tmp_path)
    arguments = ["drive", "parked_car", "--rig", "mine.toml", "--lockstep", "--pose", "drive.csv", "--out", "record"]
    assert cli.main(arguments) == 2
    said = capsys.readouterr().err
    assert "faults: steering_fault: a recorded drive has no simulated vehicle to inject them into" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "record").exists()
