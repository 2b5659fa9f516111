"""Scene and frames of a record, against the record's own tables read without the program."""

from __future__ import annotations

import json
import math
from collections import Counter
from itertools import pairwise

import numpy as np
import pyarrow.parquet as pq
import pytest

from tests.view.made import Made, taken_apart
from vve_sumo.analysis.run import Run
from vve_sumo.view.details import details
from vve_sumo.view.frames import Frames

#: of 32-bit numbers in a map of a few kilometres [m]
EXACT = 5e-4


@pytest.fixture(scope="module")
def frames(made: Made) -> Frames:
    return Frames(Run(made.traffic))


def test_the_ego_is_where_the_record_has_it(made: Made, frames: Frames) -> None:
    _head, columns = taken_apart(frames.packed())
    ticks = pq.read_table(made.traffic / "ticks.parquet").to_pydict()
    assert columns["t"].tolist() == ticks["time_s"]
    # A simulated vehicle's truth is known.
    for name, column in (
        ("x", "true_x_m"),
        ("y", "true_y_m"),
        ("heading", "true_heading_rad"),
        ("speed", "true_speed_mps"),
    ):
        np.testing.assert_allclose(columns[name], ticks[column], atol=EXACT)
    np.testing.assert_allclose(columns["wished"], ticks["acceleration_setpoint_mps2"], atol=1e-5)
    np.testing.assert_allclose(columns["yaw_rate"], ticks["yaw_rate_radps"], atol=1e-5)


def test_every_state_reason_and_note_is_the_records(made: Made, frames: Frames) -> None:
    head, columns = taken_apart(frames.packed())
    ticks = pq.read_table(made.traffic / "ticks.parquet").to_pydict()
    for name, column in (("state", "state"), ("reason", "reasons"), ("note", "note")):
        assert [head["texts"][name][code] for code in columns[name].tolist()] == ticks[column]


def test_actors_of_every_tick_are_the_records(made: Made, frames: Frames) -> None:
    head, columns = taken_apart(frames.packed())
    actors, ticks = (pq.read_table(made.traffic / f"{name}.parquet").to_pylist() for name in ("actors", "ticks"))
    wanted: dict[int, dict[str, tuple[float, float, float]]] = {}
    for row in actors:
        wanted.setdefault(row["tick"], {})[row["actor"]] = (row["x_m"], row["y_m"], row["heading_rad"])
    assert sum(map(len, wanted.values())) > len(ticks)
    first = columns["actor_first"].tolist()
    for (begin, end), tick in zip(pairwise(first), ticks, strict=True):
        names = [head["texts"]["actor"][code] for code in columns["actor_code"][begin:end].tolist()]
        there = zip(*(columns[f"actor_{name}"][begin:end].tolist() for name in ("x", "y", "heading")), strict=True)
        here = wanted.get(tick["tick"], {})
        assert Counter(names) == Counter(here.keys())
        for name, place in zip(names, there, strict=True):
            assert place == pytest.approx(here[name], abs=EXACT)


def test_returns_lie_on_what_they_are_of(made: Made, frames: Frames) -> None:
    """A return without noise would lie on the rim of the actor's box; the radar's noise is a fraction of a metre."""
    head, columns = taken_apart(frames.packed())
    ticks = pq.read_table(made.traffic / "ticks.parquet").to_pydict()
    boxes: dict[tuple[int, str], dict[str, float]] = {
        (row["tick"], row["actor"]): row for row in pq.read_table(made.traffic / "actors.parquet").to_pylist()
    }
    measured = columns["sensed0_measured"].astype(float)
    far = []
    for scan, (begin, end) in enumerate(pairwise(columns["sensed0_first"].tolist())):
        tick = ticks["tick"][int(np.argmin(np.abs(np.array(ticks["time_s"]) - measured[scan])))]
        for row in range(begin, end):
            box = boxes[tick, head["texts"]["actor"][int(columns["sensed0_code"][row])]]
            east, north = columns["sensed0_x"][row] - box["x_m"], columns["sensed0_y"][row] - box["y_m"]
            cos, sin = math.cos(box["heading_rad"]), math.sin(box["heading_rad"])
            along, across = abs(east * cos + north * sin), abs(north * cos - east * sin)
            outside = math.hypot(max(along - box["length_m"] / 2, 0.0), max(across - box["width_m"] / 2, 0.0))
            far.append(outside)
    assert len(far) == pq.read_table(made.traffic / "sensor_radar.parquet").num_rows > 300
    assert np.median(far) < 0.5
    assert np.quantile(far, 0.95) < 2.5  # half a degree of noise at 140 m


