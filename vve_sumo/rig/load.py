"""Reads rig files and merges them over their vehicle models; an error is one line that names file and key.

All errors are raised before a bus, socket or device is opened.
"""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from vve_sumo import workspace
from vve_sumo.config_file import complaint, in_key_units, numbers_of, read, read_as
from vve_sumo.errors import ConfigError
from vve_sumo.pose.receivers import port as receivers
from vve_sumo.rig.dates import day_to_come
from vve_sumo.rig.schema import Rig, rig_with
from vve_sumo.rig.unknown import UNKNOWN, first_unknown
from vve_sumo.rig.validation import refuse
from vve_sumo.scenario.schema import DEFAULT_VEHICLE
from vve_sumo.vehicle import load as vehicles
from vve_sumo.vehicle.schema import VehicleFile

_UNSURVEYED: Final = ": a lot that nobody has surveyed is refused; survey it, write down its corners and the day"
#: what to say beside that a key is missing
ADVICE: Final = {"lot": _UNSURVEYED, "lot.surveyed": _UNSURVEYED}
#: tables of a vehicle file that a rig may change
MODEL_TABLES: Final = ("vehicle", "calibration", "simulated", "measured")


def parse(table: dict[str, Any], file: Path, working: Path | None = None) -> Rig:
    """Return the rig that a parsed TOML table holds, laid over its vehicle model.

    The model is looked up from the folder of `file` and from `working`, by default the current one; `file` is named in
    the ConfigError of a wrong rig.
    """
    if (unknown := first_unknown(table)) is not None:
        raise ConfigError(f"{file}: {unknown}: is still {UNKNOWN!r}; find it out on this car or lot and write it down")
    whole = _over_model(numbers_of(table, file, Rig), file, working or Path.cwd())
    return _judged(whole, file, lambda model, rig: model.model_validate(rig))


def parse_json(table: dict[str, Any], file: Path) -> Rig:
    """Return the rig that a record keeps whole, in which days are texts; `file` is named as `parse` names it."""
    return _judged(table, file, lambda model, rig: model.model_validate_json(json.dumps(rig)))


def load(file: Path, working: Path | None = None, today: datetime.date | None = None) -> Rig:
    """Return the rig in a TOML file, laid over its vehicle model; `today` is by default this computer's day.

    Raises ConfigError naming the file and what is wrong with it, such as a day that is still to come.
    """
    rig = parse(read(file, "rig"), file, working)
    if (problem := day_to_come(rig, today or datetime.date.today())) is not None:
        raise ConfigError(f"{file}: {problem}")
    return rig


def _over_model(table: dict[str, Any], file: Path, working: Path) -> dict[str, Any]:
    """Return a rig's table completed with the values of its vehicle model."""
    stated = {name: table.get(name, {}) for name in MODEL_TABLES}
    if not all(isinstance(one, dict) for one in stated.values()):
        return table  # which the schema refuses in its own words
    name = stated["vehicle"].get("model", DEFAULT_VEHICLE)
    if not isinstance(name, str):
        raise ConfigError(f"{file}: vehicle.model: expected a text in quotes, got {name!r}")
    try:
        found = workspace.find("vehicle", name, working, beside=file.parent)
    except ConfigError as error:
        raise ConfigError(f"{file}: vehicle.model: {error}") from None
    wire = vehicles.load(found).interface  # and what is wrong in the model's own file is refused
    model = read_as(found, "vehicle", VehicleFile)
    whole: dict[str, Any] = {
        one: {k: v for k, v in model[one].items() if k != "sources"} | stated[one]
        for one in MODEL_TABLES
        if one in model  # which need not say what was measured
    }
    if "brake_gain_kgm" not in stated["calibration"]:
        _scale_brake_gain(whole, model["vehicle"])
    if isinstance(table.get("drive_by_wire"), dict):  # its settings are verified on the car: none are the model's
        whole["drive_by_wire"] = {"interface": wire.name} | table["drive_by_wire"]
        if isinstance(settings := whole["drive_by_wire"].get("settings"), dict):
            whole["drive_by_wire"]["settings"] = vehicles.located(settings, file.parent)
    # A record keeps the rig whole: the model's file must be found again from anywhere.
    whole["vehicle"]["model"] = name if name == found.name.removesuffix(".toml") else str(found.absolute())
    return table | whole


def _scale_brake_gain(whole: dict[str, Any], model: dict[str, Any]) -> None:
    """Scale the model's brake gain, where none was measured, with mass times wheel radius."""
    factors = [whole["vehicle"][key] for key in ("mass_kg", "wheel_radius_m")]
    if all(type(factor) in (int, float) for factor in factors):  # anything else the schema refuses
        share = factors[0] * factors[1] / (model["mass_kg"] * model["wheel_radius_m"])
        whole["calibration"]["brake_gain_kgm"] *= share


def _judged(table: dict[str, Any], file: Path, validate: Callable[[type[Rig], dict[str, Any]], Rig]) -> Rig:
    try:
        table, model = _with_its_receiver(table)
        rig = validate(model, table)
        refuse(rig)
    except ValidationError as error:
        message = complaint(file, error, model)
        advice = (words for key, words in ADVICE.items() if message.endswith(f"key {key!r} is missing"))
        raise ConfigError(message + next(advice, _keys_of(table, model, message))) from None
    except ConfigError as error:
        raise ConfigError(f"{file}: {error}") from None
    return rig


def _with_its_receiver(table: dict[str, Any]) -> tuple[dict[str, Any], type[Rig]]:
    """Return a rig's table and its model, which `pose.kind` decides on; raises ConfigError naming the key.

    Quantities in the keys of the kind become numbers, as `numbers_of` makes those of every rig. A kind given as a file
    is resolved against the present working folder, so that a record can be read from anywhere.
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
        receiver = receivers.load(kind)
    except ConfigError as error:
        raise ConfigError(f"pose.kind: {error}") from None
    try:
        return table | {"pose": in_key_units(pose, receiver) | {"kind": kind}}, rig_with(receiver)
    except ValueError as error:
        raise ConfigError(f"pose.{error}") from None


def _keys_of(table: dict[str, Any], model: type[Rig], message: str) -> str:
    """Return the hint beside an unknown key of the receiver: the keys that its kind has."""
    if "unknown key 'pose." not in message:
        return ""
    keys = sorted(model.model_fields["pose"].annotation.model_fields)  # type: ignore[union-attr]
    return f"; kind {table['pose']['kind']!r} has {', '.join(keys)}"
