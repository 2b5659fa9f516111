"""CommonRoad scenarios as CommonRoad's own reader and schema take them."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point

from tests.conftest import REPOSITORY
from tests.export.made import HEADING, ROADS, SPEED, TICKS, TIME, X, Y, box_at, record, with_roads
from vve_sumo.analysis import Run
from vve_sumo.cli import main
from vve_sumo.export.commonroad import bounds
from vve_sumo.export.write import export

STREET, LEFT, TURN, CROSSING, SIDE = "12345"


def test_a_record_without_roads_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    record(tmp_path / "mine", {"outcome": "timeout"})
    assert main(["export", str(tmp_path / "mine"), "commonroad", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"vve-sumo: {tmp_path / 'mine'}: the record holds no roads")
    assert [file.name for file in tmp_path.iterdir()] == ["mine"]


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=8), st.floats(5.0, 50.0), st.floats(1.0, 4.0))
def test_bounds_are_half_a_width_beside_the_centre_line(turns: list[float], step: float, width: float) -> None:
    headings = np.cumsum(turns)
    line = np.cumsum(np.vstack([[0.0, 0.0], step * np.column_stack([np.cos(headings), np.sin(headings)])]), axis=0)
    ways = np.append(headings, headings[-1])
    for side, bound in zip((1.0, -1.0), bounds(line, width), strict=True):
        off = bound - line
        across = np.cos(ways) * off[:, 1] - np.sin(ways) * off[:, 0]
        assert (side * across > 0.0).all()
        before, after = headings[:-1], headings[1:]
        for at, pair in enumerate(zip(before, after, strict=True), 1):
            for heading in pair:  # a bound's point at a corner is half a width from both pieces
                reach = math.cos(heading) * off[at, 1] - math.sin(heading) * off[at, 0]
                assert side * reach == pytest.approx(0.5 * width, abs=1e-9)
        ends = [LineString(line[:2]).distance(Point(bound[0])), LineString(line[-2:]).distance(Point(bound[-1]))]
        assert ends == pytest.approx([0.5 * width] * 2, abs=1e-9)


def test_a_line_that_turns_back_has_bounds_that_are_near() -> None:
    line = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 0.0]])
    for bound in bounds(line, 3.0):
        assert np.isfinite(bound).all()
        assert np.hypot(*(bound - line).T).max() < 3.1


@pytest.fixture(scope="module")
def read(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """Both files as commonroad-io reads them, which .ci/run installs (tests/export/commonroad.txt)."""
    place = os.environ.get("VVE_COMMONROAD")
    if place is None:
        pytest.skip("commonroad-io is not there (VVE_COMMONROAD; see tests/export/commonroad.txt)")
    files = export(
        Run(with_roads(tmp_path_factory.mktemp("commonroad") / "mine_1")), "commonroad", tmp_path_factory.mktemp("out")
    )
    assert [file.name for file in files] == ["mine_1.commonroad.xml", "mine_1.commonroad.with_ego.xml"]
    reader = [sys.executable, "-m", "tests.export.commonroad_reader", *map(str, files)]
    run = subprocess.run(
        reader, cwd=REPOSITORY, env=os.environ | {"PYTHONPATH": place}, check=True, stdout=subprocess.PIPE, timeout=120
    )
    found: list[dict[str, Any]] = json.loads(run.stdout)
    return found


def test_lanelets_are_the_lanes(read: list[dict[str, Any]]) -> None:
    lanelets = read[0]["lanelets"]
    assert set(lanelets) == {STREET, LEFT, TURN, CROSSING, SIDE}
    for number, road in zip((STREET, LEFT, TURN, SIDE), (ROADS[0], ROADS[1], ROADS[2], ROADS[4]), strict=True):
        line = np.array([road["x_m"], road["y_m"]]).T
        np.testing.assert_allclose(lanelets[number]["centre"], line, atol=1e-3)
        assert lanelets[number]["width"] == pytest.approx(road["width_m"], abs=1e-3)
    assert (lanelets[STREET]["successor"], lanelets[TURN]["predecessor"]) == ([int(TURN)], [int(STREET)])
    assert (lanelets[STREET]["left"], lanelets[LEFT]["right"]) == (int(LEFT), int(STREET))
    assert (lanelets[STREET]["right"], lanelets[LEFT]["left"]) == (None, None)
    kinds = [lanelets[number]["types"] for number in (STREET, TURN, CROSSING, SIDE)]
    assert kinds == [["unknown"], ["intersection"], ["crosswalk"], ["sidewalk"]]


def test_obstacles_are_where_the_actors_were(read: list[dict[str, Any]]) -> None:
    found = sorted(read[0]["moving"].values(), key=lambda one: (one["type"], one["states"][0][0]))
    assert [one["type"] for one in found] == ["pedestrian", "truck", "truck"]
    for actor, obstacle in zip(("walker", "lorry.7", "lorry.7"), found, strict=True):
        for step, x, y, heading, speed in obstacle["states"]:
            row = box_at(actor, 5 * step)
            assert math.hypot(x - row["x_m"], y - row["y_m"]) < 1e-3
            assert math.cos(heading - row["heading_rad"]) == pytest.approx(1.0, abs=1e-9)
            assert speed == pytest.approx(row["speed_mps"])
        assert obstacle["size"] == [row["length_m"], row["width_m"]]
    steps = [[state[0] for state in one["states"]] for one in found]
    assert steps == [[*range(31)], [*range(12)], [*range(16, 31)]]
    (parked,) = read[0]["standing"]
    assert parked == ["parkedVehicle", 30.0, 5.0, 0.3]


def test_the_ego_is_the_planning_problem_and_solves_it(read: list[dict[str, Any]]) -> None:
    ahead = 0.5 * 4.872 - 1.032  # of the Ford Fusion: from the rear axle to the middle of the box
    step, x, y, heading, speed = read[0]["initial"]
    assert (step, speed) == (0, SPEED)
    assert (x, y) == pytest.approx((X[0] + ahead * math.cos(HEADING[0]), Y[0] + ahead * math.sin(HEADING[0])), abs=1e-3)
    assert heading == pytest.approx(HEADING[0], abs=1e-6)
    (ego,) = (one for one in read[1]["moving"].values() if one["type"] == "car")
    assert len(read[1]["moving"]) == len(read[0]["moving"]) + 1
    assert ego["reaches_goal"]
    assert all(not one["reaches_goal"] for one in read[0]["moving"].values())
    assert (len(ego["states"]) - 1) * read[1]["dt"] == pytest.approx(TIME[TICKS - 1])
    assert all(lanelets == [int(TURN)] for lanelets in ego["on"])


def test_who_comes_later_is_all_that_the_schema_minds(read: list[dict[str, Any]]) -> None:
    for one in read:
        (departure,) = one["departures"]
        assert "'exact'" in departure
        assert "'16'" in departure
    assert [one["id"] for one in read] == ["ZAM_ByHand-1_1_T-1", "ZAM_ByHand-1_2_T-1"]
