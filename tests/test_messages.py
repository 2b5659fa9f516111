"""The encoding of messages: arrays, numbers of NumPy and coded texts come back, and nothing else is taken for one."""

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

from vve_sumo.coded_texts import CodedTexts
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


@given(st.lists(st.text(max_size=5), min_size=1, max_size=5), st.data())
def test_coded_texts_come_back_as_such(texts, data):
    codes = data.draw(st.lists(st.integers(0, len(texts) - 1), max_size=20))
    sent = CodedTexts(np.array(codes, np.int32), texts)
    number, back = ANYTHING.decode(ANYTHING.encode([1.5, sent]))
    assert isinstance(back, CodedTexts)
    assert (number, back.texts, back.codes.tolist()) == (1.5, tuple(texts), codes)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xc1",
        msgspec.msgpack.encode([["a"]]),
        msgspec.msgpack.encode([[7], bytes(4)]),
        msgspec.msgpack.encode([["a"], bytes(5)]),
        msgspec.msgpack.encode([["a"], b"\1\0\0\0"]),
        msgspec.msgpack.encode([["a"], b"\xff\xff\xff\xff"]),
        msgspec.msgpack.encode([[], bytes(4)]),
    ],
    ids=["nothing", "no MessagePack", "no codes", "no text", "cut code", "code too great", "code below 0", "no texts"],
)
def test_coded_texts_of_which_a_code_stands_for_none_are_malformed(content):
    data = ANYTHING.encode(msgspec.msgpack.Ext(2, content))
    assert ANYTHING.decode(data) == MalformedMessage("wrong_content")


@given(arrays.arrays("<f8", st.integers(0, 20)), st.integers(1, 3))
def test_an_array_with_steps_between_its_numbers_comes_back(array, step):
    assert ANYTHING.decode(ANYTHING.encode(array[::step])).tobytes() == array[::step].tobytes()


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
        {"time": 1.5, "range": msgspec.msgpack.Ext(3, b"d" + bytes(8))},
        {"time": 1.5, "range": CodedTexts(np.zeros(1, np.int32), ("a",))},
        {"time": 1.5, "range": msgspec.msgpack.Ext(1, b"O" + bytes(8))},
        {"time": 1.5, "range": msgspec.msgpack.Ext(1, b"d" + bytes(7))},
        {"time": 1.5, "range": msgspec.msgpack.Ext(1, b"")},
    ],
    ids=[
        "missing",
        "text for a number",
        "a list",
        "bare bytes",
        "other extension",
        "texts",
        "objects",
        "cut number",
        "nothing",
    ],
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
    coded = ANYTHING.decode(ANYTHING.encode(CodedTexts(np.array([1, 0], np.int32), ("\ud800", "b"))))
    assert list(coded) == ["b", "?"]
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
