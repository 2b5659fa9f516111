"""What every drive-by-wire interface must hold to, whoever wrote it: subclass, name the configuration, run pytest.

    from tests.ports.vehicle_interface import VehicleInterfaceConformance

    class TestMine(VehicleInterfaceConformance):
        config = InterfaceConfig("my_interface.py:make", {"variant": "b"})

The interface is judged by what it gives and takes, together with its simulated other end; nothing here knows a wire.
"""

from __future__ import annotations

import functools
import itertools
import math
import random
from typing import ClassVar, Final

import numpy as np
import pytest

from tests import vehicles
from tests.ports.interface_bench import HELD, NEUTRAL, PERIOD, STANDING, SUBSYSTEMS, Bench, engaged_drive
from tests.vehicle.whole_car import LOT
from vve_sumo.errors import ConfigError
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.injectable import injectable_kinds, require_injectable
from vve_sumo.plant.injected_faults import KINDS, FaultClock, InjectedFault
from vve_sumo.timing import MAX_GEAR_REPORT_AGE, MAX_REPORT_AGE
from vve_sumo.values import EXTENDED, ArmingState, Frame
from vve_sumo.vehicle.interface import (
    INTERFACE_KINDS,
    REQUIRED,
    ActuationCommand,
    BrakeState,
    BrakeTorque,
    Commanded,
    DriverInputs,
    Gear,
    GearState,
    InterfaceConfig,
    InterfaceFacts,
    Malformed,
    SettingValue,
    SteeringState,
    ThrottleState,
    VehicleInterface,
    WheelSpeeds,
    WhenCommandsStop,
    YawRate,
    load,
)
from vve_sumo.vehicle.reports import FOOT_TORQUE, CarReports

RESOLUTION: Final = 0.005  # of a range, that a wire may lose


