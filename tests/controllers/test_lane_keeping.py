"""Where a car kept its lane, against a mean of what was seen of it then."""

from __future__ import annotations

import numpy as np
import pytest

from controllers.lane_keeping import LAG, KeptPlace


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_car_that_leaves_is_as_far_from_its_place_as_it_has_gone(side: float) -> None:
    """Seen every 0.05 s for three seconds with 0.3 m of noise, then it goes over with 1 m/s."""
    noise = np.random.default_rng(3).normal(0.0, 0.3, 80).tolist()
    places = [side * 3.0 + error for error in noise[:60]]
    kept = KeptPlace(0.0, places[0], 0.09)
    for scan in range(1, 60):
        kept.update(0.05 * scan, places[scan], 0.09)
    known = [place for scan, place in enumerate(places) if 0.05 * scan < 0.05 * 59 - LAG]
    assert kept.value == pytest.approx(np.mean(known), abs=0.1)
    assert kept.variance < 0.2**2
    before = kept.value
    for scan in range(60, 80):
        kept.update(0.05 * scan, side * (3.0 - 0.05 * (scan - 59)) + noise[scan], 0.09)
    assert kept.value == pytest.approx(before, abs=0.1)  # a second later it has not followed
    assert kept.left_towards_path(side * 2.0) == pytest.approx(1.0, abs=0.15)
    assert kept.left_towards_path(side * 3.5) < 0.0


def test_it_follows_a_car_that_has_settled_elsewhere() -> None:
    kept = KeptPlace(0.0, 3.0, 0.04)
    for scan in range(1, 400):
        kept.update(0.05 * scan, 3.0 if scan < 40 else 2.0, 0.04)
    assert kept.value == pytest.approx(2.0, abs=0.05)
