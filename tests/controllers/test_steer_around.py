"""Controllers that steer around, in closed loop on a road without SUMO: they pass, give way, swerve, and come back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from controllers import elastic_band, follow_and_stop, frenet_sampling
from controllers.lateral_plan import LateralPlan, Planning, Task
from controllers.steer_around import PORTIONS, TUNING, controller
from tests.controllers.avoid_bench import CAR, Drive, drive
from tests.controllers.bench import ROAD, Body, steady
from tests.controllers.street import Flaws
from vve_sumo.commanded_path import flaw
from vve_sumo.controller import Controller
from vve_sumo.errors import ConfigError
from vve_sumo.path import ReferencePath
from vve_sumo.values import ControlCommand, Observation, Point, Pose, SensorOutput

MODULES = [elastic_band, frenet_sampling]
both = pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__.split(".")[-1])
#: what an honest pose and the steering law leave of the way that is planned [m]
CLEAR = 0.8


def around(module: ModuleType, **tuning: float | bool) -> Controller:
    made: Controller = module.make(CAR, {"left_m": 3.4} | tuning)
    return made


def commanded(found: Drive) -> list[int]:
    return [tick for tick, command in enumerate(found.commands) if command.path is not None]


@both
def test_it_passes_what_stands_and_comes_back(module: ModuleType) -> None:
    found = drive(around(module), ROAD, 8.0, [steady(60.0, 0.2)], 20.0, until=125.0)
    assert found.s[-1] > 125.0
    assert found.least > CLEAR
    assert abs(found.d[-1]) < 0.15
    assert found.speed.min() > 5.0
    assert np.abs(found.lateral).max() < 2.6
    assert commanded(found)
    assert found.commands[-1].path is None or abs(found.d[-1]) < 0.15


@pytest.mark.thorough
@both
@pytest.mark.parametrize(
    ("place", "turn", "length", "width", "kind"),
    [
        (0.0, 0.5, 4.5, 1.8, "car"),
        (-0.8, -0.6, 4.5, 1.8, "car"),
        (0.3, 0.0, 8.0, 2.0, "van"),
        (-0.5, 0.0, 0.5, 0.6, "pedestrian"),
    ],
)
def test_it_passes_long_and_oblique_bodies_in_a_bend(
    module: ModuleType, place: float, turn: float, length: float, width: float, kind: str
) -> None:
    step = np.arange(0.0, 300.0, 2.0)
    heading = np.cumsum(np.clip((step - 20.0) / 20.0, 0.0, 1.0) * 0.008 * 2.0)
    path = ReferencePath.from_points(np.cumsum(2.0 * np.cos(heading)), np.cumsum(2.0 * np.sin(heading)))
    at = path.at(70.0)
    x, y = at.x - place * math.sin(at.heading), at.y + place * math.cos(at.heading)
    body = steady(x, y, 0.0, at.heading + turn, length=length, width=width)
    found = drive(around(module, left_m=4.6), path, 7.0, [body], 25.0, until=140.0, kinds=[kind])
    assert found.s[-1] > 140.0
    assert found.least > CLEAR
    assert abs(found.d[-1]) < 0.15


@pytest.mark.thorough
@both
def test_who_comes_the_other_way_goes_first(module: ModuleType) -> None:
    bodies = [steady(60.0, 0.0), steady(125.0, 3.2, 8.0, math.pi)]
    found = drive(around(module), ROAD, 8.0, bodies, 30.0, until=120.0)
    assert found.least > CLEAR
    assert found.s[-1] > 120.0
    # They meet where the car is still on its own side.
    met = int(np.argmin(np.abs(125.0 - 8.0 * found.time - found.s)))
    assert abs(found.d[met]) < 0.6


@pytest.mark.thorough
def test_while_somebody_keeps_coming_it_waits() -> None:
    stream = [steady(90.0 + 30.0 * number, 3.2, 8.0, math.pi) for number in range(8)]
    found = drive(around(elastic_band), ROAD, 8.0, [steady(50.0, 0.0), *stream], 16.0)
    assert found.least > CLEAR
    assert np.abs(found.d).max() < 0.5
    assert found.speed[-1] < 0.1
    bumper = found.s[-1] + CAR.rear_axle_to_bumper
    assert 47.75 - bumper == pytest.approx(TUNING["gap_m"], abs=1.0)


def test_it_waits_as_far_behind_one_whose_nearest_corner_is_beside_its_path() -> None:
    """The radar's one point of it is 1.3 m to the right of the path; its other side is in the car's way."""
    stream = [steady(90.0 + 30.0 * number, 3.2, 8.0, math.pi) for number in range(6)]
    oblique = steady(50.0, -0.57, 0.0, -math.radians(5.0))
    found = drive(around(elastic_band), ROAD, 8.0, [oblique, *stream], 12.0)
    nearest = 50.0 - 2.25 * math.cos(math.radians(5.0)) - 0.9 * math.sin(math.radians(5.0))
    assert found.speed[-1] < 0.1
    assert not found.emergency.any()
    bumper = found.s[-1] + CAR.rear_axle_to_bumper
    assert nearest - bumper == pytest.approx(TUNING["gap_m"], abs=1.0)


@pytest.mark.parametrize(
    ("start", "offset", "begins", "lasts", "his", "own"),
    [(100.0, 0.5, 3.2, 1.0, 9.0, 7.0), (89.3, 0.59, 3.71, 1.18, 7.45, 6.45)],
)
def test_who_comes_in_its_lane_and_moves_over_is_given_way_to_as_any_other(
    start: float, offset: float, begins: float, lasts: float, his: float, own: float
) -> None:
    """He begins to when he is 2 to 4 s away: a swerve that the car has not begun yet has no use any more."""

    def place(time: float) -> tuple[float, float, float, float]:
        share = min(max((time - begins) / lasts, 0.0), 1.0)
        return start - his * time, offset + (3.3 - offset) * share * share * (3.0 - 2.0 * share), math.pi, his

    found = drive(around(elastic_band), ROAD, own, [steady(60.0, -0.1), Body(place)], 25.0, until=120.0)
    met = int(np.argmin(np.abs(start - his * found.time - found.s)))
    assert abs(found.d[met]) < 0.15
    assert found.least > CLEAR
    assert found.s[-1] > 100.0


@pytest.mark.thorough
@both
def test_out_of_a_standstill_behind_it(module: ModuleType) -> None:
    """As far behind it as the car waits for who comes the other way."""
    at = CAR.rear_axle_to_bumper + module.TUNING["gap_m"] + 2.25
    found = drive(around(module), ROAD, 8.0, [steady(at, 0.0)], 20.0, start=0.0, until=80.0)
    assert found.s[-1] > 80.0
    assert found.least > CLEAR
    assert abs(found.d[-1]) < 0.15


@pytest.mark.thorough
@pytest.mark.parametrize("gap", [4.5, 5.0, 7.0, 9.0, 12.0])
def test_out_of_a_standstill_close_behind_it(gap: float) -> None:
    """As who came while it steered out may leave it."""
    at = CAR.rear_axle_to_bumper + gap + 2.25
    found = drive(around(elastic_band), ROAD, 8.0, [steady(at, 0.0)], 25.0, start=0.0, until=80.0)
    assert found.s[-1] > 80.0
    assert found.least > CLEAR
    assert abs(found.d[-1]) < 0.15
    assert found.d.max() < 3.4 + 0.2


@pytest.mark.thorough
@pytest.mark.parametrize("bend", [1.0 / 60.0, -1.0 / 60.0])
@pytest.mark.parametrize("gap", [6.0, 9.0])
def test_out_of_a_standstill_in_a_bend(bend: float, gap: float) -> None:
    """In the one to the right the other lane is hidden by what stands there: the car stays."""
    angle = bend * np.arange(0.0, 150.0)
    road = ReferencePath.from_points((np.sin(angle) / bend).tolist(), ((1.0 - np.cos(angle)) / bend).tolist())
    at = road.at(CAR.rear_axle_to_bumper + gap + 2.25)
    found = drive(around(elastic_band), road, 8.0, [steady(at.x, at.y, 0.0, at.heading)], 25.0, start=0.0, until=70.0)
    assert found.least > CLEAR
    assert (found.s[-1] > 70.0) == (bend > 0.0)


class Blinded:
    """The elastic band, to which sensors bring nothing new from a time on."""

    def __init__(self, begins: float) -> None:
        self._controller, self._begins = around(elastic_band), begins
        self._sensors: Mapping[str, SensorOutput] = {}

    def step(self, observation: Observation) -> ControlCommand:
        if observation.time < self._begins:
            self._sensors = observation.sensors
        return self._controller.step(replace(observation, sensors=self._sensors))


@pytest.mark.thorough
@pytest.mark.parametrize("begins", [3.0, 4.0, 5.0, 7.0])
def test_a_car_on_a_way_that_sees_nothing_any_more_stops(begins: float) -> None:
    found = drive(Blinded(begins), ROAD, 8.0, [steady(CAR.rear_axle_to_bumper + 8.25, 0.0)], begins + 6.0, start=0.0)
    at = int(np.searchsorted(found.time, begins))
    assert found.least > CLEAR
    assert found.speed[-1] == 0.0
    # On the way for 0.6 s and as long as the brakes take, then 2.5 m/s2 and more.
    assert found.s[-1] - found.s[at] < 1.2 * (found.speed[at] + 1.0) + (found.speed[at] + 1.0) ** 2 / 5.0


@pytest.mark.thorough
def test_nobody_is_pulled_out_around_who_may_walk_on() -> None:
    person = steady(CAR.rear_axle_to_bumper + 5.0, 0.0, length=0.5, width=0.6, cross_section=0.5)
    found = drive(around(elastic_band), ROAD, 8.0, [person], 10.0, kinds=["pedestrian"], start=0.0)
    assert found.s[-1] < 0.5


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("gap", "speed", "begins"), [(5.0, 10.0, 140.0), (5.0, 10.0, 150.0), (15.0, 8.0, 130.0), (15.0, 10.0, 150.0)]
)
def test_who_comes_once_it_is_out_makes_it_hurry(gap: float, speed: float, begins: float) -> None:
    """He is hidden by what stands there until 80 m away, and gives way to nobody: to stop would be in his way."""
    bodies = [steady(CAR.rear_axle_to_bumper + gap + 2.25, 0.0), steady(begins, 3.2, speed, math.pi)]
    found = drive(around(elastic_band), ROAD, 8.0, bodies, 40.0, start=0.0, until=70.0)
    assert found.s[-1] > 70.0
    assert found.least > 0.5


@pytest.mark.thorough
@both
def test_it_overtakes_a_bicyclist(module: ModuleType) -> None:
    bicycle = steady(45.0, -0.8, 4.0, length=1.8, width=0.6, cross_section=1.0)
    found = drive(around(module), ROAD, 9.0, [bicycle], 25.0, kinds=["bicycle"], until=180.0)
    assert found.s[-1] > 180.0
    assert found.least > CLEAR
    assert abs(found.d[-1]) < 0.15


class Counting:
    """The elastic band, which counts the portions of its work."""

    setting_out_share = elastic_band.ElasticBand.setting_out_share
    pulls_out = elastic_band.ElasticBand.pulls_out

    def __init__(self) -> None:
        self.portions = 0

    def planning(self, task: Task) -> Planning:
        planning = elastic_band.ElasticBand().planning(task)
        while True:
            self.portions += 1
            try:
                next(planning)
            except StopIteration as end:
                plan: LateralPlan | None = end.value
                return plan
            yield


class ByTick:
    """A controller, and how many portions its planner worked on in each tick."""

    def __init__(self) -> None:
        self._planner = Counting()
        self._own = controller(CAR, {"left_m": 3.4}, self._planner, TUNING)
        self.portions: list[int] = []

    def step(self, observation: Observation) -> ControlCommand:
        before = self._planner.portions
        command = self._own.step(observation)
        self.portions.append(self._planner.portions - before)
        return command


def test_the_ticks_share_the_work_and_no_clock_decides() -> None:
    bodies = [steady(50.0, 0.2)]
    counted = ByTick()
    found = drive(counted, ROAD, 8.0, bodies, 4.0)
    assert max(counted.portions) == PORTIONS
    assert sum(counted.portions) > 10 * PORTIONS
    assert drive(ByTick(), ROAD, 8.0, bodies, 4.0).commands == found.commands


def test_it_overtakes_a_bicyclist_whom_it_has_come_behind() -> None:
    """No faster than the bicyclist at first, it would never meet him at its present speed."""
    bicycle = steady(22.0, -0.3, 4.0, length=1.8, width=0.6, cross_section=1.0)
    found = drive(around(elastic_band), ROAD, 8.0, [bicycle], 30.0, kinds=["bicycle"], start=4.0, until=150.0)
    assert found.s[-1] > 150.0
    assert found.least > CLEAR
    assert abs(found.d[-1]) < 0.15
    # It speeds up once, and does not fall back again.
    assert np.diff(np.maximum.accumulate(found.speed) - found.speed).max() < 0.5


@pytest.mark.parametrize("speed", [2.0, 6.0])
def test_it_goes_out_of_the_way_of_a_bicyclist_who_comes_head_on(speed: float) -> None:
    """Braking does not help: a car at rest is ridden into."""
    bicycle = steady(45.0, -0.6, 4.0, math.pi, length=1.8, width=0.6, cross_section=1.0)
    found = drive(around(elastic_band), ROAD, speed, [bicycle], 6.0 + 40.0 / speed, kinds=["bicycle"])
    assert found.least > CLEAR
    assert found.speed.min() > 1.0
    assert abs(found.d[-1]) < 0.15


def comes_over(begins: float, aside: float, within: float) -> Body:
    """A bicyclist who comes over into the path within a time, smoothly, from 1 s on."""

    def place(time: float) -> tuple[float, float, float, float]:
        share = min(max(time - 1.0, 0.0) / within, 1.0)
        return begins + 4.2 * time, aside * (1.0 - share**3 * (10.0 - 15.0 * share + 6.0 * share**2)), 0.0, 4.2

    return Body(place, 1.8, 0.6, 1.0)


def test_it_brakes_behind_a_bicyclist_who_turns_in_before_it_goes_around_him() -> None:
    bicycle = comes_over(50.0, -2.5, 2.5)
    found = drive(around(elastic_band, right_m=2.0), ROAD, 16.7, [bicycle], 12.0, kinds=["bicycle"])
    assert found.least > 0.8


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize(
    ("speed", "gap", "aside", "within"),
    [(13.9, 38.0, -2.5, 3.5), (13.9, 42.0, -2.5, 5.0), (10.0, 36.0, -2.5, 5.0), (13.9, 42.0, 2.8, 5.0)],
)
def test_who_comes_over_slowly_is_not_gone_around_before_he_keeps_his_line(
    speed: float, gap: float, aside: float, within: float
) -> None:
    """At first he is slower across than what stands out from the lidar's noise."""
    begins = speed + CAR.rear_axle_to_bumper + 0.9 + gap - 4.2
    bodies = [comes_over(begins, aside, within)]
    kinds = ["bicycle"]
    found = drive(around(elastic_band, right_m=2.0), ROAD, speed, bodies, 9.0, start=speed, kinds=kinds)
    braked = drive(around(elastic_band, left_m=0.0), ROAD, speed, bodies, 9.0, start=speed, kinds=kinds)
    assert braked.least > CLEAR
    assert found.least > CLEAR


