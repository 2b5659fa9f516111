"""What a reader does with the page: points, presses keys, zooms, prints, reads it on a phone or without scripts."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.report.made import Folders, runs

PHONE = {"width": 360, "height": 800}
DRAWN = 300  #: until what was unfolded is drawn [ms]
OUT = "#chart output"
#: whether what is folded is shown nonetheless
SHOWN = "document.querySelector('#provenance pre').checkVisibility()"


@pytest.fixture
def opened(browser: Any) -> Iterator[Any]:
    """Opens a report and returns its page; nothing may be said on the console until the test ends."""
    said: list[str] = []
    contexts = []

    def open_page(folder: Path, **context: Any) -> Any:
        contexts.append(browser.new_context(**context))
        page = contexts[-1].new_page()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.goto((folder / "report.html").as_uri())
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert said == []


def unfolded(page: Any, part: str) -> dict[str, float]:
    """Unfold the part that holds the chart, as a reader does, and return where its first panel is."""
    page.click(f"#{part} > summary")
    page.wait_for_selector("#chart canvas")
    page.wait_for_timeout(DRAWN)
    panel = page.locator("#chart .u-over").first
    panel.scroll_into_view_if_needed()
    box: dict[str, float] = panel.bounding_box()
    return box


def number(text: str, words: str) -> float:
    found = re.search(rf"{words}\s*(-?[\d.]+(?:e-\d+)?)", text.replace("\u00a0", " "))
    assert found is not None, text
    return float(found[1])


@pytest.mark.thorough
def test_the_curves_show_the_records_values_where_the_reader_points(folders: Folders, opened: Any) -> None:
    page = opened(folders.drive)
    box = unfolded(page, "curves")
    page.mouse.move(box["x"] + 0.4 * box["width"], box["y"] + 0.5 * box["height"])
    text = page.inner_text(OUT)
    ticks = pq.read_table(folders.drive / "ticks.parquet", columns=["time_s", "true_speed_mps"])
    times = ticks["time_s"].to_pylist()
    time = number(text, "^")
    assert time == pytest.approx(0.4 * times[-1], abs=0.03 * times[-1])
    speed = ticks["true_speed_mps"][round((time - times[0]) / (times[1] - times[0]))].as_py()
    assert number(text, "speed") == pytest.approx(speed, abs=0.0006)
    assert text.endswith("ahead: parked_car")


@pytest.mark.thorough
def test_the_curves_are_reached_and_read_with_the_keyboard_alone(folders: Folders, opened: Any) -> None:
    page = opened(folders.drive)
    focused = "document.activeElement.closest('#curves > summary') !== null"
    for _ in range(100):
        page.keyboard.press("Tab")
        if page.evaluate(focused):
            break
    page.keyboard.press("Enter")
    page.wait_for_selector("#chart canvas")
    page.keyboard.press("Tab")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    first, step = pq.read_table(folders.drive / "ticks.parquet", columns=["time_s"])["time_s"].to_pylist()[:2]
    assert number(page.inner_text(OUT), "^") == pytest.approx(first + 10 * (step - first))


@pytest.mark.thorough
def test_dragging_zooms_every_panel_and_escape_shows_all_again(folders: Folders, opened: Any) -> None:
    page = opened(folders.drive)
    box = unfolded(page, "curves")
    last = page.locator("#chart .u-over").last

    def earliest() -> float:
        """The time at the left edge, by what the last panel says there."""
        last.scroll_into_view_if_needed()
        place = last.bounding_box()
        page.mouse.move(place["x"] + 1, place["y"] + 20)
        return number(page.inner_text(OUT), "^")

    end = pq.read_table(folders.drive / "ticks.parquet", columns=["time_s"])["time_s"].to_pylist()[-1]
    assert earliest() < 0.01 * end
    panel = page.locator("#chart .u-over").first
    panel.scroll_into_view_if_needed()
    box = panel.bounding_box()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + 25, steps=4)
    page.mouse.up()
    assert earliest() == pytest.approx(0.5 * end, rel=0.03)
    page.focus("#chart [role=group]")
    page.keyboard.press("Escape")
    assert earliest() < 0.01 * end


@pytest.mark.thorough
def test_a_run_is_named_where_the_reader_points_and_with_keys(folders: Folders, opened: Any) -> None:
    page = opened(folders.sweep, viewport=PHONE, has_touch=True)
    box = unfolded(page, "runs")
    results = {spec.key: (spec, result) for spec, result in runs()}

    def agrees(text: str) -> None:
        spec, result = results[text.partition(",")[0].removeprefix("run ")]
        assert number(text, "ego speed") == spec.values["ego.speed_mps"]
        assert f"{result.figures['outcome']}" in text
        assert number(text, "minimum TTC") == result.figures["min_ttc_s"]

    page.touchscreen.tap(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    agrees(page.inner_text(OUT))
    # In the lowest left corner there is the run with the least speed and the least gap.
    page.touchscreen.tap(box["x"] + 2, box["y"] + box["height"] - 2)
    lowest = page.inner_text(OUT)
    assert (number(lowest, "ego speed"), number(lowest, "gap at rest")) == (0.0, 1.0)
    page.focus("#chart [role=group]")
    page.keyboard.press("ArrowRight")
    agrees(page.inner_text(OUT))
    page.select_option("#chart select >> nth=0", label="impact speed [m/s]")
    page.keyboard.press("Tab")
    page.focus("#chart [role=group]")
    for _ in range(3):
        page.keyboard.press("Shift+ArrowRight")
    agrees(page.inner_text(OUT))


@pytest.mark.thorough
def test_a_run_that_has_no_gap_because_it_collided_is_on_the_plot_too(folders: Folders, opened: Any) -> None:
    page = opened(folders.sweep)
    unfolded(page, "runs")
    page.focus("#chart [role=group]")
    seen = set()
    for _ in range(36):
        page.keyboard.press("ArrowRight")
        seen.add(page.inner_text(OUT).partition(",")[0].removeprefix("run "))
    assert seen == {spec.key for spec, _result in runs()}
    assert any(result.figures.get("collision") for spec, result in runs() if spec.key in seen)


@pytest.mark.thorough
def test_on_a_phone_what_is_wider_scrolls_and_says_so(folders: Folders, opened: Any) -> None:
    page = opened(folders.drive, viewport=PHONE)
    wide = page.evaluate("""() => [...document.querySelectorAll('.paper')].filter(one => one.checkVisibility()).map(
      one => [one.scrollWidth > one.clientWidth, one.parentElement.querySelector('.hint').checkVisibility()])""")
    assert wide
    assert all(both == [True, True] for both in wide)
    page.evaluate("document.querySelectorAll('details.part').forEach(one => { one.open = true; })")
    page.wait_for_timeout(DRAWN)
    cues = page.evaluate("""() => [...document.querySelectorAll('.scroll')].filter(one => one.checkVisibility()).map(
      one => [one.scrollWidth > one.clientWidth + 1, getComputedStyle(one, '::before').content.includes('scroll')])""")
    assert {wide for wide, _said in cues} == {True, False}
    assert all(wide == said for wide, said in cues)


@pytest.mark.thorough
def test_on_a_desktop_verdict_figures_and_picture_are_on_one_screen(folders: Folders, opened: Any) -> None:
    page = opened(folders.drive, viewport={"width": 1280, "height": 900})
    for part in (".verdict", ".figures > div:nth-child(5)", ".first svg.plot"):
        box = page.locator(part).bounding_box()
        assert box["y"] + box["height"] <= 900, part


@pytest.mark.thorough
@pytest.mark.parametrize("scripts", [True, False])
def test_on_paper_all_is_unfolded_and_dark_on_white(folders: Folders, opened: Any, scripts: bool) -> None:
    page = opened(folders.sweep, color_scheme="dark", java_script_enabled=scripts)
    assert not page.evaluate(SHOWN)
    page.emulate_media(media="print")
    assert page.evaluate(SHOWN)
    looks = "one => [getComputedStyle(one).color, getComputedStyle(one).backgroundColor]"
    assert page.eval_on_selector("body", looks) == ["rgb(27, 27, 27)", "rgb(255, 255, 255)"]
    ink = "() => getComputedStyle(document.querySelector('svg.plot text')).fill"
    assert page.evaluate(ink) == "rgb(27, 27, 27)"
    assert len(page.pdf()) > 10_000


@pytest.mark.thorough
def test_without_scripts_nothing_but_the_chart_is_missing(folders: Folders, opened: Any) -> None:
    page = opened(folders.sweep, java_script_enabled=False)
    page.click("#runs > summary")
    assert not page.locator("#chart").is_visible()
    assert "needs scripts" in page.inner_text("#runs noscript")
    page.click(".figures summary >> nth=0")
    assert "overlapped" in page.inner_text(".figures")  # the word is explained


def test_a_script_that_is_not_the_pages_own_does_not_run(folders: Folders, browser: Any) -> None:
    page = browser.new_page()
    page.goto((folders.sweep / "report.html").as_uri())
    page.evaluate("""() => {
      document.body.appendChild(document.createElement('script')).textContent = 'window.hit = 1';
      document.body.insertAdjacentHTML('beforeend', '<img src="data:," onerror="window.hit = 1">');
    }""")
    page.wait_for_timeout(DRAWN)
    assert page.evaluate("window.hit") is None
    page.close()
