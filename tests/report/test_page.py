"""The report's page in a real browser, and what its writing leaves alone."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from tests.drive.street import altered
from tests.isolated import REPOSITORY, command, isolated
from tests.sweep.test_dataset import PLAN, content
from vve_sumo.drive.verify import altered_parts
from vve_sumo.errors import ConfigError
from vve_sumo.report import write_report
from vve_sumo.sweep.dataset import Dataset
from vve_sumo.sweep.job import Result
from vve_sumo.sweep.run_specs import RunSpec

PHONE, DESK = {"width": 360, "height": 800}, {"width": 1280, "height": 900}
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
#: what a user may call things
CODE = "</title><script>window.hit=1</script><img src=x onerror='window.hit=1'>\"&amp; $\\frac{$ \u202e _x_"
HOSTILE = f"{CODE}\ud800"  #: with half a character, which JSON holds
#: WCAG 2.2, 1.4.3, of text that is not large
CONTRAST = 4.5
READABLE = 14.0  #: least size of letters [CSS dots]
TARGET = 32.0  #: least height of what a finger is to meet [CSS dots]
DRAWN = 300  #: until what was unfolded is drawn [ms]

UNFOLD = "document.querySelectorAll('details').forEach(one => { one.open = true; })"
#: of every text that is shown: its colour, what lies behind it, its size; of plots the size is that of the plot
LOOKS = """() => {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), looks = [];
  while (walker.nextNode()) {
    if (!walker.currentNode.data.trim()) continue;
    const element = walker.currentNode.parentElement, style = getComputedStyle(element);
    if (!element.checkVisibility() || element.closest('option')) continue;
    const plot = element.closest('svg');
    // Text upon a map of colours, which are the same in both schemes.
    if (plot && element.getAttribute('class').startsWith('f')) continue;
    let behind = element;
    while (behind && getComputedStyle(behind).backgroundColor === 'rgba(0, 0, 0, 0)') behind = behind.parentElement;
    const paper = getComputedStyle(behind || document.body).backgroundColor;
    looks.push(plot ? [style.fill, paper, 99] : [style.color, paper, parseFloat(style.fontSize)]);
  }
  return looks;
}"""
PLOTS = """() => [...document.querySelectorAll('svg.plot')].map(
  one => [one.getBoundingClientRect().width, one.querySelectorAll('path').length, one.getAttribute('aria-label')])"""
HEADINGS = "() => [...document.querySelectorAll('h1,h2,h3,h4')].map(one => Number(one.tagName[1]))"
HEIGHTS = "() => [...document.querySelectorAll('summary, button, select')].filter(one => one.checkVisibility()).map(one => one.getBoundingClientRect().height)"


class Folders(NamedTuple):
    drive: Path
    killed: Path
    sweep: Path
    hostile: Path


def drive(folder: str) -> None:
    """Drive to a car that is parked near the start; call it through `isolated`."""
    from vve_sumo.drive import run as drives

    drives.run(altered({"obstacles.0.at_m": 60.0, "road.demand": []}), Path(folder), REPOSITORY)


def cut_short(record: Path, folder: Path) -> Path:
    """Leave of a record what a kill does: tables that are streams still, and no summary."""
    folder.mkdir()
    for name in ("scenario.json", "pose.bin", "can.log"):
        shutil.copy(record / name, folder)
    for name in ("ticks", "readings", "sensor_radar", "actors"):
        table = pq.read_table(record / f"{name}.parquet")
        with pa.OSFile(str(folder / f"{name}.arrows"), "wb") as file, pa.ipc.new_stream(file, table.schema) as stream:
            stream.write_table(table.slice(0, table.num_rows // 2))
    return folder


def spoiled(record: Path, folder: Path) -> Path:
    """Write into a copy of a record what nobody should call anything."""
    shutil.copytree(record, folder)
    told = json.loads((folder / "scenario.json").read_text(encoding="utf-8"))
    told["settings"] |= {"title": CODE, "description": HOSTILE}
    told["settings"]["obstacles"][0]["id"] = HOSTILE
    told["settings"]["controller"]["name"] = HOSTILE
    (folder / "scenario.json").write_text(json.dumps(told), encoding="utf-8")
    ended = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    ended |= {"outcome": "broken", "text": HOSTILE, "passed": False, "failed": [HOSTILE]}
    (folder / "summary.json").write_text(json.dumps(ended), encoding="utf-8")
    return folder


def runs() -> Iterator[tuple[RunSpec, Result]]:
    for number in range(36):
        speed, gap = float(number % 6), float(number // 6)
        hit = speed > gap + 2.0
        figures: dict[str, Any] = {"outcome": "contact" if hit else "stopped", "passed": not hit, "collision": hit}
        figures |= {"failed": CODE if hit else "", "stop_gap_m": None if hit else 1.0 + gap, "min_gap_m": gap - 1.0}
        figures |= {"impact_speed_mps": speed if hit else 0.0, "meets_stop_gap_m": not hit, "min_ttc_s": 1.0 + gap}
        figures |= {"stop_onset_speed_mps": speed + 5.0, "stop_distance_m": 10.0 + speed, "stop_bound_m": 12.0}
        figures |= {"stop_demand_mps2": 5.0, "stop_reaction_s": 0.1, "record_sha256": "0"}
        fault = "crashed: SIGSEGV <b>" if number == 5 else ""
        values = {"ego.speed_mps": speed, "gap": gap}
        yield RunSpec(number, f"{number:016x}", values, 1), Result("", {} if fault else figures, fault)


def swept(folder: Path) -> Path:
    table = {"title": CODE, "description": CODE, "criteria": {"stop_gap_m": {"min": 1.0}}}
    table |= {"road": {"network": "linden"}, "parameters": {"gap": {"sets": ["a.b_m"], "meaning": CODE}}}
    kinds: dict[str, Any] = {"ego.speed_mps": "float", "gap": "float"}
    spec = {"title": "a sweep", "scenario": "s", "parameters": {"ego.speed_mps": [0.0, 5.0], "gap": [0.0, 5.0]}}
    dataset = Dataset(folder, replace(PLAN, spec=spec, table=table, cells=36, parameters=kinds), resume=True)
    for cell, result in runs():
        if not dataset.holds(cell.number):
            dataset.add(cell, result)
    dataset.close()
    return folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Folders:
    above = tmp_path_factory.mktemp("reports")
    isolated(drive, str(above / "drive"))
    told = Folders(
        above / "drive",
        cut_short(above / "drive", above / "killed"),
        swept(above / "sweep"),
        spoiled(above / "drive", above / "hostile"),
    )
    for folder in told:
        write_report(folder)
    return told


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api", reason="the page's test needs playwright")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"no browser is installed: looked for {', '.join(BROWSERS)}")
    with api.sync_playwright() as play:
        chromium = play.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield chromium
        chromium.close()


def luminance(colour: str) -> float:
    """Relative luminance of WCAG 2.2 of an opaque colour as CSS computes it."""
    parts = [float(part) / 255.0 for part in re.findall(r"[\d.]+", colour)]
    assert len(parts) == 3, f"not opaque: {colour}"
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_contrast_is_that_of_the_standard() -> None:
    assert contrast("rgb(0, 0, 0)", "rgb(255, 255, 255)") == pytest.approx(21.0)
    assert contrast("rgb(118, 118, 118)", "rgb(255, 255, 255)") == pytest.approx(4.54, abs=0.005)


@pytest.mark.parametrize("kind", Folders._fields)
def test_the_page_stands_in_a_browser(folders: Folders, browser: Any, kind: str) -> None:
    """On a phone, in a light and a dark room, without a word from the console and without asking for anything."""
    address = (getattr(folders, kind) / "report.html").as_uri()
    said: list[str] = []
    asked: list[str] = []
    for scheme, size in (("light", PHONE), ("dark", DESK)):
        context = browser.new_context(viewport=size, color_scheme=scheme)
        page = context.new_page()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: asked.append(request.url.split(",")[0]))
        page.goto(address)
        page.evaluate(UNFOLD)
        page.wait_for_timeout(DRAWN)
        looks = page.evaluate(LOOKS)
        assert len(looks) > 100
        assert min(size for _ink, _paper, size in looks) >= READABLE
        assert min(contrast(ink, paper) for ink, paper, _size in looks) >= CONTRAST, scheme
        # With everything unfolded, too.
        assert page.evaluate("document.scrollingElement.scrollWidth") <= size["width"]
        assert min(page.evaluate(HEIGHTS)) >= TARGET
        plots, headings = page.evaluate(PLOTS), page.evaluate(HEADINGS)
        assert len(plots) >= 3
        assert all(width > 300.0 and paths > 10 and alt for width, paths, alt in plots)
        assert page.locator(".chart canvas").count() == (1 if kind == "sweep" else len(page.query_selector_all(".panel")))
        assert headings[0] == 1
        assert headings.count(1) == 1
        assert all(below <= above + 1 for above, below in pairwise(headings))
        assert page.evaluate("[window.hit, document.documentElement.lang]") == [None, "en"]
        context.close()
    assert said == []
    assert {one for one in asked if not one.startswith("data:")} == {address}


def test_names_that_are_code_are_text(folders: Folders, browser: Any) -> None:
    page = browser.new_page()
    page.goto((folders.hostile / "report.html").as_uri())
    shown = CODE.replace("\u202e", "\ufffd")
    assert page.inner_text("h1") == shown
    assert page.title() == f"altered: {shown}"
    page.close()


@pytest.mark.parametrize(
    ("kind", "verdict", "sentence"),
    [
        ("drive", "passed", r"The car came to rest 4\.\d\d m before parked_car\."),
        ("killed", "broken off", r"The record ends after \d+\.\d\d s, with the car at \d+\.\d\d m/s"),
        ("sweep", "explored", r"30 of 35 judged runs passed \(85\.7 %\), 5 failed; 1 more ended with a fault\."),
        (
            "hostile",
            "altered",
            r"(?s)Changed since the drive: summary\.json, scenario\.json\. .*The simulation broke after",
        ),
    ],
)
def test_the_top_line_says_what_happened(folders: Folders, kind: str, verdict: str, sentence: str) -> None:
    page = (getattr(folders, kind) / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    top = page.partition("</header>")[0]
    assert f"<strong>{verdict}</strong>" in top
    assert re.search(sentence, top), top[-600:]


def test_the_worst_run_comes_first_with_the_line_that_drives_it_again(folders: Folders) -> None:
    page = (folders.sweep / "report.html").read_text(encoding="utf-8")
    failed = page.partition("Failed runs</h2>")[2]
    # Of speed 5 against gap 0 there is a fault; the hardest impact that is known is 5 m/s at gap 1.
    assert f"vve-sumo sweep --rerun sweep {11:016x}" in failed
    assert re.findall(r"<code>(\w{16})</code>", failed)[0] == f"{11:016x}"


def test_a_record_and_a_dataset_do_not_mind_their_report(folders: Folders) -> None:
    before = content(folders.sweep)
    swept(folders.sweep)  # goes on with it
    assert content(folders.sweep) == before
    assert altered_parts(folders.drive) == []
    replayed = command("replay", str(folders.drive), cwd=folders.drive.parent)
    assert (replayed.returncode, replayed.stderr) == (0, "")
    assert replayed.stdout.endswith("every setpoint and every frame is the same\n")


def test_the_same_record_has_the_same_report(folders: Folders) -> None:
    before = content(folders.killed)
    said = command("report", "killed", cwd=folders.killed.parent)
    assert said.returncode == 0, said.stderr
    assert said.stdout.startswith("broken off: The record ends after ")
    assert said.stdout.endswith("report: killed/report.html\n")
    assert content(folders.killed) == before
    assert [name for name in before if name.endswith(".png")] == sorted(
        f"report/{name}.png" for name in ("drive_overview", "gap_against_speed", "safety_over_time")
    )


@pytest.mark.parametrize("torn", ["absent", "empty", "ticks.parquet", "scenario.json"])
def test_what_cannot_be_read_is_one_line_and_nothing_is_written(folders: Folders, tmp_path: Path, torn: str) -> None:
    folder = tmp_path / "record"
    if torn == "empty":
        folder.mkdir()
    elif torn != "absent":
        shutil.copytree(folders.drive, folder, ignore=shutil.ignore_patterns("report*"))
        (folder / torn).write_bytes((folder / torn).read_bytes()[:100])
    before = content(folder)
    with pytest.raises(ConfigError) as refused:
        write_report(folder)
    assert "record" in str(refused.value)
    assert "\n" not in str(refused.value)
    assert content(folder) == before
