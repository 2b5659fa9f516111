"""Go and no-go: the simulated rig is fit, a spoilt rig's faults are found and named, a real car's bus hears nothing."""

from __future__ import annotations

import datetime
import json
import math
import re
import socket
import subprocess
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from tests import isolated
from tests.conftest import REPOSITORY
from tests.fixes import GOOD
from tests.live.bench import LiveCar
from tests.live.command_line import WATCHDOG, begun, outline, own_rig, vve_sumo
from tests.pose import nmea_sentences
from vve_sumo.bus import Bus
from vve_sumo.commissioning import align, machine_checks, rig_checks
from vve_sumo.commissioning.findings import Check, CheckReport, CheckResult
from vve_sumo.live import assembly
from vve_sumo.live.slcan import Adapter
from vve_sumo.pose import nmea
from vve_sumo.pose.ncom import Encoder
from vve_sumo.rig import load as rigs
from vve_sumo.values import Fix, FixQuality, Frame
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.interface import Gear

DAY = datetime.date(2026, 5, 1)


def reported(run: subprocess.CompletedProcess[str], name: str) -> tuple[str, str]:
    """Finding and text of a check, advice included."""
    lines = run.stdout.splitlines()
    at = next(number for number, line in enumerate(lines) if line[7:].startswith(f"{name} "))
    text = lines[at][7 + 16 :].strip() + (lines[at + 1] if lines[at + 1].lstrip().startswith("->") else "")
    return lines[at][:7].strip(), text


