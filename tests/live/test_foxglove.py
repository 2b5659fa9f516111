"""Topics for Foxglove and Lichtblick of samples that are known, read by a viewer that knows the protocol alone."""

from __future__ import annotations

import asyncio
import json
import math
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pyproj
import pytest
from starlette.routing import WebSocketRoute
from websockets.exceptions import ConnectionClosed, InvalidStatus

from tests.live.foxglove_client import PROTOCOLS, Got, Viewer
from tests.live.patience import until
from tests.report.made import driven
from tests.view.feed import PERIOD, sample
from vve_sumo.live.foxglove_topics import LiveTopics
from vve_sumo.record.roads import read_roads
from vve_sumo.values import ArmingState
from vve_sumo.view import connection, topic_stream
from vve_sumo.view.sample import ViewSample
from vve_sumo.view.server import PageServer
from vve_sumo.view.topic_stream import MAX_RATE, MAX_VIEWERS, MAX_WAITING, TopicStream

TOPICS = ("/tf", "/ego/pose", "/ego/pose_estimated", "/ego/fix", "/scene", "/sensor_radar", "/signals", "/states")
#: that a sample may be taken later than due, at most [s]: viewers and the feed share one interpreter here
STALL = 2.0


class Served:
    """Topics of made-up samples, fifty a second."""

    def __init__(self, record: Path, bodies: int) -> None:
        self.resolved = json.loads((record / "scenario.json").read_text(encoding="utf-8"))
        self.topics = LiveTopics(self.resolved, read_roads(record))
        self.stream = TopicStream(self.topics.topics, self.topics.first, {"scenario": "made"})
        routes = [WebSocketRoute("/foxglove", self.stream.watch)]
        self.server = PageServer(routes, foreign=("foxglove",), max_message=topic_stream.MAX_MESSAGE)
        self.address = f"ws{self.server.address.removeprefix('http')}foxglove"
        self.samples: dict[int, ViewSample] = {}  #: by the tick
        self.late: list[float] = []  #: how much later than due each sample was taken [s]
        self._bodies, self._over = bodies, threading.Event()

    def ns(self, drive_time: float) -> int:
        """Return the Unix time [ns] of a drive time [s]: 18 leap seconds between GNSS time and UTC."""
        return 1000 * round((self.resolved["epoch_gnss_s"] + drive_time + 315_964_800 - 18) * 1e6)

    async def _run(self) -> None:
        serving = asyncio.create_task(self.server.serve())
        tick, due = 0, time.monotonic()
        while not self._over.is_set():
            due += PERIOD
            await asyncio.sleep(max(due - time.monotonic(), 0.0))
            self.late.append(time.monotonic() - due)
            tick += 1
            made = self.samples[tick] = sample(tick, self._bodies)
            self.stream.publish(self.topics.take(made, self.stream.wanted))
        self.stream.end()
        await asyncio.sleep(0.1)
        self.server.close()
        await serving

    def run(self) -> None:
        asyncio.run(self._run())

    def end(self) -> None:
        self._over.set()


@contextmanager
def serving(record: Path, bodies: int = 5) -> Iterator[Served]:
    one = Served(record, bodies)
    thread = threading.Thread(target=one.run, daemon=True)
    thread.start()
    try:
        yield one
    finally:
        one.end()
        thread.join(15.0)
        assert not thread.is_alive()


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return driven(tmp_path_factory, tmp_path_factory.mktemp("topics") / "drive")


@pytest.fixture(scope="module")
def served(record: Path) -> Iterator[Served]:
    with serving(record) as one:
        yield one


@pytest.fixture(scope="module")
def got(served: Served) -> dict[str, list[Got]]:
    """A second of every topic; the first one in which the computer was not so busy that messages were left out."""
    for _ in range(5):
        viewer, found = Viewer(served.address), {topic: [] for topic in (*TOPICS, "/roads")}  # type: dict[str, list[Got]]
        viewer.subscribe(*found)
        while len(found["/states"]) < 50:
            one = viewer.next()
            found[one.topic].append(one)
        viewer.close()
        if not viewer.statuses:
            break
    assert viewer.statuses == []
    return found


