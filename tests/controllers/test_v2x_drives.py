"""A child between parked cars, with and without V2X: when it is known, against the geometry; and what the car does."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from shapely.geometry import LineString, Polygon

from tests.conftest import REPOSITORY
from tests.isolated import isolated
from tests.once import once
from tests.sensors.scenes import BUMPER
from vve_sumo import cli
from vve_sumo.geometry import Box
from vve_sumo.timing import PERIOD

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "record"

LATENCY = 0.05
OBU = {"name": "obu", "kind": "v2x", "settings": {"ideal": True, "latency_s": LATENCY}}
#: from the speed at which a message is due to the message: a check; to its coming out: the latency, and a tick or two
CHECK = 0.1
#: a child that sets out is heard once it is faster than this [m/s]
HEARD_FROM = 0.5


#: the child has no radio: what is known of it is what the parked cars see
TOLD_BY_OTHERS = {
    "equipped_vulnerable": 0.0, "perceiving": 1.0, "latency_s": LATENCY, "loss": 0.0, "sensitivity_dbm": -150.0,
    "position_sigma_m": 0.0, "speed_sigma_mps": 0.0, "perception_sigma_m": 0.0,
    "warnings": True, "hazard_lights": "parked_near",
}  # fmt: skip
#: people are told of twice a second
PERCEPTION_PERIOD = 0.5


def _drive(controller: str, folder: str, settings: dict[str, Any] | None = None) -> None:
    from vve_sumo.drive import run as drives
    from vve_sumo.drive.resolved_scenario import resolve_scenario
    from vve_sumo.scenario.load import parse

    file = REPOSITORY / "scenarios" / "occluded_pedestrian.toml"
    table: dict[str, Any] = tomllib.loads(file.read_text(encoding="utf-8"))
    table |= {"sensors": [OBU | ({"settings": settings} if settings else {})], "controller": {"name": controller}}
    # Nearer to the lane than in the shipped scenario: no line leads to it past the cars' far sides.
    child = table["actors"][0]
    child["offset_m"] = -3.0
    child["events"][0]["when"] = {"ego_arrives_in_s": 2.8}
    drives.run(resolve_scenario("occluded_pedestrian", parse(table, file), file, REPOSITORY), Path(folder), REPOSITORY)


@pytest.fixture(scope="module", params=["follow_and_stop", "v2x_stop"])
def record(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    name = f"occluded_{request.param}"
    return once(tmp_path_factory, name, lambda folder: isolated(_drive, request.param, str(folder)))


def _set_out(record: Path) -> float:
    """Drive time at which the child, by the truth, is fast enough to be heard of [s]."""
    actors = pd.read_parquet(record / "actors.parquet")
    moving = actors[(actors.actor == "child") & (actors.speed_mps > HEARD_FROM)]
    return PERIOD * float(moving.tick.min())


def _in_sight(record: Path) -> float:
    """Drive time from which on, once it has set out, some corner of the child is open to the bumper, by shapely [s]."""
    ticks = pd.read_parquet(record / "ticks.parquet").set_index("tick")
    actors = pd.read_parquet(record / "actors.parquet")
    for tick, rows in actors[actors.tick * PERIOD >= _set_out(record)].groupby("tick"):
        boxes = {row.actor: Box(*row[3:6], row.length_m, row.width_m) for row in rows.itertuples()}
        ego = ticks.loc[tick]
        ahead = np.array([np.cos(ego.true_heading_rad), np.sin(ego.true_heading_rad)])
        front = np.array([ego.true_x_m, ego.true_y_m]) + BUMPER * ahead
        hiding = [Polygon(box.corners()) for name, box in boxes.items() if name != "child"]
        lines = [LineString([front, corner]) for corner in boxes["child"].corners()]
        if any(not any(line.crosses(one) for one in hiding) for line in lines):
            return PERIOD * float(tick)
    raise AssertionError("the child never came into sight")


def _first(record: Path, sensor: str) -> float:
    """Drive time at which a sensor first tells of the child, once it has set out [s]."""
    table = pd.read_parquet(record / f"sensor_{sensor}.parquet")
    told = table[(table.actor == "child") & (table.tick * PERIOD >= _set_out(record))]
    return PERIOD * float(told.tick.min())


@pytest.mark.thorough
def test_the_time_gained_is_that_of_the_geometry(record: Path) -> None:
    heard, seen = _first(record, "obu"), _first(record, "radar")
    # A check each 0.1 s, the latency, and the tick in whose slack it is worked out.
    assert 0.0 <= heard - _set_out(record) - LATENCY <= CHECK + 2.5 * PERIOD
    gained, geometry = seen - heard, _in_sight(record) - (_set_out(record) + LATENCY + 0.5 * CHECK + PERIOD)
    assert gained == pytest.approx(geometry, abs=0.1)
    assert gained > 0.5


def test_with_v2x_the_car_waits_in_comfort_and_without_it_brakes_in_an_emergency(record: Path) -> None:
    summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
    ticks = pd.read_parquet(record / "ticks.parquet")
    warned = record.name.endswith("v2x_stop")
    assert summary["outcome"] == "completed"
    assert not summary["collision"]
    assert bool(ticks.emergency.any()) is not warned
    assert (ticks.note == "warned").any() == warned


@pytest.mark.thorough
def test_the_drive_replays_to_the_byte(record: Path) -> None:
    assert isolated(cli.main, ["replay", str(record)]) == 0


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive in which the child itself says nothing."""
    return once(
        tmp_path_factory, "occluded_told", lambda folder: isolated(_drive, "v2x_stop", str(folder), TOLD_BY_OTHERS)
    )


@pytest.mark.thorough
def test_a_child_without_a_radio_is_known_by_who_sees_it(told: Path) -> None:
    table = pd.read_parquet(told / "sensor_obu.parquet")
    of_child = table[table.actor == "child"]
    assert set(of_child.message) == {14}
    assert set(of_child.station) <= set(table[table.message == 2].station)
    set_out, actors = _set_out(told), pd.read_parquet(told / "actors.parquet")
    heard = _first(told, "obu")
    assert 0.0 <= heard - set_out - LATENCY <= PERCEPTION_PERIOD + CHECK + 2.5 * PERIOD
    assert heard < _in_sight(told) - 0.5
    assert set(table[table.cause == 94].actor) == {"parked_near"}
    # Where it is told to be is where it was, to the rounding of a message.
    truth = actors[actors.actor == "child"].set_index("tick")
    then = ((of_child.tick * PERIOD - PERIOD - of_child.age_s) / PERIOD).round().astype(int)
    speeds = truth.speed_mps.reindex(then).to_numpy()
    assert of_child.speed_mps.to_numpy() == pytest.approx(speeds, abs=0.06)


@pytest.mark.thorough
def test_and_the_car_waits_for_it_in_comfort(told: Path) -> None:
    summary = json.loads((told / "summary.json").read_text(encoding="utf-8"))
    ticks = pd.read_parquet(told / "ticks.parquet")
    assert (summary["outcome"], summary["collision"]) == ("completed", False)
    assert not ticks.emergency.any()
    assert (ticks.note == "warned").any()
    assert isolated(cli.main, ["replay", str(told)]) == 0
