"""The report's page in a real browser, and what its writing leaves alone."""

from __future__ import annotations

import re
import shutil
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from tests.isolated import command
from tests.report.made import CODE, Folders, swept
from tests.sweep.test_dataset import content
from vve_sumo.drive.verify import altered_parts
from vve_sumo.errors import ConfigError
from vve_sumo.report import write_report

PHONE, DESK = {"width": 360, "height": 800}, {"width": 1280, "height": 900}
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
HEIGHTS = """() => [...document.querySelectorAll('summary, button, select')].filter(
  one => one.checkVisibility()).map(one => one.getBoundingClientRect().height)"""


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


@pytest.mark.thorough(witnesses=1)
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
        assert page.locator(".chart canvas").count() == (
            1 if kind == "sweep" else len(page.query_selector_all(".panel"))
        )
        assert headings[0] == 1
        assert headings.count(1) == 1
        assert all(below <= above + 1 for above, below in pairwise(headings))
        assert page.evaluate("[window.hit, document.documentElement.lang]") == [None, "en"]
        context.close()
    assert said == []
    assert {one for one in asked if not one.startswith("data:")} == {address}


@pytest.mark.thorough
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
        (
            "sweep",
            "explored",
            r"30 of 35 judged runs met the criteria \(85\.7 %\), 5 did not; 1 more ended with an error\.",
        ),
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


@pytest.mark.thorough
def test_a_record_and_a_dataset_do_not_mind_their_report(folders: Folders) -> None:
    before = content(folders.sweep)
    swept(folders.sweep)  # goes on with it
    assert content(folders.sweep) == before
    assert altered_parts(folders.drive) == []
    replayed = command("replay", str(folders.drive), cwd=folders.drive.parent)
    assert (replayed.returncode, replayed.stderr) == (0, "")
    assert replayed.stdout.endswith("every setpoint and every frame is the same\n")


@pytest.mark.thorough
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
