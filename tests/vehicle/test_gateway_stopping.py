"""How the gateway stops the car, tells that it stands, parks it and lets it go."""

from __future__ import annotations

import itertools
import math

import pytest

from tests import vehicles
from tests.vehicle.car import FUSION, PERIOD, Car, Rig, enabled
from tests.vehicle.forged_reports import ENABLED_BRAKE, forged
from vve_sumo.values import ArmingState, Frame
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec, layout
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import ActuationCommand, Gear
from vve_sumo.vehicle.standstill import REST_TIME

S = ArmingState


def test_stopping_holds_the_angle_that_the_wheels_have():
    rig = Rig()
    rig.cruise(6.0)
    rig.run(1.0, steering=0.15)
    status = rig.step(1.0, steering=-0.3)  # a last wish that is never reached
    measured = rig.car.wheel_angle / FUSION.steering_ratio
    rig.step(acceleration=1.0, steering=-0.3, command=OperatorCommand.STOP)
    status = rig.step(acceleration=1.0, steering=-0.3)
    assert status.steering == pytest.approx(measured, abs=math.radians(0.1) / FUSION.steering_ratio)
    assert {v.steering for v in rig.run(6.0, steering=-0.3)} == {status.steering}


def test_a_steering_report_that_jumps_does_not_turn_the_wheels_at_once():
    """The wheels at the lock, by a report that lies as the stop begins: the command goes there by the limits."""
    rig = Rig()
    rig.cruise(10.0)
    before = rig.step().steering
    rig.car.forged = forged(codec.SteeringReport(8.0, 0.0, 10.0, 0.0, enabled=True))
    statuses = [rig.step(command=OperatorCommand.STOP), *rig.run(0.1)]
    largest = 10.0 * FUSION.wheelbase / rig.car.speed**2 * PERIOD
    for status in statuses:
        assert abs(status.steering - before) <= 1.1 * largest
        before = status.steering


def test_wheels_that_say_far_too_little_do_not_let_them_turn_faster():
    """The same lie at 10 m/s, while the wheels seem to creep: the limits are those at the receiver's speed."""
    rig = Rig()
    rig.cruise(10.0)
    before = rig.step().steering
    rig.car.forged = forged(codec.SteeringReport(8.0, 0.0, 10.0, 0.0, enabled=True))
    rig.car.forged |= forged(codec.WheelSpeeds(6.0, 6.0, 6.0, 6.0))
    statuses = [rig.step(command=OperatorCommand.STOP), *rig.run(0.1)]
    for status in statuses:
        assert abs(status.steering - before) <= 1.1 * 10.0 * FUSION.wheelbase / rig.car.speed**2 * PERIOD
        before = status.steering


@pytest.mark.parametrize("less", [-0.4, 0.4])
def test_a_receiver_that_says_a_little_else_changes_nothing_of_the_limits(less):
    angles = []
    for wrong in (0.0, less):
        rig = Rig()
        rig.cruise(10.0)
        rig.run(0.04)
        angles.append([rig.step(steering=0.3, speed=rig.car.speed - wrong).steering for _ in range(20)])
    assert angles[0] == angles[1]


def test_stopping_never_releases_brakes_that_are_on():
    rig = Rig()
    rig.cruise(12.0)
    rig.run(0.5, acceleration=-5.5, emergency=True)
    statuses = rig.run(0.8, acceleration=None)
    assert statuses[-1].state is S.STOPPING
    assert {status.acceleration for status in statuses} == {-5.5}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("ticks", [1, 3, 10, 30])
def test_a_fault_on_top_of_an_emergency_does_not_call_it_off(ticks):
    """However early the fault comes, the car stops no later than in the emergency alone, but for a tick's travel."""
    alone, both = Rig(), Rig()
    for rig in (alone, both):
        rig.cruise(12.0)
        rig.car.shift_time = math.inf
        rig.run(ticks * PERIOD, acceleration=-9.0, emergency=True)
    way, way_alone = 0.0, 0.0
    for _ in range(250):
        alone.step(-9.0, emergency=True)
        status = both.step(-9.0, emergency=True, faults=("virtual_contact",))
        way, way_alone = way + both.car.speed * PERIOD, way_alone + alone.car.speed * PERIOD
    assert status.state is S.STOPPED
    assert "virtual_contact" in status.reasons
    assert way <= way_alone + 0.3


