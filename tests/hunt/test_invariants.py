"""Each invariant is broken by a truth that breaks it and by no other, tick by tick and by hand."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from tests.hunt.course import course
from vve_sumo.drive.termination import Outcome
from vve_sumo.hunt.episode import RoadConditions
from vve_sumo.hunt.invariants import Judges
from vve_sumo.hunt.judging import Tolerances, Violation
from vve_sumo.hunt.simulation import EpisodeDrive
from vve_sumo.hunt.truth import TruthSample
from vve_sumo.live.wording import BRAKES, CONTROL, DRIVING, HELD, ROLLS
from vve_sumo.values import ArmingState, Point, Pose
from vve_sumo.vehicle.interface import HANDS_OFF, ActuationCommand, DriverInputs, Gear

PERIOD = 0.02
INSIDE = (505.0, 0.0)  #: a place of the lot's map that is far from every edge [m]
FOOT = DriverInputs(brake_pedal=0.21)
LIGHT_FOOT = DriverInputs(brake_pedal=0.185)  #: less than 150 N m
FIRM_FOOT = DriverInputs(brake_pedal=0.26)

#: what differs from a drive at a steady 5 m/s in the middle of the lot, at a time after the beginning [s]
Differs = Callable[[float], dict[str, Any]]


def pose(speed: float = 5.0, acceleration: float = 0.0, place: tuple[float, float] = INSIDE) -> Pose:
    return Pose(0.0, Point.REAR_AXLE, *place, 0.0, speed, 0.0, 0.0, acceleration, 0.0)


def command(throttle: float = 0.0, gear: Gear = Gear.NONE, angle: float = 0.0) -> ActuationCommand:
    return ActuationCommand(0.0, throttle, angle, 8.0, gear, enable=True, clear=False)


def sample(time: float, **changes: Any) -> TruthSample:
    usual: dict[str, Any] = {
        "pose": pose(),
        "driver": HANDS_OFF,
        "driver_brake_torque": 0.0,
        "gear": Gear.DRIVE,
        "enabled": (True, True, True),
        "command": command(),
        "state": ArmingState.ENGAGED,
        "reasons": (),
        "phase": DRIVING,
        "operator_command": None,
        "went": True,
        "due": {},
    }
    return TruthSample(time, **usual | changes)


def judged(
    differs: Differs, seconds: float, outcome: Outcome | None = None, reasons: tuple[str, ...] = ()
) -> list[Violation]:
    drive = EpisodeDrive(course(), RoadConditions(), 1)
    judges = Judges(drive.rig, drive.parameters, drive.resolved.model.limits, Tolerances())
    judges.went()
    for tick in range(round(seconds / PERIOD)):
        judges.step(sample(tick * PERIOD, **differs(tick * PERIOD)))
    judges.end(seconds, outcome, reasons)
    return judges.violations


def names(violations: list[Violation]) -> list[str]:
    return [violation.invariant for violation in violations]


def test_a_steady_drive_breaks_nothing() -> None:
    assert judged(lambda time: {"command": command(0.1)}, 10.0, Outcome.STOPPED) == []


def pressed(until: float, closed_at: float, foot: DriverInputs = FIRM_FOOT, *due: str) -> Differs:
    """The foot is on the brake from 1 s on, until a time; the throttle is closed at another."""

    def differs(time: float) -> dict[str, Any]:
        opening = 0.3 if time < closed_at else 0.0
        return {
            "driver": foot if 1.0 <= time < until else HANDS_OFF,
            "command": command(opening),
            "due": dict.fromkeys(due, 0.5),
        }

    return differs


@pytest.mark.parametrize(
    ("closed_at", "foot", "due", "broken"),
    [
        (1.16, FIRM_FOOT, (), False),
        (1.30, FIRM_FOOT, (), True),
        (1.30, FOOT, (), True),
        (1.50, FOOT, ("brake_report_frozen",), False),
        (1.70, FOOT, ("brake_report_frozen",), True),
        (1.30, FIRM_FOOT, ("brake_report_frozen",), True),
        (9.00, LIGHT_FOOT, ("brake_report_frozen",), False),
        (9.00, LIGHT_FOOT, ("brake_driver_bits_zero",), False),
        (1.30, LIGHT_FOOT, ("brake_torque_scaled",), False),
        (1.70, LIGHT_FOOT, ("brake_torque_scaled",), True),
        (1.30, FOOT, ("brake_driver_bits_zero",), True),
        (1.30, FOOT, ("throttle_report_frozen",), True),
        (1.45, FIRM_FOOT, ("brake_report_frozen", "brake_torque_frozen"), False),
        (1.60, FIRM_FOOT, ("brake_report_frozen", "brake_torque_frozen"), True),
        (9.00, FOOT, ("brake_report_frozen", "brake_torque_frozen"), False),
    ],
)
def test_a_foot_closes_the_throttle_in_time(
    closed_at: float, foot: DriverInputs, due: tuple[str, ...], broken: bool
) -> None:
    assert names(judged(pressed(4.0, closed_at, foot, *due), 3.0)) == ["foot_closes_throttle"] * broken


def test_a_fault_that_is_over_excuses_no_later_foot() -> None:
    def after_the_fault(time: float) -> dict[str, Any]:
        return pressed(4.0, 1.5, FOOT)(time) | {"due": {"reports_old": 0.4} if time < 0.9 else {}}

    assert names(judged(after_the_fault, 3.0)) == ["foot_closes_throttle"]


@pytest.mark.parametrize(
    ("torque", "lifted", "due", "broken"),
    [
        (500.0, 2.0, ("brake_report_frozen",), False),
        (500.0, 2.0, (), True),
        (500.0, 2.0, ("brake_torque_frozen",), True),
        (950.0, 2.0, ("brake_report_frozen",), True),
        (500.0, 4.0, ("brake_report_frozen",), True),
    ],
)
def test_a_foot_whose_report_is_frozen_counts_from_when_the_gateway_brakes_less_than_it(
    torque: float, lifted: float, due: tuple[str, ...], broken: bool
) -> None:
    def held_for_two_seconds(time: float) -> dict[str, Any]:
        pressed = 1.0 <= time < lifted
        commanded = command(0.3) if time >= 2.7 else command()._replace(brake_torque=900.0 if time < 2.0 else 0.0)
        return {
            "driver": FIRM_FOOT if pressed else HANDS_OFF,
            "driver_brake_torque": torque if pressed else 0.0,
            "command": commanded,
            "due": dict.fromkeys(due, 0.5),
        }

    assert names(judged(held_for_two_seconds, 3.0)) == ["foot_closes_throttle"] * broken


@pytest.mark.parametrize(("pedal", "broken"), [(0.18, False), (0.181, True)])
def test_a_pedal_that_no_controller_calls_active_has_no_foot_on_it(pedal: float, broken: bool) -> None:
    foot = DriverInputs(brake_pedal=pedal)
    assert names(judged(pressed(4.0, 9.0, foot), 3.0)) == ["foot_closes_throttle"] * broken


@pytest.mark.parametrize(("scale", "broken"), [(0.5, False), (1.5, True)])
def test_torque_that_tells_of_more_than_there_is_hides_no_foot(scale: float, broken: bool) -> None:
    due = {"brake_torque_scaled": scale}
    assert names(judged(lambda time: pressed(4.0, 1.5, FOOT)(time) | {"due": due}, 3.0)) == (
        ["foot_closes_throttle"] * broken
    )


@pytest.mark.parametrize(
    ("closed_at", "pedal", "due", "broken"),
    [
        (1.16, 0.2, (), False),
        (1.30, 0.2, (), True),
        (1.30, 0.2, ("throttle_driver_bits_zero",), True),
        (1.30, 0.2, ("brake_report_frozen",), True),
        (9.00, 0.185, ("throttle_driver_bits_zero",), False),
        (9.00, 0.2, ("throttle_report_frozen",), False),
    ],
)
def test_a_foot_on_the_throttle_closes_it_too(
    closed_at: float, pedal: float, due: tuple[str, ...], broken: bool
) -> None:
    foot = DriverInputs(throttle_pedal=pedal)
    assert names(judged(pressed(4.0, closed_at, foot, *due), 3.0)) == ["foot_on_throttle"] * broken


def test_the_throttle_stays_closed_after_a_foot_on_it_until_a_new_go() -> None:
    def opens_again(time: float) -> dict[str, Any]:
        foot = DriverInputs(throttle_pedal=0.2)
        return pressed(1.5, 1.1, foot)(time) | {"command": command(0.3 if time > 2.0 or time < 1.1 else 0.0)}

    assert names(judged(opens_again, 3.0)) == ["foot_on_throttle"]
    assert judged(lambda time: opens_again(time) | {"went": not 1.7 < time < 1.9}, 3.0) == []


def test_the_throttle_stays_closed_once_the_foot_has_lifted_until_a_new_go() -> None:
    def opens_again(time: float) -> dict[str, Any]:
        return pressed(1.5, 1.1)(time) | {"command": command(0.3 if time > 2.0 or time < 1.1 else 0.0)}

    def with_a_go(time: float) -> dict[str, Any]:
        return opens_again(time) | {"went": not 1.7 < time < 1.9}

    assert names(judged(opens_again, 3.0)) == ["foot_closes_throttle"]
    assert judged(with_a_go, 3.0) == []


def test_a_foot_that_is_there_at_the_go_counts_from_the_go_on() -> None:
    def goes(closed_at: float) -> Differs:
        return lambda time: pressed(4.0, closed_at)(time) | {"went": time > 2.0}

    assert judged(goes(2.1), 3.0) == []
    assert names(judged(goes(2.4), 3.0)) == ["foot_closes_throttle"]


def test_a_car_that_a_foot_has_stopped_does_not_drive_off() -> None:
    def drives_off(time: float) -> dict[str, Any]:
        moving = 0.0 if 1.0 < time < 3.0 else 1.0
        return {"pose": pose(moving), "driver": FOOT if time < 2.5 else HANDS_OFF}

    assert names(judged(drives_off, 5.0)) == ["foot_closes_throttle"]
    assert judged(lambda time: drives_off(min(time, 2.9)), 5.0) == []


def test_the_speed_limit_holds_but_for_a_stuck_throttle_or_a_foot_on_it() -> None:
    fast = {"pose": pose(13.6)}
    assert names(judged(lambda time: fast, 1.0)) == ["speed_limit"]
    assert judged(lambda time: {"pose": pose(13.4)}, 1.0) == []
    assert judged(lambda time: fast | {"due": {"drive_unasked": 0.1}}, 1.0) == []
    assert judged(lambda time: fast | {"driver": DriverInputs(throttle_pedal=0.3), "went": False}, 1.0) == []


@pytest.mark.parametrize(
    ("phase", "brakes", "broken"),
    [(BRAKES, False, []), (DRIVING, False, ["speed_limit"]), (BRAKES, True, ["speed_limit"])],
)
def test_a_car_that_was_pushed_and_has_no_brakes_may_roll_on_while_its_driver_is_called(
    phase: str, brakes: bool, broken: list[str]
) -> None:
    def rolls_on(time: float) -> dict[str, Any]:
        pushed = {"due": {"drive_unasked": 0.5}} if time < 1.0 else {}
        return {"pose": pose(13.6), "phase": phase, "enabled": (brakes, True, True)} | pushed

    assert [name for name in names(judged(rolls_on, 12.0)) if name == "speed_limit"] == broken


def test_the_body_stays_in_the_lot() -> None:
    outside = {"pose": pose(place=(944.0, 0.0))}
    assert names(judged(lambda time: outside, 1.0)) == ["inside_lot"]
    turned = {"driver": DriverInputs(steering_torque=6.0)}
    assert judged(lambda time: outside | turned | {"state": ArmingState.FAULT}, 1.0) == []
    # The gateway goes on commanding: nobody has taken the car over, whatever they touch.
    assert names(judged(lambda time: outside | turned, 1.0)) == ["inside_lot"]
    # Nose over the edge: the rear axle is inside.
    assert names(judged(lambda time: {"pose": pose(place=(938.5, 0.0))}, 1.0)) == ["inside_lot"]


@pytest.mark.parametrize(
    ("brakes", "phase", "left_at", "broken"),
    [
        (False, BRAKES, 6.0, []),
        (False, BRAKES, 4.5, ["inside_lot"]),
        (True, BRAKES, 6.0, ["inside_lot"]),
        (False, "stopping", 6.0, ["inside_lot"]),
    ],
)
def test_a_driver_who_was_called_for_long_brakes_a_car_whose_brakes_are_not_ours(
    brakes: bool, phase: str, left_at: float, broken: list[str]
) -> None:
    """A hand on the wheel ends the watchdog's braking, and commands do not arrive: nobody but the driver can brake."""

    def rolls(time: float) -> dict[str, Any]:
        away = {"pose": pose(3.0, place=(944.0, 0.0))} if time >= left_at else {"pose": pose(3.0)}
        return {"state": ArmingState.STOPPING, "phase": phase, "enabled": (brakes, False, False)} | away

    assert [name for name in names(judged(rolls, 8.0)) if name == "inside_lot"] == broken


