"""What a scenario's file says that changes the drive is told in words: nothing of it is left out."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from benchmarks import library
from tests.conftest import REPOSITORY
from vve_sumo.drive.run import resolve_by_name
from vve_sumo.drive.scenario_text import lines, signals_along_path
from vve_sumo.scenario import descriptions
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.schema import Control

#: keys that are about files and places of the lab, or that no reader of a scenario asks for
UNTOLD = {
    "description",
    "duration_s",
    "after_stop_s",
    "lot",
    "parameters",
    "title",
    "length_m",
    "width_m",
    "turned_deg",
}


def leaves(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every key of a file with its value, but for UNTOLD."""
    if isinstance(value, dict):
        for name, inner in value.items():
            if name not in UNTOLD:
                yield from leaves(inner, name)
    elif isinstance(value, list):
        for inner in value:
            yield from leaves(inner, key)
    else:
        yield key, value


def words(key: str, value: Any) -> str:
    """Return what a text must hold for a value of a key."""
    if key in ("offset_m",) and value:
        return f"{abs(value):g} m"
    if key == "turned_deg":
        return "against the path" if abs(value) == 180.0 else f"turned {abs(value):g}°"
    return f"{value:g}" if isinstance(value, float) else str(value)


@pytest.mark.thorough
@pytest.mark.parametrize("name", library.names())
def test_everything_in_a_shipped_scenario_is_told(name: str) -> None:
    file = REPOSITORY / "scenarios" / f"{name}.toml"
    text = "\n".join(lines(resolve_by_name(name, REPOSITORY), REPOSITORY))
    declared = [(key, value) for key, value in leaves(tomllib.loads(file.read_text(encoding="utf-8")))]
    missing = [(key, value) for key, value in declared if not isinstance(value, bool) and words(key, value) not in text]
    usual = (0.0, "pedestrian", "bicycle", "child", Control().name)
    assert [one for one in missing if one[1] not in usual] == []


@pytest.mark.thorough
def test_a_further_ego_is_told_by_what_it_has_of_its_own() -> None:
    text = lines(resolve_by_name("two_cars", REPOSITORY), REPOSITORY)
    assert [line for line in text if "second" in line] == ["ego 'second': path two_cars_front of 200 m"]


@pytest.mark.thorough
def test_the_fault_the_manoeuvre_the_traffic_and_the_signals_are_told() -> None:
    def text(name: str) -> str:
        return "\n".join(lines(resolve_by_name(name, REPOSITORY), REPOSITORY))

    assert "fault: the gateway stops the car where it is more than 0.05 m off its path" in text("leap_hard_stop")
    assert "manoeuvre: Drives a car through the manoeuvres that its calibration is fitted from" in text("calibration")
    assert "traffic linden_heavy, which drives for 60 s before" in text("rush_hour")
    assert "signals at 191 m of the path" in text("crossing_at_signal")


def test_a_signal_beside_the_way_is_not_on_it() -> None:
    """Cleveland Avenue has one at Seventeenth Avenue; the paper's path meets none."""
    assert len(signals_along_path(resolve_by_name("crossing_at_signal", REPOSITORY))) >= 1
    assert signals_along_path(resolve_by_name("calibration", REPOSITORY)) == []


def test_a_scenario_as_usual_says_only_that_there_is_no_traffic() -> None:
    lot = {"latitude_deg": 0.0, "longitude_deg": 0.0, "heading_deg": 0.0}
    table: dict[str, Any] = {"title": "t", "road": {"network": "n"}, "ego": {"path": "p", "speed_mps": 5.0, "lot": lot}}
    assert descriptions.special_conditions(parse(table, Path("usual.toml"))) == ["no traffic"]