@pytest.mark.parametrize("ticks", [1, 3, 10])
def test_a_controller_that_dies_in_an_emergency_does_not_call_it_off(ticks):
    """What comes from the drive then asks for nothing and is no emergency; the car is stopped as hard all the same."""
    rig = Rig()
    rig.cruise(12.0)
    rig.run(ticks * PERIOD, acceleration=-9.0, emergency=True)
    statuses = rig.run(0.6, acceleration=0.0, faults=("controller_raised",))
    assert statuses[-1].state is S.STOPPING
    assert statuses[-1].acceleration == pytest.approx(-9.0)


def test_an_emergency_asked_for_during_a_stop_is_heeded():
    rig = Rig()
    rig.cruise(12.0)
    assert rig.run(0.8, acceleration=0.0, faults=("off_path",))[-1].acceleration == pytest.approx(-2.4)
    assert rig.run(0.5, acceleration=-9.0, emergency=True)[-1].acceleration == pytest.approx(-9.0)
    assert rig.run(0.3, acceleration=0.0)[-1].acceleration == pytest.approx(-9.0), "and not released"


def test_what_a_refused_setpoint_says_is_wrong_counts_all_the_same():
    rig = Rig()
    rig.cruise(8.0)
    status = rig.step(1.0, sequence=0, faults=("pose_stale",))
    assert status.state is S.STOPPING
    assert "pose_stale" in status.reasons


def test_a_fault_beside_an_override_keeps_its_name():
    rig = Rig()
    rig.cruise(8.0)
    rig.car.override = True
    status = [rig.step(0.0, faults=("pose_stale",)) for _ in range(5)][-1]
    assert {"driver_override", "pose_stale"} <= set(status.reasons)


def test_stopping_sets_in_with_bounded_jerk_after_the_throttle_is_gone():
    rig = Rig()
    rig.cruise(10.0)
    rig.run(1.0, acceleration=1.5)
    granted = [rig.step(1.5, command=OperatorCommand.STOP).acceleration] + [v.acceleration for v in rig.run(1.0)]
    assert granted[0] == pytest.approx(-5.0 * PERIOD)
    assert max(a - b for a, b in itertools.pairwise(granted)) <= 5.0 * PERIOD + 1e-12
    assert granted[-1] == -2.4


def test_a_worse_fault_on_the_way_makes_it_brake_harder():
    rig = Rig()
    rig.cruise(12.0)
    rig.step(command=OperatorCommand.STOP)
    assert rig.run(1.0)[-1].acceleration == -2.4
    rig.step(extra=(Frame(codec.BRAKE_COMMAND, bytes(8)),))
    status = rig.run(0.3)[-1]
    assert (status.acceleration, status.reasons) == (-4.0, ("stop_asked", "another_writer"))


def test_stopped_uphill_it_never_touches_the_throttle():
    rig = Rig(Car(grade=0.03))
    rig.cruise(3.0)
    statuses = [rig.step(2.0, command=OperatorCommand.STOP), *rig.run(6.0)]
    assert {status.throttle for status in statuses} == {0.0}


#: From 0.30 m/s the receiver's mean, with a lag of 0.1 s, falls below 0.05 m/s at rest: 0.1 ln(30 / 5) [s].
AVERAGED = 0.18


def test_rest_is_standing_for_a_while():
    rig = Rig()
    rig.cruise(5.0)
    statuses = [rig.step(command=OperatorCommand.STOP)]
    standing = 0
    while statuses[-1].state is not S.STOPPED:
        statuses.append(rig.step())
        standing += rig.car.speed == 0.0
    assert standing * PERIOD == pytest.approx(0.3 + AVERAGED, abs=0.06)


