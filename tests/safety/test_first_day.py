"""What the page of the first day states is what can be computed again."""

from __future__ import annotations

import math
import re

import pytest
from pyproj import Geod, Transformer

from tests.conftest import REPOSITORY

PAGE = REPOSITORY / "docs" / "first_day.md"
#: rows of the table by their first word: the frame of corrections, that of satellites (EPSG), and the place [deg]
FRAMES = {
    "Columbus": ("EPSG:6319", "EPSG:7912", 40.0041, -83.0186),
    "Stuttgart": ("EPSG:7931", "EPSG:7912", 48.78, 9.18),
}
EPOCH = 2026.9


@pytest.mark.parametrize("place", FRAMES)
def test_datums_lie_as_far_apart_as_the_page_says(place: str) -> None:
    said = re.search(rf"(?m)^\| {place} .* \| ([\d.]+) m \| ([\d.]+) m \|$", PAGE.read_text(encoding="utf-8"))
    assert said is not None
    source, target, latitude, longitude = FRAMES[place]
    there = Transformer.from_crs(source, target, always_xy=True).transform(longitude, latitude, 200.0, EPOCH)
    _, _, across = Geod(ellps="GRS80").inv(longitude, latitude, there[0], there[1])
    assert math.isclose(float(said[1]), across, abs_tol=0.01)
    assert math.isclose(float(said[2]), abs(there[2] - 200.0), abs_tol=0.01)
