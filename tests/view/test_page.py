"""The page of records and sweeps in a real browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.live.patience import until
from tests.report.made import CODE
from tests.report.test_page import CONTRAST, DESK, LOOKS, PHONE, READABLE, TARGET, contrast
from tests.view.conftest import serving
from tests.view.made import Made
from vve_sumo.view.library import Library
from vve_sumo.view.server import Server, replay_server

HEIGHTS = """() => [...document.querySelectorAll('button, select, input')].filter(
  one => one.checkVisibility() && !one.closest('.events')).map(one => one.getBoundingClientRect().height)"""
#: the canvas of the street: how many different colours it shows, on a grid
COLOURS = """() => { const canvas = document.querySelector('.street canvas'), found = new Set();
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  for (let at = 0; at < data.length; at += 4 * 37) found.add(data.slice(at, at + 3).join());
  return found.size; }"""


@contextmanager
def opened(browser: Any, address: str, **options: Any) -> Iterator[Any]:
    """Open a page; it may say nothing on the console and ask for nothing but what its server has."""
    said: list[str] = []
    asked: list[str] = []
    context = browser.new_context(**({"viewport": DESK} | options))
    page = context.new_page()
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(address)
    page.wait_for_selector("html[data-ready]")
    yield page
    own = address.split("#", maxsplit=1)[0].rsplit("/", 1)[0]
    assert said == []
    assert [one for one in asked if not one.startswith((own, "data:"))] == []
    context.close()


def ticks(record: Path) -> dict[str, list[Any]]:
    return dict(pq.read_table(record / "ticks.parquet").to_pydict())


@pytest.mark.parametrize(("scheme", "size"), [("light", PHONE), ("dark", DESK), ("light", DESK)])
def test_the_page_can_be_read(browser: Any, replay: Server, scheme: str, size: dict[str, int]) -> None:
    with opened(browser, replay.address, viewport=size, color_scheme=scheme) as page:
        page.evaluate("vveSumo.shown.seek(18.2)")
        looks = page.evaluate(LOOKS)
        assert len(looks) > 30
        assert min(height for _ink, _paper, height in looks) >= READABLE
        assert min(contrast(ink, paper) for ink, paper, _height in looks) >= CONTRAST
        assert page.evaluate("document.scrollingElement.scrollWidth") <= size["width"]
        assert min(page.evaluate(HEIGHTS)) >= TARGET
        # Ground, road, marks, path, radar, cars, returns and the ego at least.
        assert page.evaluate(COLOURS) >= 8
        assert page.locator(".strips canvas").count() == 3


def test_frames_in_the_page_are_the_records(browser: Any, made: Made, replay: Server) -> None:
    table = ticks(made.traffic)
    actors = pq.read_table(made.traffic / "actors.parquet").to_pylist()
    with opened(browser, replay.address) as page:
        until(lambda: bool(page.evaluate("vveSumo.shown.records[0].frames.details !== null")))
        for k in (0, 37, 400, len(table["tick"]) - 1):
            frame = page.evaluate(f"vveSumo.shown.records[0].frames.frame({k})")
            assert frame["t"] == table["time_s"][k]
            assert frame["state"] == table["state"][k]
            assert frame["ego"]["x"] == pytest.approx(table["true_x_m"][k], abs=5e-4)
            assert frame["ego"]["steering"] == pytest.approx(
                table["measured_steering_rad"][k] if k else table["steering_rad"][k], abs=1e-6
            )
            here = {row["actor"]: row for row in actors if row["tick"] == table["tick"][k]}
            assert set(frame["actors"]["id"]) == set(here)
            for name, y in zip(frame["actors"]["id"], frame["actors"]["y"], strict=True):
                assert y == pytest.approx(here[name]["y_m"], abs=5e-4)


def test_time_goes_by_keys_buttons_events_and_by_itself(browser: Any, made: Made, replay: Server) -> None:
    times = ticks(made.traffic)["time_s"]

    def shown(page: Any) -> float:
        return float(page.evaluate("vveSumo.shown.views[0].frame.t"))

    with opened(browser, replay.address) as page:
        page.keyboard.press("End")
        assert shown(page) == times[-1]
        page.keyboard.press("ArrowLeft")
        assert shown(page) == times[-2]
        page.keyboard.press("Home")
        page.get_by_label("one tick on").click()
        assert shown(page) == times[1]
        page.get_by_text("controller: emergency").click()
        assert page.locator(".gauge", has_text="controller").inner_text().endswith("emergency")
        at = shown(page)
        page.keyboard.press("p")
        assert shown(page) < at
        box = page.locator(".timeline").bounding_box()
        page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 5)
        assert shown(page) == pytest.approx(0.5 * (times[0] + times[-1]), abs=0.2)
        page.evaluate("document.activeElement.blur()")
        before = shown(page)
        page.keyboard.press("]")
        page.keyboard.press("Space")
        until(lambda: shown(page) > before + 1.0)
        page.keyboard.press("Space")
        stopped = shown(page)
        page.wait_for_timeout(100)
        assert shown(page) == stopped


def test_two_records_run_in_step(browser: Any, made: Made) -> None:
    with serving(replay_server([made.drive, made.traffic])) as server, opened(browser, server.address) as page:
        page.evaluate("vveSumo.shown.seek(9.0)")
        frames = page.evaluate("vveSumo.shown.views.map(({ frame }) => [frame.t, frame.ego.x])")
        for (time, x), record in zip(frames, (made.drive, made.traffic), strict=True):
            table = ticks(record)
            assert time == pytest.approx(9.0, abs=0.021)
            assert x == pytest.approx(table["true_x_m"][table["time_s"].index(time)], abs=5e-4)
        assert page.locator("article.drive").count() == 2


def test_a_sweep_sorts_filters_plots(browser: Any, made: Made) -> None:
    rows = Library([made.sweep]).sweep
    assert rows is not None
    frame = rows.rows()
    with serving(replay_server([made.sweep])) as server, opened(browser, server.address) as page:
        parameter = rows.parameters[0]
        column = list(frame).index(parameter)

        def shown() -> list[str]:
            return list(page.locator(f"tbody tr:not(.spacer) td:nth-child({column + 1})").all_inner_texts())

        assert page.get_by_role("status").first.inner_text() == f"{len(frame)} of {len(frame)} runs"
        head = page.locator("th").nth(column).locator("button")
        head.click()
        ascending = [float(text) for text in shown()]
        assert ascending == sorted(frame[parameter].tolist())[: len(ascending)]
        head.click()
        assert [float(text) for text in shown()] == sorted(frame[parameter].tolist(), reverse=True)[: len(ascending)]
        limit = float(frame[parameter].median())
        page.get_by_label("filter").fill(f"{parameter} < {limit}")
        expected = int((frame[parameter] < limit).sum())
        assert page.get_by_role("status").first.inner_text() == f"{expected} of {len(frame)} runs"
        assert max(float(text) for text in shown()) < limit
        page.locator("tbody tr:not(.spacer)").first.click()
        assert page.locator("tr.chosen").count() == 1
        assert page.get_by_role("button", name="open run").is_disabled()


def test_a_kept_run_opens(browser: Any, made: Made, tmp_path: Path, copied: Callable[[Path, Path], None]) -> None:
    folder = tmp_path / "sweep"
    copied(made.sweep, folder)
    key = Library([made.sweep]).sweep.rows()["key"][0]  # type: ignore[union-attr]
    copied(made.drive, folder / "records" / key)
    with serving(replay_server([folder])) as server, opened(browser, server.address) as page:
        page.get_by_label("filter").fill(f"key = {key}")
        page.locator("tbody tr:not(.spacer)").first.click()
        page.get_by_role("button", name="open run").click()
        page.wait_for_selector("article.drive")
        assert page.evaluate("vveSumo.shown.records[0].frames.count") == len(ticks(made.drive)["tick"])


@pytest.mark.parametrize("kind", ["traffic", "sweep", "hostile"])
def test_one_file_needs_no_server(browser: Any, made: Made, tmp_path: Path, kind: str) -> None:
    file = tmp_path / "page.html"
    file.write_text(Library([getattr(made, kind)]).page(), encoding="utf-8")
    with opened(browser, file.as_uri()) as page:
        if kind == "sweep":
            assert page.locator("tbody tr:not(.spacer)").count() > 10
        else:
            page.keyboard.press("End")
            assert page.evaluate("vveSumo.shown.views[0].frame.t") == ticks(getattr(made, kind))["time_s"][-1]
        if kind == "hostile":
            assert page.inner_text("h1") == CODE
            assert page.evaluate("window.hit") is None


def test_a_record_that_is_spoilt_says_so_on_the_page(
    browser: Any, made: Made, tmp_path: Path, copied: Callable[[Path, Path], None]
) -> None:
    copied(made.drive, tmp_path / "torn")
    with serving(replay_server([tmp_path / "torn"])) as server:
        (tmp_path / "torn" / "actors.parquet").write_bytes(b"PAR1")
        context = browser.new_context()
        page = context.new_page()
        page.goto(server.address)
        page.wait_for_selector(".message")
        assert "actors.parquet: cannot be read" in page.inner_text(".message")
        context.close()


def test_an_old_scan_is_not_shown(browser: Any, replay: Server) -> None:
    with opened(browser, replay.address) as page:
        page.evaluate("vveSumo.shown.seek(18.2)")
        pictures = page.evaluate("""() => { const [view] = vveSumo.shown.views, { frame } = view, { returns } = frame;
          const drawn = (made) => { view.street.draw(made); return view.street.canvas.toDataURL(); };
          const nothing = { x: [], y: [], seen: [], measured: null }, unseen = { id: [], why: [] };
          return [frame, { ...frame, returns: { ...returns, measured: frame.t - 2 } },
            { ...frame, returns: nothing, unseen }].map(drawn); }""")
        fresh, old, none = pictures
        assert fresh != none
        assert old == none
