"""The tracker with scans that come late, against where things are at the present and how fast."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from controllers.sightings import Memory
from controllers.tracks import Target, Tracker
from tests import vehicles
from vve_sumo.path import ReferencePath
from vve_sumo.sensors.radar import BEFORE_FIRST_SCAN, Radar, RadarConfig
from vve_sumo.values import Actors, Observation, Point, Pose

CAR = vehicles.FUSION.vehicle
ROAD = ReferencePath.from_points([0.0, 1000.0], [0.0, 0.0])
PERIOD = 0.02


class Ahead(NamedTuple):
    """A lead on a straight road after two seconds, as the tracker has it and as it is."""

    nearest: Target | None
    dangers: list[Target]
    gap: float  #: [m]


def tracked(latency: float, ego: float, brakes: float, lead: float, slows: float = 0.0) -> Ahead:
    """Follow a lead of a speed [m/s] that slows down [m/s2] for two seconds; the ego brakes [m/s2] in the second."""
    radar = Radar(replace(RadarConfig().ideal(), latency=latency), CAR, np.random.default_rng(1))
    tracker, newest, nearest, s, v, gap = Tracker(CAR), BEFORE_FIRST_SCAN, None, 0.0, ego, 60.0
    for tick in range(101):
        time = tick * PERIOD
        rear = CAR.rear_axle_to_bumper + 60.0 + lead * time - 0.5 * slows * time * time
        pose = Pose(time, Point.REAR_AXLE, s, 0.0, 0.0, v, 0.0, 0.0, 0.0, 0.0)
        columns = (
            np.array([value]) for value in (rear + 2.25, 0.0, 0.0, lead - slows * time, 4.5, 1.8, 10.0, 0.0, 1.5)
        )
        scan = radar.step(time, pose, Actors(time, ("lead",), *columns, np.zeros(1, np.int8)))
        newest = newest if scan is None else scan.detections
        nearest = tracker.step(Observation(tick, time, pose, ROAD, ego, {"radar": newest}, 0.0), ROAD.project(s, 0.0))
        gap = rear - s - CAR.rear_axle_to_bumper
        slower = v - (brakes if time >= 1.0 else 0.0) * PERIOD
        at, s, v = s, s + 0.5 * (v + slower) * PERIOD, slower
    return Ahead(nearest, tracker.dangers(2.0, at), gap)


@pytest.mark.parametrize("latency", [0.0, 0.09, 0.3])
@pytest.mark.parametrize("lead", [0.0, 8.0])
def test_where_and_how_fast_the_lead_is_now_while_the_ego_brakes(latency: float, lead: float) -> None:
    """From the present pose a scan of 0.3 s ago would make a lead 1.8 m/s faster backwards, of an ego that brakes."""
    ahead = tracked(latency, ego=15.0, brakes=6.0, lead=lead)
    assert ahead.nearest is not None
    assert ahead.nearest.gap == pytest.approx(ahead.gap, abs=0.03)
    assert ahead.nearest.speed == pytest.approx(lead, abs=0.05)


@pytest.mark.parametrize("latency", [0.0, 0.09, 0.3])
def test_a_lead_that_brakes_is_no_faster_now_than_it_was(latency: float) -> None:
    """What full braking is decided by: the speed of now and a deceleration that is not too small."""
    ahead = tracked(latency, ego=12.0, brakes=0.0, lead=16.0, slows=4.0)
    (danger,) = ahead.dangers
    assert danger.speed <= 16.0 - 4.0 * 2.0 + 0.2
    assert danger.braking >= 4.0
    assert danger.gap <= ahead.gap + 0.2


def test_the_past_is_remembered_as_it_was_and_foretold_before_and_between() -> None:
    """On a circle of 20 m at 10 m/s: exact where a pose was, second order in the time since one elsewhere."""
    memory, radius, speed = Memory(), 20.0, 10.0
    turning = speed / radius

    def pose(time: float) -> Pose:
        angle = turning * time
        x, y = radius * math.sin(angle), radius * (1.0 - math.cos(angle))
        return Pose(time, Point.REAR_AXLE, x, y, angle, speed, 0.0, turning, 0.0, 0.0)

    for tick in range(100):
        memory.add(pose(tick * PERIOD))
    for time in (1.5, 1.98 - 0.09, 1.98):
        true, found = pose(time), memory.at(time)
        assert math.hypot(found.x - true.x, found.y - true.y) < 0.5 * speed * turning * PERIOD**2
        assert found.heading == pytest.approx(true.heading)
        assert found.time == pytest.approx(time)
    # Older than all that is remembered: the first of it, and what steady motion makes of that.
    assert memory.at(0.5).x == pytest.approx(pose(0.5).x, abs=0.5 * speed * turning * 0.6**2)
