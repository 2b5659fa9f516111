"""Actors that keep to their lanes: against the lanes' own geometry."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest

from tests.metrics.tables import CAR, PERIOD, actors_of, straight, ticks_of
from vve_sumo.metrics.drive_data import DriveData
from vve_sumo.metrics.lanes import LaneGraph
from vve_sumo.metrics.predicted_ways import WayLine, Ways

#: centre lines; the ego's path is y = 0, and the lane side_0 forks into left_0, straight on, and right_0, to the path
LINES = {
    "own_0": ([0.0, 300.0], [0.0, 0.0], []),
    "next_0": ([0.0, 300.0], [3.5, 3.5], []),
    "side_0": ([80.0, 80.0], [60.0, 30.0], [":fork_0_0", ":fork_1_0"]),
    ":fork_0_0": ([80.0, 80.0], [30.0, 20.0], ["on_0"]),
    "on_0": ([80.0, 80.0], [20.0, -60.0], []),
    ":fork_1_0": ([80.0, 78.0, 72.0, 70.0], [30.0, 25.0, 21.0, 20.0], ["away_0"]),
    "away_0": ([70.0, 0.0], [20.0, 20.0], []),
}
ROADS = pa.Table.from_pylist(
    [
        {"lane": lane, "kind": "junction" if lane[0] == ":" else "lane", "width_m": 3.2, "x_m": x, "y_m": y}
        | {"successors": after}
        for lane, (x, y, after) in LINES.items()
    ]
)
BUMPER = 20.0 + CAR.rear_axle_to_bumper


def driven(track: list[tuple[float, float, float]], speed: float, other: float, length: float = 4.0) -> DriveData:
    """A drive whose first tick is judged: the ego at 20 m, an actor that is put along a track (x, y, heading) later."""
    unknown = {"true_x_m": math.nan, "x_m": math.nan, "s_m": math.nan}
    ego = [{"time_s": PERIOD * i, **unknown} for i in range(len(track))]
    ego[0] = {"true_x_m": 20.0, "s_m": 20.0, "true_speed_mps": speed}
    actors = [
        {"tick": i, "actor": "other", "x_m": x, "y_m": y, "heading_rad": heading, "speed_mps": other}
        | {"length_m": length}
        for i, (x, y, heading) in enumerate(track)
    ]
    return DriveData(ticks_of(ego), actors_of(actors), straight(), CAR, PERIOD, ROADS)


def test_one_that_will_change_into_the_egos_lane_is_no_conflict_before_its_body_is_there() -> None:
    """Where it keeps to no lane, as a pedestrian does, the way that it took later counts at once."""
    track = [(BUMPER + 15.0 + 0.1 * i, max(0.0, 3.5 - 0.05 * max(0, i - 10)), 0.0) for i in range(600)]
    assert math.isnan(driven(track, 12.0, 5.0).conflict.time[0])
    assert math.isfinite(driven(track, 12.0, 5.0, length=0.5).conflict.time[0])
    # Half way between two lanes its body is in the ego's way, and stays there.
    beside = [(BUMPER + 15.0 + 0.1 * i, 1.7, 0.0) for i in range(10)]
    gap = 15.0 - 2.0
    assert driven(beside, 12.0, 5.0).conflict.time[0] == pytest.approx(gap / 7.0, abs=1e-3)


@pytest.mark.parametrize(("taken", "meets"), [("on_0", True), ("away_0", False), ("none", True)])
def test_at_a_fork_the_branch_counts_that_was_taken_later_else_the_straightest(taken: str, meets: bool) -> None:
    """It comes from the side and is 57 m before the ego's path, where both would be at the same time."""
    side = [(80.0, 57.0 - 0.3 * i, -math.pi / 2) for i in range(80)]
    onward = {
        "on_0": [(80.0, 33.0 - 0.3 * i, -math.pi / 2) for i in range(1, 80)],
        "away_0": [(80.0, 31.0, -1.6), (79.2, 28.0, -1.8), (78.0, 25.0, -2.0), (75.0, 23.0, -2.4), (72.0, 21.0, -2.6)]
        + [(70.0 - 0.3 * i, 20.0, math.pi) for i in range(80)],
        "none": [],
    }[taken]
    drive = driven(side[:10] if taken == "none" else side + onward, 10.0, 10.0)
    assert np.isfinite(drive.conflict.time[0]) == meets


