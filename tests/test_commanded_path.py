"""The check of a commanded path: each flaw by itself, and properties over any numbers at all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vve_sumo.commanded_path import MAX_LENGTH, MAX_POINTS, MAX_START_DISTANCE, MIN_SPACING, curve, flaw, plain
from vve_sumo.controller import Guarded
from vve_sumo.path import ReferencePath
from vve_sumo.values import CommandedPath, ControlCommand, Detections, Observation, Point, Pose

HERE = Pose(0.0, Point.REAR_AXLE, 10.0, -5.0, 0.3, 8.0, 0.0, 0.0, 0.0, 0.0)
ROAD = ReferencePath.from_points([0.0, 100.0], [0.0, 0.0])
NOTHING = Detections(-math.inf, np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0, np.int8))


def ahead(*along: float, aside: tuple[float, ...] = ()) -> CommandedPath:
    """Return a path with points so far ahead of the car and so far aside [m], at 8 m/s."""
    left = aside or (0.0,) * len(along)
    cos, sin = math.cos(HERE.heading), math.sin(HERE.heading)
    x = tuple(HERE.x + a * cos - b * sin for a, b in zip(along, left, strict=True))
    y = tuple(HERE.y + a * sin + b * cos for a, b in zip(along, left, strict=True))
    return CommandedPath(x, y, (8.0,) * len(along))


GOOD = ahead(0.0, 5.0, 12.0, 20.0, aside=(0.1, 0.2, 0.8, 1.5))


def test_a_path_that_a_car_could_drive_has_no_flaw() -> None:
    assert flaw(GOOD, HERE) == ""
    assert flaw(ahead(*np.linspace(0.0, MAX_LENGTH - 0.1, MAX_POINTS)), HERE) == ""
    assert flaw(ahead(0.0, MIN_SPACING + 1e-9), HERE) == ""
    assert flaw(ahead(0.99 * MAX_START_DISTANCE, 20.0), HERE) == ""


@pytest.mark.parametrize(
    ("path", "words"),
    [
        (replace(GOOD, speed=(8.0,)), "4 x, 4 y and 1 speeds"),
        (replace(GOOD, y=GOOD.y[:3]), "4 x, 3 y and 4 speeds"),
        (ahead(0.0), "1 points, expected 2 to 100"),
        (CommandedPath((), (), ()), "0 points"),
        (ahead(*np.linspace(0.0, 50.0, MAX_POINTS + 1)), "101 points"),
        (replace(GOOD, x=(*GOOD.x[:2], math.nan, GOOD.x[3])), "point 2 is not finite: (nan, "),
        (replace(GOOD, y=(math.inf, *GOOD.y[1:])), "point 0 is not finite"),
        (replace(GOOD, speed=(8.0, 8.0, -math.inf, 8.0)), "point 2 is not finite"),
        (replace(GOOD, speed=(8.0, -0.1, 8.0, 8.0)), "point 1 has the negative speed -0.1 m/s"),
        (ahead(1.01 * MAX_START_DISTANCE, 20.0), "point 0 is 3.03 m from the rear axle"),
        (ahead(0.0, -5.0), "3.14 rad to the car's heading"),
        (ahead(0.0, 1.0, aside=(0.0, 1.7)), "it begins at 1.04 rad"),
        (ahead(0.0, 5.0, 5.0, 9.0), "points 1 and 2 are 0.000 m apart, expected 0.1 m at least"),
        (ahead(0.0, MAX_LENGTH + 0.1), "it is 500 m long"),
        (ahead(0.0, 5.0, 3.0), "it does not advance from point 0 to point 1"),
        (ahead(0.0, 5.0, 10.0, 10.1, 10.0, aside=(0.0, 0.0, 0.0, 4.0, 8.0)), "it does not advance from point"),
    ],
)  # fmt: skip
def test_each_flaw_is_a_line_that_names_it(path: CommandedPath, words: str) -> None:
    assert words in flaw(path, HERE)
    assert "\n" not in flaw(path, HERE)


class Says:
    """A controller that answers with a path."""

    def __init__(self, path: object) -> None:
        self.path = path

    def step(self, _observation: Observation) -> ControlCommand:
        return ControlCommand(0.1, -1.0, path=self.path)  # type: ignore[arg-type]


def answer(path: object) -> tuple[ControlCommand | None, tuple[str, ...], str]:
    guarded = Guarded(Says(path))
    return *guarded.step(Observation(0, 0.0, HERE, ROAD, 8.0, {"radar": NOTHING}, 0.0)), guarded.text


def test_a_good_path_comes_through_in_plain_floats() -> None:
    given_as = CommandedPath(np.array(GOOD.x), list(GOOD.y), np.full(4, 8, np.int64))  # type: ignore[arg-type]
    command, failures, _ = answer(given_as)
    assert failures == ()
    assert command == ControlCommand(0.1, -1.0, path=GOOD)
    assert {type(value) for column in (command.path.x, command.path.y, command.path.speed) for value in column} == {
        float
    }
    assert math.copysign(1.0, plain(CommandedPath((-0.0,), (0.0,), (0.0,))).x[0]) == 1.0


@pytest.mark.parametrize(
    ("path", "code", "words"),
    [
        (ahead(0.0), "controller_path_invalid", "path: 1 points, expected 2 to 100"),
        (CommandedPath("12", "34", "56"), "controller_path_invalid", "must be sequences of numbers"),  # type: ignore[arg-type]
        (CommandedPath(1.0, 2.0, 3.0), "controller_path_invalid", "must be sequences of numbers"),  # type: ignore[arg-type]
        (CommandedPath((1.0, None), (1.0, 2.0), (1.0, 2.0)), "controller_path_invalid", "numbers"),  # type: ignore[arg-type]
        (CommandedPath((10**400, 1), (1, 2), (1, 2)), "controller_path_invalid", "numbers"),
        ([(1.0, 2.0)], "controller_wrong_type", "expected a ControlCommand"),
    ],
)  # fmt: skip
def test_a_bad_path_is_a_reason_code(path: object, code: str, words: str) -> None:
    command, failures, text = answer(path)
    assert (command, failures) == (None, (code,))
    assert words in text


numbers = st.floats() | st.floats(-30.0, 30.0) | st.sampled_from([0.0, -0.0, 1e308, -1e308, 5e-324])
columns = st.lists(numbers, max_size=8)


@given(x=columns, y=columns, speed=columns)
def test_no_numbers_escape_as_an_exception(x: list[float], y: list[float], speed: list[float]) -> None:
    command, failures, text = answer(CommandedPath(tuple(x), tuple(y), tuple(speed)))
    assert (command is None) == (failures == ("controller_path_invalid",)) == bool(text)


@given(
    steps=st.lists(st.tuples(st.floats(0.1, 12.0), st.floats(-1.2, 1.2)), min_size=1, max_size=12),
    offset=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)),
)
def test_an_accepted_path_is_a_regular_curve_through_its_points(
    steps: list[tuple[float, float]], offset: tuple[float, float]
) -> None:
    """Any turns at any distances: refused, or a curve that advances along every line, of finite curvature."""
    heading, x, y = HERE.heading, [HERE.x + offset[0]], [HERE.y + offset[1]]
    for step, turn in steps:
        heading += turn
        x.append(x[-1] + step * math.cos(heading))
        y.append(y[-1] + step * math.sin(heading))
    path = plain(CommandedPath(tuple(x), tuple(y), (5.0,) * len(x)))
    if flaw(path, HERE):
        return
    followed = curve(path)
    for number, piece in enumerate(followed.segments):
        end = followed.segments[number + 1].start if number + 1 < len(followed.segments) else followed.length
        begin = followed.at(piece.start)
        assert (begin.x, begin.y) == pytest.approx((x[number], y[number]), abs=1e-6)
        leg = np.array([x[number + 1] - x[number], y[number + 1] - y[number]])
        leg /= np.hypot(*leg)
        places = [followed.at(s) for s in np.linspace(piece.start, end, 40)[:-1]]
        assert all(math.isfinite(place.curvature) for place in places)
        along = np.array([(place.x, place.y) for place in places]) @ leg
        assert (np.diff(along) > 0.0).all()
