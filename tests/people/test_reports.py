"""Datagrams of reports: what goes in comes out, bit for bit, and no bytes raise."""

from __future__ import annotations

import math
import struct

from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.messages import MalformedMessage
from vve_sumo.people.reports import FieldEntered, PageAlive, PersonStop, PositionReport, decode, encode

NAMES = st.text("abcXYZ019_-", min_size=1, max_size=64)
NUMBERS = st.floats(allow_nan=True, allow_infinity=True)
POSITIONS = st.builds(PositionReport, NAMES, NUMBERS, NUMBERS, NUMBERS, NUMBERS, NUMBERS)
OTHERS = st.one_of(
    st.builds(FieldEntered, NAMES, st.text("0123456789abcdef", min_size=64, max_size=64)),
    st.builds(PageAlive, NAMES),
    st.builds(PersonStop, NAMES),
)


def bits(report: PositionReport) -> tuple[object, ...]:
    numbers = (report.measured, report.latitude, report.longitude, report.accuracy, report.heading)
    return (report.person, *(struct.pack("<d", number) for number in numbers))


@given(POSITIONS)
def test_a_position_comes_back_bit_for_bit(report: PositionReport) -> None:
    came = decode(encode(report))
    assert isinstance(came, PositionReport)
    assert bits(came) == bits(report)


@given(OTHERS)
def test_the_others_come_back(report: FieldEntered | PageAlive | PersonStop) -> None:
    assert decode(encode(report)) == report


@given(st.binary(max_size=200))
def test_no_bytes_raise(data: bytes) -> None:
    assert isinstance(decode(data), MalformedMessage)


@given(POSITIONS, st.data())
def test_a_damaged_datagram_is_none(report: PositionReport, data: st.DataObject) -> None:
    whole = encode(report)
    at = data.draw(st.integers(0, len(whole) - 1))
    damaged = whole[:at] + bytes([whole[at] ^ data.draw(st.integers(1, 255))]) + whole[at + 1 :]
    assert isinstance(decode(damaged), MalformedMessage)


def test_the_heading_of_somebody_who_says_none_is_unknown() -> None:
    assert math.isnan(PositionReport("anna", 0.0, 0.0, 0.0, 1.0).heading)
