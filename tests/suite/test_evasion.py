"""What physics leaves of a way out, against closed forms of stopping and swerving, and small steps."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests import vehicles
from vve_sumo import laws
from vve_sumo.scenario.road_users import Actor
from vve_sumo.suite import vru
from vve_sumo.suite.evasion import OUTLINED, TIMES, Body, Room, greatest_clearance
from vve_sumo.suite.physics import reaction_time
from vve_sumo.timing import PERIOD
from vve_sumo.vehicle.limits import COMFORT, Limits

CAR = vehicles.FUSION.vehicle
WIDE = Room(20.0, 20.0)


def standing(ahead: float, width: float = 0.5) -> Body:
    """Return a body of hardly any length whose near face is so far ahead in the middle of the path."""
    return Body(np.full_like(TIMES, ahead), np.zeros_like(TIMES), 0.0, width)


@pytest.mark.parametrize("speed", [3.0, 8.0, 16.7])
def test_braking_leaves_what_the_stopping_distance_leaves(speed: float) -> None:
    stop = laws.stopping_distance(speed, CAR.deceleration_limit, reaction_time(CAR), 2.0 * CAR.brake_lag)
    for spare in (-0.5, 0.5, 3.0):
        left = greatest_clearance(CAR, speed, [standing(stop + spare)], WIDE, brakes=True, steers=False)
        assert left == pytest.approx(max(spare, 0.0), abs=0.01)


@pytest.mark.parametrize("speed", [3.0, 8.0, 16.7])
@pytest.mark.parametrize("width", [0.5, 1.8])
def test_a_swerve_avoids_from_its_least_time_on(speed: float, width: float) -> None:
    """`swerve_time` for half of both widths, with all that is late: as near as an instant of TIMES."""
    limits = Limits()
    late = OUTLINED + PERIOD + CAR.steering_delay + CAR.steering_lag
    aside = 0.5 * (CAR.width + width)
    time = laws.swerve_time(aside, limits.lateral_acceleration, COMFORT.lateral_jerk, late)
    step = float(TIMES[1]) * speed

    def left(ahead: float) -> float:
        return greatest_clearance(CAR, speed, [standing(ahead, width)], WIDE, brakes=False, steers=True)

    assert left(time * speed - step) == 0.0
    assert left(time * speed + step) > 0.0
    narrow = Room(0.9 * aside, 0.9 * aside)
    far = [standing(10.0 * time * speed, width)]
    assert greatest_clearance(CAR, speed, far, narrow, brakes=False, steers=True) == 0.0


def test_both_are_no_worse_than_either() -> None:
    for name, case in vru.CASES.items():
        for kmh in (20.0, 40.0, 60.0):
            braking, steering, both = (vru.max_clearance(CAR, case, means, kmh / 3.6) for means in vru.MEANS)
            assert both >= max(braking, steering), name


def test_nobody_who_comes_head_on_is_avoided_by_braking() -> None:
    case = vru.CASES["bicyclist_oncoming"]
    assert all(vru.max_clearance(CAR, case, "braking", kmh / 3.6) == 0.0 for kmh in vru.SPEEDS)
    assert all(vru.max_clearance(CAR, case, "steering", kmh / 3.6) > vru.CLEARANCE for kmh in vru.SPEEDS)


@pytest.mark.parametrize("name", vru.CASES)
def test_without_an_answer_every_case_ends_in_contact(name: str) -> None:
    """Rectangles in steps of 1 ms: the actors' motion integrated from their keys, the car at constant speed."""
    case = vru.CASES[name]
    for kmh in vru.SPEEDS:
        if kmh > case.pace:
            actors, begins = case.scene(CAR, kmh / 3.6)
            assert 0.0 <= begins < vru.START
            assert any(_meets(Actor.model_validate(actor), kmh / 3.6) for actor in actors), kmh


def _meets(actor: Actor, speed: float) -> bool:
    length, width = vru.size(actor)
    turned, along = math.radians(actor.turned_deg), abs(actor.turned_deg) != 90.0
    half = (0.5 * length, 0.5 * width) if along else (0.5 * width, 0.5 * length)
    x, y, pace, time, step = actor.ahead_m + half[0], actor.offset_m, actor.speed_mps, 0.0, 1e-3
    while time < 12.0:
        time += step
        for event in actor.events:
            since = time - event.when.after_s
            if since > 0.0 and event.speed_mps is not None:
                pace = min(pace + event.acceleration_mps2 * step, event.speed_mps)
            if since > 0.0 and event.offset_m is not None:
                share = min(since / event.over_s, 1.0)
                y = actor.offset_m + (event.offset_m - actor.offset_m) * share**3 * (10 - 15 * share + 6 * share**2)
        x += pace * math.cos(turned) * step
        y += pace * math.sin(turned) * step if not along else 0.0
        if abs(x - speed * time + 0.5 * CAR.length) < half[0] + 0.5 * CAR.length and abs(y) < half[1] + 0.5 * CAR.width:
            return True
    return False
