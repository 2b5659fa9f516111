"""MCAP files as MCAP's own reader and protobuf decoder take them, against the numbers that the record was made of."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import jsonschema
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pyproj
import pytest
from mcap.reader import make_reader
from mcap.summary import Summary
from mcap_protobuf.decoder import DecoderFactory

from tests.analysis.made import PERIOD, put_scans
from tests.export.made import (
    ACTORS,
    ESTIMATE_OFF,
    FRAMES,
    HEADING,
    OF_DRIVE,
    ROADS,
    SHIFT,
    SPEED,
    TICKS,
    TURN,
    UNIX_EPOCH,
    X,
    Y,
    away,
    box_at,
    with_roads,
)
from vve_sumo.analysis import Run, over_time
from vve_sumo.export.write import export

SCANS = range(0, 150, 5)
#: two detections in one scan, none in the next, one of the other mode in the last
DETECTIONS = [
    {"tick": 0, "range_m": 20.5, "azimuth_rad": 0.1, "range_rate_mps": -8.0, "mode": 0, "actor": "parked"},
    {"tick": 0, "range_m": 7.25, "azimuth_rad": -0.4, "range_rate_mps": 1.5, "mode": 1, "actor": "walker"},
    {"tick": 145, "range_m": 60.0, "azimuth_rad": 0.0, "range_rate_mps": -2.0, "mode": 0, "actor": "lorry.7"},
]


class Sent(NamedTuple):
    """A message of a topic."""

    seconds: float  #: log time since drive time 0
    content: Any  #: protobuf message, or what JSON holds


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = with_roads(tmp_path_factory.mktemp("mcap") / "mine")
    put_scans(folder, SCANS, DETECTIONS)
    states = ["ready"] * 50 + ["engaged"] * 100 + ["fault"]
    table = pq.read_table(folder / "ticks.parquet")
    for name, values in (("state", states), ("reasons", [""] * 150 + ["pose_lost+late"])):
        at = table.schema.get_field_index(name)
        table = table.set_column(at, table.schema.field(at), pa.array(values))
    pq.write_table(table, folder / "ticks.parquet")
    return Run(folder)


@pytest.fixture(scope="module")
def file(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    (written,) = export(run, "mcap", tmp_path_factory.mktemp("out"))
    return written


@pytest.fixture(scope="module")
def read(file: Path) -> dict[str, list[Sent]]:
    """All messages by topic, as decoded by the schemas in the file."""
    found: dict[str, list[Sent]] = defaultdict(list)
    validators: dict[int, jsonschema.Draft202012Validator] = {}
    decoders = DecoderFactory()
    with file.open("rb") as source:
        for schema, channel, message in make_reader(source).iter_messages():
            assert schema is not None
            assert message.log_time == message.publish_time
            if channel.message_encoding == "json":
                content = json.loads(message.data)
                if schema.id not in validators:
                    closed = json.loads(schema.data) | {"additionalProperties": False}
                    validators[schema.id] = jsonschema.Draft202012Validator(closed)
                validators[schema.id].validate(content)
            else:
                content = decoders.decoder_for(channel.message_encoding, schema)(message.data)
            found[channel.topic].append(Sent(message.log_time / 1e9 - UNIX_EPOCH, content))
    return found


@pytest.fixture(scope="module")
def summary(file: Path) -> Summary:
    with file.open("rb") as source:
        found = make_reader(source).get_summary()
    assert found is not None
    return found


def heading_of(turn: Any) -> float:
    assert (turn.x, turn.y) == (0.0, 0.0)
    return 2.0 * math.atan2(turn.z, turn.w)


def seconds(stamp: Any) -> float:
    return stamp.seconds - UNIX_EPOCH + 1e-9 * stamp.nanos


def assert_ticks(sent: list[Sent]) -> None:
    np.testing.assert_allclose([one.seconds for one in sent], np.arange(TICKS) * PERIOD, atol=1e-6)


def test_the_file_is_indexed_in_compressed_chunks_and_says_what_it_is(file: Path, summary: Summary, run: Run) -> None:
    assert file.name == "mine.mcap"
    assert {index.compression for index in summary.chunk_indexes} == {"zstd"}
    assert {summary.channels[number].topic for number in summary.channels} == {
        "/tf", "/ego/pose", "/ego/pose_estimated", "/ego/fix", "/roads", "/scene", "/sensor_radar", "/gateway/log",
        "/signals", "/states", "/can",
    }  # fmt: skip
    with file.open("rb") as source:
        (about,) = make_reader(source, validate_crcs=True).iter_metadata()
    assert about.name == "vve_sumo"
    assert about.metadata["title"] == run.title
    assert float(about.metadata["epoch_gnss_s"]) == OF_DRIVE["epoch_gnss_s"]
    assert about.metadata["outcome"] == "timeout"


def test_messages_stand_in_the_order_of_their_times(file: Path) -> None:
    with file.open("rb") as source:
        times = [message.log_time for _, _, message in make_reader(source).iter_messages(log_time_order=False)]
    assert times == sorted(times)
    assert times[0] == round(1e9 * UNIX_EPOCH)


@pytest.mark.parametrize(("topic", "off"), [("/ego/pose", (0.0, 0.0, 0.0)), ("/ego/pose_estimated", ESTIMATE_OFF)])
def test_poses_are_those_of_the_rear_axle(
    read: dict[str, list[Sent]], topic: str, off: tuple[float, float, float]
) -> None:
    assert_ticks(read[topic])
    for one, x, y, heading in zip(read[topic], X, Y, HEADING, strict=True):
        assert one.content.frame_id == "map"
        assert seconds(one.content.timestamp) == pytest.approx(one.seconds, abs=1e-6)
        place = one.content.pose.position
        assert (place.x, place.y, place.z) == (x + off[0], y + off[1], 0.0)
        assert math.cos(heading_of(one.content.pose.orientation) - heading - off[2]) == pytest.approx(1.0, abs=1e-12)


def test_transforms_lead_from_the_map_to_the_bumper(read: dict[str, list[Sent]]) -> None:
    assert_ticks(read["/tf"])
    for one, x, y, heading in zip(read["/tf"], X, Y, HEADING, strict=True):
        ego, radar = one.content.transforms
        assert (ego.parent_frame_id, ego.child_frame_id) == ("map", "ego")
        assert (radar.parent_frame_id, radar.child_frame_id) == ("ego", "sensor_radar")
        assert (ego.translation.x, ego.translation.y) == (x, y)
        assert math.cos(heading_of(ego.rotation) - heading) == pytest.approx(1.0, abs=1e-12)
        ahead = 4.872 - 1.032  # of the Ford Fusion: length less rear overhang
        assert (radar.translation.x, radar.translation.y) == (pytest.approx(ahead, abs=1e-9), 0.0)
        assert heading_of(radar.rotation) == 0.0


def test_a_fix_is_where_the_car_was_in_the_lot(read: dict[str, list[Sent]]) -> None:
    """PROJ takes each fix to the lot's plane; turned and moved it is the estimate on the virtual road."""
    project, geod = pyproj.Proj(OF_DRIVE["lot_projection"]), pyproj.Geod(ellps="WGS84")
    assert_ticks(read["/ego/fix"])
    for one, x, y, heading in zip(read["/ego/fix"], X, Y, HEADING, strict=True):
        fix = one.content
        lot = complex(*project(fix.longitude, fix.latitude))
        street = lot * complex(math.cos(TURN), math.sin(TURN)) + complex(*SHIFT)
        assert abs(street - complex(x + ESTIMATE_OFF[0], y + ESTIMATE_OFF[1])) < 1e-6
        ahead = lot + np.exp(1j * (heading + ESTIMATE_OFF[2] - TURN))
        azimuth, _, _ = geod.inv(fix.longitude, fix.latitude, *project(ahead.real, ahead.imag, inverse=True))
        assert math.cos(fix.heading - math.radians(azimuth)) == pytest.approx(1.0, abs=1e-9)
        assert 0.0 <= fix.heading < math.tau


