"""The live page in a browser, fed without a drive: the stop button, and what is never shown as live."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.live.patience import until
from tests.view.feed import Live, live
from tests.view.made import Made

FEED = "document.getElementById('feed').dataset.kind"
SEATS = "vveSumo.shown.view.seats"
BOARD = f"() => {SEATS}.world.board.lines"
#: a browser that draws nothing but the headset's pictures while there is a session, as those of headsets do
NO_OTHER_PICTURES = """() => { const ask = requestAnimationFrame.bind(window);
  globalThis.requestAnimationFrame = (next) => (String(next).includes("this.draw()") ? 0 : ask(next)); }"""


@pytest.fixture
def fed(made: Made) -> Iterator[Live]:
    with live(made.drive) as one:
        yield one


@pytest.fixture
def page(browser: Any, fed: Live) -> Iterator[Any]:
    """The page, live."""
    context = browser.new_context(viewport={"width": 1000, "height": 700})
    opened = context.new_page()
    opened.goto(fed.address)
    until(lambda: says(opened, f"{FEED} === 'live'"))
    yield opened
    context.close()


def says(page: Any, condition: str) -> bool:
    return bool(page.evaluate(f"() => Boolean({condition})"))


def test_nothing_lies_over_the_button(page: Any, fed: Live) -> None:
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    page.click("#stop", timeout=5000)
    until(lambda: fed.asked > 0)


def test_it_acts_at_the_press(page: Any, fed: Live) -> None:
    place = page.locator("#stop").bounding_box()
    page.mouse.move(place["x"] + 20, place["y"] + 20)
    page.mouse.down()
    until(lambda: fed.asked > 0)


@pytest.mark.thorough
def test_an_older_browser_asks_too(page: Any, fed: Live) -> None:
    page.evaluate("() => { delete AbortSignal.timeout; }")
    page.click("#stop")
    until(lambda: fed.asked > 0)


def test_every_key_stops_whatever_is_open(page: Any, fed: Live) -> None:
    for key in (" ", "Escape", "s", "S"):
        page.keyboard.press("?")
        pressed, asked = page.evaluate("String(vveSumo.shown.pressed)"), fed.asked
        page.keyboard.press(key)
        assert page.evaluate("String(vveSumo.shown.pressed)") != pressed
        until(lambda before=asked: fed.asked > before)


def test_without_a_feed_it_asks_until_it_was_heard_after_the_last_press(page: Any, fed: Live) -> None:
    """The request on its way may have been made before the gateway came to a state that can stop."""
    fed.silent.set()
    until(lambda: says(page, f"{FEED} === 'lost'"))
    fed.busy.set()
    page.click("#stop")
    until(lambda: fed.asked == 1)
    page.keyboard.press("s")
    fed.busy.clear()
    until(lambda: fed.asked > 1)
    until(lambda: says(page, "!vveSumo.shown.asking"))
    heard = fed.asked
    page.wait_for_timeout(1500)
    assert fed.asked == heard


@pytest.mark.thorough
def test_it_asks_again_while_the_car_is_seen_to_drive_on(page: Any, fed: Live) -> None:
    page.click("#stop")
    until(lambda: fed.asked > 2)


@pytest.mark.thorough
def test_what_cannot_be_drawn_is_not_live(page: Any) -> None:
    page.evaluate("() => { vveSumo.shown.view.draw = () => { throw new Error('no canvas'); }; }")
    until(lambda: says(page, f"{FEED} === 'lost'"))
    number = page.evaluate("vveSumo.shown.waiting.n")
    until(lambda: page.evaluate("vveSumo.shown.waiting.n") > number + 5)
    assert says(page, f"{FEED} === 'lost'")


@pytest.mark.thorough
def test_events_while_the_feed_was_away_are_told(page: Any, fed: Live) -> None:
    page.evaluate("() => vveSumo.shown.socket.close()")
    fed.frames.events.append({"time": 1000.0, "kind": "note", "text": "controller: meanwhile"})
    until(lambda: "meanwhile" in page.inner_text(".events"))
    assert page.inner_text(".events").count("meanwhile") == 1


@pytest.mark.thorough
def test_the_next_drive_at_the_same_address_is_shown_anew(browser: Any, made: Made) -> None:
    """A process that was killed says no farewell; the next drive has the rig's port and token again."""
    context = browser.new_context()
    opened = context.new_page()
    with live(made.drive) as first:
        first.hub.end = lambda verdict=None: None  # type: ignore[method-assign]
        opened.goto(first.address)
        until(lambda: says(opened, f"{FEED} === 'live'"))
        port, token = first.server.port, first.token
        title = opened.title()
    until(lambda: says(opened, f"{FEED} === 'lost'"))
    with live(made.traffic, port=port, token=token):
        # The page may load itself anew while it is asked.
        with opened.expect_navigation():
            pass
        opened.wait_for_selector("html[data-ready]")
        until(lambda: says(opened, f"{FEED} === 'live'"))
        assert opened.title() != title
    context.close()