def runs_out(speed: float, arrives: float, sets_out: float = 1.0, pace: float = 3.0) -> Body:
    """Runs in from the right so that an unbraked bumper meets the middle of it."""
    x = CAR.rear_axle_to_bumper + speed * (arrives + sets_out) + 0.3

    def place(time: float) -> tuple[float, float, float, float]:
        runs = max(time - sets_out, 0.0)
        return x, pace * (runs - arrives), math.pi / 2.0, pace if runs else 0.0

    return Body(place, 0.5, 0.6, 0.5)


def test_it_swerves_and_brakes_where_braking_alone_comes_too_late() -> None:
    """At 50 km/h with 1.4 s left full braking from when the runner is known does not stop the car."""
    speed, body = 50.0 / 3.6, runs_out(50.0 / 3.6, 1.4)
    alone = drive(around(elastic_band, left_m=0.0), ROAD, speed, [body], 4.5, kinds=["pedestrian"])
    both_ = drive(around(elastic_band, right_m=2.0), ROAD, speed, [body], 4.5, kinds=["pedestrian"])
    assert both_.least > 0.1
    assert both_.emergency.any()
    assert both_.least > alone.least
    assert np.abs(both_.d).max() > 0.3


def test_without_room_it_brakes_as_the_shipped_controller_does() -> None:
    bodies = [steady(45.0, 0.0)]
    own = drive(around(elastic_band, left_m=0.0, gap_m=5.0), ROAD, 8.0, bodies, 6.0)
    shipped = drive(follow_and_stop.make(CAR, {"gap_m": 5.0}), ROAD, 8.0, bodies, 6.0)
    assert own.commands == shipped.commands


