"""What the doctor looks at without a rig: the timed street with all actors on it, and what is installed."""

from __future__ import annotations

import sys

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.commissioning.findings import CheckResult
from vve_sumo.commissioning.machine_checks import _all_at_once, _dbc
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.drive.virtual_road import scenario_engine
from vve_sumo.values import Point, Pose


def test_every_actor_is_there_from_the_first_step_on() -> None:
    resolved = resolve_by_name("cut_in", REPOSITORY)
    begin = resolved.path.at(0.0)
    ego = Pose(0.0, Point.FRONT_BUMPER, begin.x, begin.y, begin.heading, 0.0, 0.0, 0.0, 0.0, 0.0)
    names = [actor.id for actor in resolved.scenario.actors]
    assert [player.id for player in scenario_engine(resolved).step(0.0, ego)] != names
    cast = scenario_engine(_all_at_once(resolved))
    for step in range(200):
        assert [player.id for player in cast.step(0.02 * step, ego)] == names


def test_without_cantools_the_dbc_is_a_note_with_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _dbc().finding == CheckResult.GO
    monkeypatch.setitem(sys.modules, "cantools", None)  # as Python marks what cannot be imported
    check = _dbc()
    assert check.finding == CheckResult.NOTE
    assert check.advice == "reading the DBC file needs cantools: pip install 'vve-sumo[dbc]'"
