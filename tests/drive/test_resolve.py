"""What lies near a path, as scipy's tree of points has it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import KDTree

from vve_sumo.drive.path_in_network import DISTANCE_BATCH, within_distance


@pytest.mark.parametrize("count", [0, 1, DISTANCE_BATCH, 5 * DISTANCE_BATCH + 3])
@pytest.mark.parametrize("distance", [0.5, 30.0, 1000.0])
def test_near_points_are_those_of_a_tree(count: int, distance: float) -> None:
    chance = np.random.default_rng(3)
    points = chance.uniform(-500.0, 500.0, (2000, 2))
    line = np.cumsum(chance.normal(2.0, 8.0, (count, 2)), axis=0)
    wanted = KDTree(line).query(points)[0] <= distance if count else np.zeros(len(points), dtype=bool)
    assert np.array_equal(within_distance(points, line, distance), wanted)
    assert within_distance(points[:0], line, distance).shape == (0,)


def test_a_point_as_far_away_as_may_be_is_near() -> None:
    points = np.array([[3.0, 4.0], [3.0, np.nextafter(4.0, 5.0)], [-5.0, 0.0]])
    assert within_distance(points, np.zeros((1, 2)), 5.0).tolist() == [True, False, True]
