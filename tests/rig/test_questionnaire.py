"""A rig file by questions: what is not known is marked, and the file is refused until all of it is filled in."""

from __future__ import annotations

import datetime
import os
import pty
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from vve_sumo.cli.dispatch import main
from vve_sumo.errors import ConfigError
from vve_sumo.pose.receivers.port import PORT, load
from vve_sumo.rig import load as rigs
from vve_sumo.rig.questionnaire import QUESTIONS, Question, asked, taken, text_of, unknown_keys, value_of
from vve_sumo.rig.unknown import UNKNOWN, first_unknown
from vve_sumo.rig.validation import arming_obstacle

#: what somebody finds out, as it is typed
FOUND = {
    "title": "Ours on the east lot",
    "pose.kind": "ncom_udp",
    "pose.address": "192.168.25.1",
    "pose.source": "192.168.25.44",
    "pose.port": "3000",
    "pose.device": "/dev/ttyUSB0",
    "pose.baud": "460800",
    "pose.interface": "socketcan",
    "pose.channel": "can1",
    "pose.velocity_sigma_mps": "0.05",
    "pose.heading_sigma_deg": "0.2",
    "pose.rate_hz": "10",
    "pose.minimum_delay_ms": "3",
    "mounting.forward_m": "0.3",
    "mounting.left_m": "-0.2",
    "bus.interface": "socketcan",
    "bus.channel": "can0",
    "bus.bitrate": "500000",
    "drive_by_wire.interface": "dataspeed_dbw1",
    "drive_by_wire.settings.variant": "dbw1_2024",
    "drive_by_wire.settings.brake_nm": "4000",
    "drive_by_wire.settings.command_timeout_s": "0.1",
    "drive_by_wire.settings.when_commands_stop": "releases",
    "drive_by_wire.settings.mapping_file": "car.toml",
    "vehicle.model": "ford_fusion",
    "limits.speed_mps": "8",
    "lot.surveyed": "2026-05-01",
    "lot.outline": "40.0030 -83.0200; 40.0030, -83.0160; 40.0050 -83.0160; 40.0050 -83.0200",
    "lot.margin_m": "2",
    "lot.grade_percent": "1.5",
    "lot.friction": "0.8",
}
RECEIVERS = [kind for kind in PORT.shipped if load(kind).profile.live]
INTERFACES = ("dataspeed_dbw1", "dataspeed_ulc", "pacmod3", "new_eagle_raptor")


def parsed(text: str) -> dict[str, Any]:
    return tomllib.loads(text)


@pytest.mark.parametrize("interface", INTERFACES)
@pytest.mark.parametrize("kind", RECEIVERS)
def test_a_rig_of_which_all_is_known_is_one_that_may_shadow_and_not_arm(
    kind: str, interface: str, tmp_path: Path
) -> None:
    found = FOUND | {"pose.kind": kind, "drive_by_wire.interface": interface}
    answers = asked(lambda question, _wrong: found[question.key])
    assert unknown_keys(answers) == []
    rig = rigs.parse(parsed(text_of(answers)), tmp_path / "ours.toml")
    assert rig.car == "real"
    assert rig.lot.outline[1] == (40.0030, -83.0160)
    assert "watchdog_test is missing" in str(arming_obstacle(rig, datetime.date(2026, 6, 1)))


def test_every_receiver_that_a_car_can_drive_on_is_offered() -> None:
    (question,) = (one for one in QUESTIONS if one.key == "pose.kind")
    assert {*question.choices} == {*RECEIVERS}


def test_a_rig_of_which_nothing_is_known_is_refused_key_by_key_until_it_is_filled_in(tmp_path: Path) -> None:
    """Whoever fills in what the refusal names, and nothing else, comes to a rig that loads."""
    file = tmp_path / "ours.toml"
    file.write_text(text_of(asked(lambda _question, _wrong: "")), encoding="utf-8")
    named: list[str] = []
    while (unknown := refused(file)) is not None:
        assert unknown not in named
        named.append(unknown)
        fill_in(file, unknown)
    assert named[0] == "title"
    assert set(named) >= {"pose.source", "mounting.left_m", "drive_by_wire.settings", "lot.outline", "lot.friction"}
    assert rigs.load(file, tmp_path, datetime.date(2026, 6, 1)).lot.friction == 0.8


def refused(file: Path) -> str | None:
    """The key that the refusal of a file names; None where it loads."""
    try:
        rigs.load(file, file.parent, datetime.date(2026, 6, 1))
    except ConfigError as error:
        (key,) = re.fullmatch(rf"{file}: ([\w.]+): is still '{UNKNOWN}'; .*", str(error)).groups()  # type: ignore[union-attr]
        return key
    return None


def fill_in(file: Path, key: str) -> None:
    """Write what is found of a key into a file, in the place of its mark."""
    table, lines = "", file.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines):
        table = line[1:-1] if line.startswith("[") else table
        name = line.partition(" =")[0]
        if key == f"{table}.{name}".lstrip("."):
            lines[number] = f"{name} = {in_toml(key)}"
    file.write_text("\n".join(lines), encoding="utf-8")


