"""Makes Arrow's arrays of a table's columns from their buffers.

`pyarrow.array` takes five times as long for a short column, and imports pandas where it is installed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


def string_array(pieces: Sequence[bytes], kind: pa.DataType) -> pa.Array:
    """Return an array of byte strings, or of texts given as their bytes."""
    ends = np.zeros(len(pieces) + 1, np.int32)
    np.cumsum([len(piece) for piece in pieces], out=ends[1:])
    return pa.Array.from_buffers(kind, len(pieces), [None, pa.py_buffer(ends), pa.py_buffer(b"".join(pieces))])


def coded_array(codes: NDArray[np.int32], pieces: Sequence[bytes], kind: pa.DataType) -> pa.Array:
    """Return the same as `string_array`, a row for each code, which is a place in `pieces`."""
    return string_array(pieces, kind).take(number_array(codes, pa.int32()))


def number_array(numbers: NDArray[Any], kind: pa.DataType) -> pa.Array:
    """Return an array of numbers or truth values of a kind, given in numpy's type of that kind."""
    kept = np.packbits(numbers, bitorder="little") if kind == pa.bool_() else numbers
    return pa.Array.from_buffers(kind, len(numbers), [None, pa.py_buffer(kept)])
