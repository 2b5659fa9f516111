"""What of a car's answer is whose: which monitor hears what, and what is made of its word."""

from __future__ import annotations

import math

import pytest

from tests.vehicle.bare import BARE, CAR, Saying
from vve_sumo.values import Frame
from vve_sumo.vehicle.actuation import Pedals
from vve_sumo.vehicle.dataspeed.layout import BRAKE_REPORT
from vve_sumo.vehicle.interface import BrakeState, BrakeTorque, Report, ThrottleState, WheelSpeeds
from vve_sumo.vehicle.reports import CarReports
from vve_sumo.vehicle.response import ResponseMonitor
from vve_sumo.vehicle.standstill import Standstill

HOLDING = 1000.0  # [N m]
COAST, HELD, BRAKE = Pedals(0.0, 0.0), Pedals(HOLDING, 0.0), Pedals(2000.0, 0.0)
OTHERS = BrakeState(enabled=True, watchdog_braking=True)
NOT_FOLLOWING = ["brake_not_following"]


class Watched:
    """A car that says and does what a test wants, and what is said of it."""

    def __init__(self, *, own_brakes: bool = False) -> None:
        self.monitor, self.wire = ResponseMonitor(CAR, BARE, HOLDING, own_brakes=own_brakes), Saying()
        self.reports, self.standstill, self.now = CarReports(0.5, self.wire), Standstill(), 0.0

    def say(self, *reports: Report) -> None:
        self.wire.said = reports
        self.reports.take(self.now, [Frame(BRAKE_REPORT, b"")])

    def step(
        self,
        elapsed: float,
        commanded: Pedals = COAST,
        wheels: float = 20.0,
        gnss: float = math.nan,
        grade: float = 0.0,
        going: bool = True,
    ) -> list[str]:
        self.now += elapsed
        return self.monitor.step(
            self.now, elapsed, commanded, self.reports, (wheels, gnss), grade, standstill=self.standstill, going=going
        )


# The car does not do what is commanded.


def test_a_car_that_keeps_its_speed_under_its_brakes_does_not_follow() -> None:
    car = Watched()
    assert [car.step(1.0, BRAKE) for _ in range(2)] == [[], NOT_FOLLOWING]


@pytest.mark.parametrize("steps", [1, 2, 5, 10])
@pytest.mark.parametrize("gnss", [math.nan, 20.0])
def test_wheels_that_say_zero_every_other_time_hide_no_brakes_that_fail(steps: int, gnss: float) -> None:
    """20 m/s under 2000 N m, with the evidence for a standstill as the gateway weighs it."""
    car, found = Watched(), []
    for number in range(100):
        wheels = 20.0 if number // steps % 2 == 0 else 0.0
        car.standstill.step(car.now + 0.02, 0.02, wheels, None if gnss != gnss else gnss, 2000.0 / 550.0)
        found.append(car.step(0.02, BRAKE, wheels, gnss))
    assert NOT_FOLLOWING in found
    assert found.index(NOT_FOLLOWING) * 0.02 <= 0.4 + 2 * steps * 0.02


@pytest.mark.parametrize("steps", [1, 2, 5, 10])
def test_wheels_that_say_zero_every_other_time_accuse_no_sound_brakes(steps: int) -> None:
    car = Watched()
    for number in range(200):
        speed = 20.0 - 3.0 * 0.02 * number
        wheels = speed if number // steps % 2 == 0 else 0.0
        car.standstill.step(car.now + 0.02, 0.02, wheels, None, 3.0)
        assert car.step(0.02, BRAKE, wheels, going=False) == []


def test_how_hard_others_brake_is_not_known() -> None:
    car = Watched()
    car.say(OTHERS)
    assert [car.step(1.0, BRAKE) for _ in range(9)] == [[]] * 9


def standing() -> Watched:
    car = Watched()
    car.standstill.certain = car.standstill.at_rest = True
    assert car.step(0.02, HELD, 0.0) == []
    return car


def rolls(car: Watched, commanded: Pedals = HELD) -> list[list[str]]:
    """Its wheels turn with 0.1 m/s."""
    car.say(WheelSpeeds(0.2, 0.2, 0.2, 0.2))
    return [car.step(elapsed, commanded, 0.0) for elapsed in (0.02, 0.09, 0.01)]


