"""Samples for the page come through the way between two processes as they were: compared field by field, bit by bit."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tests.bits import bits
from tests.view.feed import sample
from vve_sumo.live.view_feed import MAX_ROWS
from vve_sumo.messages import MalformedMessage
from vve_sumo.values import CommandedPath, FallbackPath, FixQuality, Point, Pose
from vve_sumo.view.sample import PersonMark, ReadingView, ViewSample, decode, encode

NUMBERS = st.floats()
TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
SOME = st.tuples(NUMBERS, NUMBERS)
POSES = st.builds(Pose, point=st.sampled_from(Point), **{n: NUMBERS for n in Pose.__annotations__ if n != "point"})
#: columns as the recorder takes them: arrays of any kind of number, or lists of texts and numbers
COLUMNS = st.one_of(
    arrays.arrays(st.sampled_from("?bilfd"), st.integers(0, 20)),
    st.lists(st.one_of(TEXTS, NUMBERS, st.integers(-9, 9))),
)
READINGS = st.dictionaries(TEXTS, st.builds(ReadingView, NUMBERS, st.lists(COLUMNS, max_size=3).map(tuple)), max_size=3)
CHANGES = st.fixed_dictionaries(
    {
        "pose": st.none() | POSES,
        "s": NUMBERS,
        "status_age": NUMBERS,
        "note": TEXTS,
        "fallback_path": st.none() | st.builds(FallbackPath, NUMBERS, SOME),
        "commanded_path": st.none() | st.builds(CommandedPath, SOME, SOME, SOME),
        "faults": st.lists(TEXTS, max_size=3).map(tuple),
        "details": st.dictionaries(TEXTS, TEXTS, max_size=3),
        "quality": st.sampled_from(FixQuality),
        "signals": st.dictionaries(TEXTS, TEXTS, max_size=3),
        "people": st.lists(st.builds(PersonMark, TEXTS, TEXTS, *[NUMBERS] * 7), max_size=3).map(tuple),
        "readings": READINGS,
        "outcome": st.none() | TEXTS,
    }
)


@given(CHANGES, st.integers(0, 2**40), st.integers(0, 30))
def test_every_field_comes_through(changes: dict[str, Any], tick: int, count: int) -> None:
    sent = dataclasses.replace(sample(tick, count), **changes)
    assert bits(decode(encode(sent))) == bits(sent)


def test_the_longest_reading_and_an_empty_one_come_through() -> None:
    full = ReadingView(math.nan, (np.linspace(0.0, 1.0, MAX_ROWS), [f"sedan.{row}" for row in range(MAX_ROWS)]))
    empty = ReadingView(math.inf, (np.zeros(0), []))
    sent = dataclasses.replace(sample(1, 1000), readings={"radar": full, "lidar": empty, "none": ReadingView(0.0, ())})
    assert bits(decode(encode(sent))) == bits(sent)


@pytest.mark.parametrize("at", [0, 5, 200, -1])
def test_a_damaged_sample_is_none(at: int) -> None:
    data = bytearray(encode(sample(3)))
    data[at] ^= 1
    assert isinstance(decode(bytes(data)), MalformedMessage)
    assert isinstance(decode(bytes(data[:at])), MalformedMessage)
    assert isinstance(decode(encode(sample(3))), ViewSample)
