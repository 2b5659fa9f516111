"""What the doctor says of an external controller's rig, with ports that are free and ports that are not."""

from __future__ import annotations

import socket
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import REPOSITORY
from tests.live.stage import free_ports
from vve_sumo.commissioning import brain_checks, calibration_drive
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.live import session
from vve_sumo.rig.load import parse
from vve_sumo.rig.schema import Rig


def rig(brain: dict[str, Any] | None = None, *outputs: dict[str, Any]) -> Rig:
    """The shipped rig of an external controller on free ports, with more in its tables."""
    table = tomllib.loads((REPOSITORY / "rigs" / "foreign.toml").read_text(encoding="utf-8"))
    (table["brain"]["port"],) = free_ports(1)
    table["brain"] |= brain or {}
    table["outputs"] += outputs
    return parse(table, Path("rig.toml"))


def test_what_can_be_opened_is_named_and_closed(tmp_path: Path) -> None:
    (tmp_path / "brain.key").write_text("ab" * 32 + "\n", encoding="ascii")
    (port,) = free_ports(1)
    fit = rig({"key_file": "brain.key"}, {"kind": "nmea", "tcp": f"127.0.0.1:{port}"})
    for _ in range(2):
        assert (
            brain_checks.setpoints(fit, tmp_path).observed
            == f"127.0.0.1 port {fit.brain.port}, of this machine, signed"
        )
        assert brain_checks.outputs(fit).observed == "ncom, radar, nmea"


def test_a_port_that_another_program_has_is_named(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as there, socket.socket() as served:
        there.bind(("127.0.0.1", 0))
        served.bind(("127.0.0.1", 0))
        served.listen()
        taken = rig({"port": there.getsockname()[1]}, {"kind": "nmea", "tcp": f"127.0.0.1:{served.getsockname()[1]}"})
        with pytest.raises(RigError, match=r"brain\.port: .* is in use by another program"):
            brain_checks.setpoints(taken, tmp_path)
        with pytest.raises(RigError, match=r"outputs\.2: tcp .* is in use by another program"):
            brain_checks.outputs(taken)


def test_a_calibration_is_driven_by_its_own_controller_and_tells_no_brain(tmp_path: Path) -> None:
    plan = calibration_drive.plan("foreign", REPOSITORY, tmp_path / "record")
    assert (plan.rig.brain.kind, plan.rig.outputs) == ("own", ())
    with pytest.raises(ConfigError, match=r"external\.toml: brain\.kind is 'external', expected 'own'"):
        calibration_drive.plan("external", REPOSITORY, tmp_path / "record")


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (None, r"No such file or directory, expected a file of the key"),
        (b"zz" * 32, "expected 64 hexadecimal digits alone"),
        (b"\xff\xfe", "expected 64 hexadecimal digits alone"),
        (b"ab" * 31, "expected 64 hexadecimal digits, got 62"),
        (b"", "expected 64 hexadecimal digits, got 0"),
    ],
)
def test_a_key_that_is_none_is_one_line_before_anything_is_started(
    content: bytes | None, line: str, tmp_path: Path
) -> None:
    if content is not None:
        (tmp_path / "brain.key").write_bytes(content)
    with pytest.raises(ConfigError, match=rf"brain\.key_file: .*brain\.key: {line}"):
        brain_checks.setpoints(rig({"key_file": "brain.key"}), tmp_path)
    text = (REPOSITORY / "rigs" / "foreign.toml").read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text.replace("[brain]\n", '[brain]\nkey_file = "brain.key"\n'))
    with pytest.raises(ConfigError, match=line):
        session.plan(
            "parked_car", str(tmp_path / "mine.toml"), tmp_path, out=None, seed=None, controller=None, shadow=False
        )
    assert not (tmp_path / "runs").exists()
