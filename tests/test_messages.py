"""The encoding of messages: arrays and numbers of NumPy come back, and nothing else is taken for one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from vve_sumo.messages import MalformedMessage, MessageCodec, MessageKind


@dataclass(frozen=True, slots=True)
class Scan:
    """A message with an array, as the drive's own have."""

    time: float
    range: NDArray[np.float64]


CODEC = MessageCodec[Scan](MessageKind.OUTPUTS, Scan)
ANYTHING = MessageCodec[Any](MessageKind.VIEW, Any)


@given(st.floats(), arrays.arrays(st.sampled_from("?bBhHiIlLqQefd"), st.integers(0, 20)))
def test_an_array_comes_back_bit_for_bit_with_its_kind_of_number(time, array):
    back = ANYTHING.decode(ANYTHING.encode([time, array]))
    assert back[1].dtype == array.dtype
    assert back[1].tobytes() == array.tobytes()


def test_an_array_of_texts_or_of_two_dimensions_comes_back_as_lists():
    back = ANYTHING.decode(
        ANYTHING.encode([np.array(["a", "bc"]), np.arange(4).reshape(2, 2), np.arange(2, dtype=">i4")])
    )
    assert back == [["a", "bc"], [[0, 1], [2, 3]], [0, 1]]


def test_numbers_of_numpy_come_back_as_pythons():
    back = ANYTHING.decode(ANYTHING.encode([np.float64(0.1), np.int8(-3), np.bool_(True)]))
    assert back == [0.1, -3, True]
    assert [type(one) for one in back] == [float, int, bool]


def test_a_message_comes_back_as_its_class():
    back = CODEC.decode(CODEC.encode(Scan(1.5, np.array([2.0, 3.0]))))
    assert isinstance(back, Scan)
    assert (back.time, back.range.tolist()) == (1.5, [2.0, 3.0])


@pytest.mark.parametrize(
    "content",
    [
        {"time": 1.5},
        {"time": "1.5", "range": np.zeros(1)},
        {"time": 1.5, "range": [2.0]},
        {"time": 1.5, "range": b"\0" * 8},
        {"time": 1.5, "range": msgspec.msgpack.Ext(2, b"d" + bytes(8))},
        {"time": 1.5, "range": msgspec.msgpack.Ext(1, b"O" + bytes(8))},
        {"time": 1.5, "range": msgspec.msgpack.Ext(1, b"d" + bytes(7))},
        {"time": 1.5, "range": msgspec.msgpack.Ext(1, b"")},
    ],
    ids=["missing", "text for a number", "a list", "bare bytes", "other extension", "objects", "cut number", "nothing"],
)
def test_content_of_another_kind_is_malformed(content):
    data = MessageCodec[Any](MessageKind.OUTPUTS, Any).encode(content)
    assert CODEC.decode(data) == MalformedMessage("wrong_content")


class Place(NamedTuple):
    """A part of a message."""

    name: str
    x: float


class Word(msgspec.Struct, tag=True):
    """A message with texts at every depth."""

    text: str
    places: list[Place]
    named: dict[str, tuple[str, ...]]


def test_half_a_surrogate_pair_is_sent_as_a_question_mark_wherever_it_stands():
    codec = MessageCodec[Word](MessageKind.CONSOLE, Word)
    back = codec.decode(codec.encode(Word("a\ud800", [Place("\udfff", 1.5)], {"k\ud800": ("ok", "\ud800b")})))
    assert back == Word("a?", [Place("?", 1.5)], {"k?": ("ok", "?b")})
    held = [{"\ud800"}, frozenset({"\ud800"}), np.array(["\ud800"]), np.array(["\ud800", 1.0], dtype=object)]
    assert [ANYTHING.decode(ANYTHING.encode(one))[0] for one in held] == ["?"] * 4
    array = ANYTHING.decode(ANYTHING.encode({"t": "\ud800", "a": np.arange(3)}))
    assert (array["t"], array["a"].tolist()) == ("?", [0, 1, 2])


@given(st.text(st.characters(), max_size=40))
def test_no_text_keeps_a_message_from_being_sent(text):
    back = ANYTHING.decode(ANYTHING.encode([text]))
    assert back == [text.encode("utf-8", "replace").decode()]


def test_what_no_process_could_read_is_not_sent():
    with pytest.raises(TypeError, match="a complex is no part of a message"):
        ANYTHING.encode(1j)
