"""Writes measured values into a rig file; comments and everything else in it stay.

Knows TOML and how a rig is validated; not what the values mean or how they were measured.
"""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from vve_sumo.errors import ConfigError
from vve_sumo.rig import load
from vve_sumo.rig.schema import Rig

#: table, such as `lot` or `alignments.east`, and key to value; a day is a `datetime.date`
Values = Mapping[tuple[str, str], Any]


def lay(document: Any, values: Values) -> None:
    """Set keys of a tomlkit document, making tables that are missing; all else stays as it is."""
    import tomlkit

    for (table, key), value in values.items():
        inner = document
        *parents, last = table.split(".")
        for parent in parents:
            inner = inner.setdefault(parent, tomlkit.table(is_super_table=True))
        inner.setdefault(last, tomlkit.table())[key] = value


def put(file: Path, values: Values, emptied: Collection[str] = ()) -> Rig:
    """Set keys of a rig file, atomically for other readers, and return the rig that it holds now.

    Tables named in `emptied` lose all their other keys. Raises ConfigError, the file untouched, where it cannot be
    written or where the result would not load.
    """
    import tomlkit

    load.load(file)  # reports errors that the file already has
    document = tomlkit.parse(file.read_text(encoding="utf-8"))
    for table in emptied:
        inner = _within(document, table)
        for key in list(inner):
            if (table, key) not in values:
                inner.remove(key)
    lay(document, values)
    text = tomlkit.dumps(document)
    rig = load.parse(tomllib.loads(text), file)
    _replace(file.resolve(), text)
    return rig


def _within(document: Any, table: str) -> Any:
    """Return a table of a document by its dotted name; an empty one where it is missing."""
    inner = document
    for part in table.split("."):
        inner = inner.get(part, {})
    return inner


def _replace(file: Path, text: str) -> None:
    half = file.with_name(f".{file.name}.half")
    try:
        half.write_text(text, encoding="utf-8")
        shutil.copymode(file, half)
        half.replace(file)
    except OSError as error:
        raise ConfigError(f"rig {file}: cannot be written: {error.strerror}") from None
    finally:
        half.unlink(missing_ok=True)
