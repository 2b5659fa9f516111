"""A mapping that does not fit its DBC file is refused in one line, before anything is opened."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from vve_sumo.cli import main
from vve_sumo.errors import ConfigError
from vve_sumo.vehicle.interface import InterfaceConfig, load

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "own_car"
MAPPING, DBC = "campus_shuttle.toml", "campus_shuttle.dbc"


def changed(folder: Path, file: str, before: str, after: str) -> Path:
    """Copy the worked example, with one thing changed; return its mapping."""
    for name in (MAPPING, DBC):
        shutil.copy(EXAMPLE / name, folder / name)
    text = (folder / file).read_text(encoding="utf-8")
    assert before in text
    (folder / file).write_text(text.replace(before, after, 1), encoding="utf-8")
    return folder / MAPPING


ACCELERATION = ' SG_ ACCELERATION : 7|16@0- (0.001,0) [-6|3] "m/s^2" Car\n'
WRONG = {
    "no such signal": (
        DBC, ACCELERATION, "",
        "command.acceleration: campus_shuttle.dbc: message LongitudinalCommand has no signal ACCELERATION",
    ),
    "no such message": (
        MAPPING, 'steering_wheel_angle = "SteeringCommand', 'steering_wheel_angle = "SteeringComand',
        "command.steering_wheel_angle: campus_shuttle.dbc has no message SteeringComand, did you mean SteeringCommand?",
    ),
    "overlapping signals": (
        DBC, "ENABLE : 16|1@0+", "ENABLE : 15|1@0+",
        "message LongitudinalCommand: signals ACCELERATION and ENABLE overlap in byte 1",
    ),
    "wrong byte order, no room": (
        DBC, "ANGLE : 7|16@0- (0.05,0) [-500|500]", "ANGLE : 56|16@1- (0.05,0) [-500|500]",
        "message SteeringCommand: signal ANGLE of 16 bits has no room in 8 bytes in little byte order: "
        "is that its byte order?",
    ),
    "wrong byte order": (
        DBC, "ANGLE : 7|16@0- (0.05,0) [-500|500]", "ANGLE : 0|16@1- (0.05,0) [-500|500]",
        "command.steering_wheel_angle: campus_shuttle.dbc has SteeringCommand.ANGLE in little byte order, "
        "but byte_order says 'big'",
    ),
    "identifier clash": (
        DBC, "BO_ 273 SteeringCommand", "BO_ 272 SteeringCommand",
        "messages LongitudinalCommand and SteeringCommand share identifier 0x110",
    ),
    "no watchdog fact": (
        MAPPING, "command_timeout_s = 0.1\n", "", "key 'watchdog.command_timeout_s' is missing",
    ),
    "what it does is no fact": (
        MAPPING, 'when_commands_stop = "brakes"', 'when_commands_stop = "hopes"',
        "watchdog.when_commands_stop: expected 'releases', 'holds' or 'brakes', got 'hopes'",
    ),
    "a strength of what does not brake": (
        MAPPING, 'when_commands_stop = "brakes"', 'when_commands_stop = "holds"',
        "watchdog: when_commands_stop: an interface that holds has no deceleration",
    ),
    "a steering torque": (
        MAPPING, 'steering_wheel_angle = "SteeringCommand.ANGLE"', 'steering_torque = "SteeringCommand.ANGLE"',
        "command: a car whose steering takes a torque is refused: the gateway commands an angle",
    ),
    "a speed": (
        MAPPING, 'acceleration = "LongitudinalCommand.ACCELERATION"', 'speed = "LongitudinalCommand.ACCELERATION"',
        "command: a car that is commanded a speed is refused: the gateway's stops need a deceleration",
    ),
    "a speed as an acceleration": (
        DBC, '[-6|3] "m/s^2"', '[-6|3] "km/h"',
        "command.acceleration: campus_shuttle.dbc has LongitudinalCommand.ACCELERATION as a speed; a car that is",
    ),
    "both ways to drive": (
        MAPPING, "gear = {", 'throttle = "LongitudinalCommand.ENABLE"\ngear = {',
        "command: expected acceleration, or brake_torque and throttle, got both",
    ),
    "a unit that nobody knows": (
        DBC, '[-6|3] "m/s^2"', '[-6|3] "furlong"',
        "command.acceleration: campus_shuttle.dbc has ACCELERATION in 'furlong': expected a scale, m/s2 for each unit",
    ),
    "the driver ignored": (
        MAPPING, "[limits]", '[command.constant]\n"LongitudinalCommand.IGNORE_DRIVER" = 1\n\n[limits]',
        "command: signal IGNORE_DRIVER is set, but no frame may ask to ignore the driver",
    ),
    "a command that reports": (
        MAPPING, 'yaw = "Inertial.YAW_RATE"', 'yaw = { signal = "LongitudinalCommand.ACCELERATION", scale = 1.0 }',
        "message LongitudinalCommand is both a command and a report",
    ),
    "a signal set twice": (
        MAPPING, 'clear = ["LongitudinalCommand.CLEAR_OVERRIDE"]', 'clear = ["LongitudinalCommand.ENABLE"]',
        "command: signal ENABLE is set twice, expected each once",
    ),
    "many bits for a yes or no": (
        MAPPING, '{ signal = "SteeringCommand.MODE", yes = [2], no = 0 }', '"SteeringCommand.MODE"',
        "command.enable.1: MODE has 2 bits: expected { signal = ..., yes = [counts], no = count }",
    ),
    "a gear that has no room": (
        MAPPING, "neutral = 3, drive = 4 }", "neutral = 3, drive = 9 }",
        "command.gear.drive: GEAR holds counts of 0 to 7, expected one, got 9",
    ),
    "no DBC file": (MAPPING, 'dbc = "campus_shuttle.dbc"', 'dbc = "nobody.dbc"', "nobody.dbc cannot be read: No such"),
    "no rate of the steering": (
        MAPPING, "steering_wheel_rate_degps = 450.0", "steering_wheel_angle_deg = 450.0",
        "limits.steering_wheel_rate_degps is missing",
    ),
    "a line that is none": (DBC, "BO_ 272 Long", "BO_ x272 Long", "expected a message or a signal, got 'BO_ x272"),
    "a case without its switch": (
        DBC, ACCELERATION, ACCELERATION.replace("ACCELERATION :", "ACCELERATION m2 :"),
        "LongitudinalCommand.ACCELERATION is there only where a switch that is missing is 2",
    ),
    "another case than the constant one": (
        DBC, ACCELERATION + ' SG_ ENABLE : 16|1@0+ (1,0) [0|1] "" Car\n',
        ACCELERATION.replace("ACCELERATION :", "ACCELERATION m2 :")
        + ' SG_ KIND M : 39|8@0+ (1,0) [0|3] "" Car\n SG_ ENABLE : 16|1@0+ (1,0) [0|1] "" Car\n',
        'expected command.constant with "LongitudinalCommand.KIND" = 2',
    ),
    "CAN FD": (DBC, "BO_ 272 LongitudinalCommand: 8", "BO_ 272 LongitudinalCommand: 64", "64 bytes, expected 1 to 8"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_what_does_not_fit_is_refused_in_one_line(tmp_path, name):
    file, before, after, said = WRONG[name]
    mapping = changed(tmp_path, file, before, after)
    with pytest.raises(ConfigError, match=re.escape(said)) as refused:
        load(InterfaceConfig("generic", {"mapping_file": str(mapping)}))
    text = str(refused.value)
    assert "\n" not in text
    assert text.startswith("drive-by-wire interface generic: ")
    assert str(tmp_path) in text, "the line names the file"


@pytest.mark.parametrize("name", ["no such signal", "overlapping signals", "no watchdog fact"])
def test_no_bus_is_opened_for_a_rig_with_such_a_mapping(tmp_path, name, monkeypatch, capsys):
    """Exit code 2 and one line, from the command line, with a python-can that may open nothing."""
    import can

    file, before, after, said = WRONG[name]
    changed(tmp_path, file, before, after)
    shutil.copy(EXAMPLE / "rig.toml", tmp_path / "rig.toml")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(can, "Bus", None)
    assert main(["drive", "parked_car", "--rig", "rig.toml", "--out", "record"]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert said in lines[0]
    assert not (tmp_path / "record").exists()


@pytest.mark.parametrize(
    ("settings", "said"),
    [({}, "setting 'mapping_file' must name a mapping"), ({"mapping_file": "x", "b": 1.0}, "setting 'b' is unknown")],
)
def test_settings_that_are_none_are_refused(settings, said):
    with pytest.raises(ConfigError, match=said):
        load(InterfaceConfig("generic", settings))
