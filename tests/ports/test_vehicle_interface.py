"""The shipped drive-by-wire interface, and a small one of an invented wire, against the port's suite."""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import vehicles
from tests.drive.street import REPOSITORY, altered
from tests.isolated import isolated
from tests.live.matrix import MATRIX
from tests.live.stage import rig_of
from tests.ports.interface_bench import Bench
from tests.ports.vehicle_interface import VehicleInterfaceConformance
from tests.vehicle.whole_car import LOT
from vve_sumo.errors import ConfigError
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.injectable import injectable_kinds, require_injectable
from vve_sumo.plant.injected_faults import KINDS, InjectedFault
from vve_sumo.rig.load import parse
from vve_sumo.vehicle.interface import DEFAULT, INTERFACE_KINDS, PORT, InterfaceConfig, load

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


@pytest.mark.thorough
def test_the_papers_drive_over_another_wire():
    summary, identifiers, difference, changes = isolated(drive_with_the_toy)
    assert (summary["outcome"], summary["collision"]) == ("stopped", False)
    assert identifiers == {0x300, 0x310, 0x311}
    assert difference is None
    assert changes == [[], ["interface_interface has changed since"]]


SIMULATED = REPOSITORY / "rigs" / "simulated.toml"


def with_the_toy(text: str) -> dict[str, Any]:
    """Return a rig with the toy's wire, on which no watchdog was tried."""
    rig = tomllib.loads(text)
    rig["drive_by_wire"] = {"interface": TOY.name, "settings": dict(TOY.settings)}
    del rig["watchdog_test"]
    return rig


def rig_with_the_toy(kind: str) -> dict[str, Any]:
    """Return the rig of the simulated vehicle with the toy's wire and a fault."""
    return with_the_toy(SIMULATED.read_text(encoding="utf-8")) | {"faults": [{"kind": kind, "at_s": 1.0}]}


@pytest.mark.thorough(witnesses=9)
@pytest.mark.parametrize("kind", KINDS)
def test_a_rig_is_refused_whose_fault_the_interface_cannot_inject(kind):
    refused = INTERFACE_KINDS.keys() - {"report_malformed"}
    if kind not in refused:
        assert parse(rig_with_the_toy(kind), SIMULATED).faults[0].kind == kind
        return
    with pytest.raises(ConfigError) as caught:
        parse(rig_with_the_toy(kind), SIMULATED)
    assert str(caught.value) == (
        f"{SIMULATED}: faults.0: fault {kind}: it cannot be injected through interface {TOY.name}: "
        "of the kinds that an interface injects itself it can: report_malformed"
    )


def test_the_suite_finds_a_claim_that_is_not_kept(tmp_path):
    file = tmp_path / "boastful.py"
    boast = "\n\nSimulatedToy.injectable = frozenset({'brake_fault', 'brake_report_frozen', 'override_false'})\n"
    file.write_text(TOY_FILE.read_text(encoding="utf-8") + boast, encoding="utf-8")
    suite, config = VehicleInterfaceConformance(), dataclasses.replace(TOY, name=f"{file}:make")
    with pytest.raises(AssertionError):
        suite.test_a_reported_fault_is_one_subsystems_and_it_goes_on_working(Bench(config), 0)
    with pytest.raises(AssertionError):
        suite.test_a_frozen_report_stays_what_it_was_and_the_others_go_on(Bench(config), 0)
    with pytest.raises(AssertionError):
        suite.test_a_false_override_is_in_one_report_and_nobody_took_over(Bench(config), 1.0)


def test_a_fault_of_a_sensor_that_no_report_shows_is_refused(tmp_path):
    file = tmp_path / "poor.py"
    file.write_text(
        TOY_FILE.read_text(encoding="utf-8")
        + "\n\nimport dataclasses\n\ndef poor(settings):\n    toy = make(settings)\n"
        "    status = (BrakeState, ThrottleState, SteeringState, GearState)\n"
        "    reports = {STATUS: status, MOTION: (WheelSpeeds, YawRate)}\n"
        "    toy.facts = dataclasses.replace(toy.facts, reports=reports)\n    return toy\n",
        encoding="utf-8",
    )
    poor = dataclasses.replace(TOY, name=f"{file}:poor")
    with pytest.raises(ConfigError, match=r"fault brake_torque_scaled: .*poor: the interface reports no BrakeTorque"):
        require_injectable([InjectedFault("brake_torque_scaled", 1.0, 1.0)], poor)
    require_injectable([InjectedFault("brake_torque_scaled", 1.0, 1.0)], TOY)


def test_a_simulated_end_that_does_not_say_what_it_injects_is_told_so(tmp_path):
    file = tmp_path / "old.py"
    file.write_text(TOY_FILE.read_text(encoding="utf-8") + "\n\ndel SimulatedToy.injectable\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"old.py:make: SimulatedToy has no `injectable`, expected the kinds of"):
        require_injectable([InjectedFault("brake_fault", 1.0, 1.0)], dataclasses.replace(TOY, name=f"{file}:make"))


def test_a_car_is_not_made_with_a_fault_that_its_interface_cannot_inject():
    seeds = np.random.SeedSequence
    parameters, fault = vehicles.parameters(interface=TOY), InjectedFault("brake_fault", 1.0, 1.0)
    with pytest.raises(ConfigError, match="fault brake_fault: it cannot be injected through interface"):
        FaultInjectedCar(parameters, (0.0, 0.0, 0.0), LOT, 1_447_000_000.0, seeds(1), [fault], seeds(2))


@pytest.mark.thorough(witnesses=9)
@pytest.mark.parametrize("row", [row for row in MATRIX if row.faults], ids=lambda row: row.name)
def test_a_row_of_the_fault_matrix_is_never_green_for_a_fault_that_is_not_injected(row):
    """A rig of a row with another wire loads only where every fault of the row can be injected over it."""
    possible = all(fault.kind in injectable_kinds(TOY) for fault in row.faults)
    rig = with_the_toy(rig_of(row, 3000))
    if possible:
        assert len(parse(rig, SIMULATED).faults) == len(row.faults)
    else:
        with pytest.raises(ConfigError, match="cannot be injected through interface"):
            parse(rig, SIMULATED)


def test_the_shipped_ones_are_known():
    assert "dataspeed_dbw1" in PORT.known()
    assert PORT.find("dataspeed_dbw1")(DEFAULT.settings).facts == load(DEFAULT).facts


@pytest.mark.parametrize(
    ("config", "said"),
    [
        (InterfaceConfig("nobodys", {}), "interface nobodys: unknown; known are dataspeed_dbw1, "),
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
