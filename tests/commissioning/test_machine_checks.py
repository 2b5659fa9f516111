"""What the doctor times before a drive is the street with everybody on it."""

from __future__ import annotations

from tests.conftest import REPOSITORY
from vve_sumo.commissioning.machine_checks import _all_at_once
from vve_sumo.drive.run import choose
from vve_sumo.drive.virtual_road import scenario_engine
from vve_sumo.values import Point, Pose


def test_every_actor_is_there_from_the_first_step_on() -> None:
    setting = choose("cut_in", REPOSITORY)
    begin = setting.path.at(0.0)
    ego = Pose(0.0, Point.FRONT_BUMPER, begin.x, begin.y, begin.heading, 0.0, 0.0, 0.0, 0.0, 0.0)
    names = [actor.id for actor in setting.scenario.actors]
    assert [player.id for player in scenario_engine(setting).step(0.0, ego)] != names
    cast = scenario_engine(_all_at_once(setting))
    for step in range(200):
        assert [player.id for player in cast.step(0.02 * step, ego)] == names
