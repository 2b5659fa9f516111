"""A column of texts of which few differ: a number a row, and the texts that the numbers stand for.

Arrow and Parquet call this dictionary encoding. The module knows neither sensors nor messages nor records.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import overload

import numpy as np
from numpy.typing import NDArray


class CodedTexts(Sequence[str]):
    """Texts, a row each, as a sequence that never changes."""

    __slots__ = ("codes", "texts")

    def __init__(self, codes: NDArray[np.int32], texts: Sequence[str]) -> None:
        """`codes` are places in `texts`, one a row; raises ValueError for any other."""
        if codes.dtype != np.int32 or codes.ndim != 1:
            raise ValueError(f"codes of texts are {codes.dtype} of {codes.ndim} dimensions, expected int32 of one")
        if len(codes) and not (codes.min() >= 0 and codes.max() < len(texts)):
            raise ValueError(f"codes from {codes.min()} to {codes.max()} of {len(texts)} texts")
        codes.setflags(write=False)
        self.codes = codes
        self.texts = tuple(texts)  #: each may stand for any number of rows, none included

    def __len__(self) -> int:
        return len(self.codes)

    @overload
    def __getitem__(self, rows: int) -> str: ...
    @overload
    def __getitem__(self, rows: slice) -> CodedTexts: ...
    def __getitem__(self, rows: int | slice) -> str | CodedTexts:
        if isinstance(rows, slice):
            return CodedTexts(self.codes[rows], self.texts)
        return self.texts[int(self.codes[rows])]

    def __iter__(self) -> Iterator[str]:
        return map(self.texts.__getitem__, self.codes.tolist())


def joined(parts: Sequence[CodedTexts]) -> CodedTexts:
    """Return the rows of columns, one after the other."""
    known: dict[str, int] = {}
    codes = []
    for part in parts:
        new = np.array([known.setdefault(text, len(known)) for text in part.texts], np.int32)
        codes.append(new[part.codes])
    return CodedTexts(np.concatenate(codes), tuple(known))
