"""A scenario's table as the text of a TOML file: tables where a reader looks for them, all else in one line.

Knows the names of the tables; it must not know what they mean.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any, Final

#: keys that are tables of their own, and keys that are arrays of such
TABLES: Final = frozenset({"road", "ego", "lot", "story", "end_trigger", "parameters", "weather"})
ARRAYS: Final = frozenset({"actors", "actions"})
#: a line that is longer has one group of conditions in each line [characters]
WIDE: Final = 120


def toml_text(table: Mapping[str, Any]) -> str:
    """Return the text of a table."""
    return "\n".join(_lines("", table)).strip() + "\n"


def _lines(prefix: str, table: Mapping[str, Any]) -> Iterator[str]:
    inner = {key: value for key, value in table.items() if key in TABLES | ARRAYS}
    for key, value in table.items():
        if key not in inner:
            yield f"{key} = {_value(value)}"
    for key, value in inner.items():
        place = f"{prefix}{key}"
        if key == "parameters":
            for name, one in value.items():
                yield from ("", f"[{place}.{name}]", *(f"{of} = {_value(what)}" for of, what in one.items()))
            continue
        for one in value if key in ARRAYS else [value]:
            yield ""
            yield f"[[{place}]]" if key in ARRAYS else f"[{place}]"
            yield from _lines(f"{place}.", one)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(one)}" for key, one in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        parts = [_value(one) for one in value]
        text = "[" + ", ".join(parts) + "]"
        nested = any(isinstance(one, (list, Mapping)) for one in value)
        return text if len(text) <= WIDE or not nested else "[\n" + "".join(f"    {part},\n" for part in parts) + "]"
    return repr(value)
