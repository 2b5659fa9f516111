"""Configuration files: what a TOML table of them may say, how it is read, and one clear line for what is wrong with it.

Knows pydantic and units in the names of keys; it must not know what any file is about.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Final, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails

from vve_sumo.errors import ConfigError, closest
from vve_sumo.units import converted, dimension_of, is_quantity

Name = Annotated[str, Field(min_length=1)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
#: of an actuator's answer [s]
Short = Annotated[float, Field(ge=0.0, le=2.0, allow_inf_nan=False)]
#: of a braking [m/s2]
Strength = Annotated[float, Field(gt=0.0, le=12.0, allow_inf_nan=False)]
#: of a CAN bus [bit/s]
Bitrate = Annotated[int, Field(ge=10_000, le=1_000_000)]

#: endings of keys and what they are in SI units
UNITS: Final = {
    "_deg": math.pi / 180.0,
    "_degps": math.pi / 180.0,
    "_radps": 1.0,
    "_m": 1.0,
    "_m2": 1.0,
    "_s": 1.0,
    "_kg": 1.0,
    "_kgm": 1.0,
    "_kgm2": 1.0,
    "_mps": 1.0,
    "_mps2": 1.0,
    "_mps3": 1.0,
    "_n": 1.0,
    "_nm": 1.0,
    "_npr": 1.0,
    "_w": 1.0,
}

MAX_VALUE_LENGTH: Final = 80  #: characters of a wrong value that a complaint repeats
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


class Table(BaseModel):
    """One table of a file: unknown keys are errors, nothing is coerced, nothing changes after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    #: keys of former versions, and what each is called now
    FORMER: ClassVar[Mapping[str, str]] = {}
    #: what any other key may hold, in a table that takes others; None where it takes none
    OTHERS: ClassVar[Any] = None


def in_si(table: Table, *left_out: str) -> dict[str, float]:
    """Return the numbers that a table says, in SI units and by names without units."""
    numbers: dict[str, float] = {}
    for key, value in table:
        if value is not None and key not in left_out:
            name, _, unit = key.rpartition("_")
            factor = UNITS.get(f"_{unit}")
            numbers[key if factor is None else name] = value * (factor or 1.0)
    return numbers


def in_key_units(table: dict[str, Any], model: Any) -> dict[str, Any]:
    """Return a table with every quantity such as "25 mph" as a number under the key that names its unit.

    `model` is what the table should hold. A key without its unit takes a quantity: `speed = "25 mph"` is
    `speed_mps = 11.176`. What is wrong otherwise is left as it is. Raises ValueError, naming the key, for a unit that
    is none of the key's, and for a quantity that is there twice.
    """
    fields = {name: field.annotation for name, field in model.model_fields.items()}
    converted: dict[str, Any] = {}
    for key, value in table.items():
        try:
            name, inner = key_and_number(key, value, fields), _inside_in_key_units(value, fields.get(key))
        except ValueError as error:
            raise ValueError(f"{key}{'.' if isinstance(value, (dict, list)) else ': '}{error}") from None
        if name[0] in converted or (name[0] != key and name[0] in table):
            raise ValueError(f"{key}: is there beside {name[0]}, expected one of them")
        converted[name[0]] = inner if name == (key, value) else name[1]
    return converted


def key_and_number(key: str, value: object, fields: Collection[str]) -> tuple[str, object]:
    """Return the field that a quantity belongs to and its number there; what is no quantity comes as it is.

    Raises ValueError for a unit that is none of the field's.
    """
    if not is_quantity(value):
        return key, value
    named = (
        [key] if key in fields else [name for name in fields if dimension_of(name) and name.rpartition("_")[0] == key]
    )
    dimension = dimension_of(named[0]) if len(named) == 1 else None
    return (key, value) if dimension is None else (named[0], converted(str(value), dimension))


def _inside_in_key_units(value: Any, annotation: Any) -> Any:
    if isinstance(value, list):
        return [_numbered(number, one, annotation) for number, one in enumerate(value)]
    kinds = list(alternatives([annotation])) if isinstance(value, dict) else []
    tables = [kind for kind in kinds if is_table(kind)]
    if len(tables) == 1:
        return in_key_units(value, tables[0])
    of_all = [get_args(kind)[1] for kind in kinds if get_origin(kind) is dict]
    return {key: _inside_in_key_units(one, of_all[0]) for key, one in value.items()} if of_all else value


def _numbered(number: int, value: Any, annotation: Any) -> Any:
    kinds = [inner for kind in alternatives([annotation]) for inner in inside(kind, number)]
    try:
        return _inside_in_key_units(value, kinds[0]) if kinds else value
    except ValueError as error:
        raise ValueError(f"{number}.{error}") from None


def read_as(file: Path, kind: str, model: type[BaseModel]) -> dict[str, Any]:
    """Return the table in a TOML file as `read` does, its quantities as `in_key_units` returns them."""
    return numbers_of(read(file, kind), file, model)


def numbers_of(table: dict[str, Any], file: Path | str, model: type[BaseModel]) -> dict[str, Any]:
    """Return what `in_key_units` does; raises ConfigError that names the file and the key."""
    try:
        return in_key_units(table, model)
    except ValueError as error:
        raise ConfigError(f"{file}: {error}") from None


