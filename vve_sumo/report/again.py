"""The command that drives a recorded scenario again: its name, and with `--set` whatever was driven otherwise.

Compares the record's settings with the scenario that its name stands for where the report is written; it must not know
how a drive is run, nor the page.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vve_sumo import workspace
from vve_sumo.analysis.run import Run
from vve_sumo.config_file import read_as
from vve_sumo.errors import ConfigError
from vve_sumo.scenario import overrides
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.schema import Scenario


def command(run: Run, working: Path) -> str | None:
    """Return the command that drives the scenario of a lockstep drive again, started in the folder `working`.

    None where no such command does: the scenario is none that is found by its name there, it differs from the record in
    more than `--set` can say, a rig's car was driven, of which a record does not hold the file, or the record is a
    further ego's, which does not drive alone.
    """
    recorded, model = run.resolved["settings"], run.resolved.get("vehicle_model") or {}
    if model.get("rig") or run.resolved.get("faults") or "further_ego" in run.resolved:
        return None
    try:
        file = workspace.find("scenario", run.name, working)
        table = read_as(file, "scenario", Scenario)
        before = parse(table, file)
        options = {"seed": str(recorded["seed"]), "controller": str(recorded["controller"]["name"])}
        if recorded["ego"]["vehicle"] != before.ego.vehicle:
            options["vehicle"] = str(recorded["ego"]["vehicle"])
        chosen = overrides.choose(table, **options | {"seed": recorded["seed"]})
        values = dict(_differences(parse(chosen, file).model_dump(mode="json"), recorded))
        again = parse(overrides.checked(chosen, values, "--set "), file).model_dump(mode="json")
        settings = [word for key, value in values.items() for word in ("--set", f"{key}={_toml(value)}")]
    except (ConfigError, TypeError):
        return None
    if again != recorded:
        return None
    line = ["vve-sumo", "drive", run.name, *(word for name, value in options.items() for word in (f"--{name}", value))]
    return shlex.join([*line, *settings, "--out", "again"])


def _differences(declared: Any, recorded: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys at which two trees of settings differ, as deep as both have them, with what is there."""
    if isinstance(declared, Mapping) and isinstance(recorded, Mapping):
        if place and any(recorded[key] is None and declared.get(key) is not None for key in recorded):
            yield place, _without_none(recorded)  # a key that is to have no value is left out of its table
            return
        for key, value in recorded.items():
            yield from _differences(declared.get(key), value, f"{place}.{key}" if place else str(key))
    elif isinstance(declared, list) and isinstance(recorded, list) and len(declared) == len(recorded):
        for number, value in enumerate(recorded):
            yield from _differences(declared[number], value, f"{place}.{number}")
    elif declared != recorded:
        yield place, _without_none(recorded)


def _without_none(value: Any) -> Any:
    """Return a value without the keys that have none, for which TOML has no word."""
    if isinstance(value, Mapping):
        return {key: _without_none(one) for key, one in value.items() if one is not None}
    return [_without_none(one) for one in value] if isinstance(value, list) else value


def _toml(value: Any) -> str:
    """Return a value as TOML in one line; raises TypeError for what TOML has no word for."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{json.dumps(key)} = {_toml(one)}' for key, one in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    if isinstance(value, (bool, str)):
        return json.dumps(value)
    if isinstance(value, (int, float)):
        return repr(value)
    raise TypeError(f"{value!r} is no value of TOML")