def in_toml(key: str) -> str:
    if key == "drive_by_wire.settings":
        return '{ variant = "dbw1_2024" }'
    question = next(one for one in QUESTIONS if one.key == key)
    value = value_of(question, FOUND[key])
    return value.isoformat() if isinstance(value, datetime.date) else repr(value).replace("'", '"')


def test_what_only_the_car_tells_has_no_default() -> None:
    answers = asked(lambda _question, _wrong: "")
    assert answers == {
        "pose.kind": "ncom_udp",
        "pose.port": 3000,
        "bus.interface": "socketcan",
        "bus.channel": "can0",
        "bus.bitrate": 500000,
    }


@pytest.mark.parametrize(
    ("key", "said", "expected"),
    [
        ("limits.speed_mps", "fast", "expected a number, got 'fast'"),
        ("limits.speed_mps", "nan", "expected a number"),
        ("bus.bitrate", "5e5", "expected a whole number"),
        ("lot.surveyed", "yesterday", "expected a day such as 2026-05-01"),
        ("lot.outline", "40.0 -83.0; 40.1 -83.0", "expected three corners or more"),
        ("lot.outline", "40.0 -83.0; 40.1; 40.2 -83.1", "expected three corners or more"),
        ("pose.kind", "gps", "expected one of ncom_udp"),
        ("title", "two\x07bells", "expected a text"),
    ],
)
def test_a_wrong_answer_says_what_was_expected_and_is_asked_again(key: str, said: str, expected: str) -> None:
    complaints: list[str] = []
    tries = iter([said, FOUND[key]])

    def ask(question: Question, wrong: str) -> str:
        if question.key != key:
            return ""
        complaints.append(wrong)
        return next(tries)

    assert asked(ask)[key] == value_of(next(one for one in QUESTIONS if one.key == key), FOUND[key])
    assert complaints[0] == ""
    assert complaints[1].startswith(expected)


def test_a_mark_is_found_wherever_it_stands() -> None:
    assert first_unknown({"a": 1, "b": {"c": [1, [UNKNOWN]]}, "d": UNKNOWN}) == "b.c"
    assert first_unknown({"a": "", "b": {}}) is None


def test_answers_of_a_file_make_the_same_rig(tmp_path: Path) -> None:
    table = {"limits": {"speed_mps": 8.0}, "lot": {"surveyed": datetime.date(2026, 5, 1)}, "title": UNKNOWN}
    answers = taken(table)
    assert answers["limits.speed_mps"] == 8.0
    assert "title" in unknown_keys(answers)
    for wrong, said in (
        ({"lot": {"hole": 1}}, "lot.hole"),
        ({"limits": {"speed_mps": "x"}}, "limits.speed_mps: expected"),
    ):
        with pytest.raises(ConfigError, match=said):
            taken(wrong)


def test_the_command_writes_one_file_and_never_replaces_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "answers.toml").write_text('title = "Ours"\n[limits]\nspeed_mps = 8\n', encoding="utf-8")
    assert main(["init", "--rig", "rigs/ours.toml", "--answers", "answers.toml"]) == 0
    said = capsys.readouterr().out
    assert "keys to be filled in, first pose.address" in said
    assert "next: " not in said
    before = (tmp_path / "rigs/ours.toml").read_bytes()
    for wrong in (
        ["--rig", "rigs/ours.toml", "--answers", "answers.toml"],
        ["mine", "--rig", "rigs/other.toml"],
        ["--answers", "answers.toml"],
        [],
        ["--rig", "other.toml", "--answers", "rigs/ours.toml"],
        ["--rig", "other.toml", "--answers", "nowhere.toml"],
    ):
        assert main(["init", *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert (tmp_path / "rigs/ours.toml").read_bytes() == before
    assert {one.name for one in tmp_path.iterdir()} == {"answers.toml", "rigs"}


def test_over_a_terminal_it_asks_shows_defaults_and_what_was_wrong(tmp_path: Path) -> None:
    """A person at a terminal: a name, the default receiver, its addresses, and a delay that is none at first."""
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(tmp_path)
        os.execv(sys.executable, [sys.executable, "-m", "vve_sumo.cli", "init", "--rig", "ours.toml"])
    os.write(terminal, b"Ours\n\n192.168.25.1\n192.168.25.44\n\nsoon\n3\n" + b"\n" * 20)
    shown = b""
    while True:
        try:
            shown += os.read(terminal, 4096)
        except OSError:
            break
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    text = shown.decode()
    assert re.search(r"pose\.kind: how the receiver is heard \(.*nmea_serial.*\) \[ncom_udp\]: ", text)
    assert "expected a number, got 'soon'" in text
    said = parsed((tmp_path / "ours.toml").read_text(encoding="utf-8"))
    assert said["title"] == "Ours"
    assert said["pose"]["minimum_delay_ms"] == 3.0
    assert said["mounting"]["left_m"] == UNKNOWN
