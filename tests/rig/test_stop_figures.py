"""What a rig says of its stops is at most what car, brakes, wire, gateway, interface and tyres can do."""

from __future__ import annotations

import datetime
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.complaints import complaint_of
from tests.conftest import REPOSITORY
from tests.vehicle.van import DATASPEED, OWN_WIRE, TOY, van_file
from vve_sumo.errors import ConfigError
from vve_sumo.frames import Alignment
from vve_sumo.rig import resolve
from vve_sumo.rig.load import parse
from vve_sumo.rig.schema import Rig
from vve_sumo.values import Point, Pose
from vve_sumo.vehicle.interface import load

WATCHDOG = {"date": datetime.date(2026, 1, 1), "armed": True, "deceleration_mps2": 2.5, "delay_s": 0.2}
ROLLING = WATCHDOG | {"armed": False, "deceleration_mps2": 0.2}
#: an interface of one's own that says of itself what is put in its place
STOPS = """
import dataclasses, importlib.util
from vve_sumo.vehicle.interface import CommandsStop, WhenCommandsStop

def make(settings):
    spec = importlib.util.spec_from_file_location("toy", {toy!r})
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    wire = module.make(settings)
    wire.facts = dataclasses.replace(wire.facts, when_commands_stop=CommandsStop({stops}))
    return wire
"""
RELEASES = 'WhenCommandsStop.RELEASES, "lets go of everything and beeps"'
HOLDS = 'WhenCommandsStop.HOLDS, "keeps its last command"'
BRAKES = 'WhenCommandsStop.BRAKES, "brakes where its watchdog is armed"'


def real(**tables: Any) -> dict[str, Any]:
    table = tomllib.loads((REPOSITORY / "rigs" / "fusion_example.toml").read_text(encoding="utf-8"))
    table["lot"]["surveyed"] = datetime.date(2026, 1, 1)
    return {**table, **{name: table.get(name, {}) | change for name, change in tables.items()}}


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"limits": {"stop_deceleration_mps2": 9.0}}, "limits.stop_deceleration_mps2: expected 5.9 m/s2 or less (car"),
        ({"limits": {"critical_deceleration_mps2": 6.0}}, "limits.critical_deceleration_mps2: expected 5.9 m/s2"),
        ({"limits": {"comfort_deceleration_mps2": 8.0}}, "limits.comfort_deceleration_mps2: expected 5.9 m/s2"),
        (
            {"limits": {"stop_deceleration_mps2": 5.0}, "calibration": {"brake_gain_kgm": 700.0}},
            "limits.stop_deceleration_mps2: expected 4.64 m/s2 or less (car 5.9, brakes 4.64, wire 4.87, gateway 9, ",
        ),
        (
            {
                "limits": {
                    "emergency_deceleration_mps2": 4.0, "stop_deceleration_mps2": 4.5, "comfort_deceleration_mps2": 3.0
                }
            },
            "limits.stop_deceleration_mps2: expected 4 m/s2 or less (car 5.9, brakes 5.9, wire 6.2, gateway 4, tyres "
            "8.82 m/s2; least: limits.emergency_deceleration_mps2 is 4); got 4.5",
        ),
        ({"watchdog_test": WATCHDOG | {"deceleration_mps2": 6.0}}, "watchdog_test.deceleration_mps2: expected 5.9 m"),
    ],
)  # fmt: skip
def test_no_figure_is_more_than_car_brakes_wire_and_gateway_give(tables: dict[str, Any], said: str) -> None:
    assert complaint_of(parse, real(**tables)).startswith(said)


def test_the_figure_that_is_named_is_taken() -> None:
    """What a complaint expects is no rounding too high: with it the rig loads."""
    tables = {"calibration": {"brake_gain_kgm": 577.7}}
    said = complaint_of(parse, real(limits={"stop_deceleration_mps2": 9.0}, **tables))
    expected = float(re.search(r"expected ([\d.]+) m/s2", said)[1])  # type: ignore[index]
    assert parse(real(limits={"stop_deceleration_mps2": expected}, **tables), Path("mine.toml"))


def test_a_heavy_car_on_a_weak_wire_is_refused_and_on_its_own_it_is_not(tmp_path: Path) -> None:
    """The gateway stops with 4.0 m/s2 after a critical fault where a rig says nothing; 3412 N m give this car 3.93."""
    heavy = real(vehicle={"model": str(van_file(tmp_path, DATASPEED))})
    said = complaint_of(parse, heavy)
    assert said.startswith("limits.critical_deceleration_mps2: expected 3.93 m/s2 or less (car 5.5, brakes 5.76, wire ")
    assert "least: Dataspeed DBW1 (dbw1_2024) takes 3412 N m" in said
    assert said.endswith("got 4, its default")
    own = heavy | {"drive_by_wire": {"interface": f"{TOY}:make", "settings": {"brake_nm": 6000.0}}}
    assert parse(own, Path("mine.toml")).drive_by_wire.interface == f"{TOY}:make"


def test_a_rig_without_an_interface_has_its_vehicles(tmp_path: Path) -> None:
    model = {"vehicle": {"model": str(van_file(tmp_path, OWN_WIRE))}}
    ours = parse(real(**model) | {"drive_by_wire": {"settings": {"brake_nm": 5500.0}}}, Path("mine.toml"))
    assert resolve.model_of(ours).interface.name == f"{TOY}:make"
    assert resolve.model_of(ours).interface.settings == {"brake_nm": 5500.0}
    silent = real(**model)
    del silent["drive_by_wire"]
    assert complaint_of(parse, silent) == "key 'drive_by_wire' is missing"


