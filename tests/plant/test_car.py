"""The whole simulated vehicle: frames in, frames and bytes out."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_filter

from tests import vehicles
from vve_sumo.frames import Alignment, MapFrame, Mounting, Placement
from vve_sumo.plant.car import Car, CarOutput, CarParameters
from vve_sumo.pose.ncom import Decoder
from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec, layout, messages
from vve_sumo.vehicle.interface import Gear, InterfaceConfig
from vve_sumo.vehicle.model import IDEAL

LOT = MapFrame("+proj=tmerc +lat_0=40 +lon_0=-82.98 +k=1 +x_0=0 +y_0=0 +datum=WGS84 +units=m +no_defs")
EPOCH = 1_447_000_000.0
START = (12.0, -7.0, 0.7)
TICK = 0.02
Command = tuple[float, float, float]  # brake torque, throttle, steering-wheel angle


def commands(tick: int, command: Command) -> list[Frame]:
    torque, throttle, wheel = command
    count = tick & 255
    return [
        codec.encode(messages.BrakeCommand(messages.BrakeKind.TORQUE, torque, True, count)),
        codec.encode(messages.ThrottleCommand(messages.ThrottleKind.PERCENT, throttle, True, count)),
        codec.encode(messages.SteeringCommand(wheel, 0.0, True, count)),
        codec.encode(messages.GearCommand(Gear.DRIVE)),
    ]


def ride(car: Car, seconds: float, plan: Callable[[float], Command], start: float = 0.0) -> Iterator[CarOutput]:
    for tick in range(round(start / TICK), round((start + seconds) / TICK)):
        yield car.step((tick + 1) * TICK, commands(tick, plan(tick * TICK)))


def make(parameters: CarParameters | None = None, seed: int = 1) -> Car:
    return Car(parameters or vehicles.parameters(), START, LOT, EPOCH, np.random.SeedSequence(seed))


def in_drive(parameters: CarParameters | None = None) -> Car:
    """Enabled, in drive, held at rest, one second old."""
    car = make(parameters)
    for _ in ride(car, 1.0, lambda _: (1500.0, 0.0, 0.0)):
        pass
    assert car.interface.gear is Gear.DRIVE
    return car


def town(time: float) -> Command:
    """Shift, drive off, weave, brake to rest."""
    if time < 1.0 or time > 9.0:
        return 1500.0, 0.0, 0.0
    return 0.0, 0.25, 0.8 * math.sin(time)


def test_two_rides_with_one_seed_are_the_same_to_the_bit() -> None:
    first, second, other = ([*ride(make(seed=seed), 12.0, town)] for seed in (1, 1, 2))
    assert first == second
    assert [output.packets for output in first] != [output.packets for output in other]


def test_truth_does_not_depend_on_the_noise() -> None:
    noisy, quiet = make(), make(vehicles.parameters(noise=0.0))
    for _ in zip(ride(noisy, 12.0, town), ride(quiet, 12.0, town), strict=True):
        assert noisy.truth() == quiet.truth()


def test_reports_come_at_their_rates() -> None:
    frames = [frame for output in ride(make(), 10.0, town) for _, frame in output.reports]
    assert Counter(frame.id for frame in frames) == {
        layout.BRAKE_REPORT: 500, layout.THROTTLE_REPORT: 500, layout.STEERING_REPORT: 500, layout.BRAKE_INFO: 500,
        layout.GEAR_REPORT: 200, layout.WHEEL_SPEEDS: 1000, layout.ACCELERATIONS: 1000, layout.YAW_RATE: 1000,
    }  # fmt: skip


def test_what_is_said_is_said_in_order_and_within_its_step() -> None:
    for tick, output in enumerate(ride(make(), 2.0, town)):
        for said in (output.reports, output.packets):
            times = [time for time, _ in said]
            assert times == sorted(times)
            assert all(tick * TICK - 1e-9 < time <= (tick + 1) * TICK + 1e-9 for time in times)


@pytest.mark.parametrize("variant", list(codec.Variant))
def test_sensors_report_the_motion(variant: codec.Variant) -> None:
    interface = InterfaceConfig("dataspeed_dbw1", {"variant": variant.name.lower()})
    parameters = vehicles.parameters(noise=0.0, interface=interface)
    car, radius = make(parameters), parameters.vehicle.wheel_radius
    for output in ride(car, 9.0, town):
        truth = car.truth()
        said = {type(message): message for _, frame in output.reports if (message := codec.decode(frame, variant))}
        wheels, yaw, steering = said[messages.WheelSpeeds], said[messages.YawRate], said[messages.SteeringReport]
        assert isinstance(wheels, messages.WheelSpeeds)
        assert isinstance(yaw, messages.YawRate)
        assert isinstance(steering, messages.SteeringReport)
        assert 0.5 * radius * (wheels.rear_left + wheels.rear_right) == pytest.approx(truth.speed, abs=0.005)
        difference = radius * (wheels.rear_right - wheels.rear_left) / parameters.track
        assert difference == pytest.approx(truth.yaw_rate, abs=0.005)
        assert yaw.yaw == pytest.approx(truth.yaw_rate, abs=2e-4)
        assert steering.speed == pytest.approx(truth.speed, abs=0.005)
        # Rolling without slip at the front: the outer wheel runs on the larger circle.
        if truth.speed < 1.0 and truth.speed > 0.2:
            mean = 0.5 * (wheels.front_left + wheels.front_right) * radius
            assert mean == pytest.approx(truth.speed / math.cos(steering.wheel_angle / 14.8), abs=0.01)


def test_ncom_placed_with_the_declared_mounting_is_the_truth() -> None:
    mounting = Mounting(0.9, -0.3, 0.01)
    car = make(vehicles.parameters(mounting, noise=0.0, delay=0.0, grade=0.02))
    decoder, placement = Decoder(), Placement(LOT, Alignment(), mounting, EPOCH)
    for output in ride(car, 10.0, town):
        fixes = [fix for time, data in output.packets for fix in decoder.feed(data, time)]
        pose, truth = placement.place(fixes[-1]), car.truth()
        assert pose.time == pytest.approx(truth.time, abs=1e-6)
        assert math.hypot(pose.x - truth.x, pose.y - truth.y) < 1e-5
        assert pose.heading == pytest.approx(truth.heading, abs=2e-6)
        assert (pose.speed, pose.lateral_speed) == pytest.approx((truth.speed, truth.lateral_speed), abs=3e-4)
        assert (pose.yaw_rate, pose.grade) == pytest.approx((truth.yaw_rate, truth.grade), abs=1e-5)
    assert fixes[-1].altitude > 220.0 + 0.015 * math.hypot(truth.x - START[0], truth.y - START[1])


def test_in_park_the_car_stands_even_on_a_hill() -> None:
    car = make(vehicles.parameters(grade=0.1))
    before = car.truth()
    for tick in range(500):
        car.step((tick + 1) * TICK, [])
    after = car.truth()
    assert (after.x, after.y, after.heading, after.speed) == (before.x, before.y, before.heading, 0.0)


def test_held_in_drive_on_a_grade_for_a_minute_without_motion() -> None:
    car = in_drive(vehicles.parameters(grade=0.03))
    for _ in ride(car, 60.0, lambda _: (500.0, 0.0, 0.0), start=1.0):
        pass
    assert (car.truth().x, car.truth().y) == START[:2]


def test_released_in_drive_the_car_creeps_at_the_speed_where_creep_meets_rolling_drag() -> None:
    car = in_drive()
    for _ in ride(car, 40.0, lambda _: (0.0, 0.0, 0.0), start=1.0):
        pass
    c = vehicles.FUSION.calibration
    rolling = c.rolling_resistance * c.mass * 9.80665
    balance = c.creep_speed * (1.0 - rolling / c.creep_force)
    assert car.truth().speed == pytest.approx(balance, abs=0.01)


def test_first_torque_comes_the_declared_dead_time_after_the_frame() -> None:
    parameters = vehicles.parameters()
    car = in_drive(parameters)
    for _ in ride(car, 6.0, lambda _: (0.0, 0.3, 0.0), start=1.0):
        pass
    for _ in ride(car, 1.0, lambda _: (0.0, 0.0, 0.0), start=7.0):
        pass
    times = []
    # Half ticks cannot be commanded, so look every 5 ms, commanding as often.
    for step in range(20):
        car.step(8.0 + (step + 1) * 0.005, commands(400 + step, (2750.0, 0.0, 0.0)))
        times.append((round((step + 1) * 0.005, 3), car.truth().acceleration))
    first = next(time for time, acceleration in times if acceleration < -0.5)
    assert first - 0.005 == pytest.approx(parameters.vehicle.brake_delay, abs=1e-9)
    # And after five lags all of it: 2750 N m over 550 kg m, and the drag.
    assert times[-1][1] == pytest.approx(-5.0 - 0.17, abs=0.1)


@pytest.mark.parametrize(("gain", "mass"), [(1.0, 1.0), (0.9, 1.0), (1.0, 1.15)])
def test_perturbations_scale_the_deceleration(gain: float, mass: float) -> None:
    car = in_drive(vehicles.parameters(brake_gain_factor=gain, mass_factor=mass))
    for _ in ride(car, 6.0, lambda _: (0.0, 0.4, 0.0), start=1.0):
        pass
    for output in ride(car, 1.0, lambda _: (1650.0, 0.0, 0.0), start=7.0):
        last = output
    drag = vehicles.FUSION.calibration.drag(car.truth().speed) / 1690.0
    engine = 0.4 * 6500.0 / 1690.0 * math.exp(-(1.0 - 0.05) / 0.25)
    assert car.truth().acceleration == pytest.approx((-3.0 * gain + engine) / mass - drag, abs=0.03)
    info = [message for _, frame in last.reports if isinstance(message := codec.decode(frame), messages.BrakeInfo)]
    assert info[-1].torque_actual == pytest.approx(1650.0, abs=2.0), "the car doesn't know its brakes are worn"


def test_steering_bias_bends_the_path_of_a_wheel_that_is_reported_straight() -> None:
    bias = math.radians(3.0)
    car = in_drive(vehicles.parameters(steering_wheel_bias=bias))
    for output in ride(car, 6.0, lambda _: (0.0, 0.2, 0.0), start=1.0):
        last = output
    vehicle, truth = vehicles.parameters().vehicle, car.truth()
    length = vehicle.wheelbase + vehicle.understeer_gradient * truth.speed**2
    assert truth.yaw_rate == pytest.approx(-truth.speed * bias / vehicle.steering_ratio / length, rel=0.02)
    steering = [
        message for _, frame in last.reports if isinstance(message := codec.decode(frame), messages.SteeringReport)
    ]
    assert steering[-1].wheel_angle == pytest.approx(0.0, abs=1e-3)


def test_a_dead_host_is_braked_to_rest_by_the_dbw_controller() -> None:
    car = in_drive()
    for _ in ride(car, 6.0, lambda _: (0.0, 0.3, 0.0), start=1.0):
        pass
    speed = car.truth().speed
    assert speed > 4.0
    for tick in range(350, 350 + 250):
        output = car.step((tick + 1) * TICK, [])
    report = [
        message for _, frame in output.reports if isinstance(message := codec.decode(frame), messages.BrakeReport)
    ][-1]
    assert (report.watchdog_braking, report.fault_watchdog, report.enabled) == (True, True, False)
    assert car.truth().speed == 0.0


def test_gear_reports_follow_the_shift() -> None:
    gears = [
        message.gear
        for output in ride(make(), 1.0, lambda _: (1500.0, 0.0, 0.0))
        for _, frame in output.reports
        if isinstance(message := codec.decode(frame), messages.GearReport)
    ]
    assert gears == sorted(gears)
    assert {gears[0], gears[-1]} == {Gear.PARK, Gear.DRIVE}


def test_refuses_times_between_its_steps() -> None:
    with pytest.raises(ValueError, match=r"0\.005 s, got until=0\.012"):
        make().step(0.012, [])


MEASURED = {"imperfections": vehicles.FUSION.measured}


@pytest.mark.thorough
def test_two_measured_rides_with_one_seed_are_the_same_to_the_bit() -> None:
    first, second, other = ([*ride(make(vehicles.parameters(**MEASURED), seed), 12.0, town)] for seed in (1, 1, 2))
    assert first == second
    assert [output.reports for output in first] != [output.reports for output in other]


def test_imperfections_leave_every_other_noise_as_it_is() -> None:
    """The gyroscope's and the fixes' errors are draw for draw those of the ideal car."""
    only_wheels = replace(IDEAL, wheel_jitter=0.0005, receiver_short_gaps=0.7, receiver_gap_p95=0.0455,
                          receiver_gap_max=0.0481)  # fmt: skip
    ideal, other = make(), make(vehicles.parameters(imperfections=only_wheels))
    said: list[tuple[list[Frame], list[bytes]]] = []
    for car in (ideal, other):
        outputs = [*ride(car, 6.0, town)]
        frames = [frame for output in outputs for _, frame in output.reports if frame.id == layout.YAW_RATE]
        said.append((frames, [packet for output in outputs for _, packet in output.packets]))
    (rates, packets), (other_rates, other_packets) = said
    assert rates == other_rates
    assert other_packets == packets[: len(other_packets)]
    assert len(packets) - len(other_packets) <= 5, "held back at the end"


def test_without_noise_the_sensors_of_a_measured_car_are_ideal() -> None:
    """Brakes and tyres are not: they are the car, and no noise."""
    sound = replace(vehicles.FUSION.measured, brake_gain_factor=1.0, combined_slip=False)
    quiet, measured = make(vehicles.parameters(noise=0.0)), make(vehicles.parameters(noise=0.0, imperfections=sound))
    assert [*ride(quiet, 6.0, town)] == [*ride(measured, 6.0, town)]


def test_the_imperfect_car_moves_as_the_ideal_one_but_for_its_brakes_and_tyres() -> None:
    sound = replace(vehicles.FUSION.measured, brake_gain_factor=1.0, combined_slip=False)
    ideal, measured = make(), make(vehicles.parameters(imperfections=sound))
    for _ in zip(ride(ideal, 12.0, town), ride(measured, 12.0, town), strict=True):
        assert measured.truth() == ideal.truth()


def test_the_measured_brakes_are_as_much_weaker_as_the_vehicle_file_says() -> None:
    factor = vehicles.FUSION.measured.brake_gain_factor
    weaker, measured = (in_drive(vehicles.parameters(**said)) for said in ({"brake_gain_factor": factor}, MEASURED))
    for car in (weaker, measured):
        for _ in ride(car, 6.0, lambda _: (0.0, 0.4, 0.0), start=1.0):
            pass
        for _ in ride(car, 1.0, lambda _: (1650.0, 0.0, 0.0), start=7.0):
            pass
    assert factor < 1.0
    assert measured.truth().acceleration == pytest.approx(weaker.truth().acceleration, rel=1e-12)


def test_the_reports_of_a_measured_car_at_speed_have_its_errors() -> None:
    """From its frames alone: the steps of the wheel speeds, and the accelerometers' noise."""
    car = in_drive(vehicles.parameters(**MEASURED))
    for _ in ride(car, 8.0, lambda _: (0.0, 0.25, 0.0), start=1.0):
        pass
    wheels, along = [], []
    for output in ride(car, 10.0, lambda _: (0.0, 0.05, 0.0), start=9.0):
        for _, frame in output.reports:
            message = codec.decode(frame)
            if isinstance(message, messages.WheelSpeeds):
                wheels.append(message)
            elif isinstance(message, messages.Accelerations):
                along.append(message.longitudinal)
    steps = np.array(wheels) / 0.04
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    rest = np.array(along) - savgol_filter(along, 51, 2)
    # A parabola over half a second takes a quarter of a noise that is correlated over 0.06 s.
    assert np.std(rest) == pytest.approx(0.74 * vehicles.FUSION.measured.longitudinal_acceleration_noise, rel=0.15)