def test_a_car_that_rolls_off_under_its_holding_torque_does_not_follow() -> None:
    assert rolls(standing()) == [[], [], NOT_FOLLOWING]


def test_less_than_its_holding_torque_holds_no_car() -> None:
    assert rolls(standing(), Pedals(999.0, 0.0)) == [[], [], []]


def test_a_car_that_others_brake_is_not_held() -> None:
    car = standing()
    car.say(OTHERS)
    assert rolls(car) == [[], [], []]


@pytest.mark.parametrize(("certain", "at_rest"), [(True, False), (False, True)])
def test_only_a_car_that_is_certain_to_be_at_rest_can_roll_off(certain: bool, at_rest: bool) -> None:
    car = Watched()
    car.standstill.certain, car.standstill.at_rest = certain, at_rest
    car.step(0.02, HELD, 0.0)
    assert rolls(car) == [[], [], []]


@pytest.mark.parametrize(("gnss", "found"), [(0.11, NOT_FOLLOWING), (math.nan, [])])
def test_the_receivers_mean_shows_it_too_where_it_is_known(gnss: float, found: list[str]) -> None:
    car = standing()
    car.standstill.gnss_mean = 0.11
    assert [car.step(elapsed, HELD, 0.0, gnss) for elapsed in (0.02, 0.29, 0.01)] == [[], [], found]


# Modules that do not repeat what is commanded.

PUSHED, PUSHED_MORE = Pedals(0.0, 0.2), Pedals(0.0, 0.3)
SAYS_BRAKE, SAYS_THROTTLE = BrakeState(enabled=True, command=2000.0), ThrottleState(enabled=True, command=0.2)


@pytest.mark.parametrize(
    ("first", "then", "says", "found"),
    [
        (BRAKE, Pedals(3000.0, 0.0), SAYS_BRAKE, "brake_report_frozen"),
        (PUSHED, PUSHED_MORE, SAYS_THROTTLE, "throttle_report_frozen"),
    ],
)
def test_a_module_that_goes_on_repeating_an_old_command_is_frozen(
    first: Pedals, then: Pedals, says: Report, found: str
) -> None:
    """Its report counts for a tenth of a second and a microsecond; the command is another one since as long."""
    for age, codes in ((0.0999, []), (0.1 + 5e-7, [found]), (0.1 + 2e-6, [])):
        car = Watched()
        car.say(says)
        assert car.step(0.05, first, 0.0) == []
        car.say(says)
        assert car.step(0.0, then, 0.0) == []
        assert car.step(age, then, 0.0) == codes


def test_all_that_is_wrong_is_said() -> None:
    car = Watched()
    for elapsed, commanded in ((1.0, BRAKE), (1.0, BRAKE), (0.0, BRAKE), (0.0, Pedals(3000.0, 0.0))):
        car.step(elapsed, commanded)
        car.say(SAYS_BRAKE)
    assert car.step(0.02, Pedals(3000.0, 0.0)) == []
    assert car.step(0.08, Pedals(3000.0, 0.0), 25.0) == ["brake_not_following", "brake_report_frozen"]


# A foot.


@pytest.mark.parametrize("after", [1395.0, 1394.5, 1400.0])
def test_a_torque_that_repeats_itself_while_the_command_falls_confirms_no_override(after: float) -> None:
    """The report says 1395 N m under a command of as much, and goes on while 955 hold the car; then it says `after`."""
    car = Watched()
    for number in range(150):
        car.say(BrakeTorque(1395.0))
        car.step(0.02, Pedals(1395.0 if number < 20 else 955.0, 0.0), going=False)
    assert car.monitor.driver_inferred
    assert not car.monitor.confirms_override
    for _ in range(3):
        car.say(BrakeTorque(after))
        car.step(0.02, Pedals(955.0, 0.0), going=False)
    assert car.monitor.driver_inferred
    assert car.monitor.confirms_override == (after != 1395.0)
    car.monitor.reset()
    assert not car.monitor.confirms_override


