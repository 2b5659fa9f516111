"""Reads rig files; every complaint is one line that names file and key, and comes before anything is opened."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from vve_sumo.errors import ConfigError
from vve_sumo.rig.schema import Rig
from vve_sumo.rig.validation import refuse
from vve_sumo.scenario.load import complaint, read

_UNSURVEYED: Final = ": a lot that nobody has surveyed is refused; survey it, write down its corners and the day"
#: what to say beside that a key is missing
ADVICE: Final = {"lot": _UNSURVEYED, "lot.surveyed": _UNSURVEYED}


def parse(table: dict[str, Any], file: Path) -> Rig:
    """Return the rig that a parsed TOML table holds; `file` is named in the ConfigError of a wrong one."""
    return _judged(lambda: Rig.model_validate(table), file)


def parse_json(table: dict[str, Any], file: Path) -> Rig:
    """Return the rig that a record keeps, in which days are texts; `file` is named as `parse` names it."""
    return _judged(lambda: Rig.model_validate_json(json.dumps(table)), file)


def load(file: Path) -> Rig:
    """Return the rig in a TOML file.

    Raises ConfigError naming the file and what is wrong with it.
    """
    return parse(read(file, "rig"), file)


def _judged(validate: Callable[[], Rig], file: Path) -> Rig:
    try:
        rig = validate()
    except ValidationError as error:
        said = complaint(file, error, Rig)
        advice = (words for key, words in ADVICE.items() if said.endswith(f"key {key!r} is missing"))
        raise ConfigError(said + next(advice, "")) from None
    try:
        refuse(rig)
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    return rig
