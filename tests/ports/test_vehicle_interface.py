"""The shipped drive-by-wire interface, and a small one of an invented wire, against the port's suite."""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
from pathlib import Path
from typing import Any

import pytest

from tests.drive.street import REPOSITORY, altered
from tests.isolated import isolated
from tests.ports.vehicle_interface import VehicleInterfaceConformance
from vve_sumo.errors import ConfigError
from vve_sumo.vehicle.interface import DEFAULT, PORT, InterfaceConfig, load

TOY_FILE = Path(__file__).parent / "toy" / "interface.py"
TOY = InterfaceConfig(f"{TOY_FILE}:make", {"brake_nm": 3412.0})


class TestDataspeed2018(VehicleInterfaceConformance):
    config = InterfaceConfig("dataspeed_dbw1", {"variant": "dbw1_2018"})


class TestDataspeed2024(VehicleInterfaceConformance):
    config = DEFAULT


class TestToy(VehicleInterfaceConformance):
    config = TOY


def drive_with_the_toy() -> tuple[dict[str, Any], set[int], object, list[list[str]]]:
    """Drive the paper's drive over the toy's wire.

    Returns the summary, the identifiers on the bus, what replay says, and what is said of the toy's code before and
    after a byte of it has changed.
    """
    from vve_sumo import bus
    from vve_sumo.drive import run as drives
    from vve_sumo.drive.replay import changed_code, read_car_frames, read_pipeline_inputs, recorded_scenario, replay
    from vve_sumo.drive.resolved_scenario import DEFAULT_EPOCH

    resolved = altered({})
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(shutil.copy(TOY_FILE, scratch))
        toy = dataclasses.replace(TOY, name=f"{file}:make")
        resolved = dataclasses.replace(resolved, model=dataclasses.replace(resolved.model, interface=toy))
        folder = Path(scratch) / "record"
        summary = drives.run(resolved, folder, REPOSITORY).summary
        identifiers = {frame.id for _time, _channel, frame in bus.read_log(folder / "can.log")}
        again = recorded_scenario(folder, REPOSITORY)
        frames = read_car_frames(folder, DEFAULT_EPOCH, again.model.interface)
        difference = replay(again, read_pipeline_inputs(folder), frames, REPOSITORY)
        changes = [changed_code(folder, REPOSITORY)]
        file.write_bytes(file.read_bytes() + b"# changed\n")
        return summary, identifiers, difference, [*changes, changed_code(folder, REPOSITORY)]


def test_the_papers_drive_over_another_wire():
    summary, identifiers, difference, changes = isolated(drive_with_the_toy)
    assert (summary["outcome"], summary["collision"]) == ("stopped", False)
    assert identifiers == {0x300, 0x310, 0x311}
    assert difference is None
    assert changes == [[], ["interface_interface has changed since"]]


def test_the_shipped_ones_are_known():
    assert "dataspeed_dbw1" in PORT.known()
    assert PORT.find("dataspeed_dbw1")(DEFAULT.settings).facts == load(DEFAULT).facts


@pytest.mark.parametrize(
    ("config", "said"),
    [
        (InterfaceConfig("pacmod", {}), "interface pacmod: unknown; known are dataspeed_dbw1"),
        (InterfaceConfig("nowhere.py:make", {}), r"interface nowhere.py:make: there is no file nowhere.py"),
        (InterfaceConfig(f"{TOY_FILE}:mke", {}), r"offers no function mke\(settings\)"),
        (InterfaceConfig(f"{TOY_FILE}:make", {}), "settings must be brake_nm"),
        (InterfaceConfig("dataspeed_dbw1", {}), "setting 'variant' must be dbw1_2018 or dbw1_2024, .* got None"),
        (InterfaceConfig("dataspeed_dbw1", {"variant": 2018.0}), "setting 'variant' must be .* got 2018.0"),
    ],
)
def test_what_cannot_be_made_is_one_line(config, said):
    with pytest.raises(ConfigError, match=said) as refused:
        load(config)
    assert str(refused.value).startswith(f"drive-by-wire interface {config.name}: ")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            "reports={0x310: (BrakeState,)}",
            "it reports no GearState, SteeringState, ThrottleState, ",
        ),
        ("commands=frozenset({0x310})", "identifier 0x310 is both a command and a report"),
    ],
)
def test_what_could_not_be_driven_with_is_refused(tmp_path, change, said):
    source = TOY_FILE.read_text(encoding="utf-8")
    file = tmp_path / "poor.py"
    file.write_text(
        source + "\n\nimport dataclasses\n\ndef poor(settings):\n    toy = make(settings)\n"
        f"    toy.facts = dataclasses.replace(toy.facts, {change})\n    return toy\n",
        encoding="utf-8",
    )
    with pytest.raises(ConfigError, match=said):
        load(dataclasses.replace(TOY, name=f"{file}:poor"))


def test_what_make_returns_must_be_an_interface(tmp_path):
    file = tmp_path / "nothing.py"
    file.write_text("def make(settings):\n    return 7\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="make returned a int, which is no VehicleInterface"):
        load(InterfaceConfig(f"{file}:make", {}))