def of_ticks(served: Served, messages: list[Got]) -> Iterator[tuple[Got, ViewSample]]:
    """Yield each message with the sample that it is of, by its time; none is missing that was not left out."""
    ticks = {served.ns(one.time): one for one in served.samples.values()}
    found = [ticks[message.time] for message in messages]
    assert len(found) > 40
    missing = found[-1].tick - found[0].tick + 1 - len({one.tick for one in found})
    assert len({one.tick for one in found}) == len(found)
    assert 0 <= missing <= served.stream.left_out
    yield from zip(messages, found, strict=True)


def heading_of(turn: Any) -> float:
    return 2.0 * math.atan2(turn.z, turn.w)


def test_the_ego_is_where_the_pipeline_has_it(served: Served, got: dict[str, list[Got]]) -> None:
    for topic in ("/ego/pose", "/ego/pose_estimated"):
        for message, one in of_ticks(served, got[topic]):
            assert one.pose is not None
            content = message.content
            assert (content.frame_id, content.pose.position.x, content.pose.position.y) == (
                "map",
                one.pose.x,
                one.pose.y,
            )
            assert heading_of(content.pose.orientation) == pytest.approx(one.pose.heading, abs=1e-12)
            assert content.timestamp.seconds * 10**9 + content.timestamp.nanos == message.time
    for message, one in of_ticks(served, got["/tf"]):
        assert one.pose is not None
        ego, radar = message.content.transforms
        assert (ego.parent_frame_id, ego.child_frame_id, ego.translation.x) == ("map", "ego", one.pose.x)
        assert (radar.parent_frame_id, radar.child_frame_id) == ("ego", "sensor_radar")


def test_a_fix_is_where_the_car_is_in_the_lot(served: Served, got: dict[str, list[Got]]) -> None:
    project, turned = pyproj.Proj(served.resolved["lot_projection"]), served.resolved["lot_to_road"]
    for message, one in of_ticks(served, got["/ego/fix"]):
        assert one.pose is not None
        lot = complex(*project(message.content.longitude, message.content.latitude))
        street = lot * np.exp(1j * turned["rotation_rad"]) + complex(turned["x_m"], turned["y_m"])
        assert abs(street - complex(one.pose.x, one.pose.y)) < 1e-6


def test_the_scene_has_the_ego_and_every_actor(served: Served, got: dict[str, list[Got]]) -> None:
    for message, one in of_ticks(served, got["/scene"]):
        assert one.pose is not None
        bodies = {entity.id: entity for entity in message.content.entities}
        assert bodies.keys() == {"ego", *one.actors.ids}
        assert {entity.lifetime.seconds for entity in bodies.values()} == {1}
        for row, name in enumerate(one.actors.ids):
            (cube,) = bodies[name].cubes
            assert (cube.pose.position.x, cube.pose.position.y) == (one.actors.x[row], one.actors.y[row])
            assert (cube.size.x, cube.size.y) == (one.actors.length[row], one.actors.width[row])
        (cube,) = bodies["ego"].cubes
        middle = 0.5 * 4.872 - 1.032  # of the Ford Fusion: half its length less its rear overhang
        assert cube.pose.position.x == pytest.approx(one.pose.x + middle, abs=1e-9)


def test_a_reading_is_a_cloud_at_its_time_of_measurement(served: Served, got: dict[str, list[Got]]) -> None:
    ticks = {served.ns(one.time): one for one in served.samples.values()}
    assert len(got["/sensor_radar"]) > 10
    for message in got["/sensor_radar"]:
        cloud, reading = message.content, ticks[message.time].readings["radar"]
        assert cloud.timestamp.seconds * 10**9 + cloud.timestamp.nanos == served.ns(reading.measured)
        offsets = {field.name: field.offset for field in cloud.fields}
        point = {
            name: np.frombuffer(cloud.data, "<f8", 1, offsets[name])[0] for name in ("x", "y", "range_m", "azimuth_rad")
        }
        assert (point["range_m"], point["azimuth_rad"]) == (20.0, 0.05)
        assert (point["x"], point["y"]) == pytest.approx((20.0 * math.cos(0.05), 20.0 * math.sin(0.05)), abs=1e-9)


