"""Giving way, closed loop: a car before others who are told of by messages, and lines of sight by the lidar itself."""

from __future__ import annotations

import dataclasses
import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controllers.approach import NOWHERE, Approach, Goal, Standstill
from controllers.follow_and_stop import PERIOD, make
from controllers.give_way import GiveWay
from controllers.junction_ways import JunctionWatch
from controllers.others_on_ways import LidarMount, OthersOnWays
from controllers.signal_stop import Line
from tests.controllers.bench import CAR
from vve_sumo.geometry import Box, overlap
from vve_sumo.junctions import Control, Junction, JunctionWay
from vve_sumo.path import ReferencePath
from vve_sumo.sensors.lidar import Lidar, LidarConfig
from vve_sumo.sensors.right_of_way import RightOfWayConfig, RightOfWaySense
from vve_sumo.sensors.street import Building, walls_of
from vve_sumo.values import Actors, Observation, Point, PointCloud, Pose, SensorOutput, Stations

BUMPER = CAR.rear_axle_to_bumper
LIMIT = 11.0
LINE = 60.0  #: of the ego, along its path, which is the x axis [m]
LANE = 66.0  #: where the lane lies that crosses it northward [m]
PATH = ReferencePath.from_points(np.arange(0.0, 200.0, 2.0), np.zeros(100))
LAID = (LidarMount(1.4, 1.9, 90.0), 1.0, 1.0)


def crossing(control: Control, *, from_south: bool = True) -> Junction:
    """The ego's way is the x axis; others come on the line x = LANE."""
    own = JunctionWay("own", "beyond", control, ((0.0, 0.0), (120.0, 0.0)), LINE, 75.0, 3.5, LIMIT, LIMIT, False, (1,))
    side = -1.0 if from_south else 1.0
    points = ((LANE, side * 150.0), (LANE, -side * 60.0))
    other = JunctionWay("a", "b", Control.NONE, points, 140.0, 160.0, 3.5, LIMIT, LIMIT, False, ())
    return Junction("crossing", (own, other))


def free_turn(time: float) -> PointCloud:
    """A turn of the lidar from which nothing came back: everything is in sight, and nobody there."""
    elevations = LidarConfig().elevations
    count = 180
    azimuth = math.pi - math.tau / count * np.arange(count)
    ranges = np.zeros((count, len(elevations)))
    zeros = np.zeros(len(elevations))
    return PointCloud(time, azimuth, zeros, np.array(elevations), np.zeros(count), ranges, ranges.astype(np.int8))


def told(time: float, pose: Pose, y: float, speed: float) -> Stations:
    """A message of a car on the crossing lane, its middle at y [m]; the ego looks along +x."""
    values = {
        "number": [7], "message": [2], "kind": [0], "age": [0.0], "latitude": [0.0], "longitude": [0.0],
        "x": [LANE - pose.x - BUMPER], "y": [y - pose.y], "heading": [0.5 * math.pi], "true_heading": [0.0],
        "speed": [speed], "yaw_rate": [0.0], "acceleration": [0.0], "length": [4.8], "width": [1.8],
        "uncertainty": [0.5],
    }  # fmt: skip
    return Stations(time, **{name: np.array(column) for name, column in values.items()})


class Drive:
    """A car that goes along the x axis by what `GiveWay` says, and otherwise keeps its speed."""

    def __init__(self, junction: Junction, speed: float, desired: float = 10.0) -> None:
        self.sense = RightOfWaySense(RightOfWayConfig(120.0, 10.0), CAR, (junction,))
        (lidar, margin, over), self.desired = LAID, desired
        self.law, self.approach = GiveWay(CAR, PERIOD, margin, over, lidar), Approach(CAR, 2.0, PERIOD)
        self.standstill = Standstill(PERIOD)
        self.s, self.speed, self.acceleration, self.time = 5.0, speed, 0.0, 0.0
        self.sent = deque([0.0] * round(CAR.brake_delay / PERIOD))
        self.turn = free_turn(0.0)
        self.signal: Line | None = None

    def at(self, s: float) -> tuple[float, float]:
        return self.desired, 0.0

    def step(self, y: float | None = None, speed: float = 0.0) -> Goal:
        """Go on for a tick; somebody may be at y on the crossing lane."""
        pose = Pose(self.time, Point.REAR_AXLE, self.s, 0.0, 0.0, self.speed, 0.0, 0.0, self.acceleration, 0.0)
        self.sense.step(self.time, pose, Actors.none(self.time))
        if self.time - self.turn.time >= 0.1 - 1e-9:
            self.turn = dataclasses.replace(self.turn, time=self.time)
        outputs: dict[str, SensorOutput] = {"priorities": self.sense.output, "roof": self.turn}
        if y is not None:
            outputs["obu"] = told(self.time, pose, y, speed)
        seen = Observation(0, self.time, pose, PATH, self.desired, outputs, 0.0)
        goal = self.law.goal(seen, self.s, self.signal, self)
        command = min(1.5, self.desired - self.speed)
        if goal is not NOWHERE:
            command = min(command, self.approach.acceleration(goal, self.speed, self.acceleration))
        last_bit = self.approach.is_last_bit(goal, self.speed, self.acceleration)
        held = self.standstill.step(goal.distance, self.speed, last_bit, at_once=self.law.sets_out)
        self.sent.append(max(command if held is None else held, -3.3))
        self.acceleration += (self.sent.popleft() - self.acceleration) * PERIOD / (CAR.brake_lag + PERIOD)
        self.speed = max(self.speed + self.acceleration * PERIOD, 0.0)
        self.s, self.time = self.s + self.speed * PERIOD, self.time + PERIOD
        return goal

    @property
    def body(self) -> Box:
        return Box(self.s + BUMPER - 0.5 * CAR.length, 0.0, 0.0, CAR.length, CAR.width)


