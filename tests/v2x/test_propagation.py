"""Path loss against values worked out by hand from the tables of TR 37.885, and the losses' distributions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vve_sumo.v2x.propagation import Sight, body_loss, path_loss


@pytest.mark.parametrize(
    ("distance", "sight", "loss"),
    [
        (1.0, Sight.CLEAR, 52.800),  # 38.77 + 18.2 * 0.77085
        (10.0, Sight.CLEAR, 69.500),
        (100.0, Sight.BODY, 86.200),
        (100.0, Sight.BUILDING, 111.419),  # 36.85 + 60 + 18.9 * 0.77085
        (0.2, Sight.CLEAR, 52.800),
    ],
)
def test_path_loss(distance: float, sight: Sight, loss: float) -> None:
    assert path_loss(distance, sight) == pytest.approx(loss, abs=1e-3)


def test_a_corner_costs_more_the_farther_both_are_from_it() -> None:
    costs = [path_loss(d, Sight.BUILDING) - path_loss(d, Sight.CLEAR) for d in (10.0, 30.0, 100.0)]
    assert costs == sorted(costs)
    assert costs[0] > 10.0


@pytest.mark.parametrize(
    ("antennas", "body", "distance", "mean", "sigma"),
    [
        ((1.5, 1.5), 3.5, 100.0, 9.0, 4.5),
        ((1.5, 3.0), 2.0, 100.0, 5.0, 4.0),
        ((1.5, 1.5), 1.5, 100.0, 5.0, 4.0),
        ((1.5, 1.5), 3.5, 1000.0, 9.0 + 4.0, 4.5),
    ],
)
def test_what_a_body_costs(
    antennas: tuple[float, float], body: float, distance: float, mean: float, sigma: float
) -> None:
    normals = np.random.default_rng(3).standard_normal(200_000)
    losses = np.array([body_loss(distance, antennas, body, one) for one in normals.tolist()])
    assert losses.mean() == pytest.approx(mean, abs=0.05)
    assert losses.std() == pytest.approx(sigma, abs=0.06)
    assert losses.min() > 0.0


def test_a_body_lower_than_both_antennas_costs_nothing() -> None:
    assert body_loss(50.0, (1.5, 1.8), 1.4, 3.0) == 0.0
    assert math.isclose(body_loss(50.0, (1.5, 1.8), 1.5, 0.0), body_loss(50.0, (1.8, 1.5), 1.5, 0.0))