def test_every_way_that_it_commands_is_one_that_the_tick_takes() -> None:
    found = drive(around(elastic_band), ROAD, 7.0, [steady(45.0, 0.0)], 9.0, flaws=Flaws(misalignment=0.01))
    for tick in commanded(found):
        path = found.commands[tick].path
        assert path is not None
        assert max(path.speed) <= 7.2
        pose = Pose(0.0, Point.REAR_AXLE, found.s[tick], found.d[tick], 0.0, 7.0, 0.0, 0.0, 0.0, 0.0)
        heading = math.atan2(path.y[1] - path.y[0], path.x[1] - path.x[0])
        assert abs(heading) < 1.0
        assert not flaw(path, pose)


@pytest.mark.parametrize(("key", "value"), [("left_m", -1.0), ("right_m", 40.0), ("sensor", 1.0)])
def test_a_slip_in_the_tuning_is_named(key: str, value: float) -> None:
    with pytest.raises(ConfigError, match=key):
        elastic_band.make(CAR, {key: value})


def test_a_scenario_without_a_lidar_is_named() -> None:
    controller = elastic_band.make(CAR, {"left_m": 3.0, "sensor": "top"})
    with pytest.raises(TypeError, match="no sensor 'top' of kind lidar"):
        drive(controller, ROAD, 5.0, [], 0.1)


