"""What holds in every run of the gateway: whatever comes, repeatably, and with plain words for every reason."""

from __future__ import annotations

import ast
import inspect
import math
import pickle

from hypothesis import given, settings
from hypothesis import strategies as st

from tests.vehicle.car import CALIBRATION, FUSION, Rig
from vve_sumo.values import ArmingState, Frame, Setpoint
from vve_sumo.vehicle import (
    arming_machine,
    brake_monitor,
    engagement,
    gateway,
    monitor,
    motion_control,
    plausibility,
    report_consistency,
    reports,
    response,
    setpoint_validation,
)
from vve_sumo.vehicle.arming import COMMANDING, REASONS
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.gateway import Gateway

S = ArmingState
IGNORE_PLACES = {codec.BRAKE_COMMAND: 3, codec.THROTTLE_COMMAND: 3, codec.STEERING_COMMAND: 2}
ODD_SETPOINTS = st.builds(
    Setpoint,
    steering=st.floats(),
    acceleration=st.floats(),
    emergency=st.booleans(),
    sequence=st.integers(-1, 10_000),
    time=st.floats(0.0, 3.0) | st.just(math.nan),
    expires=st.floats(0.0, 3.0) | st.just(math.nan),
    speed=st.floats(),
    yaw_rate=st.floats(),
    grade=st.floats(),
    faults=st.sampled_from([(), (), ("pose_lost",)]),
)
ODD_FRAMES = st.builds(Frame, st.integers(0x060, 0x075), st.binary(max_size=8))


@settings(max_examples=60, deadline=None)
@given(
    st.booleans(),
    st.lists(
        st.tuples(
            st.none() | ODD_SETPOINTS | st.tuples(st.floats(-9, 3), st.floats(-1, 1), st.booleans()),
            st.lists(ODD_FRAMES, max_size=2),
            st.none() | st.sampled_from(OperatorCommand),
        ),
        min_size=1,
        max_size=60,
    ),
)
def test_whatever_comes_it_never_breaks_and_never_says_what_it_must_not(engaged, steps):
    rig, state, going = Rig(), S.DISARMED, engaged
    if engaged:
        rig.cruise(8.0)
        state = rig.step().state
    for odd, frames, command in steps:
        rig.tick += 1
        setpoint = rig.setpoint(odd[0], odd[1], emergency=odd[2]) if isinstance(odd, tuple) else odd
        status, out = rig.gateway.step(rig.now, setpoint, [*rig.car.reports(), *frames], command)
        rig.car.hear(out)
        rig.car.advance()
        for frame in out:
            if frame.id in IGNORE_PLACES:
                assert not frame.data[IGNORE_PLACES[frame.id]] & 4
        brake, throttle, steering, gear = (codec.decode(frame) for frame in out)
        assert brake.value == 0.0 or throttle.value == 0.0
        assert brake.enable == throttle.enable == steering.enable == (status.state in COMMANDING)
        assert brake.clear == gear.clear == (state is not S.ENGAGED and status.state is S.ENGAGED)
        going = status.state is S.ENGAGED and (
            going or (command is OperatorCommand.GO and "go_too_early" not in status.reasons)
        )
        assert going or throttle.value == 0.0
        assert not brake.clear or command is OperatorCommand.ENGAGE
        state = status.state
        assert all(map(math.isfinite, (status.steering, status.acceleration, status.brake_torque, status.throttle)))
        assert status.state is S.ENGAGED or throttle.value == 0.0
        assert abs(status.steering) <= FUSION.steering_limit + 1e-12


def test_the_same_inputs_give_the_same_bytes():
    def drive():
        rig = Rig()
        rig.cruise(6.0)
        rig.run(1.0, acceleration=-1.0, steering=0.2)
        return [rig.step(-2.0).brake_torque for _ in range(50)], rig.frames

    assert drive() == drive()


def test_it_can_be_sent_to_a_process_of_its_own():
    rig = Rig()
    rig.cruise(5.0)
    twin = pickle.loads(pickle.dumps(rig))
    assert (twin.step(-1.0, 0.1), twin.frames) == (rig.step(-1.0, 0.1), rig.frames)


#: Given by those who run the gateway.
OF_ITS_PROCESS = {"drive_gone", "external_brain", "operator_gone", "setpoint_corrupt", "stop_input"}


def test_every_reason_it_can_give_has_plain_words():
    """All string literals in the modules that give reasons and look like codes."""
    given_codes = set()
    for module in (
        gateway,
        arming_machine,
        monitor,
        motion_control,
        setpoint_validation,
        engagement,
        plausibility,
        reports,
        report_consistency,
        brake_monitor,
        response,
    ):
        for node in ast.walk(ast.parse(inspect.getsource(module))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and "_" in node.value:
                given_codes.add(node.value)
    given_codes -= set(OperatorCommand)
    codes = {code for code in given_codes if code.islower() and " " not in code and not code.startswith("_")}
    assert codes - set(REASONS) == {"pose_stale"}, "the trust gate's own word, which a setpoint brings"
    assert set(REASONS) - codes == {"engaging", "shifting", "shadow"} | OF_ITS_PROCESS


def test_its_defaults_are_the_fusions():
    assert Gateway(FUSION, CALIBRATION).step(0.0, None, []).status.state is S.DISARMED
