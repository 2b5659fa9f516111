"""Reads scenario files; every complaint is one line that names file, key, what was expected and what came."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from vve_sumo.errors import ConfigError
from vve_sumo.scenario.schema import Scenario


def _complaint(file: Path, error: ValidationError) -> str:
    complaints = error.errors()
    # A key that is spelt wrongly is also missing under its right name; the wrong spelling is what helps.
    first = next((one for one in complaints if one["type"] == "extra_forbidden"), complaints[0])
    key = ".".join(str(part) for part in first["loc"]) or "the file"
    if first["type"] == "extra_forbidden":
        return f"{file}: unknown key {key!r}"
    if first["type"] == "missing":
        return f"{file}: key {key!r} is missing"
    message = first["msg"][0].lower() + first["msg"][1:]
    return f"{file}: {key}: {message}, got {first['input']!r}"


def parse(table: dict[str, Any], file: Path) -> Scenario:
    """Return the scenario that a parsed table holds; `file` is named in the ConfigError of a wrong one."""
    try:
        scenario = Scenario.model_validate(table)
    except ValidationError as error:
        raise ConfigError(_complaint(file, error)) from None
    names = [obstacle.id for obstacle in scenario.obstacles]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ConfigError(f"{file}: obstacles: id {twice!r} stands twice, expected each once")
    return scenario


def load(file: Path) -> Scenario:
    """Return the scenario in a TOML file.

    Raises ConfigError naming the file and what is wrong with it.
    """
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"scenario {file}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"scenario {file}: not UTF-8 text at byte {error.start}") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"scenario {file}: not TOML: {error}") from None
    return parse(table, file)