@both
def test_at_speed_too_every_command_begins_where_the_car_is(module: ModuleType) -> None:
    """The drive holds each commanded path against the tick's check; a plan takes ticks in which the car goes metres."""
    bicycle = steady(75.0, -0.8, 4.0, length=1.8, width=0.6, cross_section=1.0)
    found = drive(around(module), ROAD, 16.0, [bicycle], 9.0, kinds=["bicycle"], until=130.0)
    assert found.least > CLEAR
    assert commanded(found)


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("module", "radius", "start"),
    [(elastic_band, -60.0, 190.0), (frenet_sampling, 60.0, 160.0)],
    ids=["band", "sampling"],
)
def test_who_comes_the_other_way_around_a_bend_goes_first(module: ModuleType, radius: float, start: float) -> None:
    """Until he is near he is farther beside the car's axis than beside the path."""
    curvature = np.clip((np.arange(400.0) - 40.0) / 20.0, 0.0, 1.0) / radius
    heading = np.concatenate(([0.0], np.cumsum(curvature)))
    path = ReferencePath.from_points(np.cumsum(np.cos(heading)), np.cumsum(np.sin(heading)))

    def place(time: float) -> tuple[float, float, float, float]:
        at = path.at(start - 8.0 * time)
        x, y = at.x - 3.3 * math.sin(at.heading), at.y + 3.3 * math.cos(at.heading)
        return x, y, at.heading + math.pi, 8.0 * (1.0 - 3.3 * at.curvature)

    stands = path.at(90.0)
    found = drive(around(module), path, 8.0, [steady(stands.x, stands.y, 0.0, stands.heading), Body(place)], 15.0)
    assert found.least > CLEAR


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(("length", "passes"), [(90.0, False), (130.0, True)])
def test_it_waits_where_it_would_come_to_its_end_beside_the_path(length: float, passes: bool) -> None:
    path = ReferencePath.from_points([0.0, length], [0.0, 0.0])
    found = drive(around(elastic_band), path, 8.0, [steady(60.0, 0.0)], 14.0, until=length - 5.0)
    assert (found.s[-1] > 70.0) == passes
    assert abs(found.d[-1]) < 0.15


