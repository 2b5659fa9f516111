"""The kit's behaviour, frame by frame: timeouts, watchdog, overrides, shifting."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vve_sumo.values import Frame
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.dataspeed.controller import (
    DbwController,
    DbwControllerParameters,
    DriverInputs,
)
from vve_sumo.vehicle.dataspeed.messages import (
    BrakeCommand,
    BrakeKind,
    Gear,
    GearCommand,
    GearReject,
    SteeringCommand,
    ThrottleCommand,
    ThrottleKind,
    WatchdogSource,
)
from vve_sumo.vehicle.dataspeed.pedals import pedal_to_torque, torque_to_pedal

STEP = 0.005
PERIOD = 4  # steps between commands: 20 ms
NAMES = ("brake", "throttle", "steering")
Alter = Callable[[list[Frame], int], list[Frame]]


def frames(
    counter: int, *, enable: bool = True, clear: bool = False, torque: float = 500.0, throttle: float = 0.0
) -> list[Frame]:
    return [
        codec.encode(BrakeCommand(BrakeKind.TORQUE, torque, enable, counter & 255, clear)),
        codec.encode(ThrottleCommand(ThrottleKind.PERCENT, throttle, enable, counter & 255, clear)),
        codec.encode(SteeringCommand(0.5, 0.0, enable, counter & 255, clear)),
    ]


class Bench:
    """A kit on a bench: commanded every 20 ms, told a speed and a driver."""

    def __init__(self, parameters: DbwControllerParameters | None = None) -> None:
        self.kit = DbwController(parameters or DbwControllerParameters(), STEP)
        self.driver = DriverInputs()
        self.speed = 0.0
        self.brake_torque = 500.0
        self.steps = 0
        self._counter = itertools.count()

    def run(self, seconds: float, alter: Alter | None = None, send: bool = True, **command: float) -> Bench:
        for _ in range(round(seconds / STEP)):
            if send and self.steps % PERIOD == 0:
                counter = next(self._counter)
                sent = frames(counter, **command)  # type: ignore[arg-type]
                self.kit.receive(alter(sent, counter) if alter else sent, self.speed, self.brake_torque)
            self.kit.step(self.driver, self.speed, 0.0)
            self.steps += 1
        return self

    def in_drive(self) -> Bench:
        """Enabled, in drive, rolling at 5 m/s."""
        self.run(0.1)
        self.kit.receive([codec.encode(GearCommand(Gear.DRIVE))], self.speed, self.brake_torque)
        self.run(0.6)
        self.speed = 5.0
        assert self.kit.gear is Gear.DRIVE
        return self.run(0.1)

    @property
    def enabled(self) -> list[bool]:
        return [module.enabled for module in self.kit.modules]


def without(identifier: int) -> Alter:
    return lambda sent, _: [frame for frame in sent if frame.id != identifier]


def frozen(identifier: int) -> Alter:
    return lambda sent, _: [
        Frame(frame.id, frame.data[:7] + b"\x63") if frame.id == identifier else frame for frame in sent
    ]


def disabled(identifier: int) -> Alter:
    """EN dropped in one command, the counter still counting."""
    byte = 2 if identifier == codec.STEERING_COMMAND else 3

    def alter(sent: list[Frame], _: int) -> list[Frame]:
        return [
            Frame(frame.id, frame.data[:byte] + bytes((frame.data[byte] & 0xFE,)) + frame.data[byte + 1 :])
            if frame.id == identifier
            else frame
            for frame in sent
        ]

    return alter


IDENTIFIERS = (codec.BRAKE_COMMAND, codec.THROTTLE_COMMAND, codec.STEERING_COMMAND)


def test_before_the_first_command_everything_is_timed_out_and_off() -> None:
    kit = Bench().run(0.02, send=False).kit
    assert [(module.timeout, module.enabled) for module in kit.modules] == [(True, False)] * 3
    assert kit.request.brake_torque == 0.0
    assert math.isnan(kit.request.wheel_angle)


@pytest.mark.parametrize("index", range(3), ids=NAMES)
def test_each_module_drops_out_passively_100_ms_after_its_own_last_command(index: int) -> None:
    bench = Bench(DbwControllerParameters(watchdog=False)).run(0.08)
    assert bench.enabled == [True] * 3
    # The last command came 20 ms ago.
    bench.run(0.075, alter=without(IDENTIFIERS[index]))
    assert bench.enabled == [True] * 3
    bench.run(0.010, alter=without(IDENTIFIERS[index]))
    assert bench.enabled == [position != index for position in range(3)]
    assert [module.timeout for module in bench.kit.modules] == [position == index for position in range(3)]
    assert not bench.kit.fault
    bench.run(0.02)
    assert bench.enabled == [True] * 3


def test_timeout_releases_the_brake() -> None:
    bench = Bench(DbwControllerParameters(watchdog=False)).run(0.1, torque=1500.0)
    assert bench.kit.request.brake_torque == 1500.0
    assert bench.run(0.2, send=False).kit.request.brake_torque == 0.0


@pytest.mark.parametrize(
    ("alter", "cause"), [(frozen, "COUNTER"), (disabled, "DISABLED"), (without, "COMMAND")], ids=["count", "en", "lost"]
)
@pytest.mark.parametrize("index", range(3), ids=NAMES)
def test_watchdog_latches_on_all_modules_brakes_and_names_the_culprit(
    alter: Callable[[int], Alter], cause: str, index: int
) -> None:
    bench = Bench(DbwControllerParameters(watchdog_torque=1234.0)).in_drive()
    bench.run(0.3, alter=alter(IDENTIFIERS[index]))
    kit = bench.kit
    assert kit.fault
    assert kit.watchdog_braking
    assert bench.enabled == [False] * 3
    assert kit.request.brake_torque == 1234.0
    culprit, name = kit.modules[index], NAMES[index].upper()
    assert culprit.source is WatchdogSource[f"{name}_{cause}"]
    assert {module.source for module in kit.modules if module is not culprit} == {WatchdogSource[f"OTHER_{name}"]}
    # It stays, though all is well again.
    bench.run(1.0)
    assert kit.fault
    assert kit.request.brake_torque == 1234.0


def test_watchdog_braking_ends_with_the_driver_and_the_fault_with_the_button() -> None:
    bench = Bench().in_drive().run(0.2, send=False)
    assert bench.kit.watchdog_braking
    bench.driver = DriverInputs(brake_pedal=0.20)
    bench.run(0.03)
    assert (bench.kit.watchdog_braking, bench.kit.fault) == (False, True)
    bench.driver = DriverInputs(acknowledge=True)
    bench.run(0.01)
    assert not bench.kit.fault
    bench.driver = DriverInputs()
    assert bench.run(0.1).enabled == [True] * 3


def test_en_may_drop_in_park_at_rest() -> None:
    bench = Bench().run(0.2)
    assert not bench.run(0.2, enable=False).kit.fault
    assert not bench.run(0.5, send=False).kit.fault


def test_a_kit_that_was_never_counted_to_has_no_watchdog() -> None:
    bench = Bench()
    bench.run(0.2, alter=lambda sent, _: [Frame(frame.id, frame.data[:7] + b"\x00") for frame in sent])
    assert not bench.run(1.0, send=False).kit.fault


@pytest.mark.parametrize(
    ("inputs", "name"),
    [
        (DriverInputs(brake_pedal=0.23), "brake"),
        (DriverInputs(throttle_pedal=0.31), "throttle"),
        (DriverInputs(steering_torque=-3.5), "steering"),
    ],
)
def test_override_latches_after_100_ms_until_clear(inputs: DriverInputs, name: str) -> None:
    bench = Bench().in_drive()
    module = getattr(bench.kit, name)
    bench.driver = inputs
    bench.run(0.095)
    assert (module.driver, module.override) == (True, False)
    bench.run(0.010)
    assert (module.override, module.enabled) == (True, False)
    bench.run(0.1, clear=True)
    assert module.override, "the driver is still on it"
    bench.driver = DriverInputs()
    bench.run(0.2)
    assert (module.override, module.enabled, bench.kit.fault) == (True, False, False)
    bench.run(0.04, clear=True)
    assert (module.override, module.enabled) == (False, True)


@pytest.mark.parametrize("pedal", [0.15, 0.22])
def test_no_override_below_the_threshold(pedal: float) -> None:
    bench = Bench().in_drive()
    bench.driver = DriverInputs(brake_pedal=pedal)
    assert not bench.run(1.0).kit.brake.override


def test_en_may_drop_while_moving_once_the_driver_has_taken_over() -> None:
    bench = Bench().in_drive()
    bench.driver = DriverInputs(brake_pedal=0.30)
    bench.run(0.12)
    assert not bench.run(0.5, enable=False).kit.fault


def test_clear_alone_clears_and_does_not_feed_the_timeout() -> None:
    bench = Bench(DbwControllerParameters(watchdog=False)).run(0.1)
    bench.driver = DriverInputs(brake_pedal=0.30)
    bench.run(0.2)
    bench.driver = DriverInputs()
    bench.run(0.2, send=False)
    whole = codec.encode(BrakeCommand(BrakeKind.NONE, 0.0, False, 0, True))
    alone = whole._replace(data=whole.data[:4])
    assert len(alone.data) == 4
    bench.kit.receive([alone], 0.0, 0.0)
    bench.run(0.005, send=False)
    assert (bench.kit.brake.override, bench.kit.brake.timeout) == (False, True)


@pytest.mark.parametrize("length", [0, 3, 7])
def test_wrong_length_counts_as_missing(length: int) -> None:
    bench = Bench().in_drive()
    bench.run(0.2, alter=lambda sent, _: [Frame(f.id, f.data[:length]) if f.id == 0x60 else f for f in sent])
    assert bench.kit.brake.source is WatchdogSource.BRAKE_COMMAND


def test_asking_to_ignore_the_driver_is_noticed_and_not_obeyed() -> None:
    bench = Bench(DbwControllerParameters(watchdog=False))

    def ignoring(sent: list[Frame], _: int) -> list[Frame]:
        return [Frame(f.id, f.data[:3] + bytes((f.data[3] | 4,)) + f.data[4:]) if f.id == 0x60 else f for f in sent]

    bench.run(0.2, alter=ignoring)
    assert bench.kit.misuses == 10
    assert bench.enabled == [False, True, True]


def test_a_fusion_does_not_know_deceleration_commands() -> None:
    bench = Bench(DbwControllerParameters(watchdog=False))
    command = BrakeCommand(BrakeKind.DECELERATION, 3.0, True, 1)
    bench.run(0.1, alter=lambda sent, _: [codec.encode(command), *sent[1:]])
    assert bench.enabled == [False, True, True]


def test_brake_ceiling_and_driver_beyond_it() -> None:
    bench = Bench(DbwControllerParameters(brake_torque_limit=3000.0)).run(0.1, torque=3250.0)
    assert bench.kit.request.brake_torque == 3000.0
    bench.driver = DriverInputs(brake_pedal=0.40)
    assert bench.run(0.1, torque=3250.0).kit.request.brake_torque == 3412.0


def test_brake_ramp_is_four_tenths_of_the_pedal_in_20_ms() -> None:
    bench = Bench()
    bench.run(0.005, torque=3250.0)
    assert bench.kit.request.brake_torque == pytest.approx(0.4 / 4 * 3412.0 / (0.330 - 0.175))


def test_steering_moves_at_the_commanded_rate() -> None:
    bench = Bench()
    rate = math.radians(40.0)
    bench.run(0.10, alter=lambda sent, n: [*sent[:2], codec.encode(SteeringCommand(0.5, rate, True, n & 255))])
    assert bench.kit.request.wheel_angle == pytest.approx(0.10 * rate, rel=1e-6)


def test_shifting_takes_its_time_and_wants_a_pressed_brake_at_rest() -> None:
    bench = Bench(DbwControllerParameters(shift_time=0.5)).run(0.02)
    drive, reverse = codec.encode(GearCommand(Gear.DRIVE)), codec.encode(GearCommand(Gear.REVERSE))
    bench.kit.receive([drive], 0.0, 0.0)
    assert bench.kit.gear_reject is GearReject.VEHICLE
    bench.kit.receive([drive], 1.0, 500.0)
    assert bench.kit.gear_reject is GearReject.VEHICLE
    bench.kit.receive([drive], 0.0, 500.0)
    assert bench.kit.gear_reject is GearReject.NONE
    bench.run(0.30)
    bench.kit.receive([reverse], 0.0, 500.0)
    assert (bench.kit.gear, bench.kit.gear_reject) == (Gear.PARK, GearReject.SHIFT_IN_PROGRESS)
    bench.run(0.19)
    assert bench.kit.gear is Gear.PARK
    bench.run(0.03)
    assert bench.kit.gear is Gear.DRIVE


def test_pedal_table_is_the_published_one_both_ways() -> None:
    for pedal, torque in ((0.246, 816.0), (0.283, 1832.0), (0.323, 3316.0), (0.33, 3412.0)):
        assert pedal_to_torque(pedal) == pytest.approx(torque)
        assert torque_to_pedal(torque) == pytest.approx(pedal)
    assert pedal_to_torque(0.5 * (0.246 + 0.283)) == pytest.approx(0.5 * (816.0 + 1832.0))


actions = st.lists(
    st.tuples(
        st.sampled_from(["all", "none", "frozen", "off", "clear", "brake", "hands_off", "ok"]), st.integers(1, 40)
    ),
    max_size=12,
)


@given(actions, st.booleans())
@settings(max_examples=60, deadline=None)
def test_whatever_happens_nothing_is_enabled_without_fresh_consent(script: list[tuple[str, int]], moving: bool) -> None:
    bench = Bench().in_drive() if moving else Bench()
    kit, last_counter, last_heard, step = bench.kit, 0, -1000, 0
    for action, steps in script:
        if action in ("brake", "hands_off", "ok"):
            bench.driver = DriverInputs(brake_pedal=0.30 if action == "brake" else 0.15, acknowledge=action == "ok")
        for _ in range(steps):
            enable = action != "off"
            if action != "none" and step % PERIOD == 0:
                last_counter += action != "frozen"
                kit.receive(frames(last_counter, enable=enable, clear=action == "clear"), bench.speed, 500.0)
                last_heard = step
            kit.step(bench.driver, bench.speed, 0.0)
            step += 1
            for module in kit.modules:
                if module.enabled:
                    assert not module.override
                    assert not kit.fault
                    assert module.command is not None
                    assert module.command.enable
                    assert moving or (step - 1 - last_heard) * STEP < 0.1
            assert 0.0 <= kit.request.brake_torque <= 3412.0
            assert not kit.watchdog_braking or kit.fault
