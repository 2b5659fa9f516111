"""A driver's foot on the whole simulated car while reports fail: the throttle closes at once, and stays so."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from tests.vehicle.foot import Alter, Course, Frozen, bits_at_zero, foot_comes, foot_unseen, under_way
from tests.vehicle.whole_car import PARAMETERS, PERIOD, WholeCar
from vve_sumo.values import ArmingState, Frame
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import layout
from vve_sumo.vehicle.dataspeed.pedals import pedal_to_torque
from vve_sumo.vehicle.interface import HANDS_OFF, DriverInputs

S = ArmingState
FULL, FIRM, STRONG_TOUCH, TOUCH = 0.30, 0.26, 0.215, 0.20  # pedal sensor
FROZEN = 1.0  # before the foot comes, the reports that shall be frozen are already [s]


def whatever(frame: Frame) -> Frame:
    return frame


#: What is wrong with the reports, made anew for each drive; only the car's motion is left in the last one.
REPORTS = {
    "sound": lambda: whatever,
    "brake report frozen": lambda: Frozen((layout.BRAKE_REPORT,)),
    "bits at zero": lambda: bits_at_zero,
    "bits and pedal at zero": lambda: foot_unseen,
    "brake report and brake torque frozen": lambda: Frozen((layout.BRAKE_REPORT, layout.BRAKE_INFO)),
}
BY_MOTION_ALONE = "brake report and brake torque frozen"
#: Time within which the throttle is closed [s]. The deceleration alone takes longer to tell from a sound car.
WITHIN = dict.fromkeys(REPORTS, 0.2) | {BY_MOTION_ALONE: 0.3}


def comes(reports: str, pedal: float, lasts: float, **arguments: float) -> tuple[WholeCar, Course]:
    whole = WholeCar()
    under_way(whole)
    alter: Alter = REPORTS[reports]()
    return whole, foot_comes(whole, DriverInputs(brake_pedal=pedal), lasts, alter, FROZEN, **arguments)


def test_the_pedal_positions_are_the_torques_that_are_meant():
    torques = [pedal_to_torque(pedal) for pedal in (FULL, FIRM, STRONG_TOUCH, TOUCH)]
    assert torques == pytest.approx([2463.0, 1200.0, 460.0, 287.0], abs=1.0)


#: By motion alone a gentle foot is not told from a slope and a weak engine.
FEET = [
    (reports, pedal, lasts)
    for reports in REPORTS
    for pedal, lasts in ((FULL, 4.0), (FIRM, 6.0), (STRONG_TOUCH, 4.0), (TOUCH, 4.0))
    if reports != BY_MOTION_ALONE or pedal >= FIRM
]


@pytest.mark.thorough(witnesses=6)
@pytest.mark.parametrize(("reports", "pedal", "lasts"), FEET)
def test_a_foot_closes_the_throttle_at_once_and_the_car_does_not_drive_off_when_it_lifts(reports, pedal, lasts):
    whole, course = comes(reports, pedal, lasts)
    assert course.throttle_closed <= WITHIN[reports]
    assert all(status.throttle == 0.0 for time, status in course.statuses if time >= WITHIN[reports])
    assert course.noticed[0] <= WITHIN[reports]
    assert course.reasons & {"driver_on_brake", "driver_inferred"}
    taken_over = course.statuses[-1][1].state is S.FAULT
    # Whoever has taken over a car in drive must hold it: it creeps, and the gateway calls for him.
    fastest = max(speed for time, speed in course.speeds if time > lasts)
    assert fastest < 1.5 if taken_over else fastest == 0.0
    assert not taken_over or {"driver_override", "driver_needed"} <= course.reasons
    assert course.statuses[-1][1].state in {S.DISARMED, S.READY, S.FAULT}
    for _ in range(50):
        assert whole.step(2.0, command=OperatorCommand.GO).throttle == 0.0


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("reports", ["sound", "brake report frozen", "bits at zero", "bits and pedal at zero"])
@pytest.mark.parametrize("lasts", [0.15, 0.5])
def test_a_foot_that_takes_the_brakes_and_lifts_again_is_said_and_the_driver_is_called(reports, lasts):
    """The module is latched from 0.1 s on: no brakes are left in a car that rolls, whatever its report says of it."""
    whole, course = comes(reports, FULL, lasts, seconds=4.0)
    assert whole.car.interface.controller.brake.override
    assert course.throttle_closed <= 0.2
    rolling = [status for time, status in course.statuses if time > lasts + 1.6]
    assert course.speeds[-1][1] > 0.5
    assert all("driver_needed" in status.reasons for status in rolling)
    assert all(status.state is S.FAULT or "brakes_latched" in status.reasons for status in rolling)


@pytest.mark.parametrize("reports", ["sound", "brake report frozen"])
def test_after_a_foot_only_a_new_engagement_and_a_new_go_move_the_car(reports):
    whole, course = comes(reports, TOUCH, 4.0)
    assert course.speeds[-1][1] == 0.0
    for _ in range(100):
        whole.step(2.0)
    assert whole.car.truth().speed == 0.0
    whole.engage()
    for _ in range(100):
        whole.step(1.5)
    assert whole.car.truth().speed > 1.0


@pytest.mark.parametrize("pedal", [0.20, 0.35])
def test_a_foot_on_the_throttle_ends_the_drive_with_bits_at_zero_too(pedal):
    def unseen(frame: Frame) -> Frame:
        if frame.id != layout.THROTTLE_REPORT:
            return frame
        return Frame(frame.id, frame.data[:-1] + bytes([frame.data[-1] & ~0x06]))

    whole = WholeCar()
    under_way(whole)
    course = foot_comes(whole, DriverInputs(throttle_pedal=pedal), 0.5, unseen, seconds=8.0)
    assert course.noticed == (pytest.approx(PERIOD), ("driver_on_throttle",))
    assert all(status.throttle == 0.0 for time, status in course.statuses if time > 0.5 * PERIOD)
    assert course.speeds[-1][1] < 1.5


# An override that is nobody's.


@dataclass
class Claims:
    """Sets the override bit in reports of one identifier, for some steps."""

    identifier: int
    byte: int
    bit: int
    frames: int

    def __call__(self, frame: Frame) -> Frame:
        if frame.id != self.identifier or self.frames <= 0:
            return frame
        self.frames -= 1
        data = bytearray(frame.data)
        data[self.byte] |= self.bit
        return Frame(frame.id, bytes(data))


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize(
    ("identifier", "byte", "bit", "frames"),
    [
        (layout.BRAKE_REPORT, 7, 0x02, 3),
        (layout.THROTTLE_REPORT, 7, 0x02, 3),
        (layout.STEERING_REPORT, 7, 0x02, 3),
        (layout.GEAR_REPORT, 0, 0x08, 1),
    ],
    ids=["brake", "throttle", "steering", "gear"],
)
def test_a_false_override_of_50_ms_keeps_braking_and_raises_the_alarm(identifier, byte, bit, frames):
    whole = WholeCar()
    under_way(whole)
    begun = whole.distance
    course = foot_comes(whole, HANDS_OFF, 0.0, Claims(identifier, byte, bit, frames))
    noticed, reasons = course.noticed
    assert noticed <= 0.06
    assert {"override_unconfirmed", "driver_needed"} <= set(reasons)
    assert "driver_override" not in course.reasons
    # 5 m/s at the gateway's 2.4 m/s2, whose jerk and whose brakes take half a second to get there.
    assert whole.distance - begun < 5.0**2 / (2.0 * 2.4) + 0.5 * 5.0
    assert whole.car.truth().speed == 0.0
    assert {status.state for _time, status in course.statuses} <= {
        S.ENGAGED,
        S.STOPPING,
        S.STOPPED,
        S.DISARMED,
        S.READY,
    }
    moving = [status for (time, status), (_, speed) in zip(course.statuses, course.speeds, strict=True)
              if time >= noticed and speed > 0.1]  # fmt: skip
    assert all("driver_needed" in status.reasons for status in moving)
    assert max(status.brake_torque for status in moving) > 0.9 * 2.4 * PARAMETERS.calibration.brake_gain


def test_a_real_override_still_gets_the_car_within_a_step_of_its_report():
    whole = WholeCar()
    under_way(whole)
    course = foot_comes(whole, DriverInputs(brake_pedal=FULL), 4.0, seconds=4.0)
    given = next(time for time, status in course.statuses if status.state is S.FAULT)
    assert given <= 0.1 + 2 * PERIOD
    assert "override_unconfirmed" not in course.reasons
