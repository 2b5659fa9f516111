"""Sensors of invented makes on the drive's picture, the page, pictures of the record, the report and in MCAP.

Each is one file in `toy/`; nothing else knows them. What is shown is held against the recorded bodies with shapely.
"""

from __future__ import annotations

import io
import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from PIL import Image
from shapely import affinity
from shapely.geometry import Point, Polygon, box

from tests.drive.street import drive_once
from tests.isolated import isolated
from tests.ports.toy_sensors import AHEAD, LISTER
from tests.view.feed import sample
from vve_sumo.analysis import sensor_statistics
from vve_sumo.analysis.run import Run
from vve_sumo.analysis.sensed import pose_at
from vve_sumo.errors import ConfigError
from vve_sumo.export.write import export
from vve_sumo.plotting import drive_page, drive_record, page
from vve_sumo.report.drive import report
from vve_sumo.values import Point as Place
from vve_sumo.values import Pose
from vve_sumo.view.browser import BrowserError, find_browser
from vve_sumo.view.frames import Frames
from vve_sumo.view.live_frame import LiveFrames
from vve_sumo.view.pictures import Pictures
from vve_sumo.view.sample import ReadingView

SENSORS = [
    AHEAD,
    {"name": "around", "kind": LISTER},
    {"name": "fan", "kind": LISTER, "settings": {"rays": True}},
]
NAMES = ["radar", "ahead", "around", "fan"]
#: noise of the toy, and what the estimated pose is wrong by [m]
CLOSE = 0.5
PARKED = "parked_car"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("drawn") / "record"
    changes = {"duration_s": 12.0, "obstacles.0.at_m": 60.0, "criteria": {}, "sensors": SENSORS}
    isolated(drive_once, changes, str(folder))
    return Run(folder)


@pytest.fixture(scope="module")
def parked(run: Run) -> Polygon:
    """The parked car's body in the map."""
    row = next(row for row in run.arrow("actors").to_pylist() if row["actor"] == PARKED)
    half = 0.5 * row["length_m"], 0.5 * row["width_m"]
    body = affinity.rotate(box(-half[0], -half[1], *half), row["heading_rad"], (0, 0), use_radians=True)
    return affinity.translate(body, row["x_m"], row["y_m"])


@pytest.mark.thorough
def test_the_record_alone_says_how_they_are_drawn(run: Run, tmp_path: Path) -> None:
    assert [*run.sensed] == NAMES
    kept = json.loads((run.folder / "scenario.json").read_text(encoding="utf-8"))
    assert kept["drawings"].keys() == {"ahead", "around", "fan"}, "what is shipped needs no word in the record"
    # Nobody needs the sensors' files to look at the record.
    for sensor in kept["settings"]["sensors"]:
        sensor["kind"] = "nowhere.py:make"
    copy = Path(shutil.copytree(run.folder, tmp_path / "copy"))
    (copy / "scenario.json").write_text(json.dumps(kept), encoding="utf-8")
    assert [table.drawing for table in Run(copy).sensed.values()] == [table.drawing for table in run.sensed.values()]


def test_a_drive_s_picture_shows_what_each_measured_and_when_it_first_saw_the_actor(run: Run, parked: Polygon) -> None:
    content = drive_record.page_of(run)
    assert content.main == PARKED
    shown = {one.sensor: one for one in content.sensed}
    assert shown.keys() == {*NAMES}
    (x,), (y,) = shown["ahead"].placed.x.tolist(), shown["ahead"].placed.y.tolist()
    assert parked.exterior.distance(Point(x, y)) < CLOSE
    (corners,) = shown["around"].placed.corners()
    assert Polygon(corners).symmetric_difference(parked).area < 0.2 * parked.area
    assert parked.centroid.distance(Point(shown["fan"].placed.x[0], shown["fan"].placed.y[0])) < CLOSE
    first = {one.sensor: one for one in content.sighted}
    assert [*first] == ["radar", "ahead", "around"], "the fan does not say whom it saw"
    rows = run.sensor("ahead")
    tick = rows[rows["actor"] == PARKED].iloc[0]
    assert first["ahead"].range == tick["range_m"]
    assert first["ahead"].time == run.ticks.set_index("tick")["time_s"][tick["tick"]]
    words = _words(content)
    assert f"ahead first sees it at {first['ahead'].time:.2f} s, {first['ahead'].range:.0f} m ┊" in words
    assert {"sensor radar", "sensor ahead", "sensor around", "sensor fan"} <= {*words}


