"""Real nodes of rclpy over Fast DDS, in a process of their own: they hear what the record holds, and they drive."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bridges.ros2.drive import heading_of
from tests.bridges.ros2.heard import Heard, heard
from tests.bridges.ros2.stage import EXAMPLES, bridge, interpreter, write_rig
from tests.conftest import REPOSITORY
from tests.live.command_line import free_port, vve_sumo
from vve_sumo.analysis import Run
from vve_sumo.export.unix_time import unix_of_drive

pytest.importorskip("rosbags", reason="needs pip install 'vve-sumo[ros2]'")


def _at(header: dict[str, Any]) -> int:
    return int(header["stamp"]["sec"]) * 1_000_000_000 + int(header["stamp"]["nanosec"])


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Heard:
    """The record of a short drive in lockstep, and what a node heard that drove it."""
    return heard(tmp_path_factory)


def _ticks(run: Run) -> dict[int, dict[str, Any]]:
    rows = run.arrow("ticks").to_pylist()
    return {1000 * unix_of_drive(run, row["time_s"]): row for row in rows}


def test_the_node_drove(driven: Heard) -> None:
    run, _ = driven
    assert run.brain == "setpoints"
    assert max(row["true_speed_mps"] for row in _ticks(run).values()) > 3.0
    assert max(abs(row["lateral_deviation_m"]) for row in _ticks(run).values()) < 0.1


def test_odometry_is_the_pose_of_every_tick(driven: Heard) -> None:
    run, messages = driven
    known = {
        at: row
        for at, row in _ticks(run).items()
        if math.isfinite(row["x_m"]) and row["faults"] in ("", "brain_silent")
    }
    odometry = {_at(one["header"]): one for one in messages["/odom"]}
    assert len(odometry) == len(messages["/odom"])
    # The receiver's packets need some ticks to say the date; from then on none is missing. That the brain has not yet
    # answered is no fault of what the sensors say.
    assert odometry.keys() <= known.keys()
    assert [at for at in known if at >= min(odometry)] == list(odometry)
    assert len(odometry) > 300
    for at, one in odometry.items():
        row, place = known[at], one["pose"]["pose"]
        assert (place["position"]["x"], place["position"]["y"]) == pytest.approx((row["x_m"], row["y_m"]), abs=2e-5)
        turn = heading_of(place["orientation"]["z"], place["orientation"]["w"])
        assert abs(math.remainder(turn - row["heading_rad"], math.tau)) < 3e-6
        assert one["twist"]["twist"]["linear"]["x"] == pytest.approx(row["speed_mps"], abs=3e-4)
        assert one["twist"]["twist"]["angular"]["z"] == pytest.approx(row["yaw_rate_radps"], abs=2e-5)


def test_fix_and_imu_come_with_odometry(driven: Heard) -> None:
    _, messages = driven
    stamps = [_at(one["header"]) for one in messages["/odom"]]
    assert [_at(one["header"]) for one in messages["/fix"]] == stamps
    assert [_at(one["header"]) for one in messages["/imu"]] == stamps
    for fix, imu, one in zip(messages["/fix"], messages["/imu"], messages["/odom"], strict=True):
        assert fix["status"]["status"] == 2
        assert imu["angular_velocity"]["z"] == pytest.approx(one["twist"]["twist"]["angular"]["z"], abs=1e-12)


def test_the_clock_goes_on_at_every_tick(driven: Heard) -> None:
    run, messages = driven
    clocks = [int(one["clock"]["sec"]) * 1_000_000_000 + int(one["clock"]["nanosec"]) for one in messages["/clock"]]
    ticks = list(_ticks(run))
    assert clocks == [at for at in ticks if at >= clocks[0]]
    assert len(clocks) > len(ticks) - 5


def test_scans_are_those_of_the_radar(driven: Heard) -> None:
    run, messages = driven
    table, clouds = run.sensed["radar"], {_at(one["header"]): one for one in messages["/radar/points"]}
    columns = [table.rows[name].to_numpy() for name in ("range_m", "azimuth_rad", "range_rate_mps")]
    recorded = {1000 * unix_of_drive(run, at): table.of_reading(n) for n, at in enumerate(table.measured.tolist())}
    assert clouds
    assert clouds.keys() <= recorded.keys()
    assert [at for at in recorded if at >= min(clouds)][: len(clouds)] == list(clouds)
    for at, cloud in clouds.items():
        points = np.frombuffer(bytes.fromhex(cloud["data"]), "<f4").reshape(-1, 6)
        wanted = np.stack([column[recorded[at]] for column in columns], axis=1).astype("<f4")
        assert sorted(map(tuple, points[:, 3:].tolist())) == sorted(map(tuple, wanted.tolist()))


def test_bodies_are_the_actors_of_the_tick(driven: Heard) -> None:
    run, messages = driven
    ticks = _ticks(run)
    actors: dict[int, dict[str, Any]] = {}
    for row in run.arrow("actors").to_pylist():
        actors.setdefault(row["tick"], {})[row["actor"]] = row
    assert len(messages["/bodies"]) > 300
    for one in messages["/bodies"]:
        markers = one["markers"][1:]
        here = actors.get(ticks[_at(one["markers"][0]["header"])]["tick"], {})
        assert {each["ns"] for each in markers} == here.keys()
        for each in markers:
            row, place = here[each["ns"]], each["pose"]["position"]
            assert (place["x"], place["y"], each["scale"]["x"]) == (row["x_m"], row["y_m"], row["length_m"])
            assert (each["scale"]["y"], each["scale"]["z"]) == (row["width_m"], row["height_m"])


def test_diagnostics_are_state_reasons_and_gap(driven: Heard) -> None:
    run, messages = driven
    rows, gaps = list(_ticks(run).items()), run.data.strip_lead.gap
    index = {at: number for number, (at, _) in enumerate(rows)}
    assert len(messages["/diagnostics"]) > 300
    for one in messages["/diagnostics"]:
        number = index[_at(one["header"])]
        values = {pair["key"]: pair["value"] for pair in one["status"][0]["values"]}
        if number and values["state"]:
            assert values["state"] == rows[number - 1][1]["state"]  # as the drive knew it
        # That the brain is silent is found after the outputs have gone out.
        assert set(rows[number][1]["faults"].split("+")) - set(values["reasons"].split("+")) <= {"", "brain_silent"}
        assert set(values["reasons"].split("+")) - {""} <= set(rows[number][1]["faults"].split("+"))
        if values["gap_m"]:
            assert float(values["gap_m"]) == pytest.approx(gaps[number], abs=0.02)


def test_the_path_is_the_recorded_one(driven: Heard) -> None:
    run, messages = driven
    (path,) = messages["/path"]
    for one in path["poses"][::25]:
        place = one["pose"]["position"]
        assert abs(run.path.project(place["x"], place["y"]).d) < 1e-6
    assert len(path["poses"]) == 1 + math.ceil(run.path.length)


def test_the_path_ahead_is_the_recorded_one_as_the_car_sees_it(driven: Heard) -> None:
    run, messages = driven
    ticks = _ticks(run)
    assert [_at(one["header"]) for one in messages["/path/ahead"]] == [_at(one["header"]) for one in messages["/odom"]]
    for one in messages["/path/ahead"][::20]:
        row = ticks[_at(one["header"])]
        cos, sin = math.cos(row["heading_rad"]), math.sin(row["heading_rad"])
        places = [each["pose"]["position"] for each in one["poses"]]
        assert -2.0 <= places[0]["x"] <= 0.1
        assert len(places) == 31
        for place in places:
            x = row["x_m"] + cos * place["x"] - sin * place["y"]
            y = row["y_m"] + sin * place["x"] + cos * place["y"]
            assert abs(run.path.project(x, y).d) < 5e-4


@pytest.mark.live
@pytest.mark.slow
def test_a_node_drives_live_and_stops_before_a_parked_car(tmp_path: Path) -> None:
    scenario = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")
    for old, new in (("at_m = 639.0", "at_m = 70.0"), ("speed_mps = 11.176", "speed_mps = 8.0")):
        assert old in scenario
        scenario = scenario.replace(old, new)
    (tmp_path / "near.toml").write_text(scenario, encoding="utf-8")
    port = write_rig(tmp_path, ("port = 3000", f"port = {free_port()}"))
    node = shlex.join([interpreter(), str(EXAMPLES / "follow_and_stop.py")])
    with bridge(tmp_path, port, node, "near.toml"):
        done = vve_sumo("drive", "near.toml", "--rig", "ros2.toml", "--quiet", "--out", "one", cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