def test_a_slow_car_goes_around_what_stands() -> None:
    found = drive(around(elastic_band), ROAD, 2.0, [steady(28.0, 0.0)], 4.0)
    assert commanded(found)


def test_who_may_be_a_part_of_a_car_far_away_does_not_cross() -> None:
    """A few rays meet a car 70 m away, and not all come back: taken for one who crosses, it was driven up to."""
    found = drive(around(frenet_sampling), ROAD, 18.0, [steady(110.0, 0.0)], 8.0)
    assert found.least > CLEAR
    assert not found.emergency.any()


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("begins", [112.0, 104.0, 120.0])
def test_who_has_gone_by_is_no_reason_to_give_up_a_way(begins: float) -> None:
    """One who comes passes the car while that sets out, too late for it to slow down behind what stands."""
    comes = Body(lambda time: (begins - 10.8 * time, 3.08, math.pi, 10.8))
    found = drive(around(elastic_band), ROAD, 9.58, [steady(83.0, -0.05), comes], 25.0, start=4.0, until=150.0)
    assert found.s[-1] > 150.0
    assert found.least > CLEAR
    assert abs(found.d[-1]) < 0.15
    assert found.d.min() > -0.5


def test_a_car_that_has_come_to_rest_in_a_swerve_does_not_squeeze_past() -> None:
    """A car is in its path from a moment on, 9 m ahead at 8 m/s: braking fully it stops 0.3 m behind."""
    appears, place = 4.0, 8.0 * 4.0 + CAR.rear_axle_to_bumper + 9.0 + 2.25
    late = Body(lambda time: (place, -0.8 if time > appears else -12.0, 0.0, 0.0))
    found = drive(around(elastic_band), ROAD, 8.0, [late], 14.0)
    rest = int(np.argmax(found.speed < 0.05))
    assert found.clearance[rest] > 0.2
    assert found.clearance[rest:].min() > found.clearance[rest] - 0.01
    assert found.speed[rest:].max() < 0.1


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("speed", [2.8, 5.6])
def test_a_slow_car_keeps_out_of_the_way_of_who_comes_head_on(speed: float) -> None:
    """A bicyclist in its lane comes into sight 4 s away, and would run into a car at rest."""
    rides, appears = 15.0 / 3.6, 4.0
    begins = speed * appears + CAR.rear_axle_to_bumper + 4.0 * (speed + rides)

    def place(time: float) -> tuple[float, float, float, float]:
        return begins - rides * (time - appears), -0.8 if time > appears else -40.0, math.pi, rides

    found = drive(
        around(elastic_band, right_m=2.0), ROAD, speed, [Body(place, 1.8, 0.6)], 12.0, start=speed, kinds=["bicycle"]
    )
    assert found.clearance.min() > 0.5
