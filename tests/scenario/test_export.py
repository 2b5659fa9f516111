"""The JSON Schema for editors, asked of another implementation of JSON Schema."""

from __future__ import annotations

import re
import tomllib
from typing import Any

import jsonschema
import pytest

from tests.conftest import REPOSITORY
from tests.scenario.test_load import full, put
from vve_sumo.scenario.export import json_schema

SCHEMA = json_schema()
VALIDATOR = jsonschema.Draft202012Validator(SCHEMA)


def complaints(table: dict[str, Any]) -> list[str]:
    return [error.message for error in VALIDATOR.iter_errors(table)]


def test_it_is_a_schema_of_its_draft_and_speaks_of_every_key() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert SCHEMA["$schema"].endswith("2020-12/schema")
    assert SCHEMA["title"]
    assert SCHEMA["$defs"]["When"]["properties"]["ttc_s"]["description"]
    assert "null" not in str(SCHEMA)
    assert "None" not in str(SCHEMA)


@pytest.mark.parametrize("file", sorted((REPOSITORY / "scenarios").glob("*.toml")), ids=lambda f: f.stem)
def test_every_shipped_scenario_is_valid(file: Any) -> None:
    assert complaints(tomllib.loads(file.read_text(encoding="utf-8"))) == []


def test_so_is_one_with_everything_and_the_documents() -> None:
    assert complaints(full()) == []
    text = (REPOSITORY / "docs" / "scenarios.md").read_text(encoding="utf-8")
    for block in re.findall(r"```toml\n(title.*?)```", text, re.DOTALL):
        assert complaints(tomllib.loads(block)) == []


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("ego", "sped_mps"), 5.0),
        (("ego", "speed_mps"), "5"),
        (("ego", "speed_mps"), 41.0),
        (("seed",), 1.5),
        (("actors", 0, "kind"), "lorry"),
        (("actors", 0, "events", 0, "when", "ttc"), 1.0),
        (("actors", 0, "events"), {}),
        (("parameters", "Gap"), {"sets": ["seed"]}),
        (("parameters", "gap", "sets"), []),
        (("end_trigger", "ttc_s"), None),
        (("controller", "tuning", "gap_m"), [5.0]),
        (("road",), {}),
    ],
)
def test_a_wrong_key_or_value_is_not(place: tuple[Any, ...], value: object) -> None:
    changed = full()
    put(changed, place, value)
    assert complaints(changed) != []
