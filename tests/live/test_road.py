"""A virtual road that meets a mistake of ours under way: a reason to stop the car; the process that drives goes on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

from vve_sumo.errors import ConfigError
from vve_sumo.live.road import LiveRoad
from vve_sumo.values import EGO, Point, Pose

POSES = {EGO: Pose(0.08, Point.FRONT_BUMPER, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)}


class Broken:
    """A world in which the ego cannot be placed: it raises `error`."""

    egos = (EGO,)

    def __init__(self, error: Exception) -> None:
        self.error, self.asked = error, 0

    def step(self, _placements: Mapping[str, Pose]) -> None:
        """Break."""
        self.asked += 1
        raise self.error


def road_in(world: Any) -> LiveRoad:
    no_engine: Any = None
    return LiveRoad(world, no_engine)


def test_it_is_a_reason_that_stays_and_is_not_asked_again() -> None:
    world = Broken(ZeroDivisionError("of ours"))
    road = road_in(world)
    around = road.around[EGO]
    around.faults = ("virtual_contact",)
    assert [road.advance(POSES), road.advance(POSES)] == [{}, {}]
    assert (around.faults, world.asked) == (("virtual_contact", "road_failed"), 1)
    assert "ZeroDivisionError: of ours" in road.traceback


def test_a_road_that_refuses_the_ego_refuses_the_drive() -> None:
    with pytest.raises(ConfigError):
        road_in(Broken(ConfigError("obstacle parked: it stands where the ego starts"))).advance(POSES)
