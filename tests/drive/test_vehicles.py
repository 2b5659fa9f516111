"""Other cars than the default one drive: a second model, and the simulated vehicle as a rig calibrates it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import REPOSITORY
from tests.isolated import isolated
from tests.vehicles import FUSION, MKZ
from vve_sumo.errors import ConfigError
from vve_sumo.record.hashes import hash_file

CALIBRATED = """
[vehicle]
steering_ratio = 15.2
brake_lag_s = 0.03

[calibration]
date = 2026-05-01
steering_wheel_bias_deg = 1.5
brake_gain_kgm = 541.0
"""


def drive(
    folder: str, vehicle: str | None = None, rig: str | None = None, values: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Drive the paper's drive, or what `values` make of it, and replay it; call it through `isolated`."""
    from vve_sumo.drive import run
    from vve_sumo.drive.replay import read_car_frames, read_pipeline_inputs, recorded_scenario, replay
    from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH
    from vve_sumo.rig.load import load

    resolved = run.resolve_by_name("parked_car", REPOSITORY, seed=1, vehicle=vehicle, values=values)
    if rig is not None:
        resolved = resolved.with_rig(load(Path(rig), REPOSITORY), REPOSITORY)
        Path(rig).unlink()  # a record is replayed without it
    record = Path(folder)
    summary = run.run(resolved, record, REPOSITORY).summary
    again = recorded_scenario(record, REPOSITORY)
    assert again.model == resolved.model
    assert replay(again, read_pipeline_inputs(record), read_car_frames(record, DEFAULT_EPOCH), REPOSITORY) is None
    return summary


def resolved(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "scenario.json").read_text(encoding="utf-8")))


@pytest.mark.slow
def test_the_mkz_drives_the_papers_drive(tmp_path: Path) -> None:
    summary = isolated(drive, str(tmp_path / "mkz"), "lincoln_mkz")
    assert summary["failed"] == []
    assert summary["outcome"] == "stopped"
    assert summary["stop_gap_m"] == pytest.approx(5.0, abs=0.5)
    assert not summary["emergency_used"]
    recorded = resolved(tmp_path / "mkz")
    assert recorded["vehicle"]["mass"] == MKZ.vehicle.mass
    assert recorded["vehicle_model"]["name"] == recorded["settings"]["ego"]["vehicle"] == "lincoln_mkz"
    assert recorded["files_sha256"]["vehicle"] == hash_file(REPOSITORY / "vehicles" / "lincoln_mkz.toml")


@pytest.mark.thorough
def test_the_simulated_vehicle_of_a_rig_is_the_car_that_the_rig_calibrates(tmp_path: Path) -> None:
    """Bias and lever arm are known to rig and car alike, so the drive is as good as with a car that has neither."""
    rig = tmp_path / "ours.toml"
    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    changes = {"forward_m = 0.30": "forward_m = 1.10", "[limits]\n": f"{CALIBRATED}\n[limits]\nstop_jerk_mps3 = 4.0\n"}
    for was, becomes in changes.items():
        assert was in text
        text = text.replace(was, becomes, 1)
    rig.write_text(text, encoding="utf-8")
    summary = isolated(drive, str(tmp_path / "record"), None, str(rig), {"obstacles.parked_car.at_m": 200.0})
    assert summary["failed"] == []
    recorded = resolved(tmp_path / "record")
    model = recorded["vehicle_model"]
    assert recorded["vehicle"]["steering_ratio"] == 15.2
    assert recorded["vehicle"]["mass"] == FUSION.vehicle.mass
    assert (model["calibration"]["brake_gain"], model["limits"]["stop_jerk"]) == (541.0, 4.0)
    assert model["mounting"]["forward"] == 1.10
    assert model["steering_wheel_bias"] == math.radians(1.5)
    assert model["rig"] == "The simulated vehicle on a made-up airfield"
    assert "rig" not in recorded, "which only a live drive has"


def test_a_vehicle_that_nobody_knows_is_named() -> None:
    from vve_sumo.drive.run import resolve_by_name

    with pytest.raises(ConfigError, match=r"parked_car\.toml: ego\.vehicle: no vehicle named 'tank'; known: ford_fus"):
        resolve_by_name("parked_car", REPOSITORY, vehicle="tank")
