"""Reads scenario files; every complaint is one line that names file, key, what was expected and what came."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from vve_sumo.errors import ConfigError
from vve_sumo.scenario.schema import Scenario

LONGEST: Final = 80  #: characters of a wrong value that a complaint repeats
#: what a TOML file should hold, by pydantic's word for the error; its own words speak of Python
EXPECTED: Final = {
    "bool_type": "expected true or false",
    "float_type": "expected a number",
    "int_type": "expected a whole number",
    "string_type": "expected a text in quotes",
    "tuple_type": "expected an array",
    "dict_type": "expected a table",
    "model_type": "expected a table",
}


def complaint(file: Path, error: ValidationError, model: type[BaseModel]) -> str:
    """Say in one line what is wrong with a file that should hold a `model`: file, key, what was expected, what came."""
    complaints = error.errors(include_url=False)
    # A key that is spelt wrongly is also missing under its right name; the wrong spelling is what helps.
    first = next((one for one in complaints if one["type"] == "extra_forbidden"), complaints[0])
    place, kinds = _walk(first, model)
    key = ".".join(map(_key, place)) or "the file"
    if first["type"] == "extra_forbidden":
        meant = _meant(str(place[-1]), [name for kind in kinds for name in kind.model_fields])
        return f"{file}: unknown key {key!r}" + (f", did you mean {meant!r}?" if meant else "")
    if first["type"] == "missing":
        return f"{file}: key {key!r} is missing"
    # Where a value may be of several kinds there is a complaint of each; together they say what is allowed.
    said = dict.fromkeys(_expected(one) for one in complaints if _walk(one, model)[0] == place)
    return f"{file}: {key}: {' or '.join(said).replace(' or expected ', ' or ')}{_came(first)}"


def _expected(complaint: ErrorDetails) -> str:
    message = complaint["msg"].removeprefix("Value error, ").replace("Input should be ", "expected ", 1)
    message = message.replace("Tuple should", "array should")
    return EXPECTED.get(complaint["type"], message[0].lower() + message[1:])


def _came(complaint: ErrorDetails) -> str:
    """What came, unless it is a table: that would repeat half the file."""
    came = complaint["input"]
    return "" if isinstance(came, dict) and complaint["type"] == "value_error" else f", got {_spelt(came)}"


def _spelt(value: object) -> str:
    """A value in few characters that a line can hold."""
    if isinstance(value, dict):
        return "a table"
    try:
        said = repr(value)
    except (ValueError, RecursionError):  # a whole number of thousands of digits, arrays in arrays in arrays
        return f"{type(value).__name__} beyond all bounds"
    return said if len(said) <= LONGEST else said[:LONGEST] + "…"


def _walk(complaint: ErrorDetails, model: type[BaseModel]) -> tuple[list[int | str], list[type[BaseModel]]]:
    """Return the keys that lead to what a complaint is about, and what tables the last of them may stand in.

    Pydantic's own place of an error names, among the keys, also the kinds that a value was tried as.
    """
    place: list[int | str] = []
    kinds: list[Any] = [model]
    unknown = len(complaint["loc"]) - 1 if complaint["type"] == "extra_forbidden" else -1
    tables = [model]
    for number, part in enumerate(complaint["loc"]):
        within = [one for kind in kinds for one in _inside(kind, part)]
        if within or number == unknown:
            tables = [kind for kind in kinds if _is_table(kind)]
            place, kinds = [*place, part], list(_alternatives(within))
    return place, tables


def _inside(kind: Any, part: int | str) -> Iterator[Any]:
    """What may stand under a key, or at a place, in something of a kind."""
    arguments = [one for one in get_args(kind) if one is not Ellipsis]
    if _is_table(kind):
        field = kind.model_fields.get(str(part))
        yield from () if field is None else (field.annotation,)
    elif get_origin(kind) is dict:
        yield arguments[1]
    elif get_origin(kind) is tuple and isinstance(part, int):
        yield arguments[min(part, len(arguments) - 1)]


def _is_table(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _alternatives(annotations: Iterable[Any]) -> Iterator[Any]:
    """Every kind that annotations allow, one by one."""
    for annotation in annotations:
        origin = get_origin(annotation)
        if origin is Annotated:
            yield from _alternatives(get_args(annotation)[:1])
        elif origin in (Union, UnionType):
            yield from _alternatives(get_args(annotation))
        elif annotation is not NoneType:
            yield annotation


def _key(part: int | str) -> str:
    """A key as it stands in a place, quoted where it is none that one would write bare."""
    text = str(part)
    return text if text.isprintable() and len(text) <= LONGEST else _spelt(text)


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
    except ValueError as error:  # also of a whole number with thousands of digits, which is no TOMLDecodeError
        raise ConfigError(f"{kind} {file}: not TOML: {error}") from None
    except RecursionError:
        raise ConfigError(f"{kind} {file}: not TOML: nested too deeply") from None


def parse(table: dict[str, Any], file: Path) -> Scenario:
    """Return the scenario that a parsed table holds; `file` is named in the ConfigError of a wrong one."""
    try:
        scenario = Scenario.model_validate(table)
    except ValidationError as error:
        raise ConfigError(complaint(file, error, Scenario)) from None
    names = [one.id for one in scenario.obstacles] + [one.id for one in scenario.actors]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        where = "obstacles" if twice in (one.id for one in scenario.obstacles) else "actors"
        raise ConfigError(f"{file}: {where}: id {twice!r} stands twice, expected each once")
    for name, parameter in scenario.parameters.items():
        for place in parameter.sets:
            if not _takes_a_value(scenario, place):
                raise ConfigError(f"{file}: parameters.{name}.sets: no key {_spelt(place)} that takes a value")
    return scenario


def _takes_a_value(scenario: Scenario, place: str) -> bool:
    """Whether a dotted key, in which tables of an array go by their id or number, leads to one value of a scenario."""
    kinds: list[Any] = [] if place.startswith("parameters.") else [Scenario]
    here: Any = scenario
    for part in place.split("."):
        key: int | str = part
        if isinstance(here, tuple):
            names = [getattr(one, "id", None) for one in here] + [str(number) for number in range(len(here))]
            if part not in names:
                return False
            key = names.index(part) % len(here)
            here = here[key]
        else:
            here = here.get(part) if isinstance(here, dict) else getattr(here, part, None)
        kinds = list(_alternatives(one for kind in kinds for one in _inside(kind, key)))
    return bool(kinds) and not any(_is_table(kind) or get_origin(kind) in (dict, tuple) for kind in kinds)


def load(file: Path) -> Scenario:
    """Return the scenario in a TOML file.

    Raises ConfigError naming the file and what is wrong with it.
    """
    return parse(read(file, "scenario"), file)