def test_a_stop_ends_within_its_bound_or_raises_the_alarm() -> None:
    rolls = {"state": ArmingState.STOPPING, "phase": "stopping"}

    def stops(time: float) -> dict[str, Any]:
        return rolls | {"pose": pose(max(10.0 - 2.5 * max(time - 0.3, 0.0), 0.0))}

    assert judged(stops, 8.0) == []
    assert names(judged(lambda time: rolls | {"pose": pose(10.0)}, 8.0)) == ["stops_in_bound"]
    assert judged(lambda time: rolls | {"pose": pose(10.0), "phase": BRAKES if time > 1.0 else "stopping"}, 8.0) == []
    assert judged(lambda time: rolls | {"pose": pose(10.0), "driver": FIRM_FOOT, "went": False}, 8.0) == []


def test_a_car_that_is_let_go_with_no_driver_counts_as_being_stopped() -> None:
    def let_go(time: float) -> dict[str, Any]:
        return {"state": ArmingState.FAULT, "phase": CONTROL} if time > 1.0 else {}

    def after_a_lever_that_was_refused(time: float) -> dict[str, Any]:
        lever = {"driver": DriverInputs(gear=Gear.PARK)} if time < 0.06 else {}
        return lever | ({"state": ArmingState.FAULT, "phase": CONTROL} if time > 2.0 else {})

    def taken_over(time: float) -> dict[str, Any]:
        return let_go(time) | {"driver": FIRM_FOOT if 0.9 < time < 1.5 else HANDS_OFF}

    assert "stops_in_bound" in names(judged(let_go, 20.0))
    assert "stops_in_bound" in names(judged(after_a_lever_that_was_refused, 20.0))
    assert "stops_in_bound" not in names(judged(taken_over, 20.0))