def test_signals_and_states_are_numbers_and_texts_of_a_tick(served: Served, got: dict[str, list[Got]]) -> None:
    schemas = {
        topic.name: json.loads(topic.schema) | {"additionalProperties": False}
        for topic in served.topics.topics
        if topic.encoding == "json"
    }
    for message, one in of_ticks(served, got["/signals"]):
        assert one.pose is not None
        jsonschema.validate(message.content, schemas["/signals"])
        assert message.content["tick"] == one.tick
        expected = {
            "x_m": one.pose.x, "speed_mps": 10.0, "acceleration_setpoint_mps2": -1.0, "s_m": 10.0,
            "measured_steering_rad": 0.01, "wheel_speed_mps": 10.0, "latency_s": 0.002, "missed": 0,
        }  # fmt: skip
        assert expected.items() <= message.content.items()
        assert ("strip_gap_m" in message.content) <= (one.tick % 5 == 0)
    for message, _ in of_ticks(served, got["/states"]):
        jsonschema.validate(message.content, schemas["/states"])
        assert message.content["state"] == ArmingState.ENGAGED.value
        assert message.content["note"] == "cruise"
    for schema in schemas.values():
        assert all(said["description"] for said in schema["properties"].values())


def test_roads_come_to_whoever_subscribes_once(served: Served, got: dict[str, list[Got]]) -> None:
    (one,) = got["/roads"]
    lanes, path = one.content.entities
    assert (lanes.id, path.id) == ("lanes", "path")
    points = np.array([(point.x, point.y) for point in path.lines[0].points])
    np.testing.assert_allclose(
        points, [[float(number) for number in point.split()] for point in served.resolved["path_m"]]
    )


def test_changes_of_state_and_bodies_that_leave(record: Path) -> None:
    from dataclasses import replace

    topics = LiveTopics(json.loads((record / "scenario.json").read_text(encoding="utf-8")), read_roads(record))
    names = {topic.name: number for number, topic in enumerate(topics.topics)}
    wanted = [names["/gateway/log"], names["/scene"]]
    from foxglove_schemas_protobuf.Log_pb2 import Log
    from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

    stopping = replace(sample(3).status, state=ArmingState.FAULT, reasons=("pose_lost", "late"))
    taken = [topics.take(one, wanted) for one in (sample(1, 2), sample(2, 1), replace(sample(3, 1), status=stopping))]
    logs = [Log.FromString(one.content) for part in taken for one in part if one.topic == wanted[0]]
    assert [(line.message, line.level) for line in logs] == [
        ("engaged", Log.INFO),
        ("fault: pose_lost+late", Log.ERROR),
    ]
    scenes = [SceneUpdate.FromString(one.content) for part in taken for one in part if one.topic == wanted[1]]
    assert [[gone.id for gone in scene.deletions] for scene in scenes] == [[], ["sedan.1"], []]
    lost = replace(sample(4, 0), pose=None, s=math.nan)
    unknown = {one.topic: one.content for one in topics.take(lost, range(len(names)))}
    assert names["/tf"] not in unknown
    assert "x_m" not in json.loads(unknown[names["/signals"]])


def test_both_names_of_the_protocol_are_spoken_and_no_other(served: Served) -> None:
    for protocol in PROTOCOLS:
        viewer = Viewer(served.address, protocol)
        assert viewer.socket.subprotocol == protocol
        assert viewer.info["capabilities"] == []
        viewer.close()
    with pytest.raises((InvalidStatus, ConnectionClosed)):
        Viewer(served.address, "ros.v1")