def test_it_stops_at_a_stop_sign_where_nobody_comes_and_goes_on() -> None:
    drive, slowest, where = Drive(crossing(Control.STOP), 10.0), math.inf, 0.0
    while drive.s < 90.0 and drive.time < 60.0:
        drive.step()
        if drive.speed < slowest:
            slowest, where = drive.speed, drive.s
    assert slowest < 0.05
    assert 0.5 < LINE - where - BUMPER < 2.0
    assert drive.time < 30.0


@pytest.mark.parametrize("control", [Control.NONE, Control.YIELD])
def test_it_does_not_stop_at_a_minor_road_where_nobody_comes(control: Control) -> None:
    junction = crossing(control)
    if control is Control.NONE:
        own, other = junction.ways
        junction = Junction("crossing", (dataclasses.replace(own, prior=()), other))
    drive, slowest = Drive(junction, 8.0, 8.0), math.inf
    while drive.s < 90.0 and drive.time < 60.0:
        drive.step()
        slowest = min(slowest, drive.speed)
    assert slowest > (7.9 if control is Control.NONE else 3.0)


@settings(deadline=None, max_examples=8)
@given(
    arrives=st.floats(0.0, 25.0),
    speed=st.floats(3.0, 1.09 * LIMIT),
    desired=st.floats(4.0, 12.0),
    control=st.sampled_from([Control.STOP, Control.YIELD, Control.EQUAL]),
)
def test_who_goes_first_is_never_met_and_the_car_crosses(
    arrives: float, speed: float, desired: float, control: Control
) -> None:
    """Another keeps its speed and is where the ways cross at a given time; it looks at nobody."""
    drive, stood_inside = Drive(crossing(control), desired, desired), False
    while drive.s < 90.0 and drive.time < 90.0:
        y = speed * (drive.time - arrives)
        drive.step(y if abs(y) < 140.0 else None, speed)
        assert not overlap(drive.body, Box(LANE, y, 0.5 * math.pi, 4.8, 1.8))
        front = drive.s + BUMPER
        stood_inside |= drive.speed < 0.05 and LANE - 0.9 < front < LANE + 0.9 + CAR.length
    assert drive.s >= 90.0
    assert not stood_inside


@pytest.mark.parametrize(("phase", "waits"), [(3, False), (5, True), (6, False), (8, True), (9, True)])
def test_at_a_signal_it_waits_for_a_gap_unless_the_signal_stops_it_or_nobody_else_may_go(
    phase: int, waits: bool
) -> None:
    """Somebody who goes first is 25 m away and comes at 10 m/s."""
    drive = Drive(crossing(Control.SIGNAL), 8.0, 8.0)
    drive.s, drive.signal = LINE - BUMPER - 15.0, Line(LINE, phase, 0.0, 0.0, 0.0, 0.0)
    for tick in range(60):
        goal = drive.step(-40.0 + 0.2 * tick, 10.0)
    assert (goal is not NOWHERE) is waits


def test_who_has_a_phase_of_his_own_gives_way_once_that_must_be_over() -> None:
    """He passes the line in it and is held up inside: who comes the other way has green by then."""
    drive = Drive(crossing(Control.SIGNAL), 2.0, 2.0)
    drive.s, drive.signal = LINE - BUMPER - 1.0, Line(LINE, 6, 0.0, 0.0, 0.0, 0.0)
    waited = []
    for tick in range(500):
        if drive.s + BUMPER > LINE + 0.5:
            drive.signal, drive.speed, drive.acceleration = None, 0.0, 0.0
        waited.append(drive.step(-40.0 + 0.02 * tick, 1.0) is not NOWHERE)
    assert not any(waited[:200])
    assert all(waited[-50:])