def test_a_motion_as_under_a_foot_confirms_an_override_whatever_the_torque_says() -> None:
    car = Watched()
    for number in range(200):
        car.say(BrakeTorque(1395.0))
        car.step(0.02, Pedals(1395.0 if number < 20 else 955.0, 0.0), wheels=20.0 - 0.1 * number)
    assert car.monitor.confirms_override


def test_where_others_brake_nothing_confirms_an_override() -> None:
    car = Watched()
    for _ in range(10):
        car.say(BrakeTorque(1395.0), OTHERS)
        car.step(0.02, going=False)
    assert not car.monitor.confirms_override


def test_a_torque_that_nobody_commanded_is_a_foot() -> None:
    car = Watched()
    assert car.monitor.driver_inferred is False
    seen = []
    for elapsed in (0.02, 0.02, 0.02):
        car.say(BrakeTorque(200.0))
        assert car.step(elapsed, going=False) == []
        seen.append(car.monitor.driver_inferred)
    assert seen == [False, False, True]
    assert car.monitor.brakes_latched is False, "a light one"
    car.say(BrakeTorque(0.0))
    car.step(0.02)
    assert car.monitor.driver_inferred is False


def test_a_torque_of_brakes_that_the_car_commands_itself_is_nobodys_foot() -> None:
    car = Watched(own_brakes=True)
    for _ in range(50):
        car.say(BrakeTorque(2000.0))
        assert car.step(0.02, going=False) == []
        assert car.monitor.driver_inferred is False
    assert car.monitor.brakes_latched is False


@pytest.mark.parametrize(("wheels", "foot"), [(19.36, False), (19.34, True)])
def test_missing_speed_is_a_foot(wheels: float, foot: bool) -> None:
    """0.65 m/s in a second, once the brakes that may have held the car have let go."""
    car = Watched()
    car.step(1e12)
    assert car.step(1.0, wheels=wheels) == []
    assert car.monitor.driver_inferred is foot


def test_a_car_that_is_not_yet_going_misses_no_speed() -> None:
    car = Watched()
    car.step(1e12)
    car.step(1.0, wheels=10.0, going=False)
    assert car.monitor.driver_inferred is False
    car.step(1.0, wheels=10.0)
    assert car.monitor.driver_inferred is False, "nor has it missed any before"


def test_where_others_brake_neither_torque_nor_missing_speed_is_a_foot() -> None:
    car = Watched()
    car.step(1e12)
    car.say(OTHERS)
    for _ in range(3):
        car.say(OTHERS, BrakeTorque(200.0))
        car.step(0.02)
        assert car.monitor.driver_inferred is False
    car.step(1.0, wheels=10.0)
    assert car.monitor.driver_inferred is False


def pressed() -> Watched:
    """A car whose driver has pressed hard by the pedal's own report, and slowed it."""
    car = Watched()
    assert car.monitor.brakes_latched is False
    car.say(BrakeState(enabled=True, driver_torque=500.0))
    for elapsed in (1e12, 1.0):
        car.step(elapsed, wheels=20.0)
    car.step(1.0, wheels=15.0)
    assert (car.monitor.driver_inferred, car.monitor.brakes_latched) == (True, True)
    car.say(BrakeState(enabled=True, driver_torque=0.0))
    return car


def test_a_car_that_is_commanded_no_more_keeps_its_latch_and_forgets_its_motion() -> None:
    car = pressed()
    car.monitor.reset()
    assert (car.monitor.driver_inferred, car.monitor.brakes_latched) == (False, True)
    car.step(1.0, wheels=10.0)
    assert (car.monitor.driver_inferred, car.monitor.brakes_latched) == (False, True)


def test_an_engagement_forgets_all_of_it() -> None:
    car = pressed()
    car.monitor.engage()
    assert (car.monitor.driver_inferred, car.monitor.brakes_latched) == (False, False)
    car.step(1.0, wheels=10.0)
    assert (car.monitor.driver_inferred, car.monitor.brakes_latched) == (False, False)


def test_a_reset_forgets_that_the_car_stood() -> None:
    car = standing()
    car.monitor.reset()
    car.standstill.certain = car.standstill.at_rest = False
    assert rolls(car) == [[], [], []]