def in_a_headset(browser: Any, fed: Live) -> Any:
    """The live page in the session of an emulated headset, which the page has as `worn`."""
    device = (Path(__file__).parent / "vendor" / "iwer.min.js").read_text(encoding="utf-8")
    context = browser.new_context(viewport={"width": 600, "height": 500})
    worn = "globalThis.worn = new IWER.XRDevice(IWER.metaQuest3); worn.installRuntime({ forceInstall: true });"
    context.add_init_script(f"{device}; {worn}")
    opened = context.new_page()
    opened.goto(fed.address)
    until(lambda: says(opened, f"{FEED} === 'live'"))
    opened.click(".seats button:has-text('driver')")
    opened.click(".seats button:has-text('headset')")
    until(lambda: says(opened, f"{SEATS}.session"))
    return opened


@pytest.mark.slow
def test_a_headset_shows_the_present_or_nothing(browser: Any, fed: Live) -> None:
    opened = in_a_headset(browser, fed)
    opened.evaluate(NO_OTHER_PICTURES)
    shown = opened.evaluate(f"{SEATS}.frame.t")
    until(lambda: opened.evaluate(f"{SEATS}.frame.t") > shown + 1.0)
    assert says(opened, f"{SEATS}.world.renderer.xr.isPresenting")
    # 10 m/s and what the made-up drive's gateway says, in the unit of the page.
    speed_and_gap, state = opened.evaluate(BOARD)
    assert speed_and_gap.startswith("36 km/h   ")
    assert state == "engaged"
    fed.silent.set()
    until(lambda: says(opened, f"{SEATS}.world.hidden"))
    assert says(opened, f"{FEED} === 'lost'")
    assert opened.evaluate(BOARD)[0] == "NO LIVE DATA"
    assert says(opened, f"{SEATS}.world.board.alarm")
    # The session outlives the feed, and shows the street again with it.
    fed.silent.clear()
    until(lambda: not says(opened, f"{SEATS}.world.hidden"))
    assert says(opened, f"{SEATS}.world.renderer.xr.isPresenting")
    until(lambda: opened.evaluate(BOARD)[0].startswith("36 km/h"))
    assert not says(opened, f"{SEATS}.world.board.alarm")
    fed.silent.set()
    until(lambda: says(opened, f"{SEATS}.world.hidden"))
    opened.evaluate(f"() => {SEATS}.session.end()")
    until(lambda: says(opened, f"!{SEATS}.session && !{SEATS}.world.renderer.xr.isPresenting"))
    # The page itself hides nothing: it says that what it shows is old.
    assert not says(opened, f"{SEATS}.world.hidden || {SEATS}.world.board.mesh.visible")
    assert says(opened, f"{FEED} === 'lost'")
    opened.context.close()


@pytest.mark.slow
@pytest.mark.parametrize("how", ["grip", "trigger held", "trigger"])
def test_who_wears_the_headset_can_ask_for_a_stop(browser: Any, fed: Live, how: str) -> None:
    """A short pull of the trigger is another thing: it puts the head to the driver's eye."""
    opened = in_a_headset(browser, fed)
    shown = opened.evaluate(f"{SEATS}.frame.t")
    until(lambda: opened.evaluate(f"{SEATS}.frame.t") > shown)
    button = "squeeze" if how == "grip" else "trigger"
    opened.evaluate(f"() => worn.controllers.right.updateButtonValue('{button}', 1)")
    if how == "trigger":
        opened.wait_for_timeout(200)
        opened.evaluate(f"() => worn.controllers.right.updateButtonValue('{button}', 0)")
        opened.wait_for_timeout(1500)
        assert fed.asked == 0
    else:
        until(lambda: fed.asked > 0)
        until(lambda: "asked to stop" in opened.evaluate(BOARD)[1])
        assert says(opened, f"{SEATS}.world.board.alarm")
    opened.context.close()


VERDICT = {"outcome": "stopped", "passed": True, "failed": []}


@pytest.mark.thorough
def test_a_drive_that_is_over_stays_in_colour_with_its_verdict_and_nothing_to_stop(page: Any, fed: Live) -> None:
    fed.end(VERDICT)
    until(lambda: says(page, f"{FEED} === 'over'"))
    assert not page.locator("#stop").is_visible()
    assert "stopped, criteria passed" in page.inner_text(".state")
    page.wait_for_timeout(1000)  # without a new frame all the while
    assert not says(page, "document.querySelector('article.stale')")
    assert page.get_attribute(".state", "data-state") == "passed"


@pytest.mark.thorough
def test_the_page_follows_the_next_drive_at_its_address(page: Any, fed: Live, made: Made) -> None:
    before = page.evaluate("vveSumo.shown.drive")
    fed.end(VERDICT)
    until(lambda: says(page, f"{FEED} === 'over'"))
    until(fed.closed.is_set)
    with live(made.drive, port=fed.place[1], token=fed.token):
        with page.expect_navigation():  # the page loads itself anew
            pass
        page.wait_for_selector("html[data-ready]")
        until(lambda: says(page, f"{FEED} === 'live'"))
        assert page.evaluate("vveSumo.shown.drive") != before
        assert page.locator("#stop").is_visible()