def test_the_token_is_needed_and_the_site_is_not_asked_for(served: Served) -> None:
    viewer = Viewer(served.address, origin="https://viewer.example")
    viewer.close()
    token = served.server.token
    for wrong in (served.address.replace(token, token[:-1] + "x"), served.address.replace(f"{token}/", "")):
        with pytest.raises(InvalidStatus, match="403"):
            Viewer(wrong)
    assert served.address.startswith("ws://127.0.0.1:")


@pytest.mark.parametrize(
    "said",
    [
        '{"op": "advertise", "channels": [{"id": 1, "topic": "/cmd", "encoding": "json", "schemaName": "x"}]}',
        '{"op": "setParameters", "parameters": [{"name": "x", "value": 1}]}',
        '{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 9000}]}',
        '{"op": "subscribe", "subscriptions": [{"id": true, "channelId": 1}]}',
        '{"op": "subscribe", "subscriptions": [[]]}',
        '{"op": "unsubscribe", "subscriptionIds": 3}',
        '{"op": "fetchAsset", "uri": "file:///etc/passwd", "requestId": 1}',
        "[" * 3000,
        "not JSON",
        b"\x01\x01\x00\x00\x00{}",
        b"\x02\x01\x00\x00\x00\x01\x00\x00\x00",
    ],
)
def test_whatever_is_no_subscription_is_refused_and_the_topics_go_on(served: Served, said: str | bytes) -> None:
    viewer = Viewer(served.address)
    viewer.socket.send(said)
    refused = viewer.text()
    assert (refused["op"], refused["level"]) == ("status", 2)
    viewer.subscribe("/ego/pose")
    assert viewer.next().topic == "/ego/pose"
    viewer.close()


def test_a_subscription_ends_when_it_is_said(served: Served) -> None:
    viewer = Viewer(served.address)
    viewer.subscribe("/ego/pose", "/states")
    until(lambda: viewer.next().topic == "/ego/pose")
    viewer.unsubscribe("/ego/pose")
    until(lambda: [viewer.next().topic for _ in range(20)] == ["/states"] * 20)
    assert served.stream.wanted == {[topic.name for topic in served.topics.topics].index("/states")}
    viewer.close()
    until(lambda: not served.stream.wanted)


def test_who_floods_is_dropped_and_no_more_than_so_many_watch(served: Served) -> None:
    dropped = served.stream.dropped
    noisy = Viewer(served.address)
    for _ in range(MAX_RATE + 1):
        noisy.socket.send('{"op": "unsubscribe", "subscriptionIds": []}')
    with pytest.raises(ConnectionClosed):
        noisy.text()
    until(lambda: served.stream.dropped == dropped + 1)
    viewers = [Viewer(served.address) for _ in range(MAX_VIEWERS)]
    with pytest.raises(ConnectionClosed):
        Viewer(served.address)
    for viewer in viewers:
        viewer.close()


def test_a_viewer_that_never_reads_slows_nobody_and_its_queue_is_bounded(
    record: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection, "ANSWER_TIMEOUT", 1.0)
    with serving(record, bodies=30) as busy:
        deaf, honest = Viewer(busy.address), Viewer(busy.address)
        deaf.subscribe(*TOPICS)
        honest.subscribe("/states")
        until(lambda: busy.stream.left_out > 0)
        longest = max(len(viewer.waiting) for viewer in busy.stream._viewers)
        assert longest <= MAX_WAITING
        begun, late = len(busy.late), busy.stream.left_out
        until(lambda: honest.next().time > busy.ns(PERIOD * (begun + 1)))
        times = [honest.next().time for _ in range(50)]
        assert np.max(np.diff(times)) == pytest.approx(PERIOD * 1e9)
        assert max(busy.late[begun:]) < STALL
        assert busy.stream.left_out > late
        until(lambda: busy.stream.dropped == 1)  # after the time that an answer may take
        assert honest.next().topic == "/states"
        honest.close()