def test_the_scene_has_every_body_at_every_tick(read: dict[str, list[Sent]]) -> None:
    assert_ticks(read["/scene"])
    ahead = 0.5 * 4.872 - 1.032
    gone = []
    for tick, one in enumerate(read["/scene"]):
        there = {entity.id: entity for entity in one.content.entities}
        assert there.keys() == {"ego"} | {actor for actor in ACTORS if not away(actor, tick)}
        gone += [(tick, deletion.id) for deletion in one.content.deletions]
        for actor in there.keys() - {"ego"}:
            row, (cube,) = box_at(actor, tick), there[actor].cubes
            place = cube.pose.position
            assert (place.x, place.y, place.z) == (row["x_m"], row["y_m"], 0.5 * cube.size.z)
            assert (cube.size.x, cube.size.y) == (row["length_m"], row["width_m"])
            assert math.cos(heading_of(cube.pose.orientation) - row["heading_rad"]) == pytest.approx(1.0, abs=1e-12)
            assert [text.text for text in there[actor].texts] == [actor]
        (cube,) = there["ego"].cubes
        place = cube.pose.position
        middle = X[tick] + ahead * math.cos(HEADING[tick]), Y[tick] + ahead * math.sin(HEADING[tick])
        assert (place.x, place.y) == pytest.approx(middle, abs=1e-9)
    assert gone == [(60, "lorry.7")]


def test_roads_are_drawn_by_both_bounds_once(read: dict[str, list[Sent]]) -> None:
    (one,) = read["/roads"]
    lanes, path = one.content.entities
    assert (lanes.id, path.id) == ("lanes", "path")
    assert len(lanes.lines) == 2 * (len(ROADS) - 1)  # one of them is a single point
    street = np.array([[[point.x, point.y] for point in line.points] for line in lanes.lines[:2]])
    np.testing.assert_allclose(street[0], [[-1.5, -60.0], [-1.5, -20.0], [-1.5, 0.0]], atol=1e-9)
    np.testing.assert_allclose(street[1], [[1.5, -60.0], [1.5, -20.0], [1.5, 0.0]], atol=1e-9)
    assert [(point.x, point.y) for point in path.lines[0].points] == [(2.0 * n, 0.0) for n in range(151)]