def test_a_car_that_was_let_go_and_moves_with_no_foot_calls_the_driver() -> None:
    def let_go(speed: float, alarm: str = CONTROL, at: float = 2.3) -> Differs:
        def differs(time: float) -> dict[str, Any]:
            foot = FIRM_FOOT if time < 1.0 else HANDS_OFF
            if time < 0.1:
                return {"driver": foot}
            return {
                "state": ArmingState.FAULT,
                "phase": alarm if time > at else CONTROL,
                "driver": foot,
                "pose": pose(speed),
            }

        return differs

    assert names(judged(let_go(1.0), 2.4)) == []
    (violation,) = judged(let_go(1.0), 4.0)
    assert violation.invariant == "unattended_alarms"
    assert 2.48 < violation.time < 2.56
    assert judged(let_go(1.0, ROLLS), 4.0) == []
    assert names(judged(let_go(1.0, ROLLS, 2.7), 4.0)) == ["unattended_alarms"]
    assert judged(let_go(0.2), 4.0) == []
    # A car that was never driven is its driver's.
    never = {"state": ArmingState.FAULT, "went": False, "driver": FIRM_FOOT}
    assert judged(lambda time: never | ({"driver": HANDS_OFF} if time > 0.1 else {}), 4.0) == []


def test_nobody_is_told_that_a_driver_who_touched_nothing_has_control() -> None:
    let_go = {"state": ArmingState.FAULT, "phase": CONTROL}
    assert names(judged(lambda time: let_go, 1.0)) == ["told_control"]
    assert judged(lambda time: let_go | {"driver": FIRM_FOOT if time < 0.4 else HANDS_OFF}, 1.0) == []
    assert names(judged(lambda time: let_go | {"pose": pose(0.0)}, 1.0)) == ["told_control"]