def test_at_rest_it_asks_for_park_and_lets_go_only_there():
    rig = Rig(Car(shift_time=2.0))
    rig.cruise(5.0)
    rig.step(command=OperatorCommand.STOP)
    while rig.step().state is not S.STOPPED:
        assert rig.commands()[3].gear is Gear.NONE
    assert rig.commands()[3].gear is Gear.PARK
    status = rig.step(command=OperatorCommand.DISARM)
    assert (status.state, status.reasons) == (S.STOPPED, ("stop_asked", "not_in_park"))
    while rig.car.gear is not Gear.PARK:
        assert rig.step().state is S.STOPPED
        assert rig.commands()[3].gear is Gear.PARK
        assert enabled(rig) == {True}
        assert not rig.gateway.done
    ticks = 0
    while rig.step(faults=("pose_lost",)).state is S.STOPPED:
        ticks += 1
        assert enabled(rig) == {True}
    assert ticks * PERIOD == pytest.approx(1.0, abs=0.05)
    assert rig.gateway.done
    status = rig.step()
    assert (status.state, status.reasons) == (S.READY, ("stop_asked", "pose_lost")), "it still says how it ended"
    assert enabled(rig) == {False}
    assert {(v.state, v.brake_torque) for v in rig.run(5.0, acceleration=2.0)} == {(S.READY, 0.0)}


@pytest.mark.parametrize(
    "trouble",
    [
        {"silent": {layout.GEAR_REPORT}},
        {"silent": {layout.WHEEL_SPEEDS}},
        {"forged": codec.GearReport(Gear.PARK, fault_bus=True)},
    ],
)
def test_a_park_that_nobody_can_be_sure_of_lets_nothing_go(trouble):
    rig = Rig()
    rig.cruise(5.0)
    rig.step(command=OperatorCommand.STOP)
    while rig.step().state is not S.STOPPED:
        pass
    rig.car.silent = trouble.get("silent", set())
    rig.car.forged = forged(trouble["forged"]) if "forged" in trouble else {}
    assert {v.state for v in rig.run(10.0)} == {S.STOPPED}
    assert rig.car.gear is Gear.PARK or layout.WHEEL_SPEEDS in rig.car.silent
    assert enabled(rig) == {True}
    rig.car.silent, rig.car.forged = set(), {}
    rig.run(2.0)
    assert rig.gateway.done


def test_no_park_is_asked_for_on_wheel_speeds_that_are_old():
    """A car that begins to roll just after its last report is stopped because reports are missing, and may roll."""
    rig = Rig(Car(shift_time=2.0))
    rig.cruise(5.0)
    rig.step(command=OperatorCommand.STOP)
    while rig.step().state is not S.STOPPED:
        pass
    assert rig.commands()[3].gear is Gear.PARK
    rig.car.silent = {layout.WHEEL_SPEEDS}
    asked = 0
    while asked < 10:
        rig.step()
        if rig.commands()[3].gear is not Gear.PARK:
            break
        asked += 1
    assert asked == 3, "0.06 s, however that is rounded"
    rig.car.silent = set()
    rig.step()
    rig.step()
    assert rig.commands()[3].gear is Gear.PARK


def test_no_gear_is_asked_for_while_the_wheels_turn():
    rig = Rig(Car(shift_time=math.inf))
    rig.step(command=OperatorCommand.ENGAGE)
    rig.run(1.0)
    assert rig.commands()[3].gear is Gear.DRIVE
    rig.car.speed = 0.5
    rig.step()
    assert rig.commands()[3].gear is Gear.NONE
    rig.step(command=OperatorCommand.STOP)
    while rig.step().state is not S.STOPPED:
        assert rig.commands()[3].gear is Gear.NONE
    rig.step()
    assert rig.commands()[3].gear is Gear.PARK
    rig.car.speed = 0.5  # pushed from behind
    rig.step()
    assert rig.commands()[3].gear is Gear.NONE
    rig.car.speed = 0.0
    steps = 0
    while rig.commands()[3].gear is Gear.NONE:
        rig.step()
        steps += 1
    assert steps * PERIOD >= REST_TIME, "a car that rolled a moment ago may only seem to stand"


