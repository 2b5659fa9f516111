"""The rows of the fault matrix that are the car's or the driver's, over every wire that a mapping makes.

Gateway and simulated car alone, without a street: a car that weaves, drives and brakes. Rows whose faults a wire cannot
tell are refused where a rig is read, and left out here.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests import vehicles
from tests.live.matrix import AT, MATRIX, Right, Row
from tests.setpoints import setpoint
from tests.vehicle.mapped.test_drives import WIRES
from tests.vehicle.whole_car import LOT, PERIOD
from vve_sumo.plant.fault_injected_car import FaultInjectedCar
from vve_sumo.plant.injectable import injectable_kinds
from vve_sumo.plant.injected_faults import InjectedFault
from vve_sumo.values import ArmingState, Frame
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.gateway import Gateway
from vve_sumo.vehicle.interface import InterfaceConfig, load

ROWS = [row for row in MATRIX if row.faults and not any(fault.kind.startswith("pose_") for fault in row.faults)]
#: wires that report nothing of the brake pedal's position: a false override is believed, and the car is the driver's
NOTHING_CONFIRMS = {"own car", "ULC"}
CASES = [(wire, row) for wire in WIRES for row in ROWS]


def faults_of(row: Row) -> list[InjectedFault]:
    return [
        InjectedFault(fault.kind, AT + fault.later, fault.duration, math.nan if fault.value is None else fault.value)
        for fault in row.faults
    ]


def drive(config: InterfaceConfig, row: Row) -> tuple[set[str], ArmingState, float, float]:
    """Return all reasons that the gateway gave, its state and the speed in the end, and the speed before the fault."""
    parameters = vehicles.parameters(noise=0.0, interface=config)
    seeds = np.random.SeedSequence
    car = FaultInjectedCar(parameters, (0.0, 0.0, 0.0), LOT, 1.447e9, seeds(1), faults_of(row), seeds(2))
    gateway = Gateway(parameters.vehicle, calibration=parameters.calibration, interface=load(config))
    heard: list[Frame] = []
    reasons: set[str] = set()
    state, engaged, went, fastest = ArmingState.DISARMED, False, math.inf, 0.0
    for tick in range(round(24.0 / PERIOD)):
        now, truth = tick * PERIOD, car.truth()
        since = now - went
        acceleration = 0.0 if since < 0.0 else 1.5 if since < 3.2 else 0.4 if since < 4.2 else -1.0
        wanted = setpoint(
            0.03 * math.sin(1.5 * max(since, 0.0)) if math.isfinite(went) else 0.0, acceleration,
            sequence=tick, time=now, expires=now + 0.1, x=truth.x, y=truth.y, heading=truth.heading,
            speed=truth.speed, yaw_rate=truth.yaw_rate,
        )  # fmt: skip
        command = None
        if not engaged and now > 0.3:
            command, engaged = OperatorCommand.ENGAGE, True
        elif math.isinf(went) and "waiting_for_go" in reasons:
            command, went = OperatorCommand.GO, now
        output = gateway.step(now, wanted, heard, command)
        state = output.status.state
        reasons.update(output.status.reasons)
        fastest = max(fastest, truth.speed)
        over = state is ArmingState.FAULT or (since > AT + 1.0 and truth.speed < 0.05)
        if since > AT + 3.0 and over:
            break
        heard = [frame for _time, frame in car.step((tick + 1) * PERIOD, output.frames).reports]
    return reasons, state, car.truth().speed, fastest


@pytest.mark.thorough(witnesses=2)
@pytest.mark.parametrize(("wire", "row"), CASES, ids=[f"{wire}, {row.name}" for wire, row in CASES])
def test_the_car_is_stopped_or_its_drivers_for_the_reason_that_the_row_says(wire, row):
    if not all(fault.kind in injectable_kinds(WIRES[wire]) for fault in row.faults):
        pytest.skip("this wire cannot tell the fault: refused where a rig is read")
    reasons, state, speed, fastest = drive(WIRES[wire], row)
    assert fastest > 3.0, "it was under way"
    codes = {*row.reasons, *row.first}
    if row.name == "override_false" and wire in NOTHING_CONFIRMS:
        codes |= {"driver_override"}
    assert not reasons.isdisjoint(codes), sorted(reasons)
    if row.right is Right.DRIVER:
        assert state is ArmingState.FAULT
    else:
        assert speed == pytest.approx(0.0, abs=0.05) or state is ArmingState.FAULT
