"""What a car at rest stands before, and that a short rest for traffic does not end a drive."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.drive.street import drive_once
from tests.isolated import isolated
from tests.vehicles import FUSION
from vve_sumo.drive.standstill_cause import REACH, StandstillCause, StandstillClassifier
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.schema import Scenario
from vve_sumo.values import Actors, Point, Pose

EGO_S = 100.0  #: of the rear axle on a straight path along +x [m]
BUMPER = EGO_S + FUSION.vehicle.rear_axle_to_bumper
LENGTH, WIDTH = 4.0, 1.8  #: of everybody on the road [m]


def scenario(*demand: str) -> Scenario:
    ego = {"path": "p", "speed_mps": 5.0, "lot": {"latitude_deg": 0.0, "longitude_deg": 0.0, "heading_deg": 0.0}}
    table: dict[str, Any] = {
        "title": "a straight road",
        "road": {"network": "n", "demand": list(demand)},
        "ego": ego,
        "obstacles": [{"id": "parked", "at_m": 0.0}],
        "actors": [{"id": "lead", "at_m": 0.0}],
    }
    return parse(table, Path("straight.toml"))


def ahead(*road: tuple[str, float, float, float], demand: tuple[str, ...] = ("light",)) -> StandstillCause:
    """Return what the car stands before: `road` are names, gaps ahead of its bumper [m], d [m], speeds [m/s]."""
    path = ReferencePath.from_points(np.array([0.0, 300.0]), np.array([0.0, 0.0]))
    pose = Pose(0.0, Point.REAR_AXLE, EGO_S, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    names, gaps, d, speeds = zip(*road, strict=True) if road else ((), (), (), ())
    column = np.array
    actors = Actors(
        time=0.0,
        ids=tuple(names),
        x=column([BUMPER + gap + LENGTH / 2.0 for gap in gaps], np.float64),
        y=column(d, np.float64),
        heading=np.zeros(len(names)),
        speed=column(speeds, np.float64),
        length=np.full(len(names), LENGTH),
        width=np.full(len(names), WIDTH),
        radar_cross_section=np.full(len(names), 10.0),
        lateral_speed=np.zeros(len(names)),
        height=np.full(len(names), 1.5),
        kind=np.zeros(len(names), np.int8),
    )
    return StandstillClassifier(scenario(*demand), path, FUSION.vehicle).classify(pose, EGO_S, actors)


def test_an_obstacle_stays_and_so_does_a_standing_actor_of_the_scenario() -> None:
    assert ahead(("parked", 5.0, 0.0, 0.0)) is StandstillCause.PERMANENT
    assert ahead(("lead", 5.0, 0.0, 0.0)) is StandstillCause.PERMANENT


def test_traffic_moves_on_whether_it_stands_or_not_and_so_does_a_moving_actor() -> None:
    assert ahead(("sedan.7", 5.0, 0.0, 0.0)) is StandstillCause.TEMPORARY
    assert ahead(("sedan.7", 5.0, 0.0, 3.0)) is StandstillCause.TEMPORARY
    assert ahead(("lead", 5.0, 0.0, 1.4)) is StandstillCause.TEMPORARY


def test_the_nearest_in_the_strip_decides() -> None:
    assert ahead(("sedan.7", 3.0, 0.0, 0.0), ("parked", 15.0, 0.0, 0.0)) is StandstillCause.TEMPORARY
    assert ahead(("parked", 3.0, 0.0, 0.0), ("sedan.7", 15.0, 0.0, 8.0)) is StandstillCause.PERMANENT
    assert ahead(("sedan.7", 3.0, 3.5, 8.0), ("parked", 5.0, 0.0, 0.0)) is StandstillCause.PERMANENT


@pytest.mark.parametrize(
    ("demand", "nothing"), [(("light",), StandstillCause.CLEAR_WITH_TRAFFIC), ((), StandstillCause.CLEAR)]
)
def test_nothing_is_ahead_beside_the_strip_too_far_away_or_behind(
    demand: tuple[str, ...], nothing: StandstillCause
) -> None:
    assert ahead(demand=demand) is nothing
    assert ahead(("sedan.7", 5.0, 3.5, 0.0), demand=demand) is nothing
    assert ahead(("sedan.7", REACH + 0.1, 0.0, 0.0), demand=demand) is nothing
    assert ahead(("sedan.7", -20.0, 0.0, 0.0), demand=demand) is nothing


def test_a_car_whose_place_is_unknown_stands_before_nothing() -> None:
    path = ReferencePath.from_points(np.array([0.0, 300.0]), np.array([0.0, 0.0]))
    pose = Pose(0.0, Point.REAR_AXLE, EGO_S, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    empty = Actors.none(0.0)
    observer = StandstillClassifier(scenario(), path, FUSION.vehicle)
    assert observer.classify(None, EGO_S, empty) is StandstillCause.CLEAR
    assert observer.classify(pose, math.nan, empty) is StandstillCause.CLEAR


@pytest.mark.thorough
def test_a_drive_goes_on_after_a_rest_for_a_car_that_crossed() -> None:
    """In ordinary light traffic a car crosses Louis Avenue at 18 m/s before the ego, which rests for 3 s."""
    summary = isolated(
        drive_once,
        {
            "seed": 1,
            "after_stop_s": 2.0,
            "ego.speed_mps": 5.0,
            "road.demand": ["linden_light"],
            "end_trigger": {"ego_at_m": 280.0},
        },
    )
    assert summary["emergency_used"] is True
    assert summary["collision"] is False
    assert summary["reasons"] == ["end_ego_at"]
    assert summary["outcome"] == "completed"