def test_nobody_is_told_driving_of_a_car_whose_module_is_off() -> None:
    off = {"enabled": (False, True, True)}
    assert names(judged(lambda time: off if time > 1.0 else {}, 3.0)) == ["told_driving"]
    assert judged(lambda time: off if 1.0 < time < 1.4 else {}, 3.0) == []
    assert judged(lambda time: off | {"phase": BRAKES}, 3.0) == []


@pytest.mark.parametrize(
    ("foot", "changes", "broken"),
    [
        (900.0, {}, False),
        (600.0, {}, True),
        (900.0, {"due": {}}, True),
        (900.0, {"enabled": (False, False, True)}, True),
        (900.0, {"command": command()}, True),
    ],
)
def test_brakes_that_a_hidden_foot_works_instead_are_not_yet_seen(
    foot: float, changes: dict[str, Any], broken: bool
) -> None:
    """Of 1200 N m commanded; it counts from when the foot lifts."""
    braking = command()._replace(brake_torque=1200.0)
    usual = {"enabled": (False, True, True), "due": {"brake_report_frozen": math.nan}, "command": braking}
    pressed = usual | {"driver": FIRM_FOOT, "driver_brake_torque": foot} | changes
    assert names(judged(lambda time: pressed if time > 1.0 else {}, 3.0)) == ["told_driving"] * broken
    lifts = judged(lambda time: {} if time <= 1.0 else pressed if time < 2.0 else usual, 3.0)
    assert names(lifts) == ["told_driving"]
    assert lifts[0].time > 2.5 or broken


