"""Whatever goes wrong stops the car; small and short troubles are forgiven."""

from __future__ import annotations

import math

import pytest

from tests.vehicle.car import PERIOD, Rig, enabled
from tests.vehicle.forged_reports import ENABLED_BRAKE, ENABLED_STEERING, ENABLED_THROTTLE, forged
from vve_sumo.values import ArmingState, FallbackPath, Frame
from vve_sumo.vehicle.arming import CRITICAL
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.interface import Gear

S = ArmingState


# Everything that stops the car. Each row: reason, what is done to the rig from then on (a dict of arguments for every
# step, after an optional change of the car), and whether the stop must be the hard one.
FAULTS = [
    *[(f"{name}_report_stale", {"silent": {identifier}}, {}) for name, identifier in (
        ("brake", layout.BRAKE_REPORT), ("throttle", layout.THROTTLE_REPORT), ("steering", layout.STEERING_REPORT),
        ("gear", layout.GEAR_REPORT))],
    ("yaw_rate_stale", {"silent": {layout.YAW_RATE}}, {}),
    *[(f"{name}_fault", {"forged": report._replace(**{flag: True})}, {}) for name, report, flags in (
        ("brake", ENABLED_BRAKE, ("fault_channel_1", "fault_channel_2", "fault_power")),
        ("throttle", ENABLED_THROTTLE, ("fault_channel_1", "fault_channel_2", "fault_power")),
        ("steering", ENABLED_STEERING, ("fault_bus_1", "fault_bus_2", "fault_calibration", "fault_power")),
    ) for flag in flags],
    *[(reason, {"forged": report._replace(**changes)}, {}) for name, report in (
        ("brake", ENABLED_BRAKE), ("throttle", ENABLED_THROTTLE), ("steering", ENABLED_STEERING),
    ) for reason, changes in (
        (f"{name}_timeout", {"timeout": True, "enabled": False}), (f"{name}_disabled", {"enabled": False}),
        ("dbw_watchdog", {"fault_watchdog": True}),
    )],
    *[(reason, {"forged": report}, {}) for reason, report in (
        ("dbw_braking", ENABLED_BRAKE._replace(watchdog_braking=True)),
        ("report_invalid", ENABLED_STEERING._replace(wheel_angle=math.nan)),
        ("report_invalid", codec.YawRate(0.0, math.nan)),
        ("gear_fault", codec.GearReport(Gear.DRIVE, fault_bus=True)),
        ("gear_lost", codec.GearReport(Gear.NEUTRAL)))],
    ("report_malformed", {"forged": Frame(layout.BRAKE_REPORT, bytes(7))}, {}),
    *[("another_writer", {}, {"extra": (Frame(identifier, bytes(8)),)}) for identifier in sorted(layout.COMMAND_IDS)],
    ("setpoint_expired", {}, {"acceleration": None}),
    ("setpoint_expired", {}, {"sequence": 7}),
    ("setpoint_expired", {}, {"expires": 1e9}),
    ("setpoint_expired", {}, {"time": 1e9, "expires": 1e9}),
    ("setpoint_expired", {}, {"expires": 0.0}),
    ("setpoint_incomplete", {}, {"sequence": -1}),
    ("setpoint_incomplete", {}, {"expires": math.nan}),
    ("setpoint_incomplete", {}, {"time": math.nan}),
    ("setpoint_not_finite", {}, {"acceleration": math.nan}),
    ("setpoint_not_finite", {}, {"acceleration": -math.inf}),
    ("setpoint_not_finite", {}, {"steering": math.nan}),
    ("setpoint_not_finite", {}, {"grade": math.inf}),
    ("outside_geofence", {}, {"faults": ("outside_geofence",)}),
    ("setpoint_not_finite", {}, {"speed": math.nan}),
    ("yaw_rate_mismatch", {}, {"yaw_rate": 0.15}),
    ("setpoint_not_finite", {}, {"yaw_rate": math.nan}),
    ("profile_invalid", {}, {"fallback_path": FallbackPath(1.0, (0.0, math.nan))}),
    ("bus_down", {}, {"process_faults": ("bus_down",)}),
    ("setpoint_corrupt", {}, {"process_faults": ("setpoint_corrupt",)}),
    ("operator_gone", {}, {"process_faults": ("operator_gone",)}),
    ("a_code_that_nobody_knows", {}, {"process_faults": ("a_code_that_nobody_knows",)}),
    ("stop_asked", {}, {"command": OperatorCommand.STOP}),
    ("stop_asked_by_page", {}, {"command": OperatorCommand.STOP_BY_PAGE}),
    ("disarm_asked", {}, {"command": OperatorCommand.DISARM}),
]  # fmt: skip


