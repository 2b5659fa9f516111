"""The dossier says what the rig's files say, asks of each rig what it has, and touches nothing but its own page."""

from __future__ import annotations

import datetime
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import REPOSITORY
from tests.live.matrix import MATRIX
from vve_sumo.cli.dispatch import main
from vve_sumo.commissioning import doctor_result
from vve_sumo.commissioning.findings import Check, CheckResult
from vve_sumo.errors import ConfigError
from vve_sumo.physical_constants import GRAVITY
from vve_sumo.report.page import ReportPage
from vve_sumo.report.tables import Cell, ReportTable
from vve_sumo.rig import load as rigs
from vve_sumo.safety import evidence
from vve_sumo.safety.briefing import briefing
from vve_sumo.safety.dossier import DossierInput, dossier
from vve_sumo.safety.rig_features import features_of

NOW = datetime.datetime(2026, 11, 28, 12, 0, tzinfo=datetime.UTC)
#: a drive with a rig starts from rest: there is no picture to be searched for
ROLLING = (REPOSITORY / "scenarios" / "delay_probe.toml").read_text(encoding="utf-8")
ROLLING = ROLLING.replace("[ego]\n", "[ego]\ninitial_speed_mps = 5.0\n", 1)
TEMPLATE = (REPOSITORY / "rigs" / "fusion_example.toml").read_text(encoding="utf-8")
SURVEYED = TEMPLATE.replace("# surveyed = 2026-05-01", "surveyed = 2026-05-01")
WATCHDOG = "\n[watchdog_test]\ndate = 2026-05-01\narmed = {}\ndeceleration_mps2 = {}\ndelay_s = 0.2\n"
ARMED = SURVEYED + WATCHDOG.format("true", 2.5)
NOT_ARMED = SURVEYED + WATCHDOG.format("false", 0.3)
WITH_PERSON = ARMED + (
    '\n[[people]]\nid = "anna"\nsource = "phone"\nlatitude_deg = 40.0080\nlongitude_deg = -83.0190\n'
    "heading_deg = 90.0\nleast_distance_m = 50.0\n"
)
WITH_BUTTON = ARMED.replace("# stop_can_id", "stop_can_id")


def rig_file(folder: Path, content: str) -> Path:
    file = folder / "rigs" / "ours.toml"
    file.parent.mkdir(exist_ok=True)
    file.write_text(content, encoding="utf-8")
    return file


def made(folder: Path, rig: str = "ours", **given: Any) -> ReportPage:
    (folder / "scenarios").mkdir(exist_ok=True)
    (folder / "scenarios" / "rolling.toml").write_text(ROLLING, encoding="utf-8")
    page = dossier(DossierInput(rig=rig, scenario="rolling", working=folder, now=NOW, **given))
    (line,) = page.content["lot_lines"]  # type: ignore[misc]
    assert "starts from rest" in line
    return page


def cells(table: Any) -> list[list[str]]:
    assert isinstance(table, ReportTable)
    return [[cell.text if isinstance(cell, Cell) else cell for cell in row] for row in table.rows]


def lines(page: ReportPage) -> str:
    """Every line to be signed, and the roles."""
    lists: Any = page.content["checklists"]
    roles = [row[0] for row in cells(page.content["roles"])]
    return "\n".join([*roles, *(row[0] for _title, table in lists for row in cells(table))])


def test_what_is_not_examined_is_no_go_and_not_armed_shadow_alone(tmp_path: Path) -> None:
    rig_file(tmp_path, SURVEYED)
    page = made(tmp_path)
    assert page.verdict.word == "not examined"
    assert "--shadow alone: watchdog_test is missing" in page.verdict.line
    assert cells(page.content["watchdog"]) == [["test", "none"]]


@pytest.mark.parametrize(
    ("finding", "age", "word", "said"),
    [
        (CheckResult.GO, 0, "GO", "The doctor said GO of this rig file on 2026-11-28T12:00:00+00:00."),
        (CheckResult.NO_GO, 0, "NO-GO", "The doctor says NO-GO: bus."),
        (CheckResult.GO, 2, "NO-GO", "older than a day"),
    ],
)
def test_the_verdict_is_the_doctors_of_today(
    finding: CheckResult, age: int, word: str, said: str, tmp_path: Path
) -> None:
    file = rig_file(tmp_path, ARMED)
    kept = NOW - datetime.timedelta(days=age)
    doctor_result.keep(file, [Check("bus", "four reports", finding)], "parked_car", tmp_path, kept)
    page = made(tmp_path)
    assert page.verdict.word == word
    assert said in page.verdict.line
    assert cells(page.content["doctor"]) == [["bus", finding.value, "four reports"]]


