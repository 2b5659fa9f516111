"""Reads scenario files; every complaint is one line that names file, key, what was expected and what came."""

from __future__ import annotations

import tomllib
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from vve_sumo.errors import ConfigError
from vve_sumo.scenario.schema import Scenario

LONGEST = 80  #: characters of a wrong value that a complaint repeats


def complaint(file: Path, error: ValidationError, model: type[BaseModel]) -> str:
    """Say in one line what is wrong with a file that should hold a `model`: file, key, what was expected, what came."""
    complaints = error.errors()
    # A key that is spelt wrongly is also missing under its right name; the wrong spelling is what helps.
    first = next((one for one in complaints if one["type"] == "extra_forbidden"), complaints[0])
    key = ".".join(str(part) for part in first["loc"]) or "the file"
    if first["type"] == "extra_forbidden":
        meant = _meant(str(first["loc"][-1]), _keys_beside(first["loc"], model))
        return f"{file}: unknown key {key!r}" + (f", did you mean {meant!r}?" if meant else "")
    if first["type"] == "missing":
        return f"{file}: key {key!r} is missing"
    message, came = first["msg"].removeprefix("Value error, "), first["input"]
    message = message[0].lower() + message[1:]
    if isinstance(came, dict):
        return f"{file}: {key}: {message}"
    said = repr(came) if len(repr(came)) <= LONGEST else repr(came)[:LONGEST] + "…"
    return f"{file}: {key}: {message}, got {said}"


def _keys_beside(place: tuple[int | str, ...], model: type[BaseModel]) -> list[str]:
    """Every key of the table that a key stands in; `place` are the keys that lead there."""
    for part in place[:-1]:
        field = model.model_fields.get(str(part))
        if field is not None:
            inner = (field.annotation, *get_args(field.annotation))
            model = next(one for one in inner if isinstance(one, type) and issubclass(one, BaseModel))
    return list(model.model_fields)


def _meant(key: str, known: list[str]) -> str:
    """The known key that differs in its unit only, or else by little; empty for none."""
    stem = key.rsplit("_", 1)[0]
    others = [
        one for one in known if stem and one in (f"{stem}_{one.rsplit('_', 1)[-1]}", f"{key}_{one[len(key) + 1 :]}")
    ]
    return next(iter(others or get_close_matches(key, known, 1, 0.7)), "")


def read(file: Path, kind: str) -> dict[str, Any]:
    """Return the table in a TOML file; `kind` names it in the ConfigError of one that cannot be read."""
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{kind} {file}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{kind} {file}: not UTF-8 text at byte {error.start}") from None
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{kind} {file}: not TOML: {error}") from None


def parse(table: dict[str, Any], file: Path) -> Scenario:
    """Return the scenario that a parsed table holds; `file` is named in the ConfigError of a wrong one."""
    try:
        scenario = Scenario.model_validate(table)
    except ValidationError as error:
        raise ConfigError(complaint(file, error, Scenario)) from None
    names = [obstacle.id for obstacle in scenario.obstacles]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ConfigError(f"{file}: obstacles: id {twice!r} stands twice, expected each once")
    return scenario


def load(file: Path) -> Scenario:
    """Return the scenario in a TOML file.

    Raises ConfigError naming the file and what is wrong with it.
    """
    return parse(read(file, "scenario"), file)
