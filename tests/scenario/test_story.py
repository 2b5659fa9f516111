"""The pieces of stories: shapes of changes, distances of conditions, and that who has no story is written as before."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from vve_sumo.errors import ConfigError
from vve_sumo.geometry import Box, Boxes, distance
from vve_sumo.path import ReferencePath
from vve_sumo.scenario.load import parse
from vve_sumo.scenario.road_users import Actor
from vve_sumo.scenario.schema import EndTrigger
from vve_sumo.scenario.story_conditions import Body, distance_between
from vve_sumo.scenario.story_schema import LineChange, SpeedAction, StoryCondition
from vve_sumo.scenario.transitions import Transition, length

SHAPES = st.sampled_from(["linear", "cubic", "sinusoidal"])
SPEEDS = st.floats(0.0, 60.0)


@given(SPEEDS, SPEEDS, SHAPES, st.floats(0.1, 20.0), st.floats(0.0, 1.5))
def test_the_way_is_the_integral_of_the_speed(
    before: float, after: float, shape: str, over: float, part: float
) -> None:
    change, until = Transition(before, after, shape, over), part * over
    times = np.linspace(0.0, until, 4001)
    numeric = float(np.trapezoid([change.at(time)[0] for time in times], times))
    assert change.integral(until) == pytest.approx(numeric, abs=1e-3)


@given(SPEEDS, SPEEDS, SHAPES, st.floats(0.2, 9.0))
def test_no_slope_is_above_the_greatest(before: float, after: float, shape: str, steepest: float) -> None:
    over = length(shape, after - before, steepest)
    change = Transition(before, after, shape, over)
    slopes = [abs(change.at(over * n / 200)[1]) for n in range(200)]
    assert max(slopes) <= steepest * (1.0 + 1e-9)
    if over > 0.01:
        assert max(slopes) == pytest.approx(steepest, rel=1e-3)


ANGLES = st.floats(-math.pi, math.pi)
PLACES = st.floats(-40.0, 40.0)


@given(PLACES, PLACES, ANGLES, ANGLES)
def test_free_space_is_the_distance_of_the_boxes(x: float, y: float, one: float, other: float) -> None:
    first, second = Box(0.0, 0.0, one, 4.5, 1.8), Box(x, y, other, 8.0, 2.5)
    bodies = [Body(box.x, box.y, box.heading, 0.0, box) for box in (first, second)]
    path = ReferencePath.from_points([0.0, 10.0], [0.0, 0.0])
    found = distance_between("straight", True, bodies[0], bodies[1], path).signed
    arrays = [
        Boxes(*(np.array([value]) for value in (box.x, box.y, box.heading, box.length, box.width, 0.0)))
        for box in (first, second)
    ]
    assert found == pytest.approx(float(distance(*arrays)[0]), abs=1e-6)


def test_along_a_path_and_across_it() -> None:
    path = ReferencePath.from_points([0.0, 100.0], [0.0, 0.0])
    one = Body(10.0, 0.0, 0.0, 12.0, Box(11.5, 0.0, 0.0, 4.5, 1.8))
    other = Body(40.0, 3.0, 0.0, 7.0, Box(41.5, 3.0, 0.0, 4.5, 1.8))
    assert distance_between("path", False, one, other, path)[:2] == pytest.approx((30.0, 5.0))
    assert distance_between("path", True, one, other, path).signed == pytest.approx(30.0 - 4.5)
    assert distance_between("path", True, other, one, path).signed == pytest.approx(-(30.0 - 4.5))
    assert distance_between("path_lateral", True, one, other, path).signed == pytest.approx(3.0 - 1.8)
    assert distance_between("heading", False, other, one, path)[:2] == pytest.approx((-30.0, 5.0))


def test_who_has_no_story_is_written_as_before() -> None:
    assert "story" not in Actor(id="a", at_m=1.0).model_dump(mode="json")
    assert set(EndTrigger().model_dump(mode="json")) == {"contact", "ego_at_m", "lateral_deviation_m", "ttc_s"}


@pytest.mark.parametrize(
    ("model", "table", "why"),
    [
        (StoryCondition, {}, "expected one of"),
        (StoryCondition, {"time_s": 1.0, "speed_mps": 1.0}, "expected one of"),
        (StoryCondition, {"ttc_s": 1.0}, "expected one of to and at_m"),
        (StoryCondition, {"speed_mps": 1.0, "to": "a"}, "is of one"),
        (StoryCondition, {"touches": True, "at_m": 3.0}, "of two bodies"),
        (SpeedAction, {"to_mps": 1.0, "shape": "linear"}, "expected one of over_s"),
        (SpeedAction, {"to_mps": 1.0, "over_s": 1.0}, "expected none of"),
        (SpeedAction, {"to_mps": -1.0}, "0 to 100"),
        (LineChange, {"at_m": 1.0}, "expected path beside"),
        (LineChange, {"path": "a", "timing": [{"time_s": 1.0, "at_m": 2.0}, {"time_s": 1.0, "at_m": 3.0}]}, "later"),
    ],
)
def test_what_says_too_much_or_too_little_is_refused(
    model: type[StoryCondition | SpeedAction | LineChange], table: dict[str, object], why: str
) -> None:
    with pytest.raises(ValidationError, match=why):
        model.model_validate(table)


@pytest.mark.parametrize(
    ("story", "why"),
    [
        ({"name": "a", "when": [[{"of": "nobody", "speed_mps": 1.0}]]}, "no actor 'nobody', expected b or ego"),
        ({"name": "a", "when": [[{"actions": ["b.c"]}]]}, "no action 'b.c', expected b.a"),
        ({"name": "a", "until": [[{"actions": ["b.c"]}]]}, "no action 'b.c', expected b.a"),
        ({"name": "a", "ends": ["c.a"]}, "no action 'c.a'"),
        ({"name": "a", "keeps": {"to": "c", "gap_m": 1.0, "side": "ahead"}}, "no actor 'c'"),
    ],
)
def test_names_of_bodies_and_actions_that_there_are_not_are_one_line(story: dict[str, object], why: str) -> None:
    lot = {"latitude_deg": 0.0, "longitude_deg": 0.0, "heading_deg": 0.0}
    table = {
        "title": "t",
        "road": {"network": "n"},
        "ego": {"path": "p", "speed_mps": 9.0, "lot": lot},
        "actors": [{"id": "b", "at_m": 1.0, "story": {"actions": [story]}}],
    }
    with pytest.raises(ConfigError, match=re.escape(why)):
        parse(table, Path("made.toml"))