def test_a_go_of_a_rig_that_may_not_arm_is_none(tmp_path: Path) -> None:
    file = rig_file(tmp_path, SURVEYED)
    doctor_result.keep(file, [Check("bus", "four reports")], "parked_car", tmp_path, NOW)
    assert made(tmp_path).verdict.word == "NO-GO"


@pytest.mark.parametrize(
    ("content", "there", "absent"),
    [
        (ARMED, ["Look-out", "The watchdog test of this car is dated"], ["Escort", "NOT armed", "stop button"]),
        (NOT_ARMED, ["The watchdog is NOT armed"], ["The watchdog test of this car is dated"]),
        (WITH_PERSON, ["Escort of the person", "knows the STOP button"], ["NOT armed"]),
        (WITH_BUTTON, ["The stop button on the car's bus was pressed"], ["Escort"]),
    ],
)
def test_roles_and_checklists_are_those_that_the_rig_asks_for(
    content: str, there: list[str], absent: list[str], tmp_path: Path
) -> None:
    rig_file(tmp_path, content)
    said = lines(made(tmp_path))
    assert [one for one in there if one not in said] == []
    assert [one for one in absent if one in said] == []


def test_every_feature_is_one_that_something_asks_for_and_the_other_way_round() -> None:
    shipped = [rigs.load(REPOSITORY / "rigs" / f"{name}.toml") for name in ("simulated", "external", "foreign")]
    assert features_of(shipped[0]) == {"armed", "udp"}
    assert features_of(shipped[1]) == {"armed", "udp", "brain", "external"}
    assert features_of(shipped[2]) == {"armed", "udp", "brain"}
    asked = {
        word
        for one in (*briefing().roles, *(item for each in briefing().checklists for item in each.items))
        for word in (*one.if_, *one.unless)
    }
    source = (REPOSITORY / "vve_sumo/safety/rig_features.py").read_text(encoding="utf-8")
    assert asked == set(re.findall(r'(?m)^        "(\w+)": ', source))


def test_a_stop_is_as_long_as_the_textbook_says_and_what_the_car_gains(tmp_path: Path) -> None:
    rig_file(tmp_path, ARMED)
    rows = [[float(number) for number in row] for row in cells(made(tmp_path).content["stops"])]
    assert [row[0] for row in rows] == pytest.approx([1.39, 4.0, 5.0, 8.0], abs=0.005)
    downhill = GRAVITY * 0.02
    for speed, kmh, _gateway, watchdog, second in rows:
        assert kmh == pytest.approx(3.6 * speed, abs=0.5)
        assert second == pytest.approx(speed, abs=0.05)
        at_least = 0.3 * speed + speed**2 / (2.0 * (2.5 - downhill))  # 0.1 s of a setpoint's life and the rig's 0.2 s
        # Until then the car gains 2 m/s2 at most, for the delay and the time in which the engine's force fades.
        gained = speed + 2.0 * 0.8
        at_most = 0.3 * gained + gained**2 / (2.0 * (2.5 - downhill))
        assert at_least - 0.05 <= watchdog <= at_most + 0.05


def junit(file: Path, **rows: str) -> Path:
    inner = {"passed": "", "failed": "<failure/>", "skipped": "<skipped/>", "broken": "<error/>"}
    tests = "".join(f'<testcase name="test_it[{row}]">{inner[came]}</testcase>' for row, came in rows.items())
    file.write_text(f'<testsuites><testsuite timestamp="2026-11-27T01:00:00">{tests}</testsuite></testsuites>')
    return file


def test_the_matrix_is_read_from_pytests_own_file(tmp_path: Path) -> None:
    file = junit(
        tmp_path / "m.xml",
        pose_lost="passed",
        bus_dead="failed",
        drive_killed="skipped",
        overrun="broken",
        other="failed",
    )
    found = evidence.matrix_evidence(file)
    assert found.passed == ("pose_lost",)
    assert set(found.failed) == {"bus_dead", "overrun"}
    assert set(found.not_tried) == {row.name for row in MATRIX} - {"pose_lost", "bus_dead", "overrun"}
    assert found.begun == "2026-11-27T01:00:00"


def hunted(folder: Path, rig_sha256: str) -> Path:
    folder.mkdir()
    (folder / "hunt.json").write_text(json.dumps({"rig_sha256": rig_sha256}), encoding="utf-8")
    report = "40 episodes, 0.1 h simulated, 900 an hour\n0 found, in 0 episodes\n0 violations are known limits\n\n"
    report += "least margins:\n   0.131  stops_in_bound: x\n   0.400  inside_lot: y\n\nfound nothing\n"
    (folder / "report.txt").write_text(report, encoding="utf-8")
    return folder


