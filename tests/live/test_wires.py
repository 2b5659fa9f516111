"""The paper's drive live over every wire that a mapping makes: frames on a bus, the simulated other end, the record."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
import tomlkit

from tests.conftest import REPOSITORY
from tests.exhaustive import with_slow
from tests.live.command_line import own_rig, vve_sumo
from tests.live.witness import stalls, witness
from tests.vehicle.mapped.test_drives import WIRES
from vve_sumo.bus import read_log
from vve_sumo.vehicle.interface import InterfaceConfig

pytestmark = [pytest.mark.live, pytest.mark.thorough]

PARKED_AT = 200.0  #: s of the parked car [m]
#: a machine that stands still for longer than the gateway's timer may is no machine for this test; so many may not
TRIES = 3


def scenario(folder: Path) -> Path:
    """Write the shipped scenario with the parked car near, on an empty road."""
    table: Any = tomlkit.parse((REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8"))
    table["road"]["demand"] = []
    table["obstacles"][0]["at_m"] = PARKED_AT
    file = folder / "near.toml"
    file.write_text(tomlkit.dumps(table), encoding="utf-8")
    return file


def rig(folder: Path, config: InterfaceConfig) -> Path:
    """Write the simulated rig with another wire; a mapping of one's own lies beside it."""
    settings = dict(config.settings)
    if isinstance(mapping := settings.get("mapping_file"), str):
        for file in Path(mapping).parent.glob("campus_shuttle.*"):
            shutil.copy(file, folder)
        settings["mapping_file"] = Path(mapping).name
    # The rig says of its watchdog that it brakes.
    settings |= {"when_commands_stop": "brakes"} if "when_commands_stop" in settings else {}
    said = ", ".join(f"{key} = {json.dumps(value)}" for key, value in settings.items())
    mine = f'interface = "{config.name}"\nsettings = {{ {said} }}'
    return own_rig(folder, ('settings = { variant = "dbw1_2024" }', mine))


@pytest.mark.parametrize("name", with_slow(list(WIRES), lambda name: name == "own car"))
def test_it_stops_behind_the_parked_car_and_replays(tmp_path: Path, name: str) -> None:
    for number in range(TRIES):
        folder = tmp_path / str(number)
        folder.mkdir()
        record = folder / "record"
        own = str(rig(folder, WIRES[name]))
        with witness(folder / "witness.txt"):
            done = vve_sumo("drive", str(scenario(folder)), "--rig", own, "--out", str(record), cwd=folder)
        assert (record / "summary.json").exists(), done.stdout + done.stderr
        summary = json.loads((record / "summary.json").read_text(encoding="utf-8"))
        if summary["reasons"] != ["timer_gap"] or not stalls(folder / "witness.txt", 0.0, float("inf")):
            break
    assert done.returncode == 0, done.stdout + done.stderr
    assert summary["outcome"] == "stopped"
    assert summary["stop_gap_m"] == pytest.approx(5.0, abs=0.7)
    assert not summary["collision"]
    recorded = json.loads((record / "scenario.json").read_text(encoding="utf-8"))
    assert recorded["gateway"]["interface"]["name"] == WIRES[name].name
    assert len({frame.id for _time, _channel, frame in read_log(record / "can.log")}) > 6
    again = vve_sumo("replay", str(record), cwd=folder)
    assert again.returncode == 0, again.stdout + again.stderr
