"""OSI traces as OSI's official classes and trace readers take them, against the numbers of the record."""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from osi3trace.osi_trace import OSITrace
from osi_utilities import MultiTraceReader, parse_osi_trace_filename

from tests.analysis.made import PERIOD, put_scans
from tests.export.made import ACTORS, EPOCH, HEADING, SPEED, TICKS, X, Y, away, box_at, record
from tests.export.test_mcap import DETECTIONS, SCANS
from vve_sumo.analysis import Run
from vve_sumo.export.write import export

FUSION_LENGTH, FUSION_OVERHANG = 4.872, 1.032
#: of the actors, in the order in which they appear
NUMBERS = {"parked": 100, "walker": 101, "lorry.7": 102}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = record(tmp_path_factory.mktemp("osi") / "mine", {"outcome": "timeout"})
    put_scans(folder, SCANS, DETECTIONS)
    return Run(folder)


@pytest.fixture(scope="module")
def files(run: Run, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return export(run, "osi", tmp_path_factory.mktemp("single"))


@pytest.fixture(scope="module")
def multi(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    (file,) = export(run, "osi-mcap", tmp_path_factory.mktemp("multi"))
    return file


def from_single(files: list[Path], multi: Path) -> tuple[list[Any], list[Any]]:
    views, scans = (list(OSITrace(str(file), kind)) for file, kind in zip(files, ("SensorView", "SensorData"),
                                                                         strict=True))  # fmt: skip
    return views, scans


def from_multi(files: list[Path], multi: Path) -> tuple[list[Any], list[Any]]:
    found: dict[str, list[Any]] = {"ground_truth": [], "radar": []}
    with MultiTraceReader() as reader:
        assert reader.open(multi)
        assert set(reader.get_available_topics()) == set(found)
        for result in reader:
            found[result.channel_name].append(result.message)
    return found["ground_truth"], found["radar"]


Reader = Callable[[list[Path], Path], tuple[list[Any], list[Any]]]


@pytest.fixture(scope="module", params=[from_single, from_multi])
def read(request: pytest.FixtureRequest, files: list[Path], multi: Path) -> tuple[list[Any], list[Any]]:
    reader: Reader = request.param
    return reader(files, multi)


def seconds(stamp: Any) -> float:
    return stamp.seconds - EPOCH + 1e-9 * stamp.nanos


def test_names_follow_the_convention(files: list[Path], multi: Path) -> None:
    protobuf = metadata.version("protobuf").replace(".", "")
    for file, code, frames in zip(files, ("sv", "sd"), (TICKS, len(SCANS)), strict=True):
        said = parse_osi_trace_filename(file.name)
        assert said["timestamp"] == datetime.datetime(2026, 1, 1)
        assert (said["osi_version"], said["protobuf_version"]) == ("380", protobuf)
        assert (said["number_of_frames"], said["custom_trace_name"]) == (frames, "mine")
        assert f"_{code}_" in file.name
    assert multi.name == f"20260101T000000Z_multi_380_{protobuf}_{TICKS}_mine.mcap"


def test_the_street_at_every_tick(run: Run, read: tuple[list[Any], list[Any]]) -> None:
    views, _ = read
    assert [seconds(view.timestamp) for view in views] == pytest.approx([n * PERIOD for n in range(TICKS)], abs=1e-6)
    ahead = 0.5 * FUSION_LENGTH - FUSION_OVERHANG
    for tick, view in enumerate(views):
        assert (view.version.version_major, view.version.version_minor, view.version.version_patch) == (3, 8, 0)
        truth = view.global_ground_truth
        assert truth.timestamp == view.timestamp
        assert not truth.HasField("proj_string")
        assert truth.host_vehicle_id.value == view.host_vehicle_id.value
        there = {body.id.value: body for body in truth.moving_object}
        actors = {actor: number for actor, number in NUMBERS.items() if not away(actor, tick)}
        assert there.keys() == {*actors.values(), truth.host_vehicle_id.value}
        for actor, number in actors.items():
            row, base = box_at(actor, tick), there[number].base
            assert (base.position.x, base.position.y) == (row["x_m"], row["y_m"])
            assert (base.dimension.length, base.dimension.width) == (row["length_m"], row["width_m"])
            assert base.orientation.yaw == row["heading_rad"]
            along = row["speed_mps"] * np.exp(1j * row["heading_rad"])
            assert (base.velocity.x, base.velocity.y) == pytest.approx((along.real, along.imag), abs=1e-12)
        ego = there[truth.host_vehicle_id.value].base
        heading = math.remainder(HEADING[tick], math.tau)
        centre = X[tick] + ahead * math.cos(heading), Y[tick] + ahead * math.sin(heading)
        assert (ego.position.x, ego.position.y) == pytest.approx(centre, abs=1e-9)
        assert ego.orientation.yaw == heading
        assert math.hypot(ego.velocity.x, ego.velocity.y) == pytest.approx(SPEED)
    assert set(ACTORS) == set(NUMBERS)


def test_every_scan_at_the_tick_at_which_it_came_out(read: tuple[list[Any], list[Any]]) -> None:
    _, scans = read
    assert [seconds(scan.timestamp) for scan in scans] == pytest.approx([n * PERIOD for n in SCANS], abs=1e-6)
    for number, (tick, scan) in enumerate(zip(SCANS, scans, strict=True)):
        (radar,) = scan.feature_data.radar_sensor
        assert seconds(radar.header.measurement_time) == pytest.approx(tick * PERIOD, abs=1e-6)
        assert radar.header.cycle_counter == number
        found = [(one.position.distance, one.position.azimuth, one.radial_velocity) for one in radar.detection]
        assert found == [
            (row["range_m"], row["azimuth_rad"], row["range_rate_mps"]) for row in DETECTIONS if row["tick"] == tick
        ]
        assert radar.header.number_of_valid_detections == len(found)


def test_the_multi_channel_trace_says_what_the_standard_requires(multi: Path) -> None:
    with MultiTraceReader() as reader:
        assert reader.open(multi)
        (about,) = (data["data"] for data in reader.get_file_metadata() if data["name"] == "net.asam.osi.trace")
        assert about["min_osi_version"] == about["max_osi_version"] == "3.8.0"
        assert about["min_protobuf_version"] == metadata.version("protobuf")
        assert about["creation_time"] == "2026-01-01T00:00:00Z"
        for topic in ("ground_truth", "radar"):
            channel = reader.get_channel_metadata(topic)
            assert channel["net.asam.osi.trace.channel.osi_version"] == "3.8.0"
            assert channel["net.asam.osi.trace.channel.protobuf_version"] == metadata.version("protobuf")


@pytest.mark.parametrize("form", ["osi", "osi-mcap"])
def test_the_same_record_has_the_same_bytes(run: Run, form: str, tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / name).mkdir()
    first, second = (export(Run(run.folder), form, tmp_path / name) for name in "ab")
    assert [file.name for file in first] == [file.name for file in second]
    assert [file.read_bytes() for file in first] == [file.read_bytes() for file in second]


def test_a_name_that_is_asked_for_is_the_last_part_of_the_convention(run: Run, tmp_path: Path) -> None:
    names = {file.name for file in export(run, "osi", tmp_path / "crash.osi")}
    assert {name.rpartition("_")[2] for name in names} == {"crash.osi"}
    assert {parse_osi_trace_filename(name)["custom_trace_name"] for name in names} == {"crash"}
