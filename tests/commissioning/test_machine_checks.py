"""What the doctor looks at without a rig: the timed street with all actors on it, and what is installed."""

from __future__ import annotations

import sys

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.commissioning.findings import CheckResult
from vve_sumo.commissioning.machine_checks import _all_at_once, dbc
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.drive.virtual_road import scenario_engine
from vve_sumo.errors import ConfigError
from vve_sumo.values import Point, Pose
from vve_sumo.vehicle.interface import DEFAULT, InterfaceConfig


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
    assert dbc(DEFAULT).finding == CheckResult.GO
    monkeypatch.setitem(sys.modules, "cantools", None)  # as Python marks what cannot be imported
    check = dbc(DEFAULT)
    assert check.finding == CheckResult.NOTE
    assert check.advice == "reading the DBC file needs cantools: pip install 'vve-sumo[dbc]'"


OWN_CAR = REPOSITORY / "examples" / "own_car"


def test_the_dbc_is_the_one_that_the_interface_declares(tmp_path) -> None:
    check = dbc(InterfaceConfig("generic", {"mapping_file": str(OWN_CAR / "campus_shuttle.toml")}))
    assert check.finding == CheckResult.GO
    assert check.observed == "8 messages of Campus shuttle, acceleration interface in campus_shuttle.dbc"
    toy = InterfaceConfig(f"{REPOSITORY / 'tests/ports/toy/interface.py'}:make", {"brake_nm": 3412.0})
    assert dbc(toy).observed == "none stated by toy"


def test_a_dbc_that_only_its_own_reader_takes_is_one_line(tmp_path) -> None:
    """cantools reads every line of such a file, the interface only messages and signals."""
    for file in OWN_CAR.glob("campus_shuttle.*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    broken = tmp_path / "campus_shuttle.dbc"
    broken.write_text(broken.read_text(encoding="utf-8") + "\nBA_DEF_ nonsense\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"campus_shuttle\.dbc: cantools says: ") as refused:
        dbc(InterfaceConfig("generic", {"mapping_file": str(tmp_path / "campus_shuttle.toml")}))
    assert "\n" not in str(refused.value)