@pytest.mark.thorough(witnesses=12)
@pytest.mark.parametrize(("reason", "car", "step"), FAULTS)
def test_whatever_goes_wrong_brings_the_car_to_rest_and_keeps_it_there(reason, car, step):
    rig = Rig()
    rig.cruise(10.0)
    rig.car.shift_time = math.inf  # and park is refused
    rig.car.silent = car.get("silent", set())
    rig.car.forged = forged(car["forged"]) if "forged" in car else {}
    arguments = {"acceleration": 1.0} | step
    first = rig.step(**arguments)
    arguments.pop("command", None)

    statuses = [first, *rig.run(0.7, **arguments)]
    at = next(i for i, status in enumerate(statuses) if status.state is not S.ENGAGED)
    assert statuses[at].state is S.STOPPING
    assert statuses[at].reasons[0] == reason
    assert all(status.throttle == 0.0 for status in statuses[at:])

    rig.car.enabled = True  # whatever a forged report says, this kit obeys
    before = rig.car.speed
    rig.run(1.5, **arguments)
    expected = 4.0 if reason in CRITICAL else 2.4
    after = rig.car.speed
    rig.run(0.4, **arguments)
    assert before > after
    assert (after - rig.car.speed) / 0.4 == pytest.approx(expected, abs=0.15)
    assert enabled(rig) == {True}

    statuses = rig.run(8.0, **arguments)
    assert statuses[-1].state is S.STOPPED
    assert {status.throttle for status in statuses} == {0.0}
    assert statuses[-1].reasons[0] == reason
    assert enabled(rig) == {True}
    rig.car.forged, rig.car.silent = {}, set()
    for tick in range(round(20.0 / PERIOD)):
        status = rig.step(2.0, command=(OperatorCommand.ENGAGE, OperatorCommand.GO, OperatorCommand.DISARM)[tick % 3])
        assert status.state is S.STOPPED, "no way from stopped to engaged, and none to a car that creeps"
        assert rig.car.speed == 0.0
    assert not rig.gateway.done


@pytest.mark.parametrize(
    ("silent", "faults", "needed"),
    [
        ({layout.BRAKE_REPORT}, (), True),
        ({layout.WHEEL_SPEEDS}, (), True),
        (set(), ("bus_down",), True),
        ({layout.GEAR_REPORT}, (), False),
        ({layout.THROTTLE_REPORT}, (), False),
    ],
)
def test_the_driver_is_called_where_nobody_hears_how_the_car_brakes(silent, faults, needed):
    rig = Rig()
    rig.cruise(10.0)
    rig.car.silent = silent
    statuses = rig.run(1.5, 0.0, process_faults=faults)
    assert statuses[-1].state is S.STOPPING
    assert rig.car.speed > 3.0
    assert ("driver_needed" in statuses[-1].reasons) is needed


def test_without_wheel_speeds_the_car_is_stopped_blindly_and_held():
    rig = Rig()
    rig.cruise(10.0)
    rig.car.silent = {layout.WHEEL_SPEEDS}
    statuses = rig.run(10.0, acceleration=1.0, speed=0.0, faults=("pose_stale",))
    assert statuses[-1].state is S.STOPPING, "nobody can tell that it stands, and a guessed pose says nothing"
    assert "wheel_speeds_stale" in statuses[-1].reasons
    assert rig.car.speed == 0.0
    assert statuses[-1].brake_torque > 2000.0


def test_without_wheel_speeds_the_receiver_tells_after_a_while_that_the_car_stands():
    """It is held then, and left to its driver: nobody asks for park on the word of one."""
    rig = Rig()
    rig.cruise(10.0)
    rig.car.silent = {layout.WHEEL_SPEEDS}
    stood = math.inf
    while rig.step(1.0).state is not S.STOPPED:
        stood = rig.now if rig.car.speed > 0.3 else stood
    assert rig.now - stood == pytest.approx(3.25, abs=0.1)
    statuses = rig.run(5.0)
    assert {status.state for status in statuses} == {S.STOPPED}
    assert all({"standstill_uncertain", "driver_needed"} <= set(status.reasons) for status in statuses)
    assert rig.commands()[3].gear is Gear.NONE
    assert min(status.brake_torque for status in statuses) > 2000.0
    assert not rig.gateway.done


