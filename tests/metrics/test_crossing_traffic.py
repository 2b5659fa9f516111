"""The least post-encroachment time of made-up traffic, by arithmetic; who goes along, joins or is far is left out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vve_sumo.geometry import Boxes
from vve_sumo.metrics.crossing_traffic import min_crossing_pet
from vve_sumo.metrics.drive_columns import ActorRows
from vve_sumo.values import Floats

TIME = np.arange(0.0, 20.0, 0.02)
ONE = np.ones_like(TIME)


def boxes(x: Floats, y: Floats, heading: Floats, speed: float) -> Boxes:
    return Boxes(x, y, heading, 4.0 * ONE, 2.0 * ONE, speed * ONE)


def ego(passes: float = 10.0) -> Boxes:
    """It drives along x at 10 m/s, its middle at the origin at this time [s]."""
    return boxes(10.0 * (TIME - passes), 0.0 * TIME, 0.0 * TIME, 10.0)


def crosser(passes: float, speed: float = 5.0, y: float = 0.0) -> Boxes:
    """It drives along y across x = y."""
    return boxes(y + 0.0 * TIME, speed * (TIME - passes), 0.5 * math.pi * ONE, speed)


def rows(*bodies: Boxes) -> ActorRows:
    at = np.tile(np.arange(len(TIME)), len(bodies))
    code = np.repeat(np.arange(len(bodies)), len(TIME))
    columns = (np.concatenate([getattr(one, name) for one in bodies]) for name in Boxes._fields)
    return ActorRows(np.arange(len(at)), at, code, [str(one) for one in range(len(bodies))], Boxes(*columns))


@pytest.mark.parametrize(("passes", "expected"), [(13.0, 3.0 - 0.3 - 0.6), (6.0, 4.0 - 0.6 - 0.3)])
def test_it_is_the_time_between_the_first_ones_leaving_and_the_seconds_entering(passes: float, expected: float) -> None:
    """Each is in the area while its middle is within 3 m of the other's line: 0.3 s of the ego, 0.6 s of the other."""
    assert min_crossing_pet(TIME, ego(), rows(crosser(passes))) == pytest.approx(expected, abs=0.01)


def test_the_least_of_all_counts_and_is_negative_where_both_are_in_the_area() -> None:
    assert min_crossing_pet(TIME, ego(), rows(crosser(15.0), crosser(12.0))) == pytest.approx(1.1, abs=0.01)
    assert min_crossing_pet(TIME, ego(), rows(crosser(15.0), crosser(10.2))) < 0.0


def test_a_leader_one_who_joins_one_who_comes_and_one_far_away_are_left_out() -> None:
    leader = boxes(10.0 * (TIME - 8.0), 0.0 * TIME, 0.0 * TIME, 10.0)
    turned = TIME > 5.0
    joins = boxes(
        np.where(turned, 10.0 * (TIME - 5.0), 0.0),
        np.where(turned, 0.0, 10.0 * (TIME - 5.0)),
        np.where(turned, 0.0, 0.5 * math.pi),
        10.0,
    )
    oncoming = boxes(-10.0 * (TIME - 10.0), 3.5 * ONE, math.pi * ONE, 10.0)
    far = crosser(10.0, y=150.0)
    for other in (leader, joins, oncoming, far):
        assert math.isnan(min_crossing_pet(TIME, ego(), rows(other)))
