"""The paper's drive over every wire that a mapping makes, in lockstep, and its record run again."""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
from pathlib import Path
from typing import Any

import pytest

from tests.drive.street import REPOSITORY, altered
from tests.isolated import isolated
from tests.vehicle.mapped import test_conformance as wires
from vve_sumo.values import EXTENDED
from vve_sumo.vehicle.interface import InterfaceConfig

WIRES = {
    "own car": wires.TestWorkedExample.config,
    "PACMod 3": wires.TestPacmod3.config,
    "Raptor": wires.TestNewEagleRaptor.config,
    "ULC": wires.TestUlc2024.config,
}


def drive(config: InterfaceConfig) -> tuple[dict[str, Any], set[int], object, list[list[str]]]:
    """Drive over a wire; return summary, identifiers, what replay says, and what has changed before and after a change.

    A mapping of its own is changed by a comment after the drive.
    """
    from vve_sumo import bus
    from vve_sumo.drive import run as drives
    from vve_sumo.drive.replay import changed_code, read_car_frames, read_pipeline_inputs, recorded_scenario, replay
    from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH

    with tempfile.TemporaryDirectory() as scratch:
        mapping = config.settings.get("mapping_file")
        if isinstance(mapping, str):
            for file in Path(mapping).parent.glob("campus_shuttle.*"):
                shutil.copy(file, scratch)
            own = Path(scratch) / Path(mapping).name
            config = dataclasses.replace(config, settings={"mapping_file": str(own)})
        resolved = altered({})
        resolved = dataclasses.replace(resolved, model=dataclasses.replace(resolved.model, interface=config))
        folder = Path(scratch) / "record"
        summary = drives.run(resolved, folder, REPOSITORY).summary
        identifiers = {frame.id for _time, _channel, frame in bus.read_log(folder / "can.log")}
        again = recorded_scenario(folder, REPOSITORY)
        frames = read_car_frames(folder, DEFAULT_EPOCH, again.model.interface)
        difference = replay(again, read_pipeline_inputs(folder), frames, REPOSITORY)
        changes = [changed_code(folder, REPOSITORY)]
        if isinstance(mapping, str):
            own.write_bytes(own.read_bytes() + b"# changed\n")
        return summary, identifiers, difference, [*changes, changed_code(folder, REPOSITORY)]


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("name", WIRES)
def test_the_papers_drive_over_every_wire(name):
    summary, identifiers, difference, changes = isolated(drive, WIRES[name])
    assert (summary["outcome"], summary["collision"]) == ("stopped", False)
    assert summary["stop_gap_m"] == pytest.approx(5.0, abs=0.7)
    assert summary["max_lateral_deviation_m"] < 0.1
    assert difference is None
    assert all(bool(identifier & EXTENDED) is (name == "Raptor") for identifier in identifiers)
    own = ["wire_campus_shuttle.toml has changed since"] if name == "own car" else []
    assert changes == [[], own]
