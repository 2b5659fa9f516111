"""What a page in a browser says: by W3C's definitions, and nothing else."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.people.geolocation import PageMessage, PagePosition, read, report_of
from vve_sumo.people.reports import FieldEntered, PageAlive, PersonStop, PositionReport

POSITION = {
    "type": "position",
    "person": "anna",
    "echo": 7,
    "timestamp": 1_700_000_000_000,
    "sent": 1_700_000_000_300,
    "latitude": 40.0,
    "longitude": -83.0,
    "accuracy": 4.5,
    "heading": None,
    "compass": None,
}
CONSENT = "ab" * 32


def sent_at(number: int) -> float:
    """The server's messages went out every tenth of a second from drive time 10 s on."""
    return 10.0 + 0.1 * number if number <= 20 else math.nan


def said(**changes: Any) -> PageMessage:
    message = read(json.dumps(POSITION | changes))
    assert message is not None
    return message


def test_a_position_is_dated_by_the_servers_message_that_the_page_had() -> None:
    """The page had message 7 of 10.7 s, and the position was 0.3 s old when it was sent: not before 10.4 s."""
    made = report_of(said(), 10.95, sent_at)
    assert made == PositionReport(
        "anna", pytest.approx(10.4), math.radians(40.0), math.radians(-83.0), 4.5, made.heading
    )
    assert math.isnan(made.heading)


def test_a_network_that_holds_a_position_back_cannot_make_it_young() -> None:
    made = report_of(said(echo=7), 15.7, sent_at)
    assert isinstance(made, PositionReport)
    assert 15.7 - made.measured == pytest.approx(5.3)


def test_a_sign_of_life_that_the_network_held_back_is_none() -> None:
    """The page had message 7 of 10.7 s when it gave it."""
    sign = read(json.dumps({"type": "alive", "person": "anna", "echo": 7}))
    assert sign is not None
    assert report_of(sign, 11.6, sent_at) == PageAlive("anna")
    assert report_of(sign, 11.8, sent_at) is None


def test_a_position_that_the_phone_kept_is_as_old_as_it_says() -> None:
    made = report_of(said(sent=POSITION["timestamp"] + 5000), 10.8, sent_at)
    assert isinstance(made, PositionReport)
    assert made.measured == pytest.approx(10.7 - 5.0)


def test_a_page_that_says_that_it_has_what_was_not_sent_is_not_believed() -> None:
    assert report_of(said(echo=21), 10.8, sent_at) is None
    assert report_of(said(type="position", echo=21), 10.8, sent_at) is None


def test_a_position_dated_after_it_was_sent_is_of_a_clock_that_was_set() -> None:
    assert report_of(said(sent=POSITION["timestamp"] - 101), 10.8, sent_at) is None
    made = report_of(said(sent=POSITION["timestamp"] - 99), 10.8, sent_at)
    assert isinstance(made, PositionReport)
    assert made.measured == pytest.approx(10.7)


@pytest.mark.parametrize(
    ("degrees", "radians"), [(0.0, math.pi / 2), (90.0, 0.0), (180.0, -math.pi / 2), (270.0, math.pi)]
)
def test_a_heading_is_clockwise_from_north(degrees: float, radians: float) -> None:
    by_motion = report_of(said(heading=degrees), 10.8, sent_at)
    by_compass = report_of(said(heading=45.0, compass=degrees), 10.8, sent_at)
    for made in (by_motion, by_compass):
        assert isinstance(made, PositionReport)
        assert math.cos(made.heading) == pytest.approx(math.cos(radians), abs=1e-12)
        assert math.sin(made.heading) == pytest.approx(math.sin(radians), abs=1e-12)


def test_the_other_messages() -> None:
    entered = read(json.dumps({"type": "entered", "person": "anna", "echo": 0, "consent": CONSENT}))
    stop = read(json.dumps({"type": "stop", "person": "anna", "echo": 0}))
    alive = read(json.dumps({"type": "alive", "person": "anna", "echo": 3}))
    assert entered is not None
    assert report_of(entered, 1.0, sent_at) == FieldEntered("anna", CONSENT)
    assert stop is not None
    assert report_of(stop, 1.0, lambda _: math.nan) == PersonStop("anna"), "a stop needs no date"
    assert alive is not None
    assert report_of(alive, 10.5, sent_at) == PageAlive("anna")
    assert report_of(alive, 10.5, lambda _: math.nan) is None


@pytest.mark.parametrize(
    "changes",
    [
        {"latitude": 90.1}, {"latitude": "40"}, {"latitude": None}, {"longitude": 181.0}, {"accuracy": -1.0},
        {"accuracy": None}, {"timestamp": -1}, {"timestamp": 1e15}, {"person": ""}, {"person": "a" * 65}, {"echo": -1},
        {"echo": 1.5}, {"heading": 400.0}, {"extra": 1}, {"type": "setpoint"}, {"type": None}, {"latitude": True},
    ],
)  # fmt: skip
def test_what_no_browser_says_is_no_message(changes: dict[str, Any]) -> None:
    assert read(json.dumps(POSITION | changes)) is None


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_what_is_no_number_is_no_message(number: str) -> None:
    for key in ("latitude", "longitude", "accuracy", "timestamp", "sent"):
        text = json.dumps(POSITION | {key: 12345}).replace("12345", number)
        assert read(text) is None


@given(st.one_of(st.text(), st.binary(), st.recursive(st.none() | st.floats() | st.text(), st.lists).map(json.dumps)))
def test_no_text_raises(text: str | bytes) -> None:
    message = read(text)
    assert message is None or not isinstance(message, PagePosition)
