"""The delay probe: when it begins to brake, against the closed form, however ticks fall; that it never lets go."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from tests.controllers.street import FUSION, drive
from vve_sumo.controller import Controller, load
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.values import ControlCommand, Detections, Observation, Point, Pose

TICK, SPEED, TRIGGER, DECELERATION, JERK = 0.02, 13.9, 40.0, 3.0, 4.0
PATH = ReferencePath.from_points(np.arange(0.0, 401.0, 10.0), np.zeros(41))


@pytest.fixture
def probe(repository) -> Callable[..., Controller]:
    return lambda **tuning: load("brake_at", FUSION, tuning, [repository / "controllers"])


def passing(controller: Controller, wall: float, ticks: int, *, seen: int) -> Iterator[tuple[float, ControlCommand]]:
    """What is asked of a car that goes on at its speed, towards a wall that an exact radar shows for `seen` ticks."""
    empty = np.empty(0)
    scan = Detections(-math.inf, empty, empty, empty, np.empty(0, np.int8))
    for tick in range(ticks):
        time, x = tick * TICK, SPEED * tick * TICK
        if tick * 2 // 5 > (tick - 1) * 2 // 5 and tick < seen:  # every 50 ms, at the first tick then
            reach = np.array([wall - x - FUSION.rear_axle_to_bumper])
            scan = Detections(time, reach, np.zeros(1), np.array([-SPEED]), np.zeros(1, np.int8))
        pose = Pose(time, Point.REAR_AXLE, x, 0.0, 0.0, SPEED, 0.0, 0.0, 0.0, 0.0)
        yield time, controller.step(Observation(tick, time, pose, PATH, SPEED, {"radar": scan}, 0.0))


@pytest.mark.parametrize("phase", [0.0, 0.05, 0.13, 0.21, 0.27])
def test_it_brakes_from_when_the_trigger_was_passed_however_the_ticks_fall(probe, phase: float) -> None:
    wall = 100.0 + phase
    passed = (wall - FUSION.rear_axle_to_bumper - TRIGGER) / SPEED
    asked = list(passing(probe(trigger_m=TRIGGER, deceleration_m_s2=DECELERATION), wall, 260, seen=260))
    for time, setpoint in asked:
        if time < passed - 1e-9:
            assert setpoint.note == "cruise"
            assert setpoint.acceleration == pytest.approx(0.0, abs=1e-9)
        else:
            assert setpoint.acceleration == pytest.approx(-min(JERK * (time - passed), DECELERATION), abs=1e-6)
    assert asked[-1][1].acceleration == -DECELERATION


def test_it_never_lets_go_of_the_brake(probe) -> None:
    asked = list(passing(probe(trigger_m=TRIGGER, deceleration_m_s2=2.0), 80.0, 600, seen=200))
    assert {setpoint.acceleration for _time, setpoint in asked[240:]} == {-2.0}


def test_it_stops_at_the_end_of_its_path(probe) -> None:
    done = drive(probe(), PATH, 12.0, [], 60.0)
    assert done.speed[-1] == 0.0
    assert done.final_s == pytest.approx(PATH.length, abs=1.0)


@pytest.mark.parametrize(("key", "value"), [("trigger_m", 0.5), ("trigger_m", 150.0), ("deceleration_m_s2", 4.0)])
def test_tuning_out_of_range_is_refused(probe, key: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"'{key}' must be .* got {value:g}"):
        probe(**{key: value})


def test_the_page_tells_its_tuning_keys_as_they_are(repository, part) -> None:
    page = (repository / "docs" / "studies.md").read_text(encoding="utf-8")
    documented = re.findall(r"^\| `(\w+_m\w*)` \| ([\d.]+) \| ([\d.]+), ([\d.]+) \|", page, re.MULTILINE)
    probe = part("brake_at")
    assert {key: float(default) for key, default, _least, _greatest in documented} == probe.TUNING
    assert {key: (float(least), float(greatest)) for key, _default, least, greatest in documented} == probe.RANGES
