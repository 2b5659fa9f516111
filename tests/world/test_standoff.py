"""When ego and a driver wait for each other, and when they only wait."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.isolated import isolated
from tests.world.streets import ALONE, PERIOD, demand, pose, street
from vve_sumo.geometry import Box
from vve_sumo.values import EGO
from vve_sumo.world.standoff import MAX_WAIT, Standoff
from vve_sumo.world.world import World

BODY = Box(0.0, 0.0, 0.0, 4.9, 1.9)


def car(x: float, y: float, heading: float) -> Box:
    return Box(x, y, heading, 4.5, 1.8)


def over(box: Box, seconds: float = MAX_WAIT + 1.0, speed: float = 0.0) -> list[str]:
    standoff, reported = Standoff(), list[str]()
    for second in range(round(seconds) + 1):
        reported = standoff.over(float(second), BODY, speed, [("other", box)])
    return reported


@pytest.mark.parametrize(
    ("box", "ends"),
    [
        (car(7.0, 0.0, math.pi), True),  # head on
        (car(7.0, 2.2, math.pi), True),  # past the corner, with too little room for either
        (car(3.9, 3.4, -0.5 * math.pi), True),  # from the left, both noses at one spot
        (car(7.0, 0.0, 0.0), False),  # the ego stands behind it in a queue
        (car(-7.0, 0.0, 0.0), False),  # it stands behind the ego in a queue
        (car(7.0, 3.4, math.pi), False),  # in the other lane
        (car(0.0, 6.0, -0.5 * math.pi), False),  # it waits at the side for the ego, which could go on
        (car(40.0, 0.0, math.pi), False),
    ],
)
def test_only_who_stands_in_the_way_of_the_ego_and_the_ego_in_his_is_in_a_standoff(box, ends):
    assert over(box) == (["other"] if ends else [])


def test_it_lasts_a_minute_and_begins_anew_when_the_ego_moves_or_the_driver_is_gone():
    opposed = [("other", car(7.0, 0.0, math.pi))]
    standoff = Standoff()
    assert standoff.over(0.0, BODY, 0.0, opposed) == []
    assert standoff.over(MAX_WAIT - 0.02, BODY, 0.0, opposed) == []
    assert standoff.over(MAX_WAIT, BODY, 0.0, opposed) == ["other"]
    assert standoff.over(MAX_WAIT + 1.0, BODY, 0.3, opposed) == []
    assert standoff.over(MAX_WAIT + 2.0, BODY, 0.0, opposed) == []
    assert standoff.over(2.0 * MAX_WAIT + 1.0, BODY, 0.0, []) == []
    assert standoff.over(2.0 * MAX_WAIT + 2.1, BODY, 0.0, opposed) == []


@given(
    st.floats(-30.0, 30.0), st.floats(-30.0, 30.0), st.floats(-4.0, 4.0), st.floats(-50.0, 50.0), st.floats(-4.0, 4.0)
)
def test_it_is_the_same_wherever_on_the_map_and_whoever_is_called_ego(x, y, heading, far, turn):
    box = car(x, y, heading)
    cos, sin = math.cos(turn), math.sin(turn)

    def moved(one: Box) -> Box:
        return Box(
            far + one.x * cos - one.y * sin, one.x * sin + one.y * cos, one.heading + turn, one.length, one.width
        )

    def opposed(ego: Box, other: Box) -> bool:
        standoff = Standoff()
        standoff.over(0.0, ego, 0.0, [("other", other)])
        return standoff.over(MAX_WAIT, ego, 0.0, [("other", other)]) == ["other"]

    nearly = any(opposed(BODY, Box(x, y, heading, 4.5 + d, 1.8 + d)) != opposed(BODY, box) for d in (-1e-6, 1e-6))
    if not nearly:
        assert opposed(moved(BODY), moved(box)) == opposed(BODY, box) == opposed(box, BODY)


def _head_on(folder: str) -> tuple[list[tuple[float, tuple[str, ...]]], set[str]]:
    """The ego faces an oncoming car in that car's lane; how the list of ended standoffs grew, and who was touched."""
    root, grown, touched = Path(folder), list[tuple[float, tuple[str, ...]]](), set[str]()
    cars = demand(root, '<flow id="on" begin="0" end="10" period="3" departPos="0"><route edges="east"/></flow>')
    with World(street(root, 1), demand=[cars], seed=1, period=PERIOD, egos=ALONE) as world:
        for k in range(round(170.0 / PERIOD)):
            world.step({EGO: pose(k * PERIOD, 150.0, -1.6, math.pi, 0.0)})
            touched |= set(world.contacts(EGO))
            if not grown or grown[-1][1] != world.removed_after_standoff:
                grown.append((k * PERIOD, world.removed_after_standoff))
    return grown, touched


@pytest.mark.thorough
def test_an_oncoming_driver_who_cannot_go_on_is_taken_off_the_street_after_a_minute_and_the_next_after_another(
    tmp_path,
):
    grown, touched = isolated(_head_on, str(tmp_path))
    assert [names for _, names in grown] == [(), ("on.0",), ("on.0", "on.1")]
    assert grown[1][0] > MAX_WAIT
    assert grown[2][0] - grown[1][0] > MAX_WAIT
    assert touched == set()
