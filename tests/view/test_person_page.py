"""A person's page: in a real browser with a position of our choosing, and by hand with what no page of ours says."""

from __future__ import annotations

import http.client
import json
import math
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from tests.live.patience import until
from tests.view.certificates import certificate_in
from tests.view.persons import ANNA, BOB, Served, served
from vve_sumo.people.consent import TEXT, digest
from vve_sumo.people.person_view import PersonView, ShownBody, ShownCar
from vve_sumo.people.reports import FieldEntered, PageAlive, PersonStop, PositionReport

HERE = {"latitude": 40.0065, "longitude": -83.019, "accuracy": 4.5}


def seen(**changes: Any) -> PersonView:
    """What a person is shown who is well."""
    car = ShownCar(ShownBody("car", 20.0, 0.0, 3.1, 4.9, 1.9), 8.0, 17.4, 2.2)
    view = PersonView("anna", "area", 5.2, 0.8, 61.0, "", (), 1.0, 2.0, 0.1, car, (ShownBody("bus", 9, 9, 0, 12, 2.5),))
    return PersonView(**{name: getattr(view, name) for name in view.__struct_fields__} | changes)


@pytest.fixture
def pages() -> Iterator[Served]:
    with served(ANNA) as one:
        yield one


@pytest.fixture
def phone(browser: Any, pages: Served) -> Iterator[Any]:
    """A page whose person has agreed, at a place."""
    context = browser.new_context(geolocation=HERE, permissions=["geolocation"], viewport={"width": 400, "height": 800})
    page = context.new_page()
    page.goto(pages.server.address)
    until(lambda: page.locator("#enter").is_enabled())
    assert pages.reports == [], "nothing is said before the person agrees"
    assert page.inner_text("#consent").split() == TEXT.split()
    page.click("#enter")
    until(lambda: len(pages.of(PositionReport)) > 0)
    yield page
    context.close()


@pytest.mark.thorough
def test_the_phones_position_comes_with_its_accuracy_and_its_age(phone: Any, pages: Served) -> None:
    received, report = next(one for one in list(pages.reports) if isinstance(one[1], PositionReport))
    assert math.degrees(report.latitude) == pytest.approx(40.0065, abs=1e-9)
    assert math.degrees(report.longitude) == pytest.approx(-83.019, abs=1e-9)
    assert report.accuracy == 4.5
    assert report.measured <= received
    phone.context.set_geolocation(HERE | {"latitude": 40.0066})
    begun = pages.clock()
    until(lambda: any(math.degrees(one.latitude) > 40.00655 for one in pages.of(PositionReport)))
    moved = next(one for one in pages.of(PositionReport) if math.degrees(one.latitude) > 40.00655)
    assert begun - 1.0 < moved.measured <= pages.clock()


@pytest.mark.thorough
def test_the_acknowledgement_names_the_text_and_signs_of_life_follow(phone: Any, pages: Served) -> None:
    assert pages.of(FieldEntered) == [FieldEntered("anna", digest(TEXT))]
    until(lambda: len(pages.of(PageAlive)) >= 4)
    times = [received for received, report in pages.reports if isinstance(report, PageAlive)]
    assert max(b - a for a, b in pairwise(times)) < 2.0


@pytest.mark.thorough
def test_the_stop_button_asks_until_it_is_heard(phone: Any, pages: Served) -> None:
    pages.pages.show("engaged", [seen()])
    phone.click("#stop")
    until(lambda: len(pages.of(PersonStop)) >= 2)
    pages.pages.show("stopping", [seen(faults=("person_stop",))])
    until(lambda: "asked for a stop" in phone.inner_text("#presence"))
    time.sleep(1.2)
    heard = len(pages.of(PersonStop))
    time.sleep(1.2)
    assert len(pages.of(PersonStop)) == heard


