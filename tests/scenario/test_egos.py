"""Further egos of a scenario: what is left out is as in [ego]; their order says nothing; mistakes are one line."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.complaints import message
from vve_sumo.scenario.egos import alone
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.schema import EgoSettings

FILE = Path(__file__).parent.parent.parent / "scenarios" / "parked_car.toml"


def table(*egos: dict[str, Any]) -> dict[str, Any]:
    return tomllib.loads(FILE.read_text(encoding="utf-8")) | {"egos": list(egos)}


def test_without_further_egos_a_record_holds_what_it_held() -> None:
    assert "egos" not in parse(tomllib.loads(FILE.read_text(encoding="utf-8")), FILE).model_dump(mode="json")
    assert "egos" not in parse(table(), FILE).model_dump(mode="json")


def test_a_key_that_is_left_out_is_as_in_ego() -> None:
    second = {
        "id": "second",
        "initial_speed": "20 mph",
        "initial_s_m": 50.0,
        "controller": {"name": "acc"},
        "criteria": {"outcome": "arrived"},
        "sensors": [{"name": "ahead", "kind": "radar", "settings": {"range_limit": "100 ft"}}],
    }
    scenario = parse(table(second), FILE)
    own = alone(scenario, scenario.egos[0])
    given = {"initial_speed_mps": 8.9408, "initial_s_m": 50.0}
    for key in EgoSettings.model_fields:
        assert getattr(own.ego, key) == given.get(key, getattr(scenario.ego, key)), key
    assert own.controller.name == "acc"
    assert scenario.controller.name == "follow_and_stop"
    assert own.criteria.outcome == "arrived"
    assert own.sensors[0].settings == {"range_limit_m": pytest.approx(30.48)}
    assert (own.radar, own.road, own.weather, own.end_trigger) == (
        scenario.radar, scenario.road, scenario.weather, scenario.end_trigger
    )  # fmt: skip
    # What is placed along the path of [ego] is not placed along another.
    assert own.obstacles == own.actors == own.people == own.egos == ()


def test_what_a_record_holds_is_the_same_scenario_whatever_the_order() -> None:
    a, b = {"id": "a", "path": "linden_loop"}, {"id": "b", "corridor": [{"left_m": 1.0}]}
    one, other = (parse(table(*egos), FILE).model_dump(mode="json") for egos in ((a, b), (b, a)))
    assert one == other
    again = parse(one, FILE)
    assert [ego.id for ego in again.egos] == ["a", "b"]
    assert again.model_dump(mode="json") == one


@pytest.mark.parametrize(
    ("egos", "words"),
    [
        ([{"path": "linden_loop"}], ["egos.0.id", "missing"]),
        ([{"id": "ego"}], ["egos", "'ego'"]),
        ([{"id": "a"}, {"id": "a"}], ["egos", "'a' stands twice"]),
        ([{"id": "parked_car"}], ["'parked_car' stands twice"]),
        ([{"id": "a", "sped_mps": 3.0}], ["egos.0.sped_mps", "speed_mps"]),
        ([{"id": "a", "speed_mps": 300.0}], ["egos.0.speed_mps", "300"]),
        ([{"id": "a", "initial_s_m": 3.0}], ["egos.a: initial_s_m needs initial_speed_mps"]),
        ([{"id": "a", "initial_speed_mps": 30.0}], ["egos.a: initial_speed_mps 30 is above speed_mps"]),
        ([{"id": "a", "sensors": [{"name": "radar", "kind": "radar"}]}], ["egos.a.sensors", "'radar' stands twice"]),
        ([{"id": f"a{n}"} for n in range(8)], ["egos", "7"]),
    ],
)
def test_a_mistake_is_one_line_that_names_it(egos: list[dict[str, Any]], words: list[str]) -> None:
    said = message(lambda: parse(table(*egos), FILE))
    assert "\n" not in said
    assert str(FILE) in said
    for word in words:
        assert word in said
