"""The page's street seen in three dimensions: by button, key and finger, in step with the replay."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from tests.view.made import Made
from vve_sumo.view.library import Library
from vve_sumo.view.server import PageServer

SEATS = "vveSumo.shown.views[0].seats"
POSE = f"{SEATS}.world.cameraPose()"


@pytest.fixture
def page(browser: Any, replay: PageServer) -> Iterator[Any]:
    """The page of a record; nothing may be said on its console, and nothing asked of another server."""
    said: list[str] = []
    asked: list[str] = []
    context = browser.new_context(viewport={"width": 900, "height": 640})
    opened = context.new_page()
    opened.on("console", lambda message: said.append(message.text))
    opened.on("pageerror", lambda error: said.append(str(error)))
    opened.on("request", lambda request: asked.append(request.url))
    opened.goto(replay.address)
    opened.wait_for_selector("html[data-ready]")
    yield opened
    context.close()
    assert said == []
    assert all(url.startswith((replay.address, "data:")) for url in asked)


def seated(page: Any, seat: str) -> None:
    page.wait_for_selector(".street.space")
    assert page.evaluate(f"{SEATS}.seat") == seat


@pytest.mark.thorough
def test_the_third_dimension_is_loaded_when_somebody_asks_for_it(page: Any) -> None:
    loaded = "performance.getEntriesByType('resource').some(({ name }) => name.endsWith('world.min.js'))"
    assert page.evaluate(loaded) is False
    page.click(".seats button:has-text('driver')")
    seated(page, "driver")
    assert page.evaluate(loaded) is True
    assert page.locator("canvas.world").is_visible()
    assert page.locator(".seats [aria-pressed=true]").inner_text() == "driver"
    page.click(".seats button:has-text('map')")
    assert not page.locator("canvas.world").is_visible()


@pytest.mark.slow
def test_the_key_goes_round_the_seats(page: Any) -> None:
    for seat in ("driver", "chase", "above"):
        page.keyboard.press("v")
        seated(page, seat)
    page.keyboard.press("v")
    assert page.evaluate(f"{SEATS}.inSpace") is False


@pytest.mark.thorough
def test_the_camera_goes_along_with_the_replay(page: Any) -> None:
    page.click(".seats button:has-text('driver')")
    seated(page, "driver")
    for time in (4.0, 9.0):
        page.evaluate(f"vveSumo.shown.seek({time})")
        pose, ego = page.evaluate(f"[{POSE}.car, vveSumo.shown.views[0].frame.ego]")
        assert math.dist((pose["x"], pose["y"]), (ego["x"], ego["y"])) < 0.01
        assert abs(math.remainder(pose["heading"] - ego["heading"], 2.0 * math.pi)) < math.radians(0.1)


@pytest.mark.slow
def test_a_drag_turns_the_head_and_a_double_click_turns_it_back(page: Any) -> None:
    page.click(".seats button:has-text('driver')")
    seated(page, "driver")
    ahead = page.evaluate(POSE)
    box = page.locator("canvas.world").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 100, y, steps=4)
    page.mouse.up()
    turned = page.evaluate(POSE)
    assert turned["heading"] - ahead["heading"] == pytest.approx(0.5, abs=0.02)
    assert turned["car"] == ahead["car"]
    page.mouse.dblclick(x, y)
    assert page.evaluate(POSE)["heading"] == pytest.approx(ahead["heading"], abs=1e-9)


def test_a_page_that_is_one_file_has_the_map_alone(browser: Any, made: Made, tmp_path: Any) -> None:
    file = tmp_path / "drive.html"
    file.write_text(Library([made.drive]).page(), encoding="utf-8")
    context = browser.new_context()
    opened = context.new_page()
    opened.goto(file.as_uri())
    opened.wait_for_selector("html[data-ready]")
    assert opened.locator(".seats").count() == 0
    opened.keyboard.press("v")
    assert opened.evaluate(f"{SEATS}.inSpace") is False
    context.close()
