"""Where the dossier's picture lays a path that nobody has aligned."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vve_sumo.safety.lot_picture import _axis


@pytest.mark.parametrize("angle", [-1.2, 0.0, 0.4, 1.5])
def test_the_axis_of_a_rectangle_is_its_longer_side_and_its_middle_the_crossing_of_the_diagonals(angle: float) -> None:
    corners = np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 30.0), (0.0, 30.0)])
    turned = corners @ np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]) + (7.0, -3.0)
    found, middle = _axis(turned)
    assert math.isclose(math.sin(found - angle), 0.0, abs_tol=1e-9)
    assert middle == pytest.approx(0.5 * (turned[0] + turned[2]))