def test_the_stop_button_acts_at_the_press_and_does_not_move(phone: Any, pages: Served) -> None:
    button = phone.locator("#stop")
    button.wait_for()  # until it is shown it has no place
    place = button.bounding_box()
    assert place["y"] + place["height"] <= 800
    pages.pages.show("engaged", [seen(faults=("person_near_lot", "person_lost", "person_unreachable"))])
    until(lambda: "this page was not heard" in phone.inner_text("#why"))
    assert button.bounding_box() == place
    phone.mouse.move(place["x"] + 20, place["y"] + 20)
    phone.mouse.down()
    until(lambda: len(pages.of(PersonStop)) > 0)
    phone.mouse.up()
    # It is heard; then the next drive begins, with the same page.
    pages.pages.show("stopping", [seen(faults=("person_stop",))])
    time.sleep(1.5)
    pages.pages.show("engaged", [seen()])
    time.sleep(0.5)
    heard = len(pages.of(PersonStop))
    phone.click("#stop")
    until(lambda: len(pages.of(PersonStop)) > heard)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("view", "kind", "words"),
    [
        (seen(), "good", "as an area"),
        (seen(presence="exact"), "good", "You are in the street"),
        (seen(presence="warning"), "warn", "stand still"),
        (seen(presence="gone", faults=("person_lost",)), "bad", "not in the street"),
        (seen(faults=("person_near_lot",)), "bad", "in the street"),
    ],
)
def test_what_the_person_is_told(phone: Any, pages: Served, view: PersonView, kind: str, words: str) -> None:
    pages.pages.show("engaged", [view])
    until(lambda: words in phone.inner_text("#presence"))
    assert phone.get_attribute("#presence", "data-kind") == kind
    assert "17 m away, here in 2 s" in phone.inner_text("#car")
    assert "at least 61 m" in phone.inner_text("#numbers")
    assert ("go away from it" in phone.inner_text("#why")) == ("person_near_lot" in view.faults)


@pytest.mark.thorough
def test_a_page_that_is_not_heard_any_more_says_so(phone: Any, pages: Served) -> None:
    pages.pages.show("engaged", [seen()])
    until(lambda: phone.get_attribute("#presence", "data-kind") == "good")
    pages.server.close()
    until(lambda: "Not connected" in phone.inner_text("#presence"))
    assert phone.get_attribute("#presence", "data-kind") == "bad"


@pytest.mark.thorough
def test_gps_that_is_lost_is_said_and_nothing_more_comes(phone: Any, pages: Served) -> None:
    phone.context.new_cdp_session(phone).send("Emulation.setGeolocationOverride")
    until(lambda: "no position" in phone.inner_text("#why"))
    count = len(pages.of(PositionReport))
    time.sleep(2.5)
    assert len(pages.of(PositionReport)) == count
    assert len(pages.of(PageAlive)) > 2


@pytest.mark.thorough
def test_a_page_that_is_killed_says_nothing_more(phone: Any, pages: Served) -> None:
    phone.close()
    time.sleep(0.5)
    count = len(pages.reports)
    time.sleep(1.5)
    assert len(pages.reports) == count


def test_a_hidden_page_gives_no_sign_of_life(phone: Any, pages: Served) -> None:
    """A browser says so of a page behind another one, or of a phone whose screen is off."""
    phone.evaluate("() => Object.defineProperty(document, 'hidden', { get: () => true, configurable: true })")
    time.sleep(0.5)
    count = len(pages.of(PageAlive))
    time.sleep(2.0)
    assert len(pages.of(PageAlive)) == count
    phone.evaluate("() => delete document.hidden")
    until(lambda: len(pages.of(PageAlive)) > count)


def test_a_second_phone_of_one_person_is_told_so_but_may_stop_and_takes_over(
    browser: Any, phone: Any, pages: Served
) -> None:
    context = browser.new_context(geolocation=HERE | {"accuracy": 7.0}, permissions=["geolocation"])
    second = context.new_page()
    second.goto(pages.server.address)
    second.click("#enter")
    until(lambda: "another phone says" in second.inner_text("#why"))
    assert not any(one.accuracy == 7.0 for one in pages.of(PositionReport))
    second.click("#stop")
    until(lambda: len(pages.of(PersonStop)) > 0)
    phone.close()
    pages.pages.show("engaged", [seen()])
    until(lambda: "another phone says" not in second.inner_text("#why"))
    context.set_geolocation(HERE | {"accuracy": 8.0})
    until(lambda: any(one.accuracy == 8.0 for one in pages.of(PositionReport)))
    context.close()


def test_a_phone_in_the_field_speaks_over_https(browser: Any, tmp_path: Path) -> None:
    """A browser gives a position to a page of another machine over HTTPS only."""
    with served(ANNA, certificate=certificate_in(tmp_path)) as pages:
        assert pages.server.address.startswith("https://")
        context = browser.new_context(geolocation=HERE, permissions=["geolocation"], ignore_https_errors=True)
        page = context.new_page()
        page.goto(pages.server.address)
        page.click("#enter")
        until(lambda: len(pages.of(PositionReport)) > 0)
        assert page.evaluate("() => isSecureContext && location.protocol === 'https:'")
        context.close()