def complaint(file: Path | str, error: ValidationError, model: type[BaseModel]) -> str:
    """Say in one line what is wrong with a file that should hold a `model`: file, key, what was expected, what came."""
    complaints = error.errors(include_url=False)
    # A key that is spelt wrongly is also missing under its right name; the wrong spelling is what helps.
    first = next((one for one in complaints if one["type"] == "extra_forbidden"), complaints[0])
    place, kinds = _walk(first, model)
    key = ".".join(map(_key, place)) or "the file"
    if first["type"] == "extra_forbidden":
        former = {old: new for kind in kinds for old, new in getattr(kind, "FORMER", {}).items()}
        if place[-1] in former:
            return f"{file}: key {key!r} is now {former[place[-1]]!r}"
        return f"{file}: {unknown_key(key, str(place[-1]), [name for kind in kinds for name in kind.model_fields])}"
    if first["type"] == "missing":
        return f"{file}: key {key!r} is missing"
    # Where a value may be of several kinds there is a complaint of each; together they say what is allowed.
    expectations = dict.fromkeys(_expected(one) for one in complaints if _walk(one, model)[0] == place)
    return f"{file}: {key}: {' or '.join(expectations).replace(' or expected ', ' or ')}{_came(first)}"


def unknown_key(key: str, last: str, known: list[str]) -> str:
    """Say that a key is unknown, and which of the `known` ones its `last` part was probably meant to be."""
    meant = _meant(last, known)
    without = dimension_of(meant) is not None and meant.rpartition("_")[0] == last
    needs = f' A key without its unit takes a text with one: {last} = "5 {meant_unit(meant)}"' if without else ""
    return f"unknown key {key!r}" + (f", did you mean {meant!r}?{needs}" if meant else "")


def _expected(complaint: ErrorDetails) -> str:
    message = complaint["msg"].removeprefix("Value error, ").replace("Input should be ", "expected ", 1)
    message = message.replace("Tuple should", "array should")
    return EXPECTED.get(complaint["type"], message[0].lower() + message[1:])


def _came(complaint: ErrorDetails) -> str:
    """What came, unless it is a table: that would repeat half the file."""
    came = complaint["input"]
    return "" if isinstance(came, dict) and complaint["type"] == "value_error" else f", got {short_repr(came)}"


def short_repr(value: object) -> str:
    """A value in few characters that a line can hold."""
    if isinstance(value, dict):
        return "a table"
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # a whole number of thousands of digits, arrays in arrays in arrays
        return f"{type(value).__name__} beyond all bounds"
    return text if len(text) <= MAX_VALUE_LENGTH else text[:MAX_VALUE_LENGTH] + "…"


def _walk(complaint: ErrorDetails, model: type[BaseModel]) -> tuple[list[int | str], list[type[BaseModel]]]:
    """Return the keys that lead to what a complaint is about, and what tables the last of them may stand in.

    Pydantic's own place of an error names, among the keys, also the kinds that a value was tried as.
    """
    place: list[int | str] = []
    kinds: list[Any] = [model]
    unknown = len(complaint["loc"]) - 1 if complaint["type"] == "extra_forbidden" else -1
    tables = [model]
    for number, part in enumerate(complaint["loc"]):
        within = [one for kind in kinds for one in inside(kind, part)]
        if within or number == unknown:
            tables = [kind for kind in kinds if is_table(kind)]
            place, kinds = [*place, part], list(alternatives(within))
    return place, tables


def inside(kind: Any, part: int | str) -> Iterator[Any]:
    """What may stand under a key, or at a place, in something of a kind."""
    arguments = [one for one in get_args(kind) if one is not Ellipsis]
    if is_table(kind):
        field = kind.model_fields.get(str(part))
        annotation = getattr(kind, "OTHERS", None) if field is None else field.annotation
        yield from () if annotation is None else (annotation,)
    elif get_origin(kind) is dict:
        yield arguments[1]
    elif get_origin(kind) is tuple and isinstance(part, int):
        yield arguments[min(part, len(arguments) - 1)]


def is_table(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def alternatives(annotations: Iterable[Any]) -> Iterator[Any]:
    """Every kind that annotations allow, one by one."""
    for annotation in annotations:
        origin = get_origin(annotation)
        if origin is Annotated:
            yield from alternatives(get_args(annotation)[:1])
        elif origin in (Union, UnionType):
            yield from alternatives(get_args(annotation))
        elif annotation is not NoneType:
            yield annotation


def _key(part: int | str) -> str:
    """A key as it stands in a place, quoted where it is none that one would write bare."""
    text = str(part)
    return text if text.isprintable() and len(text) <= MAX_VALUE_LENGTH else short_repr(text)


def meant_unit(key: str) -> str:
    """Return the first unit that may be written for a key whose name ends in one."""
    dimension = dimension_of(key)
    return "" if dimension is None else next(iter(dimension.units))


def _meant(key: str, known: list[str]) -> str:
    """The known key that differs in its unit only, or else by little; empty for none."""
    stem = key.rsplit("_", 1)[0]
    others = [
        one for one in known if stem and one in (f"{stem}_{one.rsplit('_', 1)[-1]}", f"{key}_{one[len(key) + 1 :]}")
    ]
    stems = {one.rpartition("_")[0]: one for one in known if dimension_of(one)}
    return next(iter(others), "") or closest(key, known) or stems.get(closest(key, stems), "")


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


def read_json(file: Path, writer: str, *keys: str) -> dict[str, Any]:
    """Return the table in a JSON file that `writer` wrote, such as "a drive".

    Raises ConfigError where the file cannot be read, is no table, or lacks one of the `keys`.
    """
    wrong = f"{file}: not what {writer} writes"
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{file}: cannot be read: {error.strerror}; expected what {writer} writes") from None
    except ValueError as error:
        raise ConfigError(f"{wrong}: {error}") from None
    if not isinstance(data, dict):
        raise ConfigError(f"{wrong}: expected a table of keys")
    if missing := [key for key in keys if key not in data]:
        raise ConfigError(f"{wrong}: no {missing[0]} in it")
    return data