def with_interface(folder: Path, stops: str, **tables: Any) -> dict[str, Any]:
    file = folder / "wire.py"
    file.write_text(STOPS.format(toy=str(TOY), stops=stops), encoding="utf-8")
    wire = {"drive_by_wire": {"interface": f"{file}:make", "settings": {"brake_nm": 3412.0}}}
    return real(**tables) | wire


@pytest.mark.parametrize(
    ("stops", "test", "said"),
    [
        (
            RELEASES,
            WATCHDOG,
            "watchdog_test.armed: expected false: when commands stop, toy lets go of everything and beeps; "
            "it has no watchdog that brakes",
        ),
        (HOLDS, WATCHDOG, "watchdog_test: expected none: when commands stop, toy keeps its last command, so nothing "),
        (HOLDS, ROLLING, "watchdog_test: expected none: "),
        (
            f"{BRAKES}, deceleration=2.0",
            WATCHDOG,
            "watchdog_test.deceleration_mps2: expected 2.00 m/s2 or less, all that the watchdog of toy gives; got 2.5",
        ),
        (
            f"{BRAKES}, brake_torque=550.0",
            WATCHDOG,
            "watchdog_test.deceleration_mps2: expected 1.00 m/s2 or less, all ",
        ),
    ],
)
def test_an_interface_and_a_test_that_contradict_each_other_are_refused(
    stops: str, test: dict[str, Any], said: str, tmp_path: Path
) -> None:
    assert complaint_of(parse, with_interface(tmp_path, stops, watchdog_test=test)).startswith(said)


@pytest.mark.parametrize(
    ("stops", "test"),
    [(RELEASES, ROLLING), (BRAKES, WATCHDOG), (BRAKES, ROLLING), (f"{BRAKES}, deceleration=2.5", WATCHDOG)],
)
def test_what_agrees_is_taken_as_it_was_measured(stops: str, test: dict[str, Any], tmp_path: Path) -> None:
    ours = parse(with_interface(tmp_path, stops, watchdog_test=test), Path("mine.toml"))
    facts = load(resolve.interface_of(ours)).facts
    assert resolve.watchdog_deceleration_of(ours, facts) == test["deceleration_mps2"]


def stops_inside(rig: Rig, ahead: float) -> bool:
    """Whether a car with 8 m/s is inside the fence so far [m] before the east edge of its square lot."""
    fence = resolve.geofence_of(rig, Alignment())
    (_, low), (east, high) = fence.lot.outline.min(axis=0), fence.lot.outline.max(axis=0)
    pose = Pose(0.0, Point.REAR_AXLE, east - ahead, 0.5 * (low + high), 0.0, 8.0, 0.0, 0.0, 0.0, 0.0)
    return not fence.check(pose, 0.0, None)


def test_the_fence_reckons_with_the_lesser_of_test_and_interface(tmp_path: Path) -> None:
    """A rig that was not refused cannot claim more; another wire beneath it makes the claim the greater one."""
    ours = parse(with_interface(tmp_path, BRAKES, watchdog_test=WATCHDOG), Path("mine.toml"))
    file = tmp_path / "weaker.py"
    file.write_text(STOPS.format(toy=str(TOY), stops=f"{BRAKES}, brake_torque=550.0"), encoding="utf-8")
    wire = ours.drive_by_wire.model_copy(update={"interface": f"{file}:make"})
    weaker = ours.model_copy(update={"drive_by_wire": wire})
    # From 8 m/s 12.8 m with 2.5 m/s2 and 32 m with 1.0, and 8 m for delays, the drive's fading, margin and bumper.
    assert stops_inside(ours, 26.0)
    assert not stops_inside(weaker, 26.0)
    facts = load(resolve.interface_of(weaker)).facts
    assert resolve.watchdog_deceleration_of(weaker, facts) == pytest.approx(1.0)
    assert resolve.watchdog_deceleration_of(weaker, facts, friction=0.05) == pytest.approx(0.05 * 9.80665)


@pytest.mark.thorough
def test_doctor_says_no_go(tmp_path: Path) -> None:
    from vve_sumo.commissioning.doctor import examine
    from vve_sumo.commissioning.findings import CheckResult

    text = (REPOSITORY / "rigs" / "simulated.toml").read_text(encoding="utf-8")
    file = tmp_path / "wire.py"
    file.write_text(STOPS.format(toy=str(TOY), stops=RELEASES), encoding="utf-8")
    ours = f'[drive_by_wire]\ninterface = "{file}:make"\nsettings = {{ brake_nm = 3412.0 }}'
    was = '[drive_by_wire]\nsettings = { variant = "dbw1_2024" }'
    assert was in text
    text = text.replace("delay_s = 0.12", "delay_s = 0.25")  # the toy waits 0.2 s for a command
    (tmp_path / "ours.toml").write_text(text.replace(was, ours), encoding="utf-8")
    against = examine("parked_car", str(tmp_path / "ours.toml"), REPOSITORY).against
    said = [check.observed for check in against if check.name == "rig"]
    assert len(said) == 1
    assert "watchdog_test.armed: expected false: when commands stop, toy lets go of everything and beeps" in said[0]
    assert against[0].finding is CheckResult.NO_GO


def test_an_interface_that_says_it_in_prose_is_refused(tmp_path: Path) -> None:
    table = with_interface(tmp_path, RELEASES)
    file = tmp_path / "wire.py"
    file.write_text(
        file.read_text(encoding="utf-8").replace(f"CommandsStop({RELEASES})", '"lets go"'), encoding="utf-8"
    )
    said = r"facts\.when_commands_stop: expected a CommandsStop, got 'lets go'"
    with pytest.raises(ConfigError, match=said):
        parse(table, Path("mine.toml"))