def _words(content: page.DrivePage) -> list[str]:
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(page.STYLE):
        figure = Figure(figsize=page.SIZE)
        drive_page.paint(figure, content)
    legends = [text for axes in figure.axes if axes.get_legend() for text in axes.get_legend().get_texts()]
    return [text.get_text() for text in (*(text for axes in figure.axes for text in axes.texts), *legends)]


def test_the_page_s_feed_holds_each_one_s_shapes(run: Run, parked: Polygon) -> None:
    frames = Frames(run)
    assert [(sensor["name"], sensor["shape"]) for sensor in frames.scene["sensors"]] == [
        ("radar", "points"), ("ahead", "points"), ("around", "boxes"), ("fan", "rays"),
    ]  # fmt: skip
    columns, texts = frames.columns, [event["text"] for event in frames.scene["events"]]
    assert len(columns["sensed1_x"]) == run.arrow("sensor_ahead").num_rows > 20
    assert [frames.texts["actor"][code] for code in set(columns["sensed1_code"].tolist())] == [PARKED]
    far = [parked.distance(Point(*place)) for place in zip(columns["sensed1_x"], columns["sensed1_y"], strict=True)]
    assert np.median(far) < CLOSE
    assert sum(text.startswith(f"ahead first detects {PARKED} at ") for text in texts) == 1
    # Rays come from the roof: 1.2 m ahead of the rear axle and 0.3 m to its left.
    at = int(columns["sensed3_first"][-2])
    x, y = (float(columns[f"sensed3_origin_{name}"][at]) for name in ("x", "y"))
    tick = int(columns["sensed3_tick"][-1])
    heading = run.ticks["heading_rad"][tick]
    roof = complex(run.ticks["x_m"][tick], run.ticks["y_m"][tick]) + complex(1.2, 0.3) * np.exp(1j * heading)
    assert abs(complex(x, y) - roof) < 1e-3


def test_a_live_page_s_frame_holds_what_the_record_s_does(run: Run) -> None:
    """Each sensor's last reading, sent as a live drive sends it, with the pose of when it was measured."""
    frames, live = Frames(run).columns, LiveFrames(run.resolved, lambda status: str(status["state"]))
    events = []
    for name, table in run.sensed.items():
        rows, measured = table.rows.slice(int(table.first[-2])), table.measured[-1:]
        columns = tuple(rows[column].to_pylist() for column in rows.column_names if column != "tick")
        x, y, heading = pose_at(run, measured)[:, 0].tolist()
        pose = Pose(float(measured[0]), Place.REAR_AXLE, x, y, heading, 0.0, 0.0, 0.0, 0.0, 0.0)
        readings = {name: ReadingView(float(measured[0]), columns)}
        events += live.take(replace(sample(0), time=float(measured[0]), pose=pose, readings=readings))
    frame = live.frame()
    assert frame is not None
    for number, shown in enumerate(frame["sensed"]):
        begin = int(frames[f"sensed{number}_first"][-2])
        for axis in ("x", "y"):
            assert shown[axis] == pytest.approx(frames[f"sensed{number}_{axis}"][begin:].tolist(), abs=0.01)
    assert frame["sensed"][2]["length"] == pytest.approx([4.5], abs=1.0)
    assert any(event["text"].startswith(f"ahead first detects {PARKED}") for event in events)


@pytest.mark.thorough
def test_pictures_of_the_record_draw_them(run: Run) -> None:
    try:
        find_browser()
    except BrowserError as missing:
        pytest.skip(str(missing))
    columns, k = Frames(run).columns, len(run.time) - 1
    with Pictures(run, "street", 320, 240) as pictures:
        shown = pictures.evaluate(f"pictures.frames.frame({k})")["sensed"]
        drawn = _colours(pictures.at(float(run.time[k])))
        assert not pictures.complaints
        bare = "({ frames }) => { frames.frame = ((whole) => (k) => ({ ...whole.call(frames, k), sensed: "
        bare += (
            "whole.call(frames, k).sensed.map((one, n) => (n ? { ...one, x: [], y: [] } : one)) }))(frames.frame); }"
        )
        pictures.evaluate(f"({bare})(pictures)")
        without = _colours(pictures.at(float(run.time[k])))
    assert len(shown) == len(NAMES)
    for number, reading in enumerate(shown):
        begin = int(columns[f"sensed{number}_first"][-2])
        assert reading["x"] == pytest.approx(columns[f"sensed{number}_x"][begin:].tolist())
        assert len(reading["x"]) == 1
    assert (np.abs(drawn - without).sum(axis=2) > 30).sum() > 20


