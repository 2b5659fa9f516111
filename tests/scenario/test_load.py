"""Scenario files: what they may say, and the one line that says what is wrong."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.conftest import REPOSITORY
from vve_sumo.errors import ConfigError
from vve_sumo.scenario.load import load, parse

FILE = REPOSITORY / "scenarios" / "parked_car.toml"
TEXT = FILE.read_text(encoding="utf-8")


def table() -> dict[str, object]:
    return tomllib.loads(TEXT)


@pytest.mark.parametrize("file", sorted((REPOSITORY / "scenarios").glob("*.toml")), ids=lambda f: f.stem)
def test_every_shipped_scenario_loads(file: Path) -> None:
    assert load(file).title


def test_whole_numbers_are_good_where_a_number_is_asked_for() -> None:
    changed = table()
    changed["ego"]["speed_mps"] = 11  # type: ignore[index]
    assert parse(changed, FILE).ego.speed_mps == 11.0


WRONG = {
    ("ego", "speed_mps"): ["fast", True, 0.0, float("inf"), float("nan"), None],
    ("seed",): [-1, 1.5, "1", 2**31],
    ("street", "network"): ["", 3],
    ("obstacles",): [[{"id": "a"}], [{"id": "a b", "at_m": 1.0}], "none"],
    ("criteria", "stop_gap_m"): [{"min": "4"}, {"least": 4.0}, 5.0],
    ("ego", "lot", "heading_deg"): [360.0, -1.0],
}


@pytest.mark.parametrize(("path", "value"), [(path, value) for path, values in WRONG.items() for value in values])
def test_a_wrong_value_is_one_line_with_file_key_and_value(path: tuple[str, ...], value: object) -> None:
    changed = table()
    inner = changed
    for key in path[:-1]:
        inner = inner[key]  # type: ignore[assignment]
    inner[path[-1]] = value
    with pytest.raises(ConfigError) as caught:
        parse(changed, FILE)
    text = str(caught.value)
    assert "\n" not in text
    assert str(FILE) in text
    assert ".".join(path) in text


def test_two_obstacles_of_one_name_are_refused() -> None:
    changed = table()
    changed["obstacles"] = [{"id": "a", "at_m": 100.0}, {"id": "a", "at_m": 200.0}]
    with pytest.raises(ConfigError, match="'a' stands twice"):
        parse(changed, FILE)


@given(st.binary(max_size=200))
def test_whatever_a_file_holds_it_is_a_scenario_or_a_config_error(
    tmp_path_factory: pytest.TempPathFactory, data: bytes
) -> None:
    file = tmp_path_factory.mktemp("scenario") / "x.toml"
    file.write_bytes(data)
    with pytest.raises(ConfigError):
        load(file)


def test_a_folder_is_no_scenario(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load(tmp_path)
