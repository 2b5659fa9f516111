"""Whole drives by a lidar and by a camera in place of the radar."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow
from tests.isolated import isolated
from tests.once import once
from vve_sumo.timing import PERIOD

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "child"

SENSES = {"lidar_stop": "roof", "camera_stop": "front"}


def _drive(scenario: str, controller: str, sensors: list[dict[str, Any]], folder: str) -> None:
    from vve_sumo.drive import run as drives

    values = {"controller.name": controller} | ({"sensors": sensors} if sensors else {})
    drives.run(drives.resolve_by_name(scenario, REPOSITORY, values=values), Path(folder), REPOSITORY)


def driven(tmp_path_factory: pytest.TempPathFactory, scenario: str, controller: str, *sensors: dict[str, Any]) -> Path:
    name = f"{scenario}_{controller}"
    return once(
        tmp_path_factory, name, lambda folder: isolated(_drive, scenario, controller, list(sensors), str(folder))
    )


def summary(record: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    return loaded


@pytest.mark.thorough
@pytest.mark.parametrize("controller", with_slow(SENSES, lambda controller: controller == "camera_stop"))
def test_it_stops_for_the_parked_car_as_the_radar_s_does(
    tmp_path_factory: pytest.TempPathFactory, controller: str
) -> None:
    sensor = {"name": SENSES[controller], "kind": "lidar" if controller == "lidar_stop" else "camera"}
    said = summary(driven(tmp_path_factory, "parked_car", controller, sensor))
    assert said["passed"]
    assert 4.5 <= said["stop_gap_m"] <= 5.5
    assert said["max_deceleration_mps2"] < 2.5


CONTROLLERS = ("follow_and_stop", "lidar_stop", "camera_stop", "v2x_stop")


@pytest.fixture(scope="module", params=with_slow(CONTROLLERS, lambda one: one in ("lidar_stop", "v2x_stop")))
def child(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return driven(tmp_path_factory, "every_sense", request.param)


@pytest.mark.thorough
def test_no_sense_lets_the_car_touch_the_child(child: Path) -> None:
    said = summary(child)
    assert said["passed"]
    assert not said["collision"]
    assert said["min_gap_m"] > 0.5


def test_only_messages_spare_the_emergency_braking_for_the_child(child: Path) -> None:
    ticks, actors = pd.read_parquet(child / "ticks.parquet"), pd.read_parquet(child / "actors.parquet")
    sets_out = actors[(actors.actor == "child") & (actors.speed_mps > 0.5)].tick.min()
    # It crosses the lane within 4 s.
    urgent = PERIOD * (ticks[ticks.emergency].tick - sets_out)
    urgent = urgent[urgent < 4.0]
    if child.name.endswith("v2x_stop"):
        assert urgent.empty
    else:
        # The child comes into sight 0.8 s after it has set out; some scans or turns later it counts.
        assert 0.8 < urgent.min() < 1.7
