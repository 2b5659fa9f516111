"""A car steers around what is parked in its way, live, with all processes; judged by the simulated vehicle's truth."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import steering_live
from tests.live.witness import stalls, witness

pytestmark = [pytest.mark.live, pytest.mark.alone, pytest.mark.thorough]

#: a machine that stands still says nothing about the car, and the drive is repeated; so often at most
ATTEMPTS = 3
#: along the path, behind the parked car [m]
BEHIND = 62.0
SCENARIO = """
title = "A car parked on the test track"
seed = 1
duration_s = 18.0

[road]
network = "test_track"

[ego]
path = "test_track"
speed_mps = 7.0
deviation_limit_m = 5.0

[ego.lot]
latitude_deg = 40.0041
longitude_deg = -83.0186
heading_deg = 85.0

[controller]
name = "elastic_band"
tuning = { left_m = 3.4 }

[[sensors]]
name = "roof"
kind = "lidar"

[[obstacles]]
id = "parked_car"
at_m = 45.0
"""


def test_it_passes_a_parked_car_and_comes_back(tmp_path: Path) -> None:
    for attempt in range(ATTEMPTS):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        (folder / "scenario.toml").write_text(SCENARIO, encoding="utf-8")
        (folder / "rig.toml").write_text(steering_live.rig(), encoding="utf-8")
        with witness(folder / "witness.txt"):
            done = steering_live.drive(folder, behind=BEHIND)
        if done.passed or not stalls(folder / "witness.txt", 0.0, float("inf")):
            break
    assert done.passed, done
    assert done.clearance > 0.8
    assert done.aside > 1.5
    assert done.last < 0.3
    assert done.speed == 0.0
    assert done.fit < 0.05  # what is judged is where the car was