def test_a_scan_is_a_cloud_of_its_detections(read: dict[str, list[Sent]]) -> None:
    assert [one.seconds for one in read["/sensor_radar"]] == pytest.approx([tick * PERIOD for tick in SCANS], abs=1e-6)
    for tick, one in zip(SCANS, read["/sensor_radar"], strict=True):
        cloud = one.content
        assert cloud.frame_id == "sensor_radar"
        assert seconds(cloud.timestamp) == pytest.approx(tick * PERIOD, abs=1e-6)
        offsets = {field.name: (field.offset, {2: "i1", 8: "<f8"}[field.type]) for field in cloud.fields}
        expected = [row for row in DETECTIONS if row["tick"] == tick]
        assert len(cloud.data) == cloud.point_stride * len(expected)
        for number, row in enumerate(expected):
            point = {
                name: np.frombuffer(cloud.data, kind, 1, number * cloud.point_stride + offset)[0]
                for name, (offset, kind) in offsets.items()
            }
            for name in ("range_m", "azimuth_rad", "range_rate_mps", "mode"):
                assert point[name] == row[name]
            seen = row["range_m"] * np.exp(1j * row["azimuth_rad"])
            assert (point["x"], point["y"], point["z"]) == pytest.approx((seen.real, seen.imag, 0.0), abs=1e-9)


def test_every_frame_is_there(read: dict[str, list[Sent]]) -> None:
    for one, (time, bus, name, data, sent) in zip(read["/can"], FRAMES, strict=True):
        assert one.seconds == pytest.approx(time, abs=1e-6)
        frame = one.content
        assert frame["timestamp"]["sec"] - UNIX_EPOCH + 1e-9 * frame["timestamp"]["nsec"] == pytest.approx(time)
        assert (f"can{frame['bus'] - 1}", frame["id"], frame["sent"]) == (bus, name, sent)
        assert (bytes.fromhex(frame["data"]), frame["length"]) == (data, len(data))


def test_signals_are_the_measures_over_time_and_the_columns_of_a_tick(run: Run, read: dict[str, list[Sent]]) -> None:
    measured, ticks = over_time(run), run.ticks
    assert_ticks(read["/signals"])
    numbers = [name for name in measured if measured[name].dtype.kind in "if"]
    assert {"speed_mps", "acceleration_mps2", "gap_m", "ttc_s", "drac_mps2"} <= {*numbers}
    for at, one in enumerate(read["/signals"]):
        for table, names in ((measured, numbers), (ticks, ["acceleration_setpoint_mps2", "granted_acceleration_mps2"])):
            for name in names:
                value = float(table[name].iloc[at])
                assert one.content.get(name) == (value if math.isfinite(value) else None), name
    assert {one.content["speed_mps"] for one in read["/signals"]} == {SPEED}


def test_states_and_their_changes(run: Run, read: dict[str, list[Sent]]) -> None:
    assert_ticks(read["/states"])
    for at, one in enumerate(read["/states"]):
        for name in ("state", "reasons", "note", "faults", "emergency", "pose_trusted", "lane", "contacts"):
            assert one.content[name] == run.ticks[name].iloc[at], name
    lines = [(one.content.message, one.content.level, one.content.name) for one in read["/gateway/log"]]
    assert lines == [("ready", 2, "gateway"), ("engaged", 2, "gateway"), ("fault: pose_lost+late", 4, "gateway")]
    assert [one.seconds for one in read["/gateway/log"]] == pytest.approx([0.0, 1.0, 3.0], abs=1e-6)


def test_schemas_say_what_every_field_is(summary: Summary) -> None:
    schemas = {schema.name: schema for schema in summary.schemas.values()}
    assert schemas.keys() == {
        "foxglove.FrameTransforms", "foxglove.PoseInFrame", "foxglove.LocationFix", "foxglove.SceneUpdate",
        "foxglove.PointCloud", "foxglove.Log", "vve_sumo.Signals", "vve_sumo.States", "vve_sumo.CanFrame",
    }  # fmt: skip
    for name in ("vve_sumo.Signals", "vve_sumo.States", "vve_sumo.CanFrame"):
        for field, said in json.loads(schemas[name].data)["properties"].items():
            assert said["description"], (name, field)
            assert said["type"] in ("number", "integer", "string", "boolean", "object")
    signals = json.loads(schemas["vve_sumo.Signals"].data)["properties"]
    assert signals["speed_mps"]["description"].endswith("[m/s]")


def test_the_same_record_has_the_same_bytes(run: Run, file: Path, tmp_path: Path) -> None:
    again, *_ = export(Run(run.folder), "mcap", tmp_path / "again.mcap")
    assert again.read_bytes() == file.read_bytes()
