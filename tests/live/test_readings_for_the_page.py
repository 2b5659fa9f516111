"""The page gets every reading of a live drive: an empty one too, and of a long one every so many rows."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from vve_sumo.live import view_feed


@pytest.mark.parametrize(("rows", "kept"), [(0, 0), (1, 1), (1000, 1000), (1001, 501), (2500, 834)])
def test_a_reading_of_any_length_goes_out(rows: int, kept: int) -> None:
    result: Any = SimpleNamespace(
        readings={"radar": (np.zeros(rows), ("",) * rows)}, sensors={"radar": SimpleNamespace(time=1.5)}
    )
    reading = view_feed._reading(SimpleNamespace(result=result), "radar")  # type: ignore[arg-type]
    assert reading.measured == 1.5
    assert [len(column) for column in reading.columns] == [kept, kept]
