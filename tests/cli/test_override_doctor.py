"""A real car is armed on the doctor's fresh GO alone, or with a reason that screen and record keep."""

from __future__ import annotations

import datetime
import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from tests import isolated
from tests.commissioning.test_doctor import LASTING, real_rig
from tests.conftest import REPOSITORY
from tests.live.command_line import own_rig
from tests.live.test_screen import DRIVING
from vve_sumo.cli.live_drive import examined
from vve_sumo.commissioning.doctor_result import keep
from vve_sumo.commissioning.findings import Check, CheckResult
from vve_sumo.errors import ConfigError, RigError
from vve_sumo.live.plan import DrivePlan
from vve_sumo.live.session import plan
from vve_sumo.live.wording import picture

GO = [Check("bus", "fine")]
NO_GO = [*GO, Check("fixes", "none", CheckResult.NO_GO, "look"), Check("gear", "drive", CheckResult.NOTE)]
NO_GO += [Check("arming", "no", CheckResult.NO_GO)]
HOUR = datetime.timedelta(hours=1)
UNEXAMINED = "the doctor has not examined this rig"


def now() -> datetime.datetime:
    return datetime.datetime.now(datetime.UTC)


def made(folder: Path, rig: Path, *, shadow: bool = False) -> DrivePlan:
    return plan("seen_late", str(rig), folder, out=None, seed=None, controller=None, shadow=shadow)


def real(folder: Path) -> Path:
    return real_rig(folder, "/dev/nobody", *LASTING)


def test_a_real_car_needs_a_fresh_go_of_this_rig_file(tmp_path: Path) -> None:
    rig = real(tmp_path)
    drive = made(tmp_path, rig)

    def refused() -> str:
        with pytest.raises(RigError) as caught:
            examined(drive, None)
        line = str(caught.value)
        assert line.startswith(f"{rig}: ")
        assert line.endswith(
            f"; run vve-sumo doctor seen_late --rig {rig} until it says GO, or give --override-doctor REASON"
        )
        assert "\n" not in line
        return line

    assert UNEXAMINED in refused()
    keep(rig, NO_GO, "seen_late", tmp_path, now())
    assert "the doctor says NO-GO: fixes, arming;" in refused()
    keep(rig, GO, "seen_late", tmp_path, now() - 25 * HOUR)
    assert "the doctor's GO is older than a day;" in refused()
    keep(rig, GO, "seen_late", tmp_path, now() + HOUR)
    assert "the doctor's GO is from the future" in refused()
    keep(rig, GO, "seen_late", tmp_path, now() - 23 * HOUR)
    assert examined(drive, None)["verdict"] == "GO"
    rig.write_text(rig.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert "the doctor's GO is of another version of the rig file;" in refused()


def test_a_reason_arms_all_the_same_and_is_kept(tmp_path: Path) -> None:
    rig = real(tmp_path)
    drive = made(tmp_path, rig)
    assert examined(drive, " receiver in service ")["override"] == "receiver in service"
    keep(rig, NO_GO, "seen_late", tmp_path, now())
    reported = examined(drive, "x")
    assert (reported["verdict"], reported["override"]) == ("NO-GO", "x")
    keep(rig, GO, "seen_late", tmp_path, now())
    assert "override" not in examined(drive, "x"), "nothing was overridden"


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("reason", ["", "  ", "a\nb", "\x1b[2J", "a" * 101])
def test_what_is_no_reason_is_refused(tmp_path: Path, reason: str) -> None:
    with pytest.raises(ConfigError, match="--override-doctor: expected 1 to 100 printable characters"):
        examined(made(tmp_path, real(tmp_path)), reason)


@pytest.mark.thorough
def test_a_drive_that_commands_no_real_car_needs_no_doctor(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    simulated, shadow = made(tmp_path, own_rig(tmp_path)), made(tmp_path, real(tmp_path), shadow=True)
    for drive in (simulated, shadow):
        assert examined(drive, None)["verdict"] == "none"
        assert capsys.readouterr().err == ""
        keep(drive.rig_file, NO_GO, "seen_late", tmp_path, now())
        assert examined(drive, None)["verdict"] == "NO-GO"
        assert "the doctor says NO-GO: fixes, arming; no real car is commanded" in capsys.readouterr().err
        keep(drive.rig_file, NO_GO, "seen_late", tmp_path, now() - 48 * HOUR)
        examined(drive, None)
        assert capsys.readouterr().err == "", "what is old says nothing"


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("command", [("drive", "seen_late"), ("calibrate",)])
def test_the_command_refuses_and_leaves_nothing(tmp_path: Path, command: tuple[str, ...]) -> None:
    rig = real(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    run = isolated.command(*command, "--rig", str(rig), cwd=tmp_path)
    assert (run.returncode, run.stdout) == (3, "")
    assert UNEXAMINED in run.stderr
    assert run.stderr.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_without_a_live_drive_there_is_no_doctor_to_override(tmp_path: Path) -> None:
    run = isolated.command("drive", "--override-doctor", "x", cwd=tmp_path)
    assert (run.returncode, run.stdout) == (2, "")
    assert "--override-doctor: only a live drive arms a car" in run.stderr


def test_every_picture_of_the_drive_says_so() -> None:
    lines = picture(DRIVING | {"doctor_overridden": "receiver in service"})
    assert "  ! DOCTOR OVERRIDDEN: receiver in service" in lines
    assert "OVERRIDDEN" not in "\n".join(picture(DRIVING | {"doctor_overridden": ""}))


DRIVE = """
import sys
from pathlib import Path
from vve_sumo.cli.live_drive import drive
from vve_sumo.live.session import plan
made = plan("short.toml", sys.argv[1], Path.cwd(), out=Path("record"), seed=None, controller=None, shadow=False)
drive(made, {"verdict": "NO-GO", "caveats": [], "override": "receiver in service"})
"""


@pytest.mark.thorough
@pytest.mark.live
def test_the_screen_shows_it_for_the_whole_drive_and_the_record_keeps_it(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    scenario = (REPOSITORY / "scenarios" / "seen_late.toml").read_text(encoding="utf-8")
    lines = [line if not line.startswith("duration_s") else "duration_s = 4.0" for line in scenario.splitlines()]
    (tmp_path / "short.toml").write_text("\n".join(lines), encoding="utf-8")
    here, there = pty.openpty()
    environment = os.environ | {"PYTHONPATH": str(REPOSITORY)}
    shown = b""
    with subprocess.Popen(
        [sys.executable, "-c", DRIVE, str(rig)], cwd=tmp_path, env=environment, stdin=subprocess.DEVNULL, stderr=there
    ) as process:
        os.close(there)
        while True:
            try:
                part = os.read(here, 65536)
            except OSError:
                break
            if not part:
                break
            shown += part
        process.wait()
    os.close(here)
    pictures = [picture for picture in shown.decode(errors="replace").split("\x1b[J") if "km/h" in picture]
    assert len(pictures) > 20
    assert all("! DOCTOR OVERRIDDEN: receiver in service" in picture for picture in pictures)
    reported = json.loads((tmp_path / "record" / "provenance.json").read_text(encoding="utf-8"))
    assert reported["doctor"]["override"] == "receiver in service"
    assert isolated.command("report", "record", cwd=tmp_path).returncode == 0
    assert "overridden: receiver in service" in (tmp_path / "record" / "report.html").read_text(encoding="utf-8")