@pytest.mark.thorough
@pytest.mark.live
def test_the_twin_is_go_where_it_was_aligned_and_nowhere_else(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    assert isolated.command("align", "seen_late", "--rig", str(rig), "--write", cwd=tmp_path).returncode == 0
    before = set(tmp_path.rglob("*"))
    run = vve_sumo("doctor", "seen_late", "--rig", str(rig), cwd=tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    assert run.stdout.splitlines()[-1] == "GO"
    assert "fits" in reported(run, "path in the lot")[1]
    rates = reported(run, "reports")[1]
    for name, rate in (("brake", 50), ("steering", 50), ("gear", 20), ("wheels", 100), ("yaw rate", 100)):
        heard = float(rates.split(f"{name} ")[1].split(",")[0].split(")")[0])
        assert heard == pytest.approx(rate, rel=0.1)
    assert float(reported(run, "fixes")[1].split()[0]) == pytest.approx(100.0, rel=0.05)
    assert reported(run, "gear") == ("go", "park")
    assert "none" in reported(run, "commands")[1]
    written = {str(file.relative_to(tmp_path)) for file in set(tmp_path.rglob("*")) - before if file.is_file()}
    assert written == {"runs/doctor/mine.json"}
    finding, text = reported(run, "start")
    assert finding == "go"
    left, along, turned = numbers(text)[:3]
    assert math.hypot(left, along) < 0.15
    assert turned <= 1.0
    moved = rig.read_text(encoding="utf-8").replace("latitude_deg = 40.0041", "latitude_deg = 40.0042")
    rig.write_text(moved.replace("\nheading_deg = 85.0", "\nheading_deg = 265.0"), encoding="utf-8")
    run = isolated.command("doctor", "seen_late", "--rig", str(rig), cwd=tmp_path)
    finding, text = reported(run, "start")
    assert finding == "NO-GO"
    assert math.hypot(*numbers(text)[:2]) == pytest.approx(11.1, abs=0.2)
    assert numbers(text)[2] == pytest.approx(180.0, abs=1.0)
    assert "align" in text
    assert (run.returncode, run.stdout.splitlines()[-1]) == (3, "NO-GO: start")


def numbers(text: str) -> list[float]:
    """The numbers in a text."""
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?", text)]


@pytest.mark.thorough
@pytest.mark.live
def test_a_lot_too_small_is_no_go(tmp_path: Path) -> None:
    corners = ((40.0036, -83.0195), (40.0036, -83.0160), (40.0052, -83.0160), (40.0052, -83.0195))
    run = isolated.command("doctor", "seen_late", "--rig", str(own_rig(tmp_path, outline(*corners))), cwd=tmp_path)
    assert run.returncode == 3
    assert run.stdout.splitlines()[-1] == "NO-GO: path in the lot"
    finding, text = reported(run, "path in the lot")
    assert finding == "NO-GO"
    assert "could not stop inside" in text
    assert "vve-sumo align --fit" in text


@pytest.mark.thorough
def test_a_port_that_another_program_has_is_no_go_and_no_car_is_started(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    port = tomllib.loads(rig.read_text(encoding="utf-8"))["pose"]["port"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        other.settimeout(0.0)
        run = isolated.command("doctor", "seen_late", "--rig", str(rig), cwd=tmp_path)
        with pytest.raises(BlockingIOError):
            other.recv(100)
    assert run.returncode == 3
    finding, text = reported(run, "receiver")
    assert finding == "NO-GO"
    assert "in use by another program" in text
    assert "Traceback" not in run.stderr
    kept = json.loads((tmp_path / "runs" / "doctor" / "mine.json").read_text(encoding="utf-8"))
    assert kept["verdict"] == "NO-GO"
    against = [check["name"] for check in kept["checks"] if check["finding"] == "NO-GO"]
    assert "receiver" in against
    assert run.stdout.splitlines()[-1] == f"NO-GO: {', '.join(against)}"


#: so that neither test nor survey of a real car's rig grows too old on the day that the tests run
LASTING = (("armed = true", "armed = true\nvalid_days = 3650"), ("margin_m = 1.0", "margin_m = 1.0\nvalid_days = 3650"))


def real_rig(folder: Path, channel: str, *changes: tuple[str, str]) -> Path:
    """A real car's rig whose CAN adapter is a terminal, with the simulated rig's lot."""
    text = own_rig(folder, *changes).read_text(encoding="utf-8")
    table = text.index("[car_start]")
    text = text[:table].replace('car = "simulated"', 'car = "real"').replace("automatic = true", "")
    file = folder / "real.toml"
    file.write_text(text.replace('"pty"', f'"{channel}"'), encoding="utf-8")
    return file


@pytest.mark.thorough
def test_a_speed_that_is_not_allowed_and_a_bus_and_a_receiver_that_are_not_there_are_no_go(tmp_path: Path) -> None:
    rig = real_rig(tmp_path, "/dev/nobody", *LASTING, ("speed_mps = 12.0", "speed_mps = 5.0"))
    run = isolated.command("doctor", "seen_late", "--rig", str(rig), cwd=tmp_path)
    assert run.returncode == 3
    finding, text = reported(run, "bus")
    assert finding == "NO-GO"
    assert "/dev/nobody" in text
    assert len([line for line in run.stdout.splitlines() if "/dev/nobody" in line]) == 1
    finding, text = reported(run, "fixes")
    assert finding == "NO-GO"
    assert "pose.port" in text
    assert run.stdout.splitlines()[-1] == "NO-GO: speed, watchdog record, bus, fixes, path in the lot"
    assert run.stderr == ""


def listened(rig: Path, car: LiveCar, adapter: Adapter, extra: tuple[Frame, ...] = ()) -> subprocess.CompletedProcess:
    """Run the doctor while the car goes on reporting, and demand that nobody says a word to it."""
    process = begun("doctor", "seen_late", "--rig", str(rig), cwd=rig.parent)
    due = time.monotonic()
    while process.poll() is None:
        assert adapter.receive() == [], "the doctor has sent a frame to a real car"
        if time.monotonic() >= due:
            due += 0.02
            car.advance()
            adapter.send([*car.reports(), *extra])
        time.sleep(0.002)
    out, err = process.communicate()
    return subprocess.CompletedProcess([], process.returncode, out, err)


@pytest.mark.thorough
@pytest.mark.live
def test_on_a_real_cars_bus_it_listens_and_says_nothing(tmp_path: Path) -> None:
    with Adapter() as adapter:
        run = listened(real_rig(tmp_path, adapter.name, *LASTING), LiveCar(), adapter)
    assert reported(run, "reports")[0] == "go"
    assert reported(run, "enabled") == ("go", "nothing is enabled")
    assert reported(run, "calibration")[0] == "note"
    assert run.stdout.splitlines()[-1] == "NO-GO: watchdog record, fixes, path in the lot"


@pytest.mark.thorough
@pytest.mark.live
def test_another_writer_on_our_identifiers_is_no_go(tmp_path: Path) -> None:
    command = codec.encode(codec.GearCommand(Gear.DRIVE), codec.Variant.DBW1_2024)
    with Adapter() as adapter:
        run = listened(
            real_rig(tmp_path, adapter.name, *LASTING), LiveCar(), adapter, (command, Frame(0x061, b"short"))
        )
    finding, text = reported(run, "commands")
    assert finding == "NO-GO"
    assert "0x066" in text
    assert reported(run, "understood")[0] == "NO-GO"


FIX = replace(GOOD, time=1.4e9, latitude=math.radians(40.0041), longitude=math.radians(-83.0186), heading=0.1)


def heard_from(rig: Path, **changes: float) -> list[Check]:
    """What is said of a receiver that sends this fix at 100 Hz, ten milliseconds each on its way."""
    loaded = rigs.load(rig)
    source = assembly.source_of(loaded)
    encoder = Encoder()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        sender = _Sender(out, loaded.pose.port, encoder, replace(FIX, **changes))
        try:
            heard = rig_checks.listen(loaded, _Together(source, sender), None, time.monotonic())
        finally:
            source.close()
    return list(rig_checks.pose_checks(loaded, heard))


class _Sender:
    def __init__(self, out: socket.socket, port: int, encoder: Encoder, fix: Fix) -> None:
        self._out, self._to, self._encoder, self._fix = out, ("127.0.0.1", port), encoder, fix
        self._begun, self._sent = time.monotonic(), 0

    def send(self) -> None:
        while self._sent * 0.01 <= time.monotonic() - self._begun:
            fix = replace(self._fix, time=self._fix.time + 0.01 * self._sent)
            self._out.sendto(self._encoder.encode(fix), self._to)
            self._sent += 1


class _Together:
    """The real receiver's socket, with the sender served each time that it is looked at."""

    def __init__(self, source, sender: _Sender) -> None:
        self._source, self._sender = source, sender
        self.lost = False

    def fileno(self) -> int:
        return self._source.fileno()

    def receive(self):
        self._sender.send()
        return self._source.receive()


def of(checks: list[Check], name: str) -> Check:
    return next(check for check in checks if check.name == name)


@pytest.mark.thorough
def test_what_speaks_against_a_fix_is_told_in_words(tmp_path: Path) -> None:
    rig = own_rig(tmp_path)
    good = heard_from(rig)
    assert {check.finding for check in good} <= {CheckResult.GO, CheckResult.NOTE}
    assert "declared minimum" in of(good, "age").observed
    floating = of(heard_from(rig, quality=FixQuality.RTK_FLOAT, position_sigma=0.4), "fix")
    assert floating.finding is CheckResult.NO_GO
    assert "RTK with fixed ambiguities" in floating.advice
    assert "position accuracy" in floating.advice
    assert "RTK float" in floating.observed
    assert "0.400 m" in floating.observed
    old = of(heard_from(rig, differential_age=25.0), "fix")
    assert old.finding is CheckResult.NO_GO
    assert "25.0 s old" in old.observed
    assert "corrections" in old.advice
    unlocked = heard_from(rig, locked=False)
    assert "not locked" in of(unlocked, "fix").observed
    assert of(unlocked, "fix").finding is of(unlocked, "age").finding is CheckResult.NO_GO
    assert "navigation is locked" in of(unlocked, "fix").advice
    moving = of(heard_from(rig, velocity_east=2.0, velocity_north=0.2), "standing")
    assert moving.finding is CheckResult.NO_GO


@pytest.mark.thorough
def test_a_rate_below_what_the_rig_promises_is_no_go(tmp_path: Path) -> None:
    rig = own_rig(tmp_path, ("rate_hz = 100.0", "rate_hz = 200.0"))
    assert of(heard_from(rig), "fixes").finding is CheckResult.NO_GO


def documents(rig: Path, today: datetime.date = DAY) -> dict[str, Check]:
    return {check.name: check for check in rig_checks.documents(rigs.load(rig), today)}


def test_the_messages_of_a_receiver_are_listed_and_what_is_missing_is_named() -> None:
    """At 10 fixes a second, in the 3 s in which the doctor listens; HDT comes at 2 Hz, and nothing says the date."""
    decoder = nmea_sentences.decoder()
    census = decoder.census
    for k in range(30):
        names = ["GGA", "GST", *(["HDT"] if k % 5 == 0 else []), "VTG"]
        for n, name in enumerate(names):
            census.note(name, 0.1 * k + 0.005 * n)
    check = rig_checks.message_check(decoder, 10.0)
    assert check.finding is CheckResult.NO_GO
    assert check.observed == "GGA 10/s, GST 10/s, VTG 10/s, HDT 2/s; in the order GGA GST VTG"
    decoder.counts[nmea.Outcome.READ], decoder.counts[nmea.Outcome.INCOMPLETE] = 96, 24
    assert rig_checks.message_check(decoder, 10.0).observed == f"{check.observed}; 24 incomplete"
    assert check.advice == "HDT or THS or PASHR (heading) too seldom; no RMC or ZDA (date)"
    for k in range(30):
        census.note("THS", 10.0 + 0.1 * k)
    census.note("ZDA", 10.0)
    assert rig_checks.message_check(decoder, 10.0).finding is CheckResult.GO


def test_the_papers_of_a_real_car(tmp_path: Path) -> None:
    fit = documents(real_rig(tmp_path, "/dev/ttyACM0"))
    assert fit["arming"].finding is fit["watchdog test"].finding is fit["lot"].finding is CheckResult.GO
    assert "120 days ago" in fit["watchdog test"].observed
    assert fit["calibration"].finding is CheckResult.NOTE
    untested = documents(real_rig(tmp_path, "/dev/ttyACM0", (WATCHDOG, "")))
    assert untested["arming"].finding is untested["watchdog test"].finding is CheckResult.NO_GO
    assert "--shadow" in untested["arming"].advice
    rolled = WATCHDOG.replace("armed = true", "armed = false").replace("= 2.5", "= 0.3")
    unarmed = documents(real_rig(tmp_path, "/dev/ttyACM0", (WATCHDOG, rolled)))
    assert unarmed["watchdog test"].finding is CheckResult.NOTE
    assert "driver" in unarmed["watchdog test"].advice


def test_what_a_real_car_s_rig_states_grows_old(tmp_path: Path) -> None:
    rig = real_rig(tmp_path, "/dev/ttyACM0", ("[limits]", "[calibration]\ndate = 2026-01-01\n\n[limits]"))
    year, day = datetime.date(2027, 1, 1), datetime.timedelta(days=1)
    fit = documents(rig, year)
    assert {fit[name].finding for name in ("arming", "watchdog test", "calibration", "lot")} == {CheckResult.GO}
    late = documents(rig, year + day)
    assert late["arming"].finding is late["watchdog test"].finding is CheckResult.NO_GO
    assert late["arming"].observed.startswith("watchdog_test.date: the test of 2026-01-01 was 366 days ago")
    assert "watchdog_test.valid_days allows 365" in late["watchdog test"].advice
    assert late["lot"].finding is late["calibration"].finding is CheckResult.NOTE
    assert documents(rig, datetime.date(2029, 1, 1))["lot"].finding is CheckResult.NO_GO


def test_a_simulated_vehicle_s_days_do_not_grow_old(tmp_path: Path) -> None:
    late = documents(own_rig(tmp_path), datetime.date(2099, 3, 1))
    assert {late[name].finding for name in ("arming", "watchdog test", "lot")} == {CheckResult.GO}


def test_days_to_come_are_refused_but_for_those_of_another_time_zone(tmp_path: Path) -> None:
    for rig in (own_rig(tmp_path), real_rig(tmp_path, "/dev/ttyACM0")):
        assert documents(rig, datetime.date(2025, 12, 31))["lot"].finding is CheckResult.GO
        early = documents(rig, datetime.date(2025, 12, 30))
        assert early["lot"].finding is early["watchdog test"].finding is CheckResult.NO_GO
    assert early["arming"].observed.startswith("lot.surveyed: 2026-01-01 is still to come, today is 2025-12-30")


def test_a_lot_is_told_in_square_metres(tmp_path: Path) -> None:
    corners = ((40.003, -83.020), (40.003, -83.016), (40.006, -83.016), (40.006, -83.020))
    # An ellipsoid's lengths of a degree at 40 N: 111 034 m along the meridian, 85 395 m along the parallel.
    area = 0.003 * 111_034.0 * 0.004 * 85_395.0
    found = documents(own_rig(tmp_path, outline(*corners)))["lot"].observed
    assert float(found.split()[0]) == pytest.approx(area, rel=2e-3)


def test_an_echo_is_heard_on_the_same_bus_only() -> None:
    with Bus("virtual", "echo one") as here, Bus("virtual", "echo one") as there, Bus("virtual", "echo two") as far:
        assert rig_checks.echoed(here, there).finding is CheckResult.GO
        assert rig_checks.echoed(here, far).finding is CheckResult.NO_GO
        assert rig_checks.NO_COMMAND not in layout.COMMAND_IDS


@pytest.mark.thorough
def test_what_is_named_wrongly_is_no_go_and_the_rest_is_told(tmp_path: Path) -> None:
    run = isolated.command("doctor", "no_such", "--rig", "nobody", cwd=tmp_path)
    assert run.returncode == 3
    assert run.stderr == ""
    assert "parked_car" in reported(run, "scenario")[1]
    assert "simulated" in reported(run, "rig")[1]
    assert run.stdout.splitlines()[-1] == "NO-GO: scenario, rig"
    assert reported(run, "python")[0] == "go"
    assert list(tmp_path.iterdir()) == [], "a verdict is kept on a rig and on nothing else"


@pytest.mark.thorough
def test_the_scenario_alone_is_examined_without_a_rig(tmp_path: Path) -> None:
    run = isolated.command("doctor", "seen_late", cwd=tmp_path)
    assert (run.returncode, run.stdout.splitlines()[-1]) == (0, "GO")
    assert "200 steps" in reported(run, "street")[1]
    assert "there and back" in reported(run, "network")[1]
    assert reported(run, "braking") == (
        "go",
        "car 5.9, brakes 5.9, wire 6.2, gateway 9, tyres 8.82 m/s2; least: vehicle.deceleration_limit_mps2 is 5.9; "
        "laden with 2095 kg 4.76 m/s2",
    )
    assert "receiver" not in run.stdout
    assert list(tmp_path.iterdir()) == [], "a verdict is kept on a rig and on nothing else"


def test_the_versions_asked_for_are_those_of_the_package() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = {}
    for line in project["dependencies"]:
        name, _, wanted = line.replace(">=", "==").partition("==")
        declared[name] = wanted
    assert {name: declared[name] for name in machine_checks.LIBRARIES} == machine_checks.LIBRARIES
    exact = {line.split("==")[0] for line in project["dependencies"] if "==" in line}
    assert set(machine_checks.EXACT) == exact & set(machine_checks.LIBRARIES)
    least, beyond = (tuple(map(int, bound.strip("<>=").split("."))) for bound in project["requires-python"].split(","))
    assert (least, (beyond[0], beyond[1] - 1)) == machine_checks.PYTHONS


def test_a_street_that_is_too_slow_is_no_go_and_a_held_back_one_a_note() -> None:
    load = {"refused": 0, "removed": 0}
    assert machine_checks._judged_virtual_road([0.002] * 200, True, load).finding is CheckResult.GO
    assert machine_checks._judged_virtual_road([0.002] * 190 + [0.03] * 10, False, load).finding is CheckResult.NO_GO
    held = machine_checks._judged_virtual_road([0.002] * 200, True, {"refused": 7, "removed": 5})
    assert held.finding is CheckResult.NOTE
    assert "12 vehicles" in held.observed


def test_what_the_kernel_permits_is_told_and_changes_nothing() -> None:
    before = Path("/proc/self/oom_score_adj").read_text()
    found = machine_checks._priority().observed
    assert re.search(r"oom_score_adj -1000 (not )?permitted$", found)
    assert Path("/proc/self/oom_score_adj").read_text() == before


def test_a_folder_that_takes_no_records_is_no_go() -> None:
    _room, speed = machine_checks._disk(Path("/proc/runs"))
    assert speed.finding is CheckResult.NO_GO
    assert "--out" in speed.advice


def test_a_report_says_what_is_against() -> None:
    report = CheckReport()
    report.add(
        [
            Check("one", "good"),
            Check("two", "bad", CheckResult.NO_GO, "mend it"),
            Check("three", "so", CheckResult.NOTE),
        ]
    )
    assert [check.name for check in report.against] == ["two"]
    assert "-> mend it" in report.checks[1].lines()[1]
    assert report.attempt("four", "do", lambda: align.site_of("none", "none", Path("/"))) is None
    assert report.against[-1].name == "four"