def test_park_is_not_requested_of_a_moving_car() -> None:
    assert names(judged(lambda time: {"pose": pose(0.3), "command": command(gear=Gear.PARK)}, 1.0)) == [
        "no_park_while_moving"
    ]
    assert judged(lambda time: {"pose": pose(0.0), "command": command(gear=Gear.PARK)}, 1.0) == []


def test_a_car_may_begin_to_roll_while_it_shifts_to_park_and_not_after() -> None:
    def rolls(time: float) -> dict[str, Any]:
        return {"pose": pose(0.0 if time < 0.3 else 0.2), "command": command(gear=Gear.PARK)}

    assert judged(rolls, 0.5) == []
    assert names(judged(rolls, 0.7)) == ["no_park_while_moving"]


def test_a_held_car_stands_or_the_alarm_comes() -> None:
    creeps = {"pose": pose(0.3), "phase": HELD, "went": False, "reasons": ("waiting_for_go",)}
    assert names(judged(lambda time: creeps, 3.0)) == ["held_stands"]
    assert judged(lambda time: creeps | {"phase": BRAKES if time > 0.9 else HELD}, 3.0) == []


def test_steering_commands_keep_to_the_rate_and_the_lateral_jerk() -> None:
    ratio = course().resolved.vehicle.steering_ratio
    rate = course().resolved.vehicle.steering_rate_limit

    def turning(speed: float, by: float) -> Differs:
        return lambda time: {"pose": pose(speed), "command": command(angle=by * ratio * min(time, 0.8))}

    assert judged(turning(0.0, 0.99 * rate), 2.0) == []
    assert names(judged(turning(0.0, 1.1 * rate), 2.0)) == ["steering_commands"]
    # 5 m/s3 of lateral jerk at 10 m/s turns the wheels by 5 * 2.85 / 100 rad/s.
    assert judged(turning(10.0, 0.14), 2.0) == []
    assert names(judged(turning(10.0, 0.28), 2.0)) == ["steering_commands"]


def test_a_drive_into_which_the_driver_stepped_does_not_end_as_stopped() -> None:
    def foot(until: float) -> Differs:
        return lambda time: {"driver": FOOT if 1.0 < time < until else HANDS_OFF}

    for outcome in (Outcome.STOPPED, Outcome.ARRIVED, Outcome.COMPLETED, Outcome.TIMEOUT):
        assert names(judged(foot(2.0), 3.0, outcome, ("end_contact",))) == ["honest_verdict"]
        assert judged(foot(2.0), 3.0, outcome, ("driver_on_brake",)) == []
    assert judged(foot(2.0), 3.0, Outcome.DRIVER) == []
    assert judged(foot(1.2), 3.0, Outcome.STOPPED) == []
