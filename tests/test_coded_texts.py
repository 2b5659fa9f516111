"""A column of coded texts is the list of its texts, whatever is done with it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.coded_texts import CodedTexts, joined

#: few texts, so that most come several times; a text may stand twice among them, and some for no row
TEXTS = st.lists(st.text(max_size=3), min_size=1, max_size=5)


@st.composite
def columns(draw: st.DrawFn) -> tuple[CodedTexts, list[str]]:
    texts = draw(TEXTS)
    codes = draw(st.lists(st.integers(0, len(texts) - 1), max_size=12))
    return CodedTexts(np.array(codes, np.int32), texts), [texts[code] for code in codes]


@given(columns(), st.slices(12))
def test_a_column_is_the_list_of_its_texts(column: tuple[CodedTexts, list[str]], part: slice) -> None:
    coded, plain = column
    assert list(coded) == plain
    assert len(coded) == len(plain)
    assert [coded[row] for row in range(-len(plain), len(plain))] == plain + plain
    assert isinstance(coded[part], CodedTexts)
    assert list(coded[part]) == plain[part]
    assert all(type(text) is str for text in coded)


@given(st.lists(columns(), min_size=1, max_size=4))
def test_columns_are_joined_one_after_the_other(parts: list[tuple[CodedTexts, list[str]]]) -> None:
    whole = joined([coded for coded, _ in parts])
    assert list(whole) == [text for _, plain in parts for text in plain]
    assert len(set(whole.texts)) == len(whole.texts)


def test_a_row_that_is_not_there_is_an_error_as_in_a_list() -> None:
    with pytest.raises(IndexError):
        CodedTexts(np.zeros(2, np.int32), ("a",))[2]


def test_a_column_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        CodedTexts(np.zeros(2, np.int32), ("a",)).codes[0] = 1


@pytest.mark.parametrize(
    ("codes", "said"),
    [
        (np.array([0, 2], np.int32), "codes from 0 to 2 of 2 texts"),
        (np.array([-1], np.int32), "codes from -1 to -1 of 2 texts"),
        (np.array([0]), "codes of texts are int64 of 1 dimensions, expected int32 of one"),
        (np.zeros((1, 1), np.int32), "codes of texts are int32 of 2 dimensions, expected int32 of one"),
        (np.array([0.0]), "codes of texts are float64 of 1 dimensions, expected int32 of one"),
    ],
)
def test_codes_that_stand_for_no_text_are_refused(codes: Any, said: str) -> None:
    with pytest.raises(ValueError, match=f"^{said}$"):
        CodedTexts(codes, ("a", "b"))
