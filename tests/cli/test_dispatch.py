"""The command line as a user meets it: help that teaches, one line for bad input, exit codes, nothing left behind."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests import isolated
from tests.conftest import REPOSITORY
from vve_sumo.cli import main, scenarios
from vve_sumo.cli.dispatch import COMMANDS

SCENARIO = (REPOSITORY / "scenarios" / "parked_car.toml").read_text(encoding="utf-8")


def vve_sumo(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the command in a folder with the checkout's package, in a Python of its own."""
    return subprocess.run(
        [sys.executable, "-m", "vve_sumo.cli", *arguments],
        cwd=cwd,
        env={"PATH": "/usr/bin:/bin", "PYTHONPATH": str(REPOSITORY), "HOME": str(cwd)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def test_help_names_every_command_and_the_exit_codes(tmp_path: Path) -> None:
    run = vve_sumo("--help", cwd=tmp_path)
    assert run.returncode == 0
    for word in ("drive", "pose", "path", "network", "steering-margin", "init", "exit codes"):
        assert word in run.stdout
    assert "examples" in vve_sumo("drive", "--help", cwd=tmp_path).stdout


def test_help_imports_nothing_heavy(tmp_path: Path) -> None:
    code = (
        "import sys\nfrom vve_sumo.cli import main\n"
        "try:\n main(['--help'])\nexcept SystemExit: pass\n"
        "print([m for m in ('numpy', 'pandas', 'libsumo', 'control', 'matplotlib', 'rich', 'can') if m in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True, timeout=60
    )
    assert run.stdout.splitlines()[-1] == "[]"


@pytest.mark.thorough
def test_the_drive_does_without_slow_imports() -> None:
    """python-control, pandas and matplotlib cost seconds, numexpr starts threads; the first tick needs none of them."""
    code = (
        "import sys, vve_sumo.drive.run\n"
        "print([m for m in ('pandas', 'control', 'matplotlib', 'cantools', 'asammdf', 'numexpr') if m in sys.modules])"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True, timeout=60
    )
    assert run.stdout.splitlines()[-1] == "[]"


def edited(old: str, new: str) -> str:
    """Return the shipped scenario with one passage changed."""
    assert old in SCENARIO
    return SCENARIO.replace(old, new)


WRONG_SCENARIOS = {
    "unknown key": (edited("speed_mps = 11.176", "speed_kmh = 40.0"), ["speed"]),
    "wrong unit in a value": (edited("speed_mps = 11.176", 'speed_mps = "25 kg"'), ["ego.speed_mps", "25 kg"]),
    "value out of range": (edited("speed_mps = 11.176", "speed_mps = -3.0"), ["ego.speed_mps", "-3.0"]),
    "not a number": (edited("speed_mps = 11.176", "speed_mps = nan"), ["ego.speed_mps"]),
    "unknown network": (edited('network = "linden"', 'network = "atlantis"'), ["atlantis", "linden"]),
    "unknown demand": (edited('demand = ["linden_17th_light"]', 'demand = ["rush"]'), ["rush", "linden_light"]),
    "unknown path": (edited('path = "linden_17th"', 'path = "nowhere"'), ["nowhere"]),
    "obstacle beyond the path": (edited("at_m = ", "at_m = 9"), ["parked_car", "beyond"]),
    "not TOML": ("title = \n", ["TOML"]),
    "not text": ("title = '\udcff'", ["UTF-8"]),
    "missing table": ("title = 'x'\n", ["road", "missing"]),
}


@pytest.mark.thorough(witnesses=4)
@pytest.mark.parametrize("case", WRONG_SCENARIOS, ids=str)
def test_a_wrong_scenario_is_one_line_exit_2_and_nothing_left(case: str, tmp_path: Path) -> None:
    text, words = WRONG_SCENARIOS[case]
    file = tmp_path / "mine.toml"
    file.write_bytes(text.encode("utf-8", errors="surrogateescape"))
    refused(tmp_path, ["drive", str(file), "--out", "record"], words)


def refused(folder: Path, arguments: list[str], words: list[str]) -> None:
    """Assert that a command is refused in one line with these words, with exit code 2, and leaves nothing behind."""
    before = sorted(folder.rglob("*"))
    run = isolated.command(*arguments, cwd=folder)
    assert run.returncode == 2, run.stdout + run.stderr
    assert len(run.stderr.strip().splitlines()) == 1, run.stderr
    for word in words:
        assert word in run.stderr
    assert sorted(folder.rglob("*")) == before


def test_a_refusal_is_one_line_exit_2_of_the_process(tmp_path: Path) -> None:
    """Once with a Python of its own; the other refusals are in processes that have everything imported."""
    run = isolated.command("drive", "no_such_scenario", cwd=tmp_path)
    assert (run.returncode, run.stdout, len(run.stderr.splitlines())) == (2, "", 1)
    assert "no_such_scenario" in run.stderr


def test_wrong_uses_are_one_line_exit_2(tmp_path: Path) -> None:
    refused(tmp_path, ["drive", "no_such_scenario"], ["no_such_scenario", "parked_car"])
    refused(tmp_path, ["drive", "missing.toml"], ["missing.toml"])
    refused(tmp_path, ["drive", "--controller", "no_such_controller"], ["no_such_controller", "follow_and_stop"])
    refused(tmp_path, ["drive", "--controller", "gone.py:make"], ["gone.py"])
    refused(tmp_path, ["drive", "--seed", "-1"], ["seed", "-1"])
    refused(tmp_path, ["drive", "--pose", "gone.csv"], ["gone.csv"])
    refused(tmp_path, ["nonsense"], ["nonsense"])
    refused(tmp_path, ["pose", "decode", "gone.ncom", "--csv", "out.csv"], ["gone.ncom"])
    refused(tmp_path, ["path", "record", "linden", "--from", "a", "--to", "b", "--out", "p.csv"], ["'a'"])


def test_a_car_is_named_once(tmp_path: Path) -> None:
    for arguments, words in [
        (["--rig", "simulated", "--vehicle", "lincoln_mkz"], "--vehicle: a rig brings its own vehicle"),
        (["--lockstep"], "--lockstep: expected --rig"),
        (["--foxglove"], "--foxglove: only a live drive has topics"),
        (["--rig", "simulated", "--lockstep", "--shadow"], "--shadow: only a live drive sets enable bits"),
        (["--vehicle", "tank"], "ego.vehicle: no vehicle named 'tank'; known: ford_fusion, lincoln_mkz"),
        (["--rig", "fusion_example", "--lockstep"], "key 'lot.surveyed' is missing"),
    ]:
        run = isolated.command("drive", "parked_car", *arguments, cwd=tmp_path)
        assert (run.returncode, run.stdout) == (2, "")
        assert words in run.stderr
        assert run.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
def test_what_only_shows_at_the_start_leaves_nothing_either(tmp_path: Path) -> None:
    scenario(tmp_path, "at_m = 639.0", "at_m = 2.0")
    refused(tmp_path, ["drive", "mine.toml", "--out", "record"], ["parked_car", "starts"])
    scenario(tmp_path, "[controller]" if "[controller]" in SCENARIO else "[criteria]", NAN_TUNING)
    refused(tmp_path, ["drive", "mine.toml", "--out", "record"], ["tuning"])


NAN_TUNING = '[controller]\nname = "follow_and_stop"\ntuning = { gap_m = nan }\n\n[criteria]'


@pytest.mark.thorough
def test_places_that_cannot_be_written_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    refused(tmp_path, ["drive", "--out", "file/record"], ["file/record"])
    refused(tmp_path, ["drive", "--out", "/proc/nowhere/record"], ["/proc/nowhere"])
    refused(tmp_path, ["init", "file/mine"], ["file"])


@pytest.mark.thorough
def test_recordings_that_are_none_are_one_line(tmp_path: Path) -> None:
    (tmp_path / "binary.csv").write_bytes(bytes(range(256)) * 4)
    (tmp_path / "torn.csv").write_text(
        "time_s,latitude_deg,longitude_deg,heading_deg,speed_mps\n"
        + "".join(f"{t},40.0,-83.0,90.0,0.0\n" for t in range(5))
        + "5,40.0,east,90.0,0.0\n",
        encoding="utf-8",
    )
    (tmp_path / "gap.csv").write_text(
        "time_s,latitude_deg,longitude_deg,heading_deg,speed_mps\n1,40,-83,90,0\n2,40,-83,90,0\n1e12,40,-83,90,0\n",
        encoding="utf-8",
    )
    refused(tmp_path, ["drive", "--pose", "binary.csv", "--out", "record"], ["binary.csv"])
    refused(tmp_path, ["drive", "--pose", "torn.csv", "--out", "record"], ["torn.csv", "line 7", "longitude_deg"])
    refused(tmp_path, ["drive", "--pose", "gap.csv", "--out", "record"], ["gap.csv", "without a fix"])


@pytest.mark.thorough
def test_a_title_with_brackets_is_only_a_title(tmp_path: Path) -> None:
    scenario(
        tmp_path, 'title = "The paper\'s drive: a car parked in the middle of the road"', 'title = "[red]x[/nope]"'
    )
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8").replace("duration_s = 180.0", "duration_s = 1.0")
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    run = isolated.command("drive", "mine.toml", "--out", "record", cwd=tmp_path)
    assert run.returncode == 1, run.stderr
    assert "[red]x[/nope]" in run.stdout


def test_a_recording_is_never_written_over(shared_data: Path, tmp_path: Path) -> None:
    packet = bytes.fromhex((shared_data / "ncom" / "real_packet.hex").read_text(encoding="ascii").strip())
    (tmp_path / "packet.ncom").write_bytes(packet)
    refused(tmp_path, ["pose", "decode", "packet.ncom", "--csv", "packet.ncom"], ["packet.ncom", "itself"])
    assert (tmp_path / "packet.ncom").read_bytes() == packet


@pytest.mark.thorough
def test_a_refusal_takes_away_only_what_it_made(tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    scenario(tmp_path, "at_m = 639.0", "at_m = 2.0")
    refused(tmp_path, ["drive", "mine.toml", "--out", "own"], ["starts"])
    refused(tmp_path, ["drive", "mine.toml", "--out", "a/b/c"], ["starts"])


def test_a_street_that_is_not_there_is_refused_by_name(tmp_path: Path) -> None:
    refused(tmp_path, ["network", "edges", "linden", "Nowhere Road"], ["linden", "Nowhere Road"])


def test_demand_refuses_edges_that_are_none(tmp_path: Path) -> None:
    demand = ["network", "demand", "linden", "--level", "light", "--out", "x.rou.xml"]
    refused(tmp_path, [*demand, "--clear", "nope"], ["nope"])
    (tmp_path / "p.csv").write_bytes(b"\xff\xfe latitude_deg,longitude_deg\n")
    refused(tmp_path, [*demand, "--path", "p.csv"], ["p.csv", "edges"])


def test_a_folder_that_holds_something_is_not_driven_into(tmp_path: Path) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("the only copy", encoding="utf-8")
    refused(tmp_path, ["drive", "--out", "full"], ["full", "not empty"])


@pytest.mark.thorough
def test_wrong_networks_and_paths_are_named(tmp_path: Path) -> None:
    (tmp_path / "broken.net.xml").write_text("<net><location", encoding="utf-8")
    (tmp_path / "flat.net.xml").write_text(
        '<net version="1.20"><location netOffset="0,0" convBoundary="0,0,9,9" projParameter="!"/></net>',
        encoding="utf-8",
    )
    (tmp_path / "routes.net.xml").write_text("<routes/>", encoding="utf-8")
    (tmp_path / "web.net.xml").write_text(
        '<net><location netOffset="0,0" convBoundary="0,0,9,9" projParameter="+proj=merc +units=m"/></net>',
        encoding="utf-8",
    )
    for name, word in (("broken", "read"), ("flat", "projection"), ("routes", "<routes>"), ("web", "+proj=tmerc")):
        scenario(tmp_path, 'network = "linden"', f'network = "{name}.net.xml"')
        refused(tmp_path, ["drive", "mine.toml"], [f"{name}.net.xml", word])
    rows = {
        "empty.csv": ("", "latitude_deg"),
        "header.csv": ("latitude_deg,longitude_deg\n", "2 points"),
        "columns.csv": ("lat,lon\n40.0,-82.9\n", "latitude_deg"),
        "words.csv": ("latitude_deg,longitude_deg\n40.0,west\n", "line 2"),
        "paris.csv": ("latitude_deg,longitude_deg\n48.85,2.35\n48.86,2.36\n", "off the network"),
        "field.csv": ("latitude_deg,longitude_deg\n39.99348,-82.97025\n39.99348,-82.97024\n", "from every lane"),
        "nan.csv": ("latitude_deg,longitude_deg\nnan,-82.97\n40.0,-82.97\n", "line 2"),
    }
    for name, (text, word) in rows.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        scenario(tmp_path, 'path = "linden_17th"', f'path = "{name}"')
        refused(tmp_path, ["drive", "mine.toml"], [name, word])


def scenario(folder: Path, old: str, new: str) -> None:
    """Write the shipped scenario with one passage changed as mine.toml."""
    (folder / "mine.toml").write_text(edited(old, new), encoding="utf-8")


def test_the_genuine_packet_decodes_to_one_row(shared_data: Path, tmp_path: Path) -> None:
    packet = bytes.fromhex((shared_data / "ncom" / "real_packet.hex").read_text(encoding="ascii").strip())
    (tmp_path / "packet.ncom").write_bytes(packet)
    run = isolated.command("pose", "decode", "packet.ncom", "--csv", "fixes.csv", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    with (tmp_path / "fixes.csv").open(encoding="utf-8", newline="") as file:
        (row,) = csv.DictReader(file)
    assert row["nav_status"] == "2"
    assert float(row["time_gps_s"]) == pytest.approx(19873636 * 60 + 22.913, abs=5e-4)
    assert float(row["latitude_deg"]) == pytest.approx(37.48668, abs=1e-5)
    assert float(row["longitude_deg"]) == pytest.approx(-122.21812, abs=1e-5)
    assert float(row["velocity_down_mps"]) == pytest.approx(-0.0255, abs=1e-9)
    assert row["heading_deg"] == ""
    assert row["trusted"] == "false"
    assert "status_not_locked" in row["reason"]


def test_init_lays_out_a_workspace_that_drives_and_never_replaces(tmp_path: Path) -> None:
    run = isolated.command("init", "mine", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    for name in ("controllers/follow_and_stop.py", "networks/linden.net.xml", "scenarios/parked_car.toml"):
        assert (tmp_path / "mine" / name).is_file()
    again = isolated.command("init", "mine", cwd=tmp_path)
    assert again.returncode == 2
    assert "there already" in again.stderr


@pytest.mark.thorough
def test_a_users_own_controller_drives_and_its_failure_is_a_stop(tmp_path: Path) -> None:
    """A controller that raises under way ends as a stop with a reason, in the record and on the screen."""
    (tmp_path / "mine.py").write_text(
        "from vve_sumo.values import ControlCommand\n"
        "class Mine:\n"
        "    def step(self, observation):\n"
        "        if observation.time > 6.0:\n"
        "            raise RuntimeError('out of ideas')\n"
        "        return ControlCommand(steering=0.0, acceleration=1.0)\n"
        "def make(vehicle, tuning):\n"
        "    return Mine()\n",
        encoding="utf-8",
    )
    run = isolated.command("drive", "--controller", "mine.py:make", "--out", "record", "--quiet", cwd=tmp_path)
    assert run.returncode == 1, run.stderr
    assert "out of ideas" in run.stdout
    assert "fault" in run.stdout
    shutil.rmtree(tmp_path / "record")


def test_a_defect_of_ours_is_no_failed_drive(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def defective(arguments: object) -> int:
        raise ZeroDivisionError("in a command")

    def gone(arguments: object) -> int:
        raise BrokenPipeError

    monkeypatch.setattr(scenarios, "run", defective)
    assert main(["scenarios"]) == 70
    assert "ZeroDivisionError: in a command" in capsys.readouterr().err
    monkeypatch.setattr(scenarios, "run", gone)
    assert main(["scenarios"]) == 141


@pytest.mark.parametrize(
    ("arguments", "now"),
    [
        (["align", "--rig", "ours", "--store"], "--store is now --write"),
        (["align", "--rig", "ours", "--fit", "--cut", "a.csv"], "--cut is now --write-shortened-path"),
        (["calibrate", "--rig", "ours", "--leave=mass"], "--leave is now --keep-values"),
        (["study", "cliff", "parked_car"], "cliff is now vve-sumo study latency"),
        (["design"], "design is now vve-sumo steering-margin"),
        (["export", "runs/mine", "--csv"], "required: FORMAT, such as csv"),
        (["path", "record", "linden", "--from", "-21405924#2"], "one that begins with a minus is written --from=-…"),
    ],
)
def test_a_former_or_wrong_spelling_gets_one_line_with_the_right_one(
    arguments: list[str], now: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as wrong:
        main(arguments)
    assert wrong.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert now in line


def test_every_command_says_its_own_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    drives = {"drive", "study", "suite", "sweep", "certify", "hunt", "calibrate", "replay", "compare"}
    for command in COMMANDS:
        name = command.__name__.rpartition(".")[2].replace("_", "-")
        with pytest.raises(SystemExit):
            main([name, "--help"])
        text = capsys.readouterr().out
        assert "exit codes:" in text
        assert name in drives or "\n  1  " not in text, f"{name}: exit code 1 is for what was driven and failed"


@pytest.mark.parametrize(
    "words",
    [
        "network build", "network edges", "network picture", "network demand", "path record", "path cut", "lot survey",
        "pose decode", "scenarios show", "scenarios schema", "scenarios import",
    ],
)  # fmt: skip
def test_what_only_writes_files_has_no_exit_code_of_a_drive(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([*words.split(), "--help"])
    codes = capsys.readouterr().out.partition("exit codes:")[2]
    assert re.findall(r"^ +(\d+) ", codes, flags=re.MULTILINE) == ["0", "2", "70", "130"]


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_a_shell_completes_commands_and_options(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    for word in ("steering-margin", "--override-doctor", "export"):
        assert word in script


def test_bash_takes_the_completion(tmp_path: Path) -> None:
    script = vve_sumo("completion", "bash", cwd=tmp_path).stdout
    (tmp_path / "completion.sh").write_text(script, encoding="utf-8")
    asks = (
        "source completion.sh; COMP_WORDS=(vve-sumo steer); COMP_CWORD=1; "
        'complete -p vve-sumo | grep -o -- "-F [^ ]*" | { read -r _ name; $name; echo "${COMPREPLY[@]}"; }'
    )
    run = subprocess.run(["bash", "-c", asks], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert run.stdout.split() == ["steering-margin"], run.stderr


@pytest.mark.thorough
def test_a_program_reads_what_a_command_prints(tmp_path: Path) -> None:
    listed = json.loads(isolated.command("scenarios", "--json", cwd=tmp_path).stdout)
    assert {"name", "title", "network", "others", "passes_if"} == set(listed[0])
    examined = isolated.command("doctor", "--json", cwd=tmp_path)
    said = json.loads(examined.stdout)
    assert said["verdict"] == ("GO" if examined.returncode == 0 else "NO-GO")
    assert {"name", "finding", "found", "advice"} <= set(said["checks"][0])
    scenario(tmp_path, "duration_s = 180.0", "duration_s = 1.0")
    drive = isolated.command("drive", "mine.toml", "--out", "late", "--quiet", "--json", cwd=tmp_path)
    summary = json.loads(drive.stdout)
    assert summary == {"record": "late"} | json.loads((tmp_path / "late" / "summary.json").read_text())
