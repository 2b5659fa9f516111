"""Real stations on a real virtual road: what the ego's sensors are handed of them, what is recorded, and its replay."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.parquet as pq
import pytest

from tests.conftest import REPOSITORY
from tests.isolated import isolated
from tests.once import once
from tests.stations.messages import EPOCH, car, packet
from vve_sumo.drive.replay_stations import replay_stations
from vve_sumo.frames import Alignment
from vve_sumo.record.reader import read_table
from vve_sumo.stations.received_stations import StationsSetup
from vve_sumo.stations.station_gate import GateLimits
from vve_sumo.v2x.pdu_header import MessageId

PERIOD = 0.02
TICKS = 400


class Road(NamedTuple):
    """A road on which a real station drove ahead of the ego, and its record."""

    folder: Path
    seen: list[dict[str, Any]]


def _drive(folder: str) -> None:
    """The ego stands at its path's start; a station comes towards it along the path, 40 m to 10 m ahead, at 4 m/s."""
    from vve_sumo.drive.run import resolve_by_name
    from vve_sumo.drive.stations_on_road import StationsOnRoad
    from vve_sumo.drive.virtual_road import VirtualRoad, open_world, scenario_engine
    from vve_sumo.record.writer import RecordWriter
    from vve_sumo.stations.received_stations import ReceivedStations
    from vve_sumo.stations.reports import read
    from vve_sumo.values import EGO, Point, Pose

    resolved = resolve_by_name("parked_car", REPOSITORY)
    frame, begin = resolved.map_frame, resolved.path.at(0.0)
    setup = StationsSetup(frame.projection, frame.offset, Alignment(), (begin.x, begin.y), EPOCH, GateLimits())
    content = resolved.to_dict(REPOSITORY) | {"stations": setup.to_dict()}
    Path(folder).mkdir(parents=True)
    record = RecordWriter(Path(folder), content, EPOCH)
    road = VirtualRoad(open_world(resolved), scenario_engine(resolved), waits=True)
    stations = StationsOnRoad(ReceivedStations(setup), record)
    road.admit_stations(stations)
    seen = []
    for tick in range(TICKS):
        time = PERIOD * tick
        if tick % 5 == 0 and time < 6.0:
            s = 45.0 - 4.0 * time
            at = resolved.path.at(s)
            # It faces the ego: its front is nearer than its middle.
            datagram = car(time, at.x, at.y, at.heading + math.pi, 4.0, frame=frame)
            stations.receive(time + 0.004, datagram, read(datagram, time + 0.004, EPOCH))
        if tick % 50 == 0:
            for bad in (b"no packet", packet(MessageId.DENM, b"none"), packet(MessageId.CAM, b"\xff" * 40)):
                stations.receive(time + 0.005, bad, read(bad, time + 0.005, EPOCH))
        pose = Pose(time + PERIOD, Point.FRONT_BUMPER, begin.x, begin.y, begin.heading, 0.0, 0.0, 0.0, 0.0, 0.0)
        road.advance({EGO: pose})
        actors = road.around[EGO].actors
        rows = [row for row, name in enumerate(actors.ids) if name == "station.4711"]
        seen.append(
            {"time": actors.time, "faults": list(road.around[EGO].faults)}
            | ({"x": float(actors.x[rows[0]]), "y": float(actors.y[rows[0]]), "speed": float(actors.speed[rows[0]]),
                "kind": int(actors.kind[rows[0]])} if rows else {})
        )  # fmt: skip
    road.close()
    record.close()
    path = [(s, *(getattr(resolved.path.at(s), name) for name in ("x", "y", "heading"))) for s in range(60)]
    (Path(folder) / "seen.json").write_text(json.dumps({"seen": seen, "path": path}))


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> Road:
    folder = once(tmp_path_factory, "stations_on_road", lambda where: isolated(_drive, str(where)))
    return Road(folder, json.loads((folder / "seen.json").read_text())["seen"])


def test_a_station_is_an_actor_where_it_says(road: Road) -> None:
    path = json.loads((road.folder / "seen.json").read_text())["path"]
    there = [one for one in road.seen if "x" in one]
    assert there[0]["time"] == pytest.approx(0.12, abs=0.021)  # after its second message
    moving = [one for one in there if one["time"] < 5.9]
    assert len(moving) == len([one for one in road.seen if 0.11 < one["time"] < 5.9])
    for one in moving:
        s = 45.0 - 4.0 * one["time"] + 2.25  # of its middle
        low = path[int(s)]
        x, y = low[1] + (s - int(s)) * math.cos(low[3]), low[2] + (s - int(s)) * math.sin(low[3])
        assert math.hypot(one["x"] - x, one["y"] - y) < 0.15
        assert (one["speed"], one["kind"]) == (4.0, 0)


def test_it_leaves_when_it_has_fallen_silent(road: Road) -> None:
    last = max(one["time"] for one in road.seen if "x" in one)
    assert last == pytest.approx(5.9 + 2.0, abs=0.05)
    assert not any(one["faults"] for one in road.seen)


def test_raw_bytes_and_bodies_are_recorded(road: Road) -> None:
    datagrams = read_table(road.folder, "station_datagrams").to_pylist()
    assert [row["refused"] for row in datagrams].count("") == 60
    assert [row["refused"] for row in datagrams].count("malformed") == 8 * 2
    assert [row["refused"] for row in datagrams].count("no_body") == 8
    assert {row["station"] for row in datagrams} == {4711, -1}
    bodies = read_table(road.folder, "stations").to_pylist()
    seen = {round(one["time"], 6): one for one in road.seen if "x" in one}
    assert {round(row["time_s"], 6) for row in bodies} == set(seen)
    for row in bodies:
        assert (row["x_m"], row["y_m"]) == (seen[round(row["time_s"], 6)]["x"], seen[round(row["time_s"], 6)]["y"])


def test_a_replay_of_the_bytes_gives_the_same_bodies_bit_for_bit(road: Road) -> None:
    assert replay_stations(road.folder) is None


@pytest.mark.parametrize("table", ["station_datagrams", "stations"])
def test_a_replay_notices_what_differs(road: Road, tmp_path: Path, table: str) -> None:
    for file in road.folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    read = pq.read_table(tmp_path / f"{table}.parquet")
    rows = read.to_pylist()
    if table == "stations":
        rows[50]["x_m"] = math.nextafter(rows[50]["x_m"], math.inf)
    else:
        spoilt = bytearray(rows[10]["datagram"])
        spoilt[-12] ^= 4
        rows[10]["datagram"] = bytes(spoilt)
    pq.write_table(type(read).from_pylist(rows, read.schema), tmp_path / f"{table}.parquet")
    assert replay_stations(tmp_path) is not None
