"""Reads rig files; every complaint is one line that names file and key, and comes before anything is opened."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from vve_sumo.errors import ConfigError
from vve_sumo.pose.receivers import port as receivers
from vve_sumo.rig.schema import Rig, rig_with
from vve_sumo.rig.validation import refuse
from vve_sumo.scenario.load import complaint, read

_UNSURVEYED: Final = ": a lot that nobody has surveyed is refused; survey it, write down its corners and the day"
#: what to say beside that a key is missing
ADVICE: Final = {"lot": _UNSURVEYED, "lot.surveyed": _UNSURVEYED}


def parse(table: dict[str, Any], file: Path) -> Rig:
    """Return the rig that a parsed TOML table holds; `file` is named in the ConfigError of a wrong one."""
    return _judged(table, file, lambda model, rig: model.model_validate(rig))


def parse_json(table: dict[str, Any], file: Path) -> Rig:
    """Return the rig that a record keeps, in which days are texts; `file` is named as `parse` names it."""
    return _judged(table, file, lambda model, rig: model.model_validate_json(json.dumps(rig)))


def load(file: Path) -> Rig:
    """Return the rig in a TOML file.

    Raises ConfigError naming the file and what is wrong with it.
    """
    return parse(read(file, "rig"), file)


def _judged(table: dict[str, Any], file: Path, validate: Callable[[type[Rig], dict[str, Any]], Rig]) -> Rig:
    try:
        table, model = _with_its_receiver(table)
        rig = validate(model, table)
        refuse(rig)
    except ValidationError as error:
        said = complaint(file, error, model)
        advice = (words for key, words in ADVICE.items() if said.endswith(f"key {key!r} is missing"))
        raise ConfigError(said + next(advice, _keys_of(table, model, said))) from None
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    return rig


def _with_its_receiver(table: dict[str, Any]) -> tuple[dict[str, Any], type[Rig]]:
    """Return a rig's table and its model, which `pose.kind` decides on; raises ConfigError naming the key.

    A kind that is a file of somebody's counts from the working folder of now, whoever reads the record later.
    """
    pose = table.get("pose")
    if not isinstance(pose, dict):
        return table, Rig
    if "kind" not in pose:
        raise ConfigError("key 'pose.kind' is missing")
    kind = pose["kind"]
    if not (isinstance(kind, str) and kind.isprintable()):
        raise ConfigError("pose.kind: expected the name of a kind of receiver in quotes")
    file, colon, function = kind.rpartition(":")
    kind = f"{Path(file).resolve()}:{function}" if colon else kind
    try:
        return table | {"pose": pose | {"kind": kind}}, rig_with(receivers.load(kind))
    except ConfigError as error:
        raise ConfigError(f"pose.kind: {error}") from None


def _keys_of(table: dict[str, Any], model: type[Rig], said: str) -> str:
    """Return what to say beside that a key of the receiver is unknown: those that its kind has."""
    if "unknown key 'pose." not in said:
        return ""
    keys = sorted(model.model_fields["pose"].annotation.model_fields)  # type: ignore[union-attr]
    return f"; kind {table['pose']['kind']!r} has {', '.join(keys)}"