# By hand.


def open_socket(pages: Served, **options: Any) -> ClientConnection:
    address = pages.server.address.replace("http:", "ws:") + "socket"
    return connect(address, open_timeout=10, **options)


def say(socket: ClientConnection, **message: Any) -> None:
    socket.send(json.dumps({"person": "anna", "echo": 1} | message))


def dropped(pages: Served, speak: Callable[[ClientConnection], None]) -> bool:
    """Whether the server ends a connection on which this is said."""
    with open_socket(pages) as socket:
        json.loads(socket.recv(timeout=10))
        json.loads(socket.recv(timeout=10))
        speak(socket)
        try:
            for _ in range(30):
                socket.recv(timeout=10)
        except ConnectionClosed:
            return True
        return False


POSITION = {
    "type": "position", "timestamp": 1000, "sent": 1000, "latitude": 40.0, "longitude": -83.0, "accuracy": 4.0,
    "heading": None, "compass": None,
}  # fmt: skip
ENTERED = {"type": "entered", "consent": digest(TEXT)}


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize(
    "messages",
    [
        ["nonsense"],
        [POSITION],
        [{"type": "alive"}],
        [{"type": "stop", "person": "nobody"}],
        [ENTERED | {"consent": "0" * 64}],
        [ENTERED | {"person": "nobody"}],
        [ENTERED, POSITION | {"latitude": 91.0}],
        [ENTERED, {"type": "setpoint", "acceleration": 2.0}],
        [ENTERED, *[{"type": "alive"}] * 40],
    ],
    ids=["text", "not_agreed", "alive", "nobodys_stop", "other_text", "nobody", "no_place", "setpoint", "flood"],
)
def test_what_no_page_says_ends_the_connection(pages: Served, messages: list[Any]) -> None:
    def speak(socket: ClientConnection) -> None:
        for message in messages:
            if isinstance(message, str):
                socket.send(message)
            else:
                say(socket, **message)

    assert dropped(pages, speak)
    assert pages.of(PositionReport) == []
    assert pages.of(PersonStop) == []


def test_without_the_token_nobody_speaks(pages: Served) -> None:
    with pytest.raises(Exception, match=r"403"):
        connect(f"ws://127.0.0.1:{pages.server.port}/wrong/socket", open_timeout=10)
    with pytest.raises(Exception, match=r"403"):
        open_socket(pages, origin="http://elsewhere.example")


def test_the_request_to_stop_without_a_token_is_the_other_pages_alone(pages: Served) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", pages.server.port, timeout=10.0)
    connection.request("POST", "/stop", headers={"Host": f"127.0.0.1:{pages.server.port}"})
    assert connection.getresponse().status in (404, 405)
    connection.close()
    assert pages.reports == []


def test_a_long_message_ends_the_connection(pages: Served) -> None:
    assert dropped(pages, lambda socket: socket.send("x" * 600))


def test_one_person_is_one_phone() -> None:
    with served(ANNA, BOB) as pages, open_socket(pages) as first, open_socket(pages) as second:
        for socket in (first, second):
            assert json.loads(socket.recv(timeout=10))["type"] == "hello"
        say(first, **ENTERED)
        until(lambda: len(pages.of(FieldEntered)) == 1)
        say(second, **ENTERED)
        until(lambda: json.loads(second.recv(timeout=10))["type"] == "taken")
        say(second, **ENTERED | {"person": "bob"})
        until(lambda: len(pages.of(FieldEntered)) == 2)
        assert pages.of(FieldEntered)[1].person == "bob"
        first.close()
        with open_socket(pages) as third:
            until(lambda: "anna" not in pages.pages._held)
            say(third, **ENTERED)
            until(lambda: len(pages.of(FieldEntered)) == 3)


def test_the_page_of_somebody_with_a_receiver_reports_no_position() -> None:
    with served(BOB) as pages, open_socket(pages) as socket:
        assert json.loads(socket.recv(timeout=10))["people"] == [{"id": "bob", "kind": "bicycle", "phone": False}]
        number = json.loads(socket.recv(timeout=10))["n"]
        say(socket, **ENTERED | {"person": "bob"})
        say(socket, **POSITION | {"person": "bob", "echo": number})
        say(socket, type="alive", person="bob", echo=number)
        until(lambda: len(pages.of(PageAlive)) == 1)
        assert pages.of(PositionReport) == []