class VehicleInterfaceConformance:
    """The suite; `config` says which interface."""

    config: ClassVar[InterfaceConfig]

    @pytest.fixture
    def interface(self) -> VehicleInterface:
        return load(self.config)

    @pytest.fixture
    def bench(self) -> Bench:
        return Bench(self.config)

    # What it says of itself.

    def test_its_identifiers_are_apart_and_of_11_or_29_bits(self, interface):
        facts = interface.facts
        assert facts.commands
        assert not facts.commands & facts.reports.keys()
        assert facts.commands | facts.reports.keys() <= facts.occupied
        assert all(0 <= number <= 0x7FF or 0 <= number - EXTENDED <= 0x1FFF_FFFF for number in facts.occupied)

    def test_it_reports_what_the_gateway_needs(self, interface):
        assert set().union(*interface.facts.reports.values()) >= REQUIRED

    def test_its_ranges_and_times_can_be_driven_with(self, interface):
        facts = interface.facts
        if facts.acceleration_limits is None:
            assert 1000.0 <= facts.brake_torque_limit < math.inf
        else:
            assert -math.inf < facts.acceleration_limits.minimum <= -2.0
            assert 0.5 <= facts.acceleration_limits.maximum < math.inf
        assert 0.0 < facts.wheel_angle_limit < math.inf
        assert 0.0 < facts.wheel_rate_limit < math.inf
        assert PERIOD < facts.command_timeout < math.inf
        assert facts.title
        assert facts.when_commands_stop.words

    # Out.

    def test_it_sends_its_command_identifiers_alone_and_always_alike(self, interface):
        sent = [[frame.id for frame in interface.encode(NEUTRAL)] for _ in range(3)]
        assert sent[0] == sent[1] == sent[2]
        assert len(sent[0]) == len(set(sent[0])) > 0
        assert set(sent[0]) <= interface.facts.commands
        assert all(len(frame.data) <= 8 for frame in interface.encode(NEUTRAL))

    def test_no_two_commands_in_a_row_are_alike(self, interface):
        """A counter that runs is what its own watchdog goes by; it runs around, too."""
        if not interface.facts.counts:
            pytest.skip("its wire has no counter")
        sent = [interface.encode(NEUTRAL) for _ in range(600)]
        assert all(one != two for one, two in itertools.pairwise(sent))

    @pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
    def test_what_is_commanded_can_be_read_again(self, interface, share):
        """The pedals never both at once: no car is commanded so, and a wire may have no way to say it."""
        facts = interface.facts
        for angle in (-share * facts.wheel_angle_limit, share * facts.wheel_angle_limit):
            for wanted in _motions(facts, share):
                command = NEUTRAL._replace(**wanted, wheel_angle=angle, enable=True)
                said = _commanded(interface, command)
                assert abs(said.pop("wheel_angle") - angle) <= RESOLUTION * facts.wheel_angle_limit
                assert said.keys() == set(_taken(facts))
                for name, value in said.items():
                    assert abs(value - wanted.get(name, 0.0)) <= RESOLUTION * _largest(facts, name)

    @pytest.mark.parametrize("field", ["brake_torque", "throttle", "acceleration", "wheel_angle", "wheel_rate"])
    @pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
    def test_what_is_no_number_never_reaches_the_wire(self, interface, field, value):
        if field not in (*_taken(interface.facts), "wheel_angle", "wheel_rate"):
            assert interface.encode(NEUTRAL._replace(**{field: value})), "what the wire does not take is not looked at"
            return
        with pytest.raises(ValueError):  # noqa: PT011  the words are the interface's own
            interface.encode(NEUTRAL._replace(**{field: value}))
        assert interface.encode(NEUTRAL)

    def test_what_is_beyond_a_range_is_refused_and_not_clipped(self, interface):
        facts = interface.facts
        beyond = [("wheel_rate", -0.1)]
        if facts.acceleration_limits is None:
            beyond += [("brake_torque", 1.01 * facts.brake_torque_limit), ("brake_torque", -1.0)]
            beyond += [("throttle", 1.01), ("throttle", -0.01)]
        else:
            beyond += [("acceleration", 1.01 * limit) for limit in facts.acceleration_limits]
        beyond += [("wheel_angle", sign * 1.01 * facts.wheel_angle_limit) for sign in (-1.0, 1.0)]
        beyond += [("wheel_rate", 1.01 * facts.wheel_rate_limit)]
        for field, value in beyond:
            with pytest.raises(ValueError):  # noqa: PT011
                interface.encode(NEUTRAL._replace(**{field: value}))
        for wanted in _motions(facts, 1.0):
            assert interface.encode(NEUTRAL._replace(**wanted, wheel_rate=facts.wheel_rate_limit))

    # In.

    def test_whatever_is_on_the_bus_is_a_declared_report_or_malformed(self, interface):
        chance = random.Random(1)
        for _ in range(3000):
            number = chance.choice([*interface.facts.occupied, 0x7FE])
            reports = interface.decode(Frame(number, chance.randbytes(chance.choice((0, 1, 2, 4, 6, 7, 8, 8, 8)))))
            if isinstance(reports, Malformed):
                assert number in interface.facts.reports
                continue
            assert {type(report) for report in reports} <= set(interface.facts.reports.get(number, ()))
            values = [value for report in reports for value in report if isinstance(value, float)]
            assert not any(map(math.isinf, values))

    def test_its_own_commands_report_nothing(self, interface):
        for frame in interface.encode(NEUTRAL._replace(enable=True)):
            assert interface.decode(frame) == ()

    def test_silence_is_not_enabled(self, interface):
        reports = CarReports(0.3, interface)
        assert not reports.any_enabled()
        assert reports.stale(0.0)
        assert reports.faults() == ["report_invalid"]

    # With its other end.

    def test_nothing_is_enabled_before_it_is_commanded(self, bench):
        bench.run(0.5, None)
        assert not any(bench.enabled())
        assert not any(bench.end.enabled)
        bench.run(0.5, NEUTRAL)
        assert not any(bench.enabled())

    def test_all_is_enabled_when_commanded_and_nothing_else(self, bench):
        bench.engaged()
        assert bench.end.enabled == (True, True, True)
        assert not any(report.override or report.fault or report.timeout for report in _subsystems(bench))

    def test_required_reports_come_in_time(self, bench):
        bench.run(3.0, NEUTRAL)
        for kind in REQUIRED:
            limit = MAX_GEAR_REPORT_AGE if kind is GearState else MAX_REPORT_AGE
            times = [0.0, *bench.times[kind], bench.now]
            assert max(two - one for one, two in itertools.pairwise(times)) <= 0.6 * limit

    def test_actuation_comes_about_and_is_reported(self, bench):
        bench.engaged()
        wanted = HELD._replace(brake_torque=1200.0, acceleration=-2.0, wheel_angle=0.8, wheel_rate=4.0)
        bench.run(0.5, wanted)
        facts = bench.interface.facts
        assert bench.newest[SteeringState].wheel_angle == pytest.approx(0.8, abs=RESOLUTION * facts.wheel_angle_limit)
        if facts.acceleration_limits is not None:
            assert bench.acceleration == pytest.approx(-2.0, abs=RESOLUTION * _largest(facts, "acceleration"))
            return
        assert bench.measured.brake_torque == pytest.approx(1200.0, abs=RESOLUTION * facts.brake_torque_limit)
        if BrakeTorque in bench.newest:
            reported = bench.newest[BrakeTorque].actual
            assert reported == pytest.approx(1200.0, abs=2.0 * RESOLUTION * facts.brake_torque_limit)

    def test_left_is_positive_on_both_ways(self, bench):
        bench.engaged().run(0.5, HELD._replace(wheel_angle=-0.8))
        assert bench.measured.wheel_angle < -0.7
        assert bench.newest[SteeringState].wheel_angle < -0.7

    def test_the_gear_is_taken_at_rest_on_the_brakes(self, bench):
        bench.engaged()
        assert bench.newest[GearState].gear is Gear.PARK
        for gear in (Gear.DRIVE, Gear.PARK):
            bench.run(2.0, HELD._replace(gear=gear))
            assert bench.newest[GearState].gear is bench.end.gear is gear

    def test_motion_is_reported_as_it_is(self, bench):
        wheels = WheelSpeeds(30.0, 30.5, 30.0, 30.5)
        bench.measured = STANDING._replace(speed=9.6, wheels=wheels, rates=YawRate(0.0, 0.21))
        bench.run(0.1, NEUTRAL)
        assert bench.newest[WheelSpeeds] == pytest.approx(wheels, abs=0.05)
        assert bench.newest[YawRate].yaw == pytest.approx(0.21, abs=2e-3)

    def test_a_wheel_speed_that_is_not_measured_is_reported_as_invalid_or_not_at_all(self, bench):
        wheels = WheelSpeeds(30.0, 30.0, math.nan, 30.0)
        bench.measured = STANDING._replace(speed=9.6, wheels=wheels)
        bench.run(0.1, NEUTRAL)
        if WheelSpeeds in bench.newest:
            assert any(map(math.isnan, bench.newest[WheelSpeeds]))

    def test_it_lets_go_when_commands_stop(self, bench):
        """Neither at once, or a frame that is lost would do, nor later than it says."""
        bench.engaged().run(0.6 * bench.interface.facts.command_timeout, None)
        assert all(bench.end.enabled)
        bench.run(0.4 * bench.interface.facts.command_timeout + 0.05, None)
        stops = bench.interface.facts.when_commands_stop
        goes_on = stops.action is WhenCommandsStop.HOLDS
        assert any(bench.end.enabled) is any(bench.enabled()) is goes_on
        assert bench.end.watchdog_braking is (stops.action is WhenCommandsStop.BRAKES)
        assert bench.measured.brake_torque <= stops.brake_torque
        assert not bench.acceleration > 0.0

    def test_a_driver_who_takes_over_keeps_the_car_until_a_clear(self, bench):
        bench.engaged()
        wanted = HELD
        bench.run(0.1, wanted, DriverInputs(brake_pedal=0.20))
        foot = bench.newest[BrakeState]
        assert foot.driver or foot.driver_torque > FOOT_TORQUE, "by its bit, or by the pedal's position"
        bench.run(0.3, wanted, DriverInputs(brake_pedal=0.40))
        assert any(report.override for report in _subsystems(bench))
        assert not bench.newest[BrakeState].enabled
        assert bench.end.driver_brake_torque > 0.0
        bench.run(0.3, wanted)
        assert not bench.newest[BrakeState].enabled, "enable alone does not take the car back"
        bench.run(0.1, NEUTRAL._replace(clear=True))
        assert not any(report.override for report in _subsystems(bench))

    @pytest.mark.parametrize(
        "hands",
        [
            DriverInputs(throttle_pedal=0.40),
            DriverInputs(steering_torque=5.0),
            DriverInputs(steering_torque=-5.0),
        ],
        ids=["throttle", "wheel, to the left", "wheel, to the right"],
    )
    def test_a_driver_takes_over_by_throttle_and_by_steering_wheel_too(self, bench, hands):
        bench.engaged()
        wanted = HELD
        bench.run(0.3, wanted, hands)
        assert any(report.override for report in _subsystems(bench))
        assert not all(bench.end.enabled)
        bench.run(0.3, wanted)
        assert any(report.override for report in _subsystems(bench)), "enable alone does not take the car back"
        bench.run(0.1, NEUTRAL._replace(clear=True))
        assert not any(report.override for report in _subsystems(bench))

    @pytest.mark.parametrize("subsystem", [1, 2, 3])
    def test_a_subsystem_that_drops_out_says_so(self, bench, subsystem):
        bench.engaged().end.drop_out(subsystem)
        wanted = HELD
        bench.run(0.2, wanted)
        assert not bench.enabled()[subsystem - 1]
        bench.end.drop_out(None)
        bench.run(0.2, wanted)
        assert bench.enabled()[subsystem - 1]

    def test_no_fault_of_a_report_is_put_on_unasked(self, bench):
        bench.engaged()
        for _ in range(10):
            for frame in bench.end.reports(bench.measured):
                assert bench.end.alter(0.0, frame, lambda _kind, _time: None) == frame

    # Faults that are injected.

    def test_it_claims_no_fault_that_nobody_knows(self, bench):
        assert bench.end.injectable <= INTERFACE_KINDS.keys()

    @pytest.mark.parametrize("kind", sorted(INTERFACE_KINDS))
    def test_what_is_claimed_can_be_injected_and_the_rest_is_refused(self, bench, kind):
        fault = InjectedFault(kind, 1.0, 1.0)
        if kind in bench.end.injectable:
            require_injectable((fault,), self.config)
            assert kind in injectable_kinds(self.config)
            return
        with pytest.raises(ConfigError, match=f"fault {kind}: it cannot be injected through interface ") as refused:
            require_injectable((fault,), self.config)
        assert self.config.name in str(refused.value)
        assert "\n" not in str(refused.value)

    @pytest.mark.parametrize("kind", [kind for kind in KINDS if not kind.startswith("pose_")])
    def test_every_fault_that_is_not_refused_shows(self, kind):
        """In what the car sends, or in how it moves."""
        if kind not in injectable_kinds(self.config):
            pytest.skip(f"{kind}: refused")
        foot = {"brake_driver_bits_zero": "brake_override", "throttle_driver_bits_zero": "throttle_override"}
        others = (foot[kind],) if kind in foot else ()
        config = (self.config.name, tuple(self.config.settings.items()))
        assert _ride(*config, kind, *others) != _ride(*config, *others)

    def _claimed(self, bench: Bench, kind: str) -> None:
        if kind not in bench.end.injectable:
            pytest.skip(f"{kind}: not claimed, and so refused")

    @pytest.mark.parametrize("number", range(3))
    def test_a_reported_fault_is_one_subsystems_and_it_goes_on_working(self, bench, number):
        kind = ("brake_fault", "throttle_fault", "steering_fault")[number]
        self._claimed(bench, kind)
        wanted = HELD
        bench.engaged().inject(kind)
        bench.run(0.1, wanted)
        assert [report.fault for report in _subsystems(bench)] == [index == number for index in range(3)]
        assert bench.end.enabled == (True, True, True)
        assert all(bench.enabled())
        bench.restore()
        bench.run(0.1, wanted)
        assert not any(report.fault for report in _subsystems(bench))

    def test_a_malformed_report_is_the_one_of_the_steering(self, bench):
        self._claimed(bench, "report_malformed")
        bench.engaged().inject("report_malformed")
        bench.run(0.1, HELD)
        reports = bench.interface.facts.reports
        assert bench.malformed
        assert all(SteeringState in reports[number] for number in bench.malformed)

    @pytest.mark.parametrize("number", range(3))
    def test_a_frozen_report_stays_what_it_was_and_the_others_go_on(self, bench, number):
        kind = ("brake_report_frozen", "throttle_report_frozen", "steering_report_frozen")[number]
        self._claimed(bench, kind)
        bench.engaged().inject(kind)
        bench.run(0.1, HELD)
        kept = bench.newest[SUBSYSTEMS[number]]
        times = len(bench.times[SUBSYSTEMS[number]])
        bench.run(0.5, NEUTRAL)
        assert bench.newest[SUBSYSTEMS[number]] == kept
        assert len(bench.times[SUBSYSTEMS[number]]) > times, "it goes on coming"
        assert bench.enabled() == [index == number for index in range(3)], "the others say that they let go"
        assert bench.malformed == set()
        bench.restore()
        bench.run(0.1, NEUTRAL)
        assert not any(bench.enabled())

    @pytest.mark.parametrize(
        ("kind", "hands", "number"),
        [
            ("brake_driver_bits_zero", DriverInputs(brake_pedal=0.40), 0),
            ("throttle_driver_bits_zero", DriverInputs(throttle_pedal=0.40), 1),
        ],
    )
    def test_drivers_bits_that_stay_off_hide_the_driver_and_no_more(self, bench, kind, hands, number):
        self._claimed(bench, kind)
        bench.engaged().inject(kind)
        bench.run(0.3, HELD, hands)
        report = _subsystems(bench)[number]
        assert not report.override
        assert not report.driver  # type: ignore[union-attr]
        assert not bench.end.enabled[number], "the driver has taken over all the same"
        bench.restore()
        bench.run(0.1, NEUTRAL, hands)
        assert _subsystems(bench)[number].override

    @pytest.mark.parametrize("value", [1.0, 2.0, 3.0, 4.0])
    def test_a_false_override_is_in_one_report_and_nobody_took_over(self, bench, value):
        self._claimed(bench, "override_false")
        wanted = HELD
        bench.engaged().inject("override_false", value)
        bench.run(0.2, wanted)
        said = [report.override for report in (*_subsystems(bench), bench.newest[GearState])]  # type: ignore[union-attr]
        assert said == [index == value for index in (1.0, 2.0, 3.0, 4.0)]
        assert bench.end.enabled == (True, True, True)
        bench.restore()
        bench.run(0.2, wanted)
        assert not bench.newest[GearState].override  # type: ignore[union-attr]
        assert not any(report.override for report in _subsystems(bench))

    def test_the_drivers_gear_lever_is_followed_and_reported(self, bench):
        self._claimed(bench, "gear_lever")
        bench.engaged().run(2.0, HELD._replace(gear=Gear.DRIVE))
        wanted = HELD
        bench.run(2.0, wanted, DriverInputs(gear=Gear.NEUTRAL))
        assert bench.newest[GearState] == GearState(Gear.NEUTRAL, override=True)
        assert bench.end.gear is Gear.NEUTRAL

    # With gateway and car.

    def test_the_gateway_drives_off_stops_and_parks(self):
        drive = engaged_drive(self.config)
        drive.run(4.0, 1.5)
        assert drive.speed > 3.0
        assert drive.gateway.monitor.wheel_speed == pytest.approx(drive.speed, abs=0.1)
        drive.run(1.0, 0.0, steering=0.05)
        assert drive.gateway.monitor.measured_steering == pytest.approx(0.05, abs=0.005)
        drive.run(5.0, -2.0)
        assert drive.speed == 0.0
        assert drive.state is ArmingState.ENGAGED
        drive.end()
        drive.run(5.0, 0.0)
        assert drive.gear is Gear.PARK
        assert drive.gateway.done

    def test_a_driver_takes_the_car_from_the_gateway(self):
        drive = engaged_drive(self.config)
        drive.run(3.0, 1.5)
        drive.run(0.3, 0.0, driver=DriverInputs(brake_pedal=0.40))
        assert drive.state is ArmingState.FAULT
        assert "driver_override" in drive.reasons
        assert not any(drive.enabled)

    def test_another_writer_stops_the_car(self):
        drive = engaged_drive(self.config)
        drive.run(2.0, 1.5)
        drive.intrude()
        assert drive.state is ArmingState.STOPPING
        assert "another_writer" in drive.reasons