@pytest.mark.parametrize("wheel", range(4))
def test_an_invalid_wheel_counts_as_no_speed(wheel):
    rig = Rig()
    rig.cruise(10.0)
    speeds = [30.0] * 4
    speeds[wheel] = math.nan
    rig.car.forged = forged(codec.WheelSpeeds(*speeds))
    statuses = rig.run(6.0, acceleration=1.0)
    assert statuses[0].state is S.STOPPING
    assert "report_invalid" in statuses[0].reasons
    assert rig.car.speed == 0.0


def test_a_steering_that_does_not_follow_stops_the_car():
    rig = Rig()
    rig.cruise(5.0)
    rig.car.steering_stuck = True
    statuses = rig.run(4.0, steering=0.4)
    assert (statuses[-1].state, statuses[-1].reasons[0]) == (S.STOPPED, "steering_not_following")


@pytest.mark.parametrize("gap", [0.041, 0.5, 0.0, -0.02, math.nan, math.inf])
def test_a_gateway_that_was_not_run_in_time_stops_the_car(gap):
    rig = Rig()
    rig.cruise(10.0)
    late = rig.now + gap
    output = rig.gateway.step(late, rig.setpoint(1.0), rig.car.reports())
    assert (output.status.state, output.status.reasons[0]) == (S.STOPPING, "timer_gap")
    assert output.status.throttle == 0.0


def test_a_missed_period_is_forgiven():
    rig = Rig()
    rig.cruise(10.0)
    rig.tick += 1
    assert rig.step(0.0).state is S.ENGAGED


@pytest.mark.parametrize("trouble", ["timer_gap", "another_writer"])
def test_its_own_troubles_latch_before_engaging_too(trouble):
    rig = Rig()
    rig.run(0.1)
    if trouble == "timer_gap":
        rig.tick += 10
        status = rig.step()
    else:
        status = rig.step(extra=(Frame(layout.GEAR_COMMAND, b"\x04"),))
    assert (status.state, status.reasons) == (S.FAULT, (trouble,))
    assert rig.step(command=OperatorCommand.ENGAGE).state is S.FAULT
    assert rig.step(command=OperatorCommand.DISARM).state is S.DISARMED
    assert rig.step().state is S.READY


def test_a_lone_reordered_or_doubled_setpoint_is_passed_over_and_named():
    rig = Rig()
    rig.cruise(10.0)
    status = rig.step(2.0, sequence=rig.sequence)
    assert (status.state, status.reasons) == (S.ENGAGED, ("setpoint_out_of_order",))
    assert status.acceleration < 0.2
    assert rig.step(0.0).reasons == ()


def test_a_setpoint_is_used_until_it_expires_and_not_a_tick_longer():
    rig = Rig()
    rig.cruise(10.0)
    statuses = rig.run(0.14, acceleration=None)
    assert [status.state for status in statuses] == [S.ENGAGED] * 5 + [S.STOPPING] * 2


@pytest.mark.parametrize(("speed", "yaw_rate"), [(-0.6, 0.0), (0.6, 0.0), (0.0, 0.09), (0.0, -0.09)])
def test_small_differences_between_satellite_and_car_are_forgiven(speed, yaw_rate):
    rig = Rig()
    rig.cruise(10.0)
    for tick in range(100):
        # A gyroscope is never still to the last bit.
        rig.car.forged = forged(codec.YawRate(0.0, 0.001 * (tick % 2)))
        status = rig.step(0.0, speed=rig.car.speed + speed, yaw_rate=yaw_rate)
    assert status.state is S.ENGAGED


@pytest.mark.parametrize(("difference", "ticks"), [(-1.5, 24), (1.5, 24), (-10.0, 4)])
def test_a_short_difference_is_forgiven(difference, ticks):
    rig = Rig()
    rig.cruise(10.0)
    for tick in range(200):
        status = rig.step(0.0, speed=rig.car.speed + (difference if tick % (ticks + 1) else 0.0))
    assert status.state is S.ENGAGED
