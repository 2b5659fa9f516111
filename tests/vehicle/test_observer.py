"""The observer beside an external controller: same drive, same faults, and not one frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.setpoints import setpoint
from tests.vehicle.car import CALIBRATION, FUSION, PERIOD, Car
from vve_sumo.values import ArmingState, Frame, GatewayStatus
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.dataspeed.interface import DataspeedDbw1
from vve_sumo.vehicle.interface import ActuationCommand, Gear
from vve_sumo.vehicle.observer import Observer

S, Act = ArmingState, OperatorCommand
#: what an external controller sends
COMMANDS = DataspeedDbw1().encode(ActuationCommand(300.0, 0.0, 0.1, 1.0, Gear.DRIVE, True, False))


@dataclass
class Watched:
    """An observer and a car whose speed the test says."""

    car: Car = field(default_factory=Car)
    observer: Observer = field(default_factory=lambda: Observer(FUSION, CALIBRATION, DataspeedDbw1()))
    tick: int = 0

    def step(
        self, command: OperatorCommand | None = None, process_faults: Sequence[str] = (), faults: tuple[str, ...] = ()
    ) -> GatewayStatus:
        """Let one period go by."""
        self.tick += 1
        now = self.tick * PERIOD
        car = self.car
        car.x += car.speed * PERIOD
        said = setpoint(
            0.0, 0.0, sequence=self.tick, time=now, expires=now + 0.1, speed=car.speed, yaw_rate=0.0, x=car.x, y=0.0,
            heading=0.0, faults=faults,
        )  # fmt: skip
        output = self.observer.step(now, said, [*COMMANDS, *car.reports()], command, process_faults)
        assert output.frames == ()
        return output.status

    def run(self, seconds: float) -> GatewayStatus:
        """Let time pass."""
        for _ in range(round(seconds / PERIOD)):
            status = self.step()
        return status

    def driving(self) -> Watched:
        """Begin a drive and be at speed."""
        assert self.run(0.5).state is S.READY
        assert self.step(Act.ENGAGE).reasons == ("external_brain", "waiting_for_go")
        assert self.step(Act.GO).reasons == ("external_brain",)
        self.car.gear, self.car.enabled = Gear.DRIVE, True
        while self.car.speed < 5.0:
            self.car.speed += 2.0 * PERIOD
            assert self.step().state is S.ENGAGED
        return self


@pytest.mark.parametrize(("command", "reason"), [(Act.STOP, "stop_asked"), (Act.STOP_BY_PAGE, "stop_asked_by_page")])
def test_a_drive_from_ready_to_its_end_with_the_car_in_drive_all_the_time(command, reason):
    """The brain's own command frames are no second writer's, and a car that stands in drive is enough for the end."""
    watched = Watched().driving()
    assert watched.step(command).state is S.STOPPING
    assert watched.run(1.0).state is S.STOPPING  # the brain takes its time
    assert not watched.observer.done
    watched.car.speed = 0.0
    assert watched.run(1.0).state is S.STOPPED
    status = watched.run(1.5)
    assert (status.state, watched.observer.done) == (S.READY, True)
    assert status.reasons[0] == reason


def test_an_operator_who_disarms_a_car_under_way_is_named_as_what_ended_the_drive():
    watched = Watched().driving()
    status = watched.step(Act.DISARM)
    assert (status.state, status.reasons) == (S.STOPPING, ("disarm_asked", "external_brain"))
    watched.car.speed = 0.0
    assert watched.run(2.5).reasons[0] == "disarm_asked"
    assert watched.step(Act.DISARM).reasons == ("external_brain",), "disarmed, it begins anew"


def test_every_fault_ends_the_drive_and_is_kept_as_its_reason():
    for process_faults, faults, reason in (
        (("bus_down",), (), "bus_down"),
        ((), ("geofence_breach",), "geofence_breach"),
        (("stop_input",), (), "stop_input"),
    ):
        watched = Watched().driving()
        assert watched.step(process_faults=process_faults, faults=faults).state is S.STOPPING
        assert reason in watched.run(0.2).reasons


def test_the_driver_takes_over_at_once():
    watched = Watched().driving()
    watched.car.override = True
    status = watched.step()
    assert (status.state, status.reasons[0]) == (S.FAULT, "driver_override")


def test_a_foot_on_the_brake_ends_a_drive_and_keeps_one_from_beginning():
    watched = Watched().driving()
    watched.car.driver_brake = True
    status = watched.step()
    assert (status.state, status.reasons[:1]) == (S.STOPPING, ("driver_on_brake",))
    watched.car.driver_brake, watched.car.speed = False, 0.0
    assert "driver_on_brake" in watched.run(1.0).reasons, "it says why to the end"

    held = Watched().driving()
    held.step(Act.END)
    held.car.speed = 0.0
    while held.run(0.02).state is not S.STOPPED:
        pass
    held.car.driver_brake = True
    assert "driver_on_brake" not in held.run(0.2).reasons, "who holds a car that has stopped did not stop it"

    waiting = Watched()
    waiting.run(0.5)
    waiting.step(Act.ENGAGE)
    waiting.car.driver_brake = True
    waiting.step()
    assert {"go_too_early", "driver_on_brake", "waiting_for_go"} <= set(waiting.step(Act.GO).reasons)
    waiting.car.driver_brake = False
    waiting.step()
    assert waiting.step(Act.GO).reasons == ("external_brain",)


def test_reports_that_stop_end_the_drive():
    watched = Watched().driving()
    watched.car.silent = set(range(0x60, 0x80))
    assert "wheel_speeds_stale" in watched.run(0.3).reasons
    assert watched.observer.monitor.last_dbw_report < watched.tick * PERIOD - 0.2


def test_nothing_is_asked_of_the_car():
    status = Watched().driving().run(0.1)
    assert (status.acceleration, status.brake_torque, status.throttle, status.limited) == (0.0, 0.0, 0.0, ())


ACTS = st.sampled_from([None, *OperatorCommand])
FRAMES = st.builds(Frame, st.integers(0x60, 0x7F), st.binary(max_size=8))


@settings(max_examples=60)
@given(st.lists(st.tuples(ACTS, st.lists(FRAMES, max_size=4), st.booleans()), max_size=30))
def test_whatever_comes_no_frame_goes_out(steps: list[tuple[OperatorCommand | None, list[Frame], bool]]) -> None:
    observer, car = Observer(FUSION, CALIBRATION, DataspeedDbw1()), Car()
    for number, (command, strange, whole) in enumerate(steps):
        now = number * PERIOD
        still = {"speed": 0.0, "yaw_rate": 0.0, "x": 0.0, "y": 0.0, "heading": 0.0}
        said = setpoint(0.0, 0.0, sequence=number, time=now, expires=now + 0.1, **still)
        output = observer.step(now, said if whole else None, [*car.reports(), *strange], command)
        assert output.frames == ()
