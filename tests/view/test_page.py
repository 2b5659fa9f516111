"""The page of records and sweeps in a real browser."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from tests.exhaustive import with_slow
from tests.live.patience import until
from tests.report.made import CODE
from tests.report.test_page import CONTRAST, DESK, LOOKS, PHONE, READABLE, TARGET, contrast
from tests.view.conftest import holds, serving
from tests.view.made import Made
from vve_sumo.view.library import Library
from vve_sumo.view.notebook import ShownPage
from vve_sumo.view.server import PageServer, replay_server

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


@pytest.mark.parametrize(
    ("scheme", "size"),
    with_slow([("light", PHONE), ("dark", DESK), ("light", DESK)], lambda one: one == ("light", PHONE)),
)
def test_the_page_can_be_read(browser: Any, replay: PageServer, scheme: str, size: dict[str, int]) -> None:
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


def test_frames_in_the_page_are_the_records(browser: Any, made: Made, replay: PageServer) -> None:
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


@pytest.mark.thorough
def test_time_goes_by_keys_buttons_events_and_by_itself(browser: Any, made: Made, replay: PageServer) -> None:
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


@pytest.mark.slow
def test_two_records_run_in_step(browser: Any, made: Made) -> None:
    with serving(replay_server([made.drive, made.traffic])) as server, opened(browser, server.address) as page:
        page.evaluate("vveSumo.shown.seek(9.0)")
        frames = page.evaluate("vveSumo.shown.views.map(({ frame }) => [frame.t, frame.ego.x])")
        for (time, x), record in zip(frames, (made.drive, made.traffic), strict=True):
            table = ticks(record)
            assert time == pytest.approx(9.0, abs=0.021)
            assert x == pytest.approx(table["true_x_m"][table["time_s"].index(time)], abs=5e-4)
        assert page.locator("article.drive").count() == 2


@pytest.mark.thorough
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


@pytest.mark.thorough
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


@pytest.mark.thorough
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


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_an_old_scan_is_not_shown(browser: Any, replay: PageServer) -> None:
    with opened(browser, replay.address) as page:
        page.evaluate("vveSumo.shown.seek(18.2)")
        pictures = page.evaluate("""() => { const [view] = vveSumo.shown.views;
          const { frame } = view, [reading] = frame.sensed;
          const drawn = (made) => { view.street.draw(made); return view.street.canvas.toDataURL(); };
          const nothing = { x: [], y: [], seen: [], measured: null, unseen: { id: [], why: [] } };
          return [frame, { ...frame, sensed: [{ ...reading, measured: frame.t - 2 }] },
            { ...frame, sensed: [nothing] }].map(drawn); }""")
        fresh, old, none = pictures
        assert fresh != none
        assert old == none


#: of every strip: the room beside its upright axis and what its widest label needs there, both in pixels, and its span
AXES = """() => vveSumo.shown.views.flatMap(view => view.strips.plots.map(plot => {
  const axis = plot.axes[1], context = document.createElement('canvas').getContext('2d');
  context.font = '14px system-ui, sans-serif';
  const widest = Math.max(...axis._values.map(text => context.measureText(text).width));
  return [axis._size, widest + axis.gap, plot.scales.y.max - plot.scales.y.min]; }))"""


@pytest.mark.thorough
def test_strips_have_room_for_their_labels_and_a_least_span(browser: Any, replay: PageServer) -> None:
    with opened(browser, replay.address) as page:
        until(lambda: holds(page, "vveSumo.shown.records[0].frames.details !== null"))
        # A car that keeps its speed but for noise, as strips of a live drive take it.
        page.evaluate("""() => { const { strips } = vveSumo.shown.views[0];
          strips.data = null;
          for (let k = 0; k < 150; k += 1) strips.add({ t: k / 10, gap: null,
            ego: { speed: 11.244 + 0.003 * (k % 2), acceleration: 0.04 * (k % 2), wished: 0 } }); }""")
        strips = page.evaluate(AXES)
        assert len(strips) == 3
        assert all(room >= needed for room, needed, _span in strips)
        assert all(span >= least for (_room, _needed, span), least in zip(strips, (10.0, 2.0, 10.0), strict=True))
        # Labels with many digits, such as those of a gap of kilometres, have room too.
        page.evaluate("""() => { const { strips } = vveSumo.shown.views[0];
          strips.data[2][1] = strips.data[2][1].map((_, k) => 123456 + 9 * k);
          strips.build(null); strips.plots[2].setScale('x', { min: 0, max: 15 }); }""")
        until(lambda: holds(page, "vveSumo.shown.views[0].strips.plots[2].axes[1]._size > 42"))
        assert all(room >= needed for room, needed, _span in page.evaluate(AXES))


@pytest.mark.thorough
def test_what_is_still_computed_does_not_look_like_a_free_road(browser: Any, replay: PageServer) -> None:
    gauge = "[...document.querySelectorAll('.gauge')].find(one => one.innerText.startsWith('gap ahead')).innerText"
    with opened(browser, replay.address) as page:
        until(lambda: holds(page, "vveSumo.shown.records[0].frames.details !== null"))
        said = page.evaluate(f"""() => {{ const [view] = vveSumo.shown.views, frame = {{ ...view.frame, gap: null }};
          return ['coming', 'failed', 'there'].map((detailed) => {{ view.show({{ ...frame, detailed }});
            return {gauge}; }}); }}""")
        assert [text.split("\n")[-1] for text in said] == ["computing …", "could not be computed", "nothing ahead"]


@pytest.mark.thorough
def test_two_records_have_their_names_their_gauges_and_their_ends(
    browser: Any, made: Made, tmp_path: Path, copied: Callable[[Path, Path], None]
) -> None:
    copied(made.drive, tmp_path / "before" / "run")
    copied(made.traffic, tmp_path / "after" / "run")
    folders = [tmp_path / "before" / "run", tmp_path / "after" / "run"]
    ends = [ticks(folder)["time_s"][-1] for folder in folders]
    assert ends[0] != ends[1]
    first = int(ends[0] > ends[1])  # of the two to end
    with serving(replay_server(folders)) as server, opened(browser, server.address) as page:
        assert page.locator("article h2").all_inner_texts() == ["before/run", "after/run"]
        assert all(one.is_visible() for one in page.locator(".gauge:not([hidden])").all())
        state = page.locator("article .state")
        page.evaluate(f"vveSumo.shown.seek({min(ends) - 0.5})")
        assert [one for one in state.all_inner_texts() if one.startswith("OVER")] == []
        page.evaluate(f"vveSumo.shown.seek({min(ends) + 0.5})")
        assert [text.startswith("OVER") for text in state.all_inner_texts()] == [number == first for number in (0, 1)]
        page.evaluate("vveSumo.shown.seek(0)")
        assert [one for one in state.all_inner_texts() if one.startswith("OVER")] == []


@pytest.mark.thorough
def test_a_drive_that_failed_says_at_its_end_what_it_failed(browser: Any, made: Made, tmp_path: Path) -> None:
    verdict = Library([made.drive]).record("0").scene()["verdict"]  # type: ignore[union-attr]
    assert verdict == {"outcome": "stopped", "passed": True, "failed": []}
    with serving(replay_server([made.drive])) as server, opened(browser, server.address) as page:
        page.evaluate("vveSumo.shown.seek(1e9)")
        assert "stopped, criteria passed" in page.inner_text(".state")
        assert page.get_attribute(".state", "data-state") == "passed"
        page.evaluate("""() => { vveSumo.shown.records[0].scene.verdict =
          { outcome: 'timeout', passed: false, failed: ['stop_gap_m is none'] }; vveSumo.shown.seek(1e9); }""")
        assert "FAILED: stop_gap_m is none" in page.inner_text(".state")
        assert page.get_attribute(".state", "data-state") == "failed"


@pytest.mark.thorough
def test_speeds_are_shown_in_miles_an_hour_on_request_and_from_then_on(browser: Any, replay: PageServer) -> None:
    with opened(browser, replay.address) as page:
        page.evaluate("vveSumo.shown.seek(18.2)")
        speed = float(page.evaluate("vveSumo.shown.views[0].frame.ego.speed"))
        first = page.locator(".gauge").first
        assert first.inner_text().split()[1:] == [f"{3.6 * speed:.1f}", "km/h"]
        page.keyboard.press("u")
        assert first.inner_text().split()[1:] == [f"{speed / 0.44704:.1f}", "mph"]
        assert "[mph]" in page.inner_text(".strips")
        drawn = page.evaluate("vveSumo.shown.views[0].strips.data[0][1][0]")
        assert drawn == pytest.approx(page.evaluate("vveSumo.shown.records[0].frames.columns.speed[0]") / 0.44704)
        page.reload()
        page.wait_for_selector("html[data-ready]")
        page.evaluate("vveSumo.shown.seek(18.2)")
        assert first.inner_text().split()[1:] == [f"{speed / 0.44704:.1f}", "mph"]


@pytest.mark.thorough
def test_the_page_in_a_notebooks_cell_needs_no_server(browser: Any, made: Made, tmp_path: Path) -> None:
    cell = tmp_path / "cell.html"
    cell.write_text(f"<!doctype html><meta charset='utf-8'>{ShownPage(made.drive)._repr_html_()}", encoding="utf-8")
    context = browser.new_context(viewport=DESK)
    page = context.new_page()
    page.goto(cell.as_uri())
    inside = page.frame_locator("iframe")
    inside.locator("html[data-ready]").wait_for()
    assert inside.locator("h1").inner_text() == Library([made.drive]).record("0").scene()["title"]  # type: ignore[union-attr]
    assert inside.locator(".gauge").count() > 5
    context.close()