def certified(folder: Path, rig_sha256: str) -> Path:
    folder.mkdir()
    said = {
        "verdict": "FAILED",
        "passed": False,
        "results": [{"verdict": "passed"}, {"verdict": "FAILED"}, {"verdict": "passed"}],
        "brain": {"command": "python brain.py", "files_sha256": {"brain.py": "ab" * 32}},
        "rig_sha256": rig_sha256,
        "began_utc": "2026-11-26",
    }
    (folder / "certificate.json").write_text(json.dumps(said), encoding="utf-8")
    return folder


def test_what_was_tried_before_says_of_which_rig_file(tmp_path: Path) -> None:
    from vve_sumo.record.hashes import hash_file

    mine = hash_file(rig_file(tmp_path, ARMED))
    page = made(
        tmp_path,
        matrix=junit(tmp_path / "m.xml", pose_lost="passed"),
        hunt=hunted(tmp_path / "night", mine),
        certificate=certified(tmp_path / "cert", "0" * 64),
    )
    matrix, hunt, certificate = cells(page.content["tried"])
    assert matrix[1].startswith("1 rows passed, 0 failed")
    assert "0 found" in hunt[1]
    assert "least margin 0.131 stops_in_bound" in hunt[1]
    assert hunt[2] == "this rig file"
    assert certificate[1].startswith(
        "FAILED on 2026-11-26 (2 passed, 1 FAILED); python brain.py; brain.py abababababab…"
    )
    assert certificate[2] == "ANOTHER version of the rig file"


def test_what_was_not_given_is_said_and_not_taken_for_good(tmp_path: Path) -> None:
    rig_file(tmp_path, ARMED)
    assert {row[1].partition(":")[0] for row in cells(made(tmp_path).content["tried"])} == {"not given"}


@pytest.mark.parametrize("option", ["matrix", "hunt", "certificate", "records"])
def test_evidence_that_is_none_is_one_line_that_names_the_file(option: str, tmp_path: Path) -> None:
    rig_file(tmp_path, ARMED)
    nothing = tmp_path / "nothing"
    with pytest.raises(ConfigError, match=str(nothing)):
        made(tmp_path, **{option: (nothing,) if option == "records" else nothing})


@pytest.mark.parametrize("content", ["", "no xml", "<testsuites/>", '<testsuite><testcase name="x[y]"/></testsuite>'])
def test_a_file_without_a_row_of_the_matrix_is_refused(content: str, tmp_path: Path) -> None:
    file = tmp_path / "m.xml"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"m\.xml: expected"):
        evidence.matrix_evidence(file)


def test_a_rig_that_is_refused_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["dossier", "fusion_example"]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


#: fails where a program opens a socket, a serial line, a pty, or starts another program than git
GUARD = """
import sys
def hook(event, arguments):
    if event in ("socket.bind", "socket.connect", "pty.spawn", "os.fork", "os.forkpty", "os.posix_spawn"):
        raise SystemExit(f"touched: {event} {arguments}")
    if event == "subprocess.Popen" and "git" not in str(arguments[0]):
        raise SystemExit(f"started: {arguments[0]}")
sys.addaudithook(hook)
from vve_sumo.cli.dispatch import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the shipped simulated rig, made by a program that may touch nothing."""
    folder = tmp_path_factory.mktemp("dossier")
    command = [sys.executable, "-c", GUARD, "dossier", "simulated", "--out", "day.html"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=250, check=False)
    assert done.returncode == 0, done.stderr
    assert {file.name for file in folder.iterdir()} == {"day.html"}
    return folder / "day.html"


@pytest.mark.thorough
def test_it_opens_nothing_and_holds_everything(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert "linden_17th in the lot of simulated" in text
    assert all(f">{one.title}<" in text for one in briefing().checklists)
    assert len(text) < 400_000


@pytest.mark.thorough
def test_in_a_browser_it_fetches_nothing_and_has_room_to_sign(page: Path, browser: Any) -> None:
    asked: list[str] = []
    view = browser.new_page(viewport={"width": 1280, "height": 900})
    view.on("request", lambda request: asked.append(request.url))
    view.goto(page.as_uri())
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    blanks = view.query_selector_all(".blank")
    assert len(blanks) == 2 * (len(briefing().of({"armed", "udp"}).roles) + _items())
    assert min(one.bounding_box()["width"] for one in blanks) > 100.0
    view.set_viewport_size({"width": 360, "height": 800})
    assert view.evaluate("document.documentElement.scrollWidth") <= 360
    view.close()


def _items() -> int:
    return sum(len(one.items) for one in briefing().of({"armed", "udp"}).checklists)
