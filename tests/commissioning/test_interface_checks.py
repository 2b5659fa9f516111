"""`vve-sumo vehicle check`: what it says of sound interfaces, and of ones with a planted mistake."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from vve_sumo.cli import main
from vve_sumo.commissioning.findings import CheckResult
from vve_sumo.commissioning.interface_checks import checks
from vve_sumo.commissioning.interface_under_check import model
from vve_sumo.errors import ConfigError

TOY = REPOSITORY / "tests" / "ports" / "toy" / "interface.py"
OWN_CAR = REPOSITORY / "examples" / "own_car"


def against(name: str, **settings: object) -> dict[str, str]:
    """What speaks against an interface, by the name of the check."""
    found = checks(model(name, settings, "ford_fusion", REPOSITORY))  # type: ignore[arg-type]
    return {check.name: check.observed for check in found if check.finding is CheckResult.NO_GO}


def with_mistake(folder: Path, mistake: str) -> str:
    file = folder / "mistaken.py"
    file.write_text(TOY.read_text(encoding="utf-8") + "\n\n" + mistake, encoding="utf-8")
    return f"{file}:make"


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("name", "settings"),
    [
        (str(OWN_CAR / "campus_shuttle.toml"), {}),
        ("dataspeed_dbw1", {"variant": "dbw1_2024"}),
        ("dataspeed_ulc", {"variant": "dbw1_2018"}),
        ("pacmod3", {"brake_nm": 3412.0, "command_timeout_s": 0.1, "when_commands_stop": "releases"}),
        ("new_eagle_raptor", {"brake_nm": 5000.0, "command_timeout_s": 0.1, "when_commands_stop": "brakes"}),
        (f"{TOY}:make", {"brake_nm": 3412.0}),
    ],
)
def test_nothing_speaks_against_a_sound_interface(name, settings):
    assert against(name, **settings) == {}


MISTAKES = {
    "override": "_step = SimulatedToy.step\n\n\ndef step(self, driver, speed, angle):\n"
    "    request = _step(self, driver, speed, angle)\n    self._override = False\n    return request\n\n\n"
    "SimulatedToy.step = step\n",
    "counter": "_encode = Toy.encode\n\n\ndef encode(self, command):\n    self._counter = 0\n"
    "    return _encode(self, command)\n\n\nToy.encode = encode\n",
    "values": "_encode = Toy.encode\n\n\ndef encode(self, command):\n"
    "    angle = 0.0 if math.isnan(command.wheel_angle) else command.wheel_angle\n"
    "    return _encode(self, command._replace(wheel_angle=angle))\n\n\nToy.encode = encode\n",
    "time-out": "TIMEOUT = 5.0\nSimulatedToy.enabled = property(lambda self: (self._enable,) * 3)\n",
    "enable": "SimulatedToy.enabled = property(lambda self: (True, True, True))\n",
}


@pytest.mark.parametrize("check", ["override", "counter", "values", "time-out", "enable"])
def test_a_planted_mistake_is_found(tmp_path, check):
    assert check in against(with_mistake(tmp_path, MISTAKES[check]), brake_nm=3412.0)


def test_code_that_raises_is_a_check_that_failed(tmp_path):
    mistake = "def encode(self, command):\n    raise KeyError('gear')\n\n\nToy.encode = encode\n"
    found = against(with_mistake(tmp_path, mistake), brake_nm=3412.0)
    assert "its code raised KeyError: 'gear' (mistaken.py, line " in found["enable"]


def test_the_command_prints_a_table_and_exits_by_it(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["vehicle", "check", with_mistake(tmp_path, MISTAKES["counter"]), "--set", "brake_nm=3412.0"]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].startswith("NO-GO: ")
    assert any(line.startswith("NO-GO  counter ") for line in lines)
    ask = ["vehicle", "check", with_mistake(tmp_path, MISTAKES["counter"]), "--set", "brake_nm=3412.0", "--json"]
    assert main(ask) == 3
    assert json.loads(capsys.readouterr().out)["good"] is False


def test_names_that_mean_nothing_are_one_line(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.toml").write_text("title = 'none of them'\n", encoding="utf-8")
    for name, said in {
        "nobodys": "interface nobodys: unknown",
        "none.toml": "none.toml: cannot be read",
        "other.toml": "other.toml: expected a mapping (dbc = ...), a vehicle or a rig, found none of them",
    }.items():
        assert main(["vehicle", "check", name]) == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert len(lines) == 1
        assert said in lines[0]
    with pytest.raises(ConfigError, match="a file has its own settings"):
        model(str(OWN_CAR / "campus_shuttle.toml"), {"a": 1.0}, "ford_fusion", tmp_path)