def _taken(facts: InterfaceFacts) -> tuple[str, ...]:
    """Return what of the motion the wire takes."""
    return ("brake_torque", "throttle") if facts.acceleration_limits is None else ("acceleration",)


def _largest(facts: InterfaceFacts, quantity: str) -> float:
    limits = facts.acceleration_limits
    if quantity == "acceleration" and limits is not None:
        return max(-limits.minimum, limits.maximum)
    return facts.brake_torque_limit if quantity == "brake_torque" else 1.0


def _motions(facts: InterfaceFacts, share: float) -> list[dict[str, float]]:
    """Return commands of a `share` of what the wire takes: of braking, and of driving."""
    if facts.acceleration_limits is None:
        return [{"brake_torque": share * facts.brake_torque_limit}, {"throttle": share}]
    return [{"acceleration": share * limit} for limit in facts.acceleration_limits]


def _commanded(interface: VehicleInterface, command: ActuationCommand) -> dict[str, float]:
    """All frames of a step together; each quantity that is said is said once."""
    said = [each for frame in interface.encode(command) if (each := interface.commanded(frame)) is not None]
    columns = {
        name: [value for each in said if not math.isnan(value := getattr(each, name))] for name in Commanded._fields
    }
    assert all(len(column) <= 1 for column in columns.values())
    return {name: column[0] for name, column in columns.items() if column}


