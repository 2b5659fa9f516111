"""Faults that no report confesses: each is noticed before it has led the car astray, and the car comes to rest.

The figures are declared beside each fault; what is measured is the true motion of the simulated vehicle.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import pytest

from controllers import follow_and_stop
from tests import vehicles
from tests.exhaustive import with_slow
from tests.live.matrix import GATEWAY, HALF, OPEN_THROTTLE, PERIOD, PUSH, PUSHED, Layer, Right, Row, bound
from tests.vehicle.closed_loop import Came, ClosedLoop, Slowing, came_of, straight, winding
from vve_sumo.path import ReferencePath
from vve_sumo.plant.injected_faults import InjectedFault

AT: Final = 7.0  #: of the fault, after the first motion, when the car keeps its speed [s]
SECONDS: Final = 12.0  #: that are watched after it
BRAKES_AT: Final = 11.5  #: drive time at which brakes are asked for, where the fault is one of the brakes [s]
SPEEDS: Final = (5.0, 8.0)


class Noticed(NamedTuple):
    """What is promised of a fault."""

    kind: str
    codes: tuple[str, ...]  #: one of these is what the stop begins with
    seconds: float = math.inf  #: from the fault, at most
    metres: float = math.inf  #: that the car was led off its path by then, at most
    value: float = math.nan
    path: ReferencePath = winding()
    stops: Layer = GATEWAY


#: enough of them that the wheel is turned within a second
BENDS: Final = winding(swing=1.5, period=50.0)
_ASTRAY: Final = ("position_mismatch", "heading_mismatch")

PROMISED: Final = (
    Noticed("pose_drift_lateral", ("position_mismatch",), metres=0.75),
    Noticed("pose_drift_lateral", ("position_mismatch",), metres=0.75, path=straight()),
    Noticed("pose_drift_along", ("position_mismatch",), seconds=0.75 / 0.4),
    Noticed("pose_steps", ("position_mismatch",), metres=0.6),
    Noticed("pose_steps", ("position_mismatch",), metres=0.6, path=straight()),
    Noticed("pose_heading_drift", _ASTRAY, metres=0.5),
    Noticed("pose_heading_drift", _ASTRAY, metres=0.5, path=straight()),
    Noticed("pose_overtaken", ("position_mismatch",), metres=0.75),
    Noticed("pose_overtaken", ("position_mismatch",), metres=0.75, path=straight()),
    Noticed("wheel_speeds_zero", ("speed_mismatch", "position_mismatch"), 0.15),
    Noticed("wheel_speeds_zero", ("speed_mismatch", "position_mismatch"), 0.15, path=straight()),
    Noticed("wheel_speeds_scaled", ("speed_mismatch", "position_mismatch"), 1.5),
    Noticed("wheel_speeds_scaled", ("speed_mismatch", "position_mismatch"), 1.5, value=1.25),
    Noticed("steering_report_frozen", ("steering_report_frozen", "steering_mismatch"), 2.1, path=BENDS),
    Noticed("yaw_rate_frozen", ("yaw_rate_frozen", "yaw_rate_mismatch", "steering_mismatch", *_ASTRAY), 2.1),
)


def driven(kind: str, speed: float, path: ReferencePath, value: float = math.nan, brakes: float = 0.0) -> Came:
    """What comes of a fault at a speed; with `brakes` [m/s2] the controller asks for them from `BRAKES_AT` on."""
    controller = follow_and_stop.make(vehicles.FUSION.vehicle, {})
    slowing = Slowing(controller, BRAKES_AT, brakes) if brakes else controller
    loop = ClosedLoop(path, speed, [InjectedFault(kind, AT, 3600.0, value)], controller=slowing)
    return came_of(loop, AT, SECONDS)


def farthest_way(came: Came, stops: Layer, push: float = 0.0) -> float:
    """The closed form of the stopping distance of a fault that was noticed so late [m]."""
    return bound(Row("", "", Right.REST, stops=stops, notice=came.noticed + PERIOD, push=push), came.speed, 0.0)


@pytest.mark.thorough(witnesses=3)
@pytest.mark.parametrize("speed", with_slow(SPEEDS, lambda speed: speed == SPEEDS[0]))
@pytest.mark.parametrize("promised", PROMISED, ids=lambda promised: promised.kind)
def test_a_fault_that_no_report_confesses_is_noticed_and_stops_the_car(promised: Noticed, speed: float) -> None:
    came = driven(promised.kind, speed, promised.path, promised.value)
    assert came.noticed <= promised.seconds
    assert came.deviation <= promised.metres
    assert not set(promised.codes).isdisjoint(came.reasons), came
    assert came.way <= farthest_way(came, promised.stops)
    assert came.let_go == 0.0, "a car that moves is neither held to stand nor let go"


@pytest.mark.thorough
@pytest.mark.parametrize("speed", with_slow(SPEEDS, lambda speed: speed == SPEEDS[0]))
@pytest.mark.parametrize("kind", ["pose_minute_wrong", "pose_ahead_once", "pose_forged"])
def test_packets_that_cannot_be_from_when_they_say_are_ridden_through(kind: str, speed: float) -> None:
    came = driven(kind, speed, winding())
    assert came.noticed == math.inf
    assert came.farthest < 0.2


# Faults of what pushes and brakes, and of speeds that do not change: they show when something is asked for.


@pytest.mark.parametrize("speed", with_slow(SPEEDS, lambda speed: speed == SPEEDS[0]))
def test_brakes_that_give_half_are_noticed_within_one_stop(speed: float) -> None:
    came = driven("brakes_weak", speed, straight(), brakes=2.0)
    assert came.reasons[0] == "brake_not_following"
    assert came.began + came.noticed < BRAKES_AT + 1.5, "half of 2 m/s2 would take as many seconds as the speed says"
    assert came.let_go == 0.0
    way = speed * (came.noticed + PERIOD) + speed * speed / (2.0 * HALF.deceleration) + speed * (HALF.lag + HALF.rise)
    assert came.way <= way


@pytest.mark.parametrize("speed", with_slow(SPEEDS, lambda speed: speed == SPEEDS[0]))
def test_brakes_that_give_nothing_are_noticed_soon_and_never_taken_for_rest(speed: float) -> None:
    came = driven("brakes_weak", speed, straight(), value=0.0, brakes=2.0)
    assert came.reasons[0] == "brake_not_following"
    assert came.began + came.noticed <= BRAKES_AT + 0.6
    assert came.let_go == 0.0
    assert came.ended == "stopping", "nothing that the gateway has stops this car"


@pytest.mark.parametrize("speed", with_slow(SPEEDS, lambda speed: speed == SPEEDS[0]))
def test_an_engine_that_pushes_unasked_is_noticed_and_braked_down(speed: float) -> None:
    came = driven("drive_unasked", speed, straight(), value=OPEN_THROTTLE)
    assert came.reasons[0] in ("brake_not_following", "drive_not_following")
    assert came.noticed <= 2.0
    assert came.let_go <= 0.05
    assert came.way <= farthest_way(came, PUSHED, PUSH)


@pytest.mark.parametrize("speed", with_slow(SPEEDS, lambda speed: speed == SPEEDS[0]))
def test_wheel_speeds_that_are_frozen_show_as_soon_as_the_speed_changes(speed: float) -> None:
    came = driven("wheel_speeds_frozen", speed, straight(), brakes=2.0)
    assert not set(came.reasons).isdisjoint(("wheel_speeds_frozen", "speed_mismatch", "position_mismatch"))
    assert came.began + came.noticed <= BRAKES_AT + 1.2
    assert came.let_go == 0.0
    assert came.way <= farthest_way(came, GATEWAY)
    assert "driver_needed" in came.all_reasons, "the receiver alone does not say that it stands"
