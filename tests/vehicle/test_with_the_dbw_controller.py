"""The gateway with the whole simulated vehicle, whose kit has a watchdog of its own: it must never have to act."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vehicle.whole_car import PARAMETERS, PERIOD, VEHICLE, WholeCar
from vve_sumo.values import ArmingState, FallbackPath
from vve_sumo.vehicle.arming import COMMANDING
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import HANDS_OFF, DriverInputs, Gear

S = ArmingState


def test_a_drive_from_park_to_park():
    whole = WholeCar()
    whole.engage()
    for _ in range(300):
        whole.step(min(8.0 - whole.car.truth().speed, 1.5))
    assert whole.car.truth().speed > 6.0
    whole.step(command=OperatorCommand.STOP)
    states = []
    while not whole.gateway.done:
        states.append(whole.step().state)
    assert list(dict.fromkeys(states)) == [S.STOPPING, S.STOPPED, S.DISARMED]
    assert whole.car.interface.gear is Gear.PARK
    for _ in range(500):
        assert whole.step(2.0).state is S.READY
    assert not whole.car.interface.controller.fault
    assert whole.car.truth().speed == 0.0


def test_in_drive_the_driver_hands_over_with_the_foot_on_the_brake():
    whole = WholeCar()
    whole.car.interface.controller.gear = Gear.DRIVE
    foot = DriverInputs(brake_pedal=0.20)
    for _ in range(10):
        status = whole.step(driver=foot)
    assert status.state is S.READY
    whole.step(command=OperatorCommand.ENGAGE, driver=foot)
    for _ in range(50):
        assert whole.step(1.0, driver=foot).state is S.ENGAGED
    assert whole.step(1.0, command=OperatorCommand.GO, driver=foot).reasons == ("go_too_early", "driver_on_brake")
    for _ in range(50):
        status = whole.step(1.0)
    assert status.reasons == ("waiting_for_go",)
    assert whole.car.truth().speed == 0.0
    whole.step(1.0, command=OperatorCommand.GO)
    for _ in range(100):
        whole.step(1.0)
    assert whole.car.truth().speed > 1.0


TAKING_OVER = {
    "brake": DriverInputs(brake_pedal=0.30),
    "throttle": DriverInputs(throttle_pedal=0.45),
    "wheel": DriverInputs(steering_torque=5.0),
}


@pytest.mark.thorough(witnesses=1)
@pytest.mark.parametrize("limb", TAKING_OVER)
@pytest.mark.parametrize("after", [0.0, 1.0])
def test_a_driver_who_takes_over_has_the_car_and_the_watchdog_keeps_still(limb, after):
    whole = WholeCar()
    whole.engage()
    for _ in range(200):
        whole.step(1.5)
    if after:
        whole.step(command=OperatorCommand.STOP)
        for _ in range(round(after / PERIOD)):
            whole.step()
    ticks, throttle = 0, []
    while (status := whole.step(1.5, driver=TAKING_OVER[limb])).state is not S.FAULT:
        ticks += 1
        throttle.append(status.throttle)
    assert ticks * PERIOD <= 0.15  # the kit takes 0.1 s to call it taking over
    assert limb == "wheel" or throttle[-1] == 0.0, "cut before that"
    assert "driver_override" in status.reasons
    for _ in range(100):
        counters = {codec.decode(frame).counter for frame in whole.frames[:3]}
        status = whole.step(1.5, driver=TAKING_OVER[limb] if limb == "brake" else HANDS_OFF)
        commands = [codec.decode(frame) for frame in whole.frames[:3]]
        assert not any(command.enable or command.clear for command in commands)
        assert {command.counter for command in commands} == {(counter + 1) % 256 for counter in counters}
        assert not whole.car.interface.controller.fault
    for _ in range(600):
        whole.step(driver=TAKING_OVER["brake"])
    assert whole.gateway.done


def test_in_shadow_all_is_worked_out_and_nothing_is_commanded():
    """The driver drives, shifts and brakes; the kit is never enabled, and nothing of it counts as taking over."""
    whole = WholeCar(gateway=Gateway(VEHICLE, calibration=PARAMETERS.calibration, shadow=True))
    for _ in range(10):
        status = whole.step()
    assert (status.state, status.reasons) == (S.READY, ("shadow",))
    status = whole.step(command=OperatorCommand.ENGAGE)
    assert (status.state, status.reasons) == (S.ENGAGED, ("shadow", "waiting_for_go"))
    status = whole.step(1.0, command=OperatorCommand.GO)
    whole.car.interface.controller.gear = Gear.DRIVE
    seen = []
    for tick in range(400):
        driver = (
            DriverInputs(throttle_pedal=0.35, steering_torque=4.0) if tick < 200 else DriverInputs(brake_pedal=0.24)
        )
        seen.append(whole.step(1.0 if tick < 200 else -2.0, 0.05, driver=driver))
        for command in map(codec.decode, whole.frames[:3]):
            assert (command.enable, command.clear) == (False, False)
        assert codec.decode(whole.frames[3]) == codec.GearCommand(Gear.NONE)
    assert {(status.state, status.reasons) for status in seen} == {(S.ENGAGED, ("shadow",))}
    assert max(status.throttle for status in seen) > 0.1
    assert max(status.brake_torque for status in seen) > 800.0
    assert seen[150].steering == pytest.approx(0.05)
    whole.step(command=OperatorCommand.STOP, driver=DriverInputs(brake_pedal=0.24))
    for _ in range(50):
        status = whole.step(driver=DriverInputs(brake_pedal=0.24))
    assert (status.state, status.reasons) == (S.STOPPED, ("stop_asked", "shadow"))
    whole.car.interface.controller.gear = Gear.PARK
    while not whole.gateway.done:
        whole.step()
    assert not whole.car.interface.controller.fault


TROUBLES = st.one_of(
    st.builds(lambda code: {"process_faults": (code,)}, st.sampled_from(["bus_down", "operator_gone", "what_is_this"])),
    st.builds(lambda code: {"faults": (code,)}, st.sampled_from(["pose_stale", "geofence_breach"])),
    st.builds(lambda command: {"command": command}, st.sampled_from(OperatorCommand)),
    st.builds(lambda fallback_path: {"fallback_path": fallback_path}, st.builds(
        FallbackPath, st.floats(-1.0, 5.0), st.lists(st.floats(-0.2, 0.2), max_size=66).map(tuple)
    )),
    st.builds(lambda limb: {"driver": limb}, st.sampled_from([
        *TAKING_OVER.values(), DriverInputs(brake_pedal=0.19), DriverInputs(throttle_pedal=0.2)
    ])),
    st.sampled_from([{"acceleration": None}, {"steering": math.nan}, {"speed": 30.0}, {"sequence": 0}]),
)  # fmt: skip
PHASES = st.lists(st.tuples(st.integers(1, 60), st.none() | TROUBLES), min_size=1, max_size=8)


@pytest.mark.thorough
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 250), PHASES)
def test_whatever_happens_the_kits_watchdog_has_nothing_to_do(driven, phases):
    """Engage, drive, then troubles for a while each, then nothing at all: at rest in the end, or the driver's."""
    whole, was, going, drivers = WholeCar(), S.DISARMED, False, False

    def tick(**arguments) -> None:
        nonlocal was, going, drivers
        truth = whole.car.truth()
        status = whole.step(**({"acceleration": 1.5} | arguments))
        brake, throttle, steering, gear = map(codec.decode, whole.frames)
        taken_over = any(module.override for module in whole.car.interface.controller.modules)
        if arguments.get("command") is OperatorCommand.GO and was is S.ENGAGED and "go_too_early" not in status.reasons:
            going = True
        going = going and status.state is S.ENGAGED
        assert throttle.value == 0.0 or going
        if was in COMMANDING and status.state not in COMMANDING:
            assert "driver_override" in status.reasons or (whole.car.interface.gear is Gear.PARK and truth.speed == 0.0)
        assert brake.enable == throttle.enable == steering.enable == (status.state in COMMANDING)
        assert gear.gear is Gear.NONE or abs(truth.speed) < 0.1
        assert not whole.car.interface.controller.fault or taken_over
        drivers = drivers or "driver_override" in status.reasons
        was = status.state

    for index in range(80 + driven):
        tick(command={10: OperatorCommand.ENGAGE, 60: OperatorCommand.GO}.get(index))
    for ticks, trouble in phases:
        for _ in range(ticks):
            tick(**(trouble or {}))
    for _ in range(600):
        if not whole.gateway.done:
            tick(acceleration=None)
    assert was not in COMMANDING
    assert drivers or (was in {S.DISARMED, S.READY} and whole.car.truth().speed == 0.0)
