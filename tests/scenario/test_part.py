"""A scenario on a part of its path goes as on the whole one: the same triggers and contacts at the same places."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.config_file import read_as
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.part import bound_to_the_start, on_part
from vve_sumo.scenario.schema import Scenario

FILE = Path("part.toml")
HEAD = {
    "title": "A part",
    "road": {"network": "linden"},
    "ego": {
        "path": "whole",
        "speed_mps": 8.0,
        "lot": {"latitude_deg": 40.0, "longitude_deg": -83.0, "heading_deg": 0.0},
    },
}


def parted(begin: float, end: float, **tables) -> tuple[dict, tuple[str, ...]]:
    """A scenario with these tables, on a part."""
    table = {**HEAD, **tables, "ego": HEAD["ego"] | tables.get("ego", {})}
    part = on_part(parse(table, FILE), table, begin, end, "part.csv", 3.8)
    parse(part.table, FILE)
    return part.table, part.left_out


def test_every_place_along_the_path_counts_from_the_new_start() -> None:
    table, left_out = parted(
        100.0,
        200.0,
        ego={"corridor": [{"from_m": 120.0, "to_m": 150.0, "left_m": 3.0}, {"from_m": 190.0, "left_m": 2.0}]},
        obstacles=[{"id": "near", "at_m": 150.0}, {"id": "before", "at_m": 99.0}, {"id": "behind", "at_m": 201.0}],
        actors=[
            {
                "id": "one",
                "at_m": 160.0,
                "enters": {"ego_at_m": 130.0},
                "events": [{"when": {"ego_at_m": 140.0}, "speed_mps": 2.0}],
            },
            {"id": "ahead", "ahead_m": 20.0, "enters": {"ego_at_m": 110.0}},
            {"id": "elsewhere", "path": "other", "at_m": 7.0},
        ],
        people=[{"id": "walker", "at_m": 170.0}],
        end_trigger={"ego_at_m": 190.0},
        parameters={
            "place": {"sets": ["obstacles.near.at_m"], "min": 140.0, "max": 180.0},
            "gone": {"sets": ["obstacles.behind.at_m"]},
            "speed": {"sets": ["ego.speed_mps"], "min": 3.0},
        },
    )
    assert [one["at_m"] for one in table["obstacles"]] == [50.0]
    assert table["actors"][0]["at_m"] == 60.0
    assert table["actors"][0]["enters"] == {"ego_at_m": 30.0}
    assert table["actors"][0]["events"][0]["when"] == {"ego_at_m": 40.0}
    assert table["actors"][1]["enters"] == {"ego_at_m": 10.0}
    assert table["actors"][1]["ahead_m"] == 20.0
    assert table["actors"][2]["at_m"] == 7.0
    assert table["people"][0]["at_m"] == 70.0
    assert table["ego"]["corridor"] == [
        {"from_m": 20.0, "to_m": 50.0, "left_m": 3.0},
        {"from_m": 90.0, "left_m": 2.0},
    ]
    assert table["end_trigger"] == {"ego_at_m": 90.0}
    assert table["ego"]["path"] == "part.csv"
    assert set(table["parameters"]) == {"place", "speed"}
    assert table["parameters"]["place"] == {"sets": ["obstacles.near.at_m"], "min": 40.0, "max": 80.0}
    assert table["parameters"]["speed"] == {"sets": ["ego.speed_mps"], "min": 3.0}
    assert [line.split(",")[0] for line in left_out] == ["before", "behind"]


def test_an_end_trigger_beyond_the_part_comes_with_its_end() -> None:
    table, _ = parted(100.0, 180.0, end_trigger={"ego_at_m": 230.0})
    assert table["end_trigger"] == {"ego_at_m": 80.0}


def test_a_parameter_of_a_place_and_a_speed_is_refused() -> None:
    both = {"both": {"sets": ["obstacles.near.at_m", "ego.speed_mps"]}}
    with pytest.raises(ConfigError, match=r"parameters\.both\.sets: expected only distances"):
        parted(100.0, 200.0, obstacles=[{"id": "near", "at_m": 150.0}], parameters=both)


@pytest.mark.parametrize(
    ("name", "bound"),
    [
        ("cut_in", False),
        ("lead_braking", False),
        ("pedestrian_750_crossing", False),
        ("occluded_pedestrian", False),
        ("pedestrian_400_walking_along", True),
    ],
)
def test_whose_motion_counts_from_the_start(name: str, bound: bool) -> None:
    file = REPOSITORY / "scenarios" / f"{name}.toml"
    scenario = parse(read_as(file, "scenario", Scenario), file)
    assert any(map(bound_to_the_start, scenario.actors)) is bound