def seen_at_the_line(junction: Junction, walls: list[Building], time: float) -> tuple[RightOfWaySense, Observation]:
    """Return what a car that stands at the line has seen after a time [s]: the ways, and the last turn of the lidar."""
    pose = Pose(0.0, Point.REAR_AXLE, LINE - 1.0 - BUMPER, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    sense = RightOfWaySense(RightOfWayConfig(120.0, 10.0), CAR, (junction,))
    sense.step(0.0, pose, Actors.none(0.0))
    lidar = Lidar(dataclasses.replace(LidarConfig(), steps=900).ideal(), np.random.default_rng(1), walls_of(walls))
    for tick in range(round(time / PERIOD)):
        now = tick * PERIOD
        lidar.step(now, dataclasses.replace(pose, time=now), Actors.none(now))
        lidar.prepare()
    outputs: dict[str, SensorOutput] = {"priorities": sense.output, "roof": lidar.output}
    return sense, Observation(0, time, dataclasses.replace(pose, time=time), PATH, 10.0, outputs, 0.0)


def looks(walls: list[Building], time: float = 0.6) -> float:
    """Return how far along the crossing lane, before the path, it is in sight of a car that stands at the line [m]."""
    sense, seen = seen_at_the_line(crossing(Control.STOP), walls, time)
    watch, others = JunctionWatch(CAR), OthersOnWays(CAR, LidarMount(1.4, 1.9, 90.0))
    found = watch.step(seen, sense.output, seen.pose.x)
    assert found is not None
    (conflict,) = found.conflicts
    others.step(seen, found.conflicts)
    return conflict.reach - others.in_sight[0]


def house_at(corner_x: float, corner_y: float) -> Building:
    return Building(((corner_x, corner_y), (50.0, corner_y), (50.0, -90.0), (corner_x, -90.0)), 8.0)


def joined(*, crossed: bool) -> Junction:
    """Others come on the line x = LANE and go straight on, or turn into the ego's lane beyond."""
    if crossed:
        return crossing(Control.YIELD)
    own, other = crossing(Control.YIELD).ways
    points = ((LANE, -150.0), (LANE, -9.0), (LANE + 2.0, -4.0), (LANE + 6.0, -1.0), (LANE + 10.0, 0.0), (120.0, 0.0))
    return Junction("joined", (own, dataclasses.replace(other, points=points)))


@pytest.mark.parametrize("crossed", [True, False])
@pytest.mark.parametrize("corner_x", [60.0, 62.0, 63.5])
def test_where_a_house_hides_the_approach_of_a_way_that_it_crosses_or_joins_it_waits(
    crossed: bool, corner_x: float
) -> None:
    """Somebody may come from just beyond sight, and he would not be the last."""
    _, seen = seen_at_the_line(joined(crossed=crossed), [house_at(corner_x, -6.0)], 0.6)
    law = GiveWay(CAR, PERIOD, 1.0, 1.0, LidarMount(1.4, 1.9, 90.0))
    assert law.goal(seen, seen.pose.x, None, Drive(joined(crossed=crossed), 0.0)) is not NOWHERE
    assert not law.goes
    _, seen = seen_at_the_line(joined(crossed=crossed), [], 0.6)
    law = GiveWay(CAR, PERIOD, 1.0, 1.0, LidarMount(1.4, 1.9, 90.0))
    assert law.goal(seen, seen.pose.x, None, Drive(joined(crossed=crossed), 0.0)) is NOWHERE
    assert law.goes


def test_a_house_at_the_corner_hides_the_lane_behind_it() -> None:
    """Its near corner is on the line from the lidar that meets the lane where the sight must end."""
    open_street = looks([])
    corner_x, corner_y = 62.0, -6.0
    house = house_at(corner_x, corner_y)
    lidar_x = LINE - 1.0 - BUMPER + 1.4
    meets = corner_y * (LANE - lidar_x) / (corner_x - lidar_x)
    reach = -(0.5 * CAR.width + 0.95 + 0.3)  # the conflict begins so far before the path's line
    assert open_street > 75.0
    assert looks([house]) == pytest.approx(reach - meets, abs=4.5)


def test_a_scenario_that_has_the_sense_and_no_lidar_is_refused() -> None:
    sense = RightOfWaySense(RightOfWayConfig(120.0, 10.0), CAR, (crossing(Control.STOP),))
    # At the first tick, with the junction far away.
    pose = Pose(0.0, Point.REAR_AXLE, -100.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0)
    sense.step(0.0, pose, Actors.none(0.0))
    law, drive = GiveWay(CAR, PERIOD, 1.0, 1.1, LidarMount(1.4, 1.9, 90.0)), Drive(crossing(Control.STOP), 5.0)
    seen = Observation(0, 0.0, pose, PATH, 10.0, {"priorities": sense.output}, 0.0)
    with pytest.raises(TypeError, match="no sensor of kind lidar"):
        law.goal(seen, -100.0, None, drive)


def test_the_tuning_key_turns_it_off() -> None:
    assert make(CAR, {"right_of_way": False})._give_way is None
    assert make(CAR, {})._give_way is not None


@pytest.mark.parametrize("begins", [-3.0, -2.0, -1.0, 0.0])
def test_before_a_way_that_begins_where_it_meets_the_path_the_car_waits(begins: float) -> None:
    """Nothing of it lies before the conflict, so that no sight of it can tell that nobody comes from there."""
    own, other = crossing(Control.YIELD).ways
    other = dataclasses.replace(other, points=((LANE, begins), (LANE, 60.0)), line=0.5, exit=12.0)
    drive = Drive(Junction("driveway", (own, other)), 5.0, 5.0)
    while drive.time < 40.0:
        drive.step()
    assert LINE - 2.0 < drive.s + BUMPER < LANE - 1.75
    assert drive.speed == pytest.approx(0.0, abs=0.05)
