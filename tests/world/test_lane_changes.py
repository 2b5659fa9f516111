"""Cars that change lanes do so in seconds, and what the snapshot says of their motion is how they move."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.isolated import isolated
from tests.world.streets import ALONE, PERIOD, demand, pose, street
from vve_sumo.values import EGO
from vve_sumo.world.surroundings import followed
from vve_sumo.world.world import World

EAST = '<route edges="east"/>'
#: Lorries that crawl in the right lane, and cars that overtake them and come back: SUMO's drivers keep to the right.
OVERTAKING = (
    '<vType id="lorry" vClass="truck" length="12" maxSpeed="5"/><vType id="car" sigma="0" lcKeepRight="20"/>'
    + "".join(
        f'<vehicle id="lorry{i}" type="lorry" depart="0" departPos="{150 + 150 * i}" departLane="0">{EAST}</vehicle>'
        for i in range(4)
    )
    + "".join(
        f'<vehicle id="car{i}" type="car" depart="{4 * i}" departPos="20" departSpeed="14" departLane="0">{EAST}'
        "</vehicle>"
        for i in range(6)
    )
)
SECONDS = 50.0

Moment = tuple[float, float, float, float, float]  #: x, y, heading, speed, speed across


def _overtaken(folder: str) -> dict[str, list[Moment]]:
    """What the snapshots say of every car."""
    root, reported = Path(folder), dict[str, list[Moment]]()
    with World(street(root), demand=[demand(root, OVERTAKING)], seed=1, period=PERIOD, egos=ALONE) as world:
        for k in range(round(SECONDS / PERIOD)):
            # Beside the road, where it is in nobody's way.
            assert world.step({EGO: pose(k * PERIOD, 400.0, -20.0, 0.0, 0.0)})[EGO].faults == ()
            actors = world.actors(EGO)
            columns = (actors.x, actors.y, actors.heading, actors.speed, actors.lateral_speed)
            for name, *moment in zip(actors.ids, *(column.tolist() for column in columns), strict=True):
                reported.setdefault(name, []).append(tuple(moment))
    return reported


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Moment]]:
    return isolated(_overtaken, str(tmp_path_factory.mktemp("street")))


def test_no_car_jumps_sideways(reported: dict[str, list[Moment]]) -> None:
    sideways = {name: [abs(b[1] - a[1]) for a, b in pairwise(rows)] for name, rows in reported.items()}
    changed = [
        name for name, rows in reported.items() if max(y for _, y, *_ in rows) - min(y for _, y, *_ in rows) > 3.0
    ]
    assert len(changed) >= 3, "cars that overtook"
    assert max(map(max, sideways.values())) < 0.05, "3.2 m take 3 s, which is 0.02 m a step"


def test_its_speeds_along_and_across_are_how_it_moves(reported: dict[str, list[Moment]]) -> None:
    """The virtual road goes to the east, so y is the way across: the integral of what is said must give it."""
    for name, rows in reported.items():
        y = rows[0][1]
        for before, (_, _, heading, speed, across) in pairwise(rows):
            middle = before[2] + 0.5 * math.remainder(heading - before[2], math.tau)
            y += PERIOD * (0.5 * (before[3] + speed) * math.sin(middle) + across * math.cos(middle))
        assert y == pytest.approx(rows[-1][1], abs=0.15), name
    fastest = max(abs(row[4]) for rows in reported.values() for row in rows)
    assert 0.3 < fastest < 0.8, "half of 3.2 m in 3 s, where SUMO's body begins to turn"


@given(st.floats(-3.14, 3.14), st.floats(-3.14, 3.14), st.floats(0.001, 0.5))
def test_a_body_turns_by_no_more_than_it_can_and_comes_to_where_sumo_has_it(before, heading, most):
    at = before
    for _ in range(math.ceil(math.pi / most) + 1):
        last, at = at, followed(at, heading, most)
        assert abs(math.remainder(at - last, math.tau)) <= most + 1e-12
        assert abs(math.remainder(heading - at, math.tau)) <= abs(math.remainder(heading - last, math.tau)) + 1e-12
    assert at == heading


def test_a_heading_that_is_no_number_stays_that_and_holds_up_none_after_it():
    assert math.isnan(followed(1.0, math.nan, 0.1))
    assert followed(math.nan, 1.0, 0.1) == 1.0