def test_a_brake_module_that_drops_out_calls_the_driver_while_the_car_moves():
    rig = Rig()
    rig.cruise(5.0)
    rig.car.forged = forged(ENABLED_BRAKE._replace(enabled=False))
    statuses = rig.run(0.1)
    assert "brake_disabled" in statuses[-1].reasons
    assert "driver_needed" in statuses[-1].reasons


def test_after_parking_another_controller_may_count_from_zero():
    rig = Rig()
    rig.engage()
    rig.step(command=OperatorCommand.STOP)
    rig.run(3.0)
    rig.sequence = -1
    assert rig.gateway.monitor.sequence > 100
    rig.step(command=OperatorCommand.DISARM)
    assert rig.gateway.monitor.sequence == -1
    rig.run(0.1)
    assert rig.gateway.monitor.sequence == rig.sequence
    rig.engage()
    assert not rig.gateway.done
    rig.run(1.0, acceleration=1.0)
    assert rig.car.speed > 0.3


def _torques(fault: str, brake_gain: float = 1.6) -> list[float]:
    """Brake torques of a stop by a fault [N m], on a car that brakes so many times as hard as is believed of it."""
    rig, torques = Rig(Car(brake_gain=brake_gain)), []
    rig.cruise(12.0)
    rig.step(0.0, process_faults=(fault,))
    for _ in range(60):
        assert rig.step(0.0).state is S.STOPPING
        torques.append(rig.commands()[0].value)
    return torques


@pytest.mark.parametrize("fault", ["reports_inconsistent", "speed_mismatch", "wheel_speeds_frozen"])
def test_where_the_speed_is_in_doubt_the_car_that_seems_to_brake_too_hard_is_braked_no_softer(fault):
    """Where it is known, the torque goes back as the wheels slow down faster than asked."""
    known, doubted = _torques("pose_stale"), _torques(fault)
    assert min(known[30:]) < 0.8 * max(known)
    assert doubted == sorted(doubted)
    assert all(mine >= its for mine, its in zip(doubted, known, strict=True))


@pytest.mark.parametrize("fault", ["reports_inconsistent", "speed_mismatch", "wheel_speeds_frozen"])
def test_where_the_speed_is_in_doubt_the_car_that_seems_to_brake_too_little_is_braked_harder(fault):
    assert max(_torques(fault, 0.7)) > 1.1 * max(_torques(fault, 1.0))


class Asking(DataspeedDbw1):
    """An interface that keeps the newest acceleration that it is asked for [m/s2]."""

    acceleration = math.nan

    def encode(self, command: ActuationCommand) -> tuple[Frame, ...]:
        self.acceleration = command.acceleration
        return super().encode(command)


@pytest.mark.parametrize(("brake_gain", "harder"), [(0.7, 1.1), (1.6, 1.0)])
def test_where_the_speed_is_in_doubt_an_acceleration_is_asked_for_that_is_the_lesser_of_both(brake_gain, harder):
    """Of a car that takes accelerations: the stop's without a speed, or that which the wheels ask for."""
    asking = Asking()
    rig = Rig(Car(brake_gain=brake_gain), Gateway(FUSION, vehicles.FUSION.calibration, period=PERIOD, interface=asking))
    rig.cruise(12.0)
    rig.step(0.0, process_faults=("speed_mismatch",))
    ratios = []
    for _ in range(60):
        status = rig.step(0.0)
        assert asking.acceleration <= status.acceleration
        ratios.append(asking.acceleration / status.acceleration)
    assert max(ratios[10:]) == pytest.approx(harder, abs=1e-9) if harder == 1.0 else max(ratios) > harder


def test_wheels_that_are_heard_again_do_not_soften_a_stop():
    """What the car lost meanwhile came by braking as hard as asked: it is no sign of brakes that bite too hard."""
    rig = Rig()
    rig.cruise(16.0)
    rig.run(0.2, acceleration=None)
    rig.car.silent = {layout.WHEEL_SPEEDS}
    rig.run(0.3, acceleration=None)
    unheard = rig.commands()[0].value
    rig.car.silent = set()
    for _ in range(20):
        assert rig.step(None).state is S.STOPPING
        assert rig.commands()[0].value > 0.8 * unheard, "less what is braked against creep where nobody knows of it"