#: a side road whose lane leads into three connections that lie upon each other at first: straight on, right, left
FAN = {
    "in_0": ([80.0, 80.0], [70.0, 30.0], [":j_0_0", ":j_1_0", ":j_2_0"]),
    "out_0": ([80.0, 80.0], [-10.0, -90.0], []),
}
FAN |= {":j_0_0": ([80.0, 80.0], [30.0, -10.0], ["out_0"])}
for number, side in ((1, -1.0), (2, 1.0)):
    turn = np.linspace(0.0, math.pi / 2.0, 12)
    bend = (80.0 + side * 22.0 * (1.0 - np.cos(turn))).tolist(), (30.0 - 22.0 * np.sin(turn)).tolist()
    FAN |= {f":j_{number}_0": (*bend, [f"away{number}_0"])}
    FAN |= {f"away{number}_0": ([bend[0][-1], bend[0][-1] + side * 60.0], [bend[1][-1]] * 2, [])}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(("beside", "sway"), [(-0.6, 0.0), (0.6, 0.0), (0.6, 0.05)])
def test_at_constant_motion_the_time_to_collision_falls_steadily_also_where_lanes_fan_out(
    beside: float, sway: float
) -> None:
    """It goes straight on, a little beside the middle of its lane, nearer to one of the branches for a while."""
    count, speed, other = 400, 5.0, 7.0
    rows = [
        {"time_s": PERIOD * i, "true_x_m": 40.0 + speed * PERIOD * i, "s_m": 40.0 + speed * PERIOD * i}
        | {"true_speed_mps": speed}
        for i in range(count)
    ]
    actors = [
        {"tick": i, "actor": "other", "x_m": 80.0 + beside + sway * math.sin(0.1 * i), "y_m": 52.0 - other * PERIOD * i}
        | {"heading_rad": -math.pi / 2, "speed_mps": other}
        for i in range(count)
    ]
    roads = pa.Table.from_pylist(
        [
            {"lane": lane, "kind": "junction" if lane[0] == ":" else "lane", "width_m": 3.2, "x_m": x, "y_m": y}
            | {"successors": after}
            for lane, (x, y, after) in FAN.items()
        ]
    )
    drive = DriveData(ticks_of(rows), actors_of(actors), straight(), CAR, PERIOD, roads)
    found = drive.conflict.time
    meets = np.flatnonzero(found > 0.0)
    assert len(meets) > 300
    assert (np.diff(meets) == 1).all()
    np.testing.assert_allclose(np.diff(found[meets]), -PERIOD, atol=0.02 * sway / 0.05 + 1e-3)


def test_an_actor_is_in_the_nearest_lane_that_goes_its_way() -> None:
    lanes, names = LaneGraph.from_table(ROADS), [*LINES]
    places = [(50.0, 0.3, 0.0), (50.0, 2.0, 0.0), (50.0, 0.0, math.pi), (50.0, 6.0, 0.0), (80.0, 0.0, -math.pi / 2)]
    ways = Ways.from_lines(
        [WayLine(x + math.cos(to) * np.arange(3.0), y + math.sin(to) * np.arange(3.0)) for x, y, to in places]
    )
    found = [names[lane] if lane >= 0 else "" for lane in lanes.along(ways, ways.count)[ways.first]]
    assert found == ["own_0", "next_0", "", "", "on_0"]


def test_where_an_actor_is_on_its_lane_its_box_is_where_it_was() -> None:
    """Whatever its place and turn in the lane: with both at rest nothing is predicted but what is."""
    for y, heading in ((3.9, 0.2), (3.0, -0.3), (1.9, 0.0)):
        drive = driven([(BUMPER + 10.0, y, heading)], 8.0, 0.0)
        bare = DriveData(drive.ticks, drive.actors, drive.path, CAR, PERIOD)
        np.testing.assert_allclose(drive.conflict.time, bare.conflict.time, rtol=1e-6)


def test_a_table_without_lanes_is_as_none() -> None:
    drive = driven([(BUMPER + 10.0, 0.0, 0.0)], 8.0, 3.0)
    drive.roads = ROADS.slice(0, 0)
    assert drive.conflict.time[0] == pytest.approx(8.0 / 5.0, rel=1e-6)