def _colours(picture: bytes) -> Any:
    return np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)


@pytest.mark.thorough
def test_mcap_holds_a_cloud_of_each_and_boxes_and_rays(run: Run, parked: Polygon, tmp_path: Path) -> None:
    (file,) = export(run, "mcap", tmp_path)
    read: dict[str, list[Any]] = {}
    with file.open("rb") as source:
        for _schema, channel, _message, content in make_reader(
            source, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages(topics=["/tf", *(f"/sensor_{name}{end}" for name in NAMES for end in ("", "/shapes"))]):
            read.setdefault(channel.topic, []).append(content)
    assert read.keys() == {
        "/tf", "/sensor_radar", "/sensor_ahead", "/sensor_around", "/sensor_fan", "/sensor_around/shapes",
        "/sensor_fan/shapes",
    }  # fmt: skip
    frames = {one.child_frame_id: one for one in read["/tf"][-1].transforms}
    cloud, truth = read["/sensor_ahead"][-1], run.sensor("ahead")
    offsets = {field.name: field.offset for field in cloud.fields}
    x, y, far = (np.frombuffer(cloud.data, "<f8", 1, offsets[name])[0] for name in ("x", "y", "range_m"))
    assert (x, y) == (far, 0.0)
    assert far == truth["range_m"].iloc[-1]
    assert parked.distance(Point(*_in_map(frames, cloud.frame_id, x, y))) < CLOSE
    (entity,) = read["/sensor_around/shapes"][-1].entities
    (cube,) = entity.cubes
    middle = Point(*_in_map(frames, entity.frame_id, cube.pose.position.x, cube.pose.position.y))
    assert parked.centroid.distance(middle) < CLOSE
    assert cube.size.x * cube.size.y == pytest.approx(parked.area)
    (entity,) = read["/sensor_fan/shapes"][-1].entities
    begin, end = entity.lines[0].points
    assert (begin.x, begin.y) == (0.0, 0.0)
    assert parked.centroid.distance(Point(*_in_map(frames, entity.frame_id, end.x, end.y))) < CLOSE


def _in_map(frames: dict[str, Any], name: str, x: float, y: float) -> tuple[float, float]:
    """Lead a point from a frame to the map, by the transforms of the file."""
    place = complex(x, y)
    while name != "map":
        frame = frames[name]
        turn = 2.0 * math.atan2(frame.rotation.z, frame.rotation.w)
        place = place * np.exp(1j * turn) + complex(frame.translation.x, frame.translation.y)
        name = frame.parent_frame_id
    return place.real, place.imag


@pytest.mark.thorough
def test_the_report_has_a_section_of_each_that_says_whom_it_saw(run: Run) -> None:
    sections = report(run).content["sensors"]
    assert isinstance(sections, list)
    assert [section["name"] for section in sections] == ["radar", "ahead", "around"]
    shown = sensor_statistics(run, "ahead")
    assert shown.loc[PARKED, "scans_detected"] == len(run.sensor("ahead"))
    assert not {"scans_visible", "range_error_mean_m", "range_rate_error_mean_mps"} & {*shown.columns}
    with pytest.raises(
        ConfigError, match=r"^sensor 'fan' does not say whom it saw, expected radar or ahead or around$"
    ):
        sensor_statistics(run, "fan")
    # Of boxes the middle is measured, and no error can be held against the nearest point.
    around = sensor_statistics(run, "around")
    assert around.loc[PARKED, "detected_share"] == 1.0
    assert not {"range_error_mean_m", "range_rate_error_mean_mps"} & {*around.columns}
    assert {"range_error_mean_m", "range_rate_error_mean_mps"} <= {*sensor_statistics(run, "radar").columns}