@pytest.mark.thorough
def test_a_seen_actor_is_not_among_the_unseen_and_why_is_found_by_rays(made: Made, frames: Frames) -> None:
    head, columns = taken_apart(frames.packed())
    why, found = taken_apart(details(Run(made.traffic)))
    ticks = pq.read_table(made.traffic / "ticks.parquet").to_pydict()
    actors: dict[int, list[dict[str, float]]] = {}
    for row in pq.read_table(made.traffic / "actors.parquet").to_pylist():
        actors.setdefault(row["tick"], []).append(row)
    vehicle = Run(made.traffic).vehicle
    ahead = vehicle.rear_axle_to_bumper - 0.1
    reasons: Counter[str] = Counter()
    for scan, (begin, end) in enumerate(pairwise(found["unseen0_first"].tolist())):
        at = int(np.argmin(np.abs(np.array(ticks["time_s"]) - columns["sensed0_measured"][scan])))
        heading = ticks["heading_rad"][at]
        antenna = (ticks["x_m"][at] + ahead * math.cos(heading), ticks["y_m"][at] + ahead * math.sin(heading))
        rays = lit(antenna, heading, actors.get(ticks["tick"][at], []))
        here = slice(columns["sensed0_first"][scan], columns["sensed0_first"][scan + 1])
        seen = {head["texts"]["actor"][code] for code in columns["sensed0_code"][here].tolist()}
        for row in range(begin, end):
            name = head["texts"]["actor"][found["unseen0_code"][row]]
            reason = why["texts"]["why"][found["unseen0_why"][row]]
            assert name not in seen
            reasons[reason] += 1
            # A ray every 0.01 degree may pass a body that is seen through a gap narrower than that.
            assert rays.get(name, 0) <= 2 if reason == "occluded" else rays.get(name, 0) >= 1, (scan, name, reason)
    assert reasons["occluded"] >= 10
    assert reasons["missed"] >= 10


def lit(antenna: tuple[float, float], heading: float, actors: list[dict[str, float]]) -> Counter[str]:
    """How many rays of a fan, every 0.01 degree, end on each actor within the radar's field of view."""
    angles = np.radians(np.arange(-45.0, 45.0, 0.01))
    reach = np.where(np.abs(angles) <= math.radians(10.0), 174.0, 60.0)
    nearest, owner = reach.copy(), np.full(len(angles), -1)
    for number, box in enumerate(actors):
        turn = heading - box["heading_rad"]
        cos, sin = math.cos(box["heading_rad"]), math.sin(box["heading_rad"])
        east, north = antenna[0] - box["x_m"], antenna[1] - box["y_m"]
        x, y = east * cos + north * sin, north * cos - east * sin
        dx, dy = np.cos(angles + turn), np.sin(angles + turn)
        with np.errstate(divide="ignore"):
            one, two = (-box["length_m"] / 2 - x) / dx, (box["length_m"] / 2 - x) / dx
            three, four = (-box["width_m"] / 2 - y) / dy, (box["width_m"] / 2 - y) / dy
        enter = np.maximum(np.minimum(one, two), np.minimum(three, four))
        leave = np.minimum(np.maximum(one, two), np.maximum(three, four))
        hit = (enter <= leave) & (enter > 0.0) & (enter < nearest)
        nearest[hit], owner[hit] = enter[hit], number
    return Counter(str(actors[number]["actor"]) for number in owner[owner >= 0].tolist())


def test_the_scene_says_what_stands_still(made: Made, frames: Frames) -> None:
    scene = json.loads(json.dumps(frames.scene, allow_nan=False))
    resolved = json.loads((made.traffic / "scenario.json").read_text(encoding="utf-8"))
    lanes = pq.read_table(made.traffic / "roads.parquet").to_pylist()
    assert [lane["id"] for lane in scene["lanes"]] == [lane["lane"] for lane in lanes]
    assert scene["lanes"][3]["points"][0] == pytest.approx([lanes[3]["x_m"][0], lanes[3]["y_m"][0]], abs=EXACT)
    path = [tuple(map(float, point.split())) for point in resolved["path_m"]]
    assert scene["path"][0] == pytest.approx(path[0], abs=0.01)
    assert scene["path"][-1] == pytest.approx(path[-1], abs=0.6)
    length = sum(math.dist(*ends) for ends in pairwise(scene["path"]))
    assert length == pytest.approx(scene["path_length"], abs=0.6)
    line = scene["stop_line"]
    front = resolved["vehicle"]["wheelbase"] + resolved["vehicle"]["front_overhang"]
    assert math.dist((line["x"], line["y"]), path[-1]) == pytest.approx(front, abs=0.01)
    assert scene["actors"]["child"]["kind"] == "child"
    assert scene["lot"] is None
    (sensor,) = scene["sensors"]
    assert sensor["name"] == "radar"
    assert sensor["view"] == {"forward": pytest.approx(front - 0.1), "left": 0.0, "yaw": 0.0}
    assert sensor["sectors"] == [
        {"range": 174.0, "half_angle": pytest.approx(math.radians(10.0))},
        {"range": 60.0, "half_angle": pytest.approx(math.radians(45.0))},
    ]


def test_events_are_in_order_and_name_what_the_record_holds(made: Made, frames: Frames) -> None:
    events = frames.scene["events"]
    assert [one["time"] for one in events] == sorted(one["time"] for one in events)
    texts = [one["text"] for one in events]
    notes = pq.read_table(made.traffic / "ticks.parquet")["note"].to_pylist()
    changes = [now for before, now in pairwise(notes) if now and now != before]
    assert [text.removeprefix("controller: ") for text in texts if text.startswith("controller: ")] == changes
    assert sum(text.startswith("radar first detects child") for text in texts) == 1
    assert texts[-1].startswith("end: ")
    # The engaged car is held at first, and then drives.
    assert any(text.startswith("held: ") for text in texts)
    assert "driving" in texts


def test_the_gap_at_the_end_is_the_summarys(made: Made) -> None:
    _head, columns = taken_apart(details(Run(made.drive)))
    summary = json.loads((made.drive / "summary.json").read_text(encoding="utf-8"))
    assert columns["gap"][-1] == pytest.approx(summary["stop_gap_m"], abs=0.05)
    assert len(columns["gap"]) == summary["ticks"]
