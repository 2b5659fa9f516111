"""Who is at the console and who sits behind the wheel: asked for where a real car is driven, and nowhere else."""

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
from tests.commissioning.test_doctor import real_rig
from tests.conftest import REPOSITORY
from tests.live.command_line import own_rig, vve_sumo
from vve_sumo.cli.live_drive import named
from vve_sumo.commissioning import doctor_result
from vve_sumo.commissioning.findings import Check, CheckResult
from vve_sumo.errors import ConfigError
from vve_sumo.live.plan import DrivePlan
from vve_sumo.live.session import plan

#: prints who was named, of a drive that is never begun
NAMES = """
import sys
from pathlib import Path
from vve_sumo.cli.live_drive import named
from vve_sumo.live.session import plan
made = plan("seen_late", sys.argv[1], Path.cwd(), out=None, seed=None, controller=None, shadow=True)
done = named(made, *(None if name == "-" else name for name in sys.argv[2:]))
assert done.t0 > made.t0
print([done.operator, done.driver])
"""


def asked(rig: Path, typed: str, *names: str) -> tuple[str, int, str]:
    """Return what is said on a terminal, where somebody types; exit code and the names that came of it."""
    here, there = pty.openpty()
    os.write(here, typed.encode())
    with subprocess.Popen(
        [sys.executable, "-c", NAMES, str(rig), *names],
        cwd=rig.parent,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
        stdin=there,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        out, err = process.communicate(timeout=120)
    os.close(here)
    os.close(there)
    return err, process.returncode, out.strip()


@pytest.mark.thorough
def test_a_real_car_asks_for_both_on_a_terminal(tmp_path: Path) -> None:
    rig = real_rig(tmp_path, "/dev/nobody")
    said, code, names = asked(rig, "Ada Lovelace\nGrace Hopper\n", "-", "-")
    assert (code, names) == (0, "['Ada Lovelace', 'Grace Hopper']")
    assert said.index("name of the operator") < said.index("name of the driver")
    said, code, names = asked(rig, "Grace\n", "Ada", "-")
    assert (code, names) == (0, "['Ada', 'Grace']")
    assert "name of the operator" not in said
    said, code, names = asked(rig, "", "Ada", "Grace")
    assert (said, code, names) == ("", 0, "['Ada', 'Grace']")


@pytest.mark.thorough
def test_no_answer_is_no_name(tmp_path: Path) -> None:
    said, code, _names = asked(real_rig(tmp_path, "/dev/nobody"), "\n", "-", "Grace")
    assert code != 0
    assert "--operator: expected a name of 1 to 100 printable characters, got ''" in said


@pytest.mark.thorough
def test_a_simulated_vehicle_asks_nobody(tmp_path: Path) -> None:
    assert asked(own_rig(tmp_path), "", "-", "-") == ("", 0, "[None, None]")


def made(folder: Path) -> DrivePlan:
    """The plan of a drive with the simulated vehicle."""
    return plan("seen_late", str(own_rig(folder)), folder, out=None, seed=None, controller=None, shadow=False)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("name", ["", "  ", "a\nb", "\x1b[2J", "a" * 101])
def test_what_is_no_name_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="--driver: expected a name"):
        named(made(tmp_path), "Ada", name)


def test_without_a_rig_there_is_nobody_to_name(tmp_path: Path) -> None:
    run = isolated.command("drive", "--driver", "Ada", cwd=tmp_path)
    assert (run.returncode, run.stderr) == (
        2,
        "vve-sumo: --driver: only a live drive has an operator and a driver; name the rig with --rig\n",
    )


@pytest.mark.thorough
@pytest.mark.live
def test_the_record_names_them_and_the_doctors_word(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    found = [Check("bus", "1 Mbit/s"), Check("fixes", "none", CheckResult.NO_GO, "look at pose.port")]
    doctor_result.keep(rig, found, "seen_late", tmp_path, datetime.datetime.now(datetime.UTC))
    scenario = (REPOSITORY / "scenarios" / "seen_late.toml").read_text(encoding="utf-8")
    lines = [line if not line.startswith("duration_s") else "duration_s = 5.0" for line in scenario.splitlines()]
    (tmp_path / "short.toml").write_text("\n".join(lines), encoding="utf-8")
    people = ("--operator", "Ada Lovelace", "--driver", "Grace Hopper")
    run = vve_sumo("drive", "short.toml", "--rig", str(rig), *people, "--out", "record", cwd=tmp_path)
    reported = json.loads((tmp_path / "record" / "provenance.json").read_text(encoding="utf-8"))
    assert (reported["operator"], reported["driver"]) == ("Ada Lovelace", "Grace Hopper"), run.stderr
    assert (reported["doctor"]["verdict"], reported["doctor"]["caveats"]) == ("NO-GO", [])
    assert "Ada" not in (tmp_path / "record" / "scenario.json").read_text(encoding="utf-8")
    assert isolated.command("replay", "record", cwd=tmp_path).returncode == 0
    assert isolated.command("report", "record", cwd=tmp_path).returncode == 0
    page = (tmp_path / "record" / "report.html").read_text(encoding="utf-8")
    assert "Ada Lovelace" in page
    assert "NO-GO of 20" in page