@functools.cache
def _ride(name: str, settings: tuple[tuple[str, SettingValue], ...], *kinds: str) -> object:
    """All that a car with these faults sends, and how it moves, in three seconds of pulling away, braking, swerving."""
    config = InterfaceConfig(name, dict(settings))
    faults = [InjectedFault(kind, 1.6, 1.4, clock=FaultClock.DRIVE) for kind in kinds]
    parameters, seeds = vehicles.parameters(noise=0.0, interface=config), np.random.SeedSequence
    car = FaultInjectedCar(parameters, (0.0, 0.0, 0.0), LOT, 1_447_000_000.0, seeds(1), faults, seeds(2))
    interface, said = load(config), []
    for tick in range(150):
        now = tick * PERIOD
        torque, throttle = (1500.0, 0.0) if now < 1.0 else (0.0, 0.3) if now < 2.2 else (500.0 + 100.0 * now, 0.0)
        gear, angle = Gear.DRIVE if now < 1.0 else Gear.NONE, 0.5 * math.sin(3.0 * now)
        command = ActuationCommand(torque, throttle, angle, 6.0, gear, enable=True, clear=False)
        command = command._replace(acceleration=8.0 * throttle - torque / 550.0)
        output = car.step((tick + 1) * PERIOD, interface.encode(command))
        said.append((output.reports, car.truth(), car.car.interface.enabled))
    assert kinds or car.truth().speed > 0.5, "a sound car is under way to the end"
    return said


def _subsystems(bench: Bench) -> list[BrakeState | ThrottleState | SteeringState]:
    return [bench.newest[kind] for kind in SUBSYSTEMS]  # type: ignore[misc]
