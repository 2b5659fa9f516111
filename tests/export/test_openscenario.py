"""OpenSCENARIO files by the standard's schema and by a reader of it."""

from __future__ import annotations

import math
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import xmlschema
from scenariogeneration import xosc

from tests.export.made import HEADING, TIME, X, Y, box_at, record
from vve_sumo.analysis import Run
from vve_sumo.errors import ConfigError
from vve_sumo.export.write import export


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = Run(record(tmp_path_factory.mktemp("osc") / "mine", {"outcome": "timeout"}))
    (file,) = export(run, "openscenario", tmp_path_factory.mktemp("out"))
    return file


@pytest.fixture(scope="module")
def events(file: Path) -> dict[str, dict[str, xosc.Event]]:
    """Events of every entity that does something, by their names."""
    board = xosc.ParseOpenScenario(str(file)).storyboard
    groups = [group for story in board.stories for act in story.acts for group in act.maneuvergroup]
    return {
        group.actors.actors[0].entity: {event.name: event for event in group.maneuvers[0].events} for group in groups
    }


@pytest.mark.thorough
def test_it_is_valid_by_the_schema_of_asam(file: Path) -> None:
    assert file.name == "mine.xosc"
    spec = find_spec("schemas")  # of scenariogeneration
    assert spec is not None
    assert spec.submodule_search_locations
    schema = Path(next(iter(spec.submodule_search_locations))) / "OpenSCENARIO_1_2.xsd"
    xmlschema.XMLSchema(str(schema)).validate(str(file))


def line_of(event: xosc.Event) -> xosc.Polyline:
    return event.action[0].action.trajectory.shapes


def at(event: xosc.Event) -> float:
    return event.trigger.conditiongroups[0].conditions[0].valuecondition.value


def test_the_egos_rear_axle_goes_where_it_went(events: dict[str, dict[str, xosc.Event]]) -> None:
    line = line_of(events["ego"]["follow"])
    time = np.array(line.time)
    assert (time[0], time[-1]) == (0.0, TIME[-1])
    assert np.diff(time).max() < 0.11
    came = np.array([(point.x, point.y) for point in line.positions])
    np.testing.assert_allclose(came[:, 0], np.interp(time, TIME, X), atol=1e-3)
    np.testing.assert_allclose(came[:, 1], np.interp(time, TIME, Y), atol=1e-3)
    turned = np.interp(time, TIME, HEADING) - [point.h for point in line.positions]
    np.testing.assert_allclose(np.cos(turned), 1.0, atol=1e-9)


def test_who_leaves_and_returns_is_two_entities(events: dict[str, dict[str, xosc.Event]]) -> None:
    first, second = events["lorry.7"], events["lorry.7_2"]
    assert set(first) == {"follow", "leave"}
    assert set(second) == {"enter", "follow"}
    assert at(first["leave"]) == pytest.approx(59 * 0.02)
    assert at(second["enter"]) == at(second["follow"]) == pytest.approx(80 * 0.02)
    row, point = box_at("lorry.7", 80), line_of(second["follow"]).positions[0]
    assert math.hypot(point.x - row["x_m"], point.y - row["y_m"]) < 1e-3


def test_what_stands_is_put_there_and_does_nothing(file: Path, events: dict[str, dict[str, xosc.Event]]) -> None:
    scenario = xosc.ParseOpenScenario(str(file))
    assert "parked" not in events
    assert {*scenario.storyboard.init.initactions} == {"ego", "parked", "walker", "lorry.7"}
    objects = {one.name: one.entityobject for one in scenario.entities.scenario_objects}
    assert isinstance(objects["walker"], xosc.Pedestrian)
    assert isinstance(objects["parked"], xosc.Vehicle)


def test_a_drive_of_a_single_tick_is_refused_in_one_line(tmp_path: Path) -> None:
    made = record(tmp_path / "mine", {"outcome": "timeout"}, ticks=1)
    ticks = pq.read_table(made / "ticks.parquet")
    pq.write_table(ticks.slice(0, 1), made / "ticks.parquet")
    with pytest.raises(ConfigError, match="mine: a drive of a single tick has no trajectory in OpenSCENARIO"):
        export(Run(made), "openscenario", tmp_path)
