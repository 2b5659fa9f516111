"""The real gateway, explored: from every state that is found, whatever can happen, until nothing new is found.

The car here is no car: its reports are made up, every combination of them, so that nothing physical stands in the way
of a state. Time goes in steps of a tenth of a second; a state is what the gateway can do next, not its counters.
"""

from __future__ import annotations

import io
import itertools
import pickle
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import pytest

from tests.exhaustive import with_slow
from tests.setpoints import setpoint as complete
from tests.vehicle.car import CALIBRATION, FUSION
from vve_sumo.values import ArmingState, Frame
from vve_sumo.vehicle.arming import COMMANDING
from vve_sumo.vehicle.arming_machine import OperatorCommand
from vve_sumo.vehicle.calibration import Calibration
from vve_sumo.vehicle.dataspeed import codec
from vve_sumo.vehicle.dataspeed.messages import BrakeReportKind
from vve_sumo.vehicle.gateway import Gateway, GatewayOutput
from vve_sumo.vehicle.interface import Gear, InterfaceFacts
from vve_sumo.vehicle.limits import Limits

#: a fixture that takes long: `./check test` leaves its tests out
THOROUGH_FIXTURE = "reached"

S = ArmingState
PERIOD = 0.1
LONG = 46  # steps: longer than anything that the gateway waits for


class World(NamedTuple):
    """What the gateway receives during a step."""

    enabled: bool = True  #: the kit says so
    gear: Gear = Gear.DRIVE
    speed: float = 0.0
    driver: str = ""  #: the pedal that the driver touches
    override: bool = False
    said: str = "good"  #: the setpoint: good, none, or one with a fault
    found: tuple[str, ...] = ()


#: Everything that shall bring an engaged car to rest.
FAULTS = [
    World(said="fault"),
    World(said="none"),
    World(found=("bus_down",)),
    World(found=("unheard_of",)),
    World(enabled=False),
    World(gear=Gear.NEUTRAL),
]
EVERY_WORLD = [
    World(*choice)
    for choice in itertools.product(
        (False, True), (Gear.PARK, Gear.DRIVE, Gear.NEUTRAL), (0.0, 5.0), ("", "brake", "throttle"), (False, True),
        ("good", "none", "fault"),
    )
]  # fmt: skip
#: those that lead to every state; the others add ways between states
FEW_WORLDS = [
    world
    for world in EVERY_WORLD
    if world.gear is not Gear.NEUTRAL and world.driver != "throttle" and world.said != "none"
]


@cache
def reports(world: World) -> tuple[Frame, ...]:
    wheel, on = world.speed / FUSION.wheel_radius, world.enabled
    said = [
        codec.BrakeReport(
            BrakeReportKind.PEDAL,
            0.15,
            0.15,
            0.15,
            on,
            override=world.override,
            driver=world.driver == "brake",
        ),
        codec.ThrottleReport(0.15, 0.15, 0.15, on, driver=world.driver == "throttle"),
        codec.SteeringReport(0.0, 0.0, world.speed, 0.0, on),
        codec.GearReport(world.gear),
        codec.WheelSpeeds(wheel, wheel, wheel, wheel),
        codec.YawRate(0.0, 0.0),
    ]
    return tuple(map(codec.encode, said))


#: Constants, which all copies of a gateway share.
CONSTANTS: dict[int, object] = {}


class Pickler(pickle.Pickler):
    def persistent_id(self, one: object) -> int | None:
        if not isinstance(one, (Calibration, InterfaceFacts, Limits)):
            return None
        CONSTANTS[id(one)] = one
        return id(one)


class Unpickler(pickle.Unpickler):
    def persistent_load(self, pid: int) -> object:
        return CONSTANTS[pid]


class Explored:
    """A gateway and its clock; a copy of it costs little."""

    def __init__(self, gateway: Gateway, tick: int = 0, x: float = 0.0) -> None:
        self.gateway, self.tick, self.x = gateway, tick, x
        self._pickled = io.BytesIO()

    def copy(self) -> Explored:
        if not self._pickled.tell():
            Pickler(self._pickled).dump(self.gateway)
        return Explored(Unpickler(io.BytesIO(self._pickled.getbuffer())).load(), self.tick, self.x)

    def step(self, world: World, command: OperatorCommand | None = None) -> GatewayOutput:
        self.tick += 1
        now = self.tick * PERIOD
        self.x += world.speed * PERIOD
        setpoint = None
        if world.said != "none":
            faults = ("pose_lost",) if world.said == "fault" else ()
            setpoint = complete(
                0.0, 1.0, sequence=self.tick, time=now, expires=now + 0.5 * PERIOD, speed=world.speed, yaw_rate=0.0,
                x=self.x, y=0.0, heading=0.0, faults=faults,
            )  # fmt: skip
        return self.gateway.step(now, setpoint, reports(world), command, world.found)

    @property
    def state(self) -> ArmingState:
        return self.gateway._arming.state

    @property
    def going(self) -> bool:
        return self.gateway._arming.going

    @property
    def key(self) -> tuple[object, ...]:
        """What decides what can happen next."""
        gateway, handover, arming = self.gateway, self.gateway._engagement, self.gateway._arming
        in_command = self.state in COMMANDING
        return (
            self.state,
            in_command and (handover.enabled, handover.in_drive, arming.going, bool(arming._old_overrides)),
            gateway.monitor.standstill.certain,
            gateway.monitor.standstill.at_rest,
            gateway.done,
        )


def watched(before: Explored, world: World, command: OperatorCommand | None) -> None:
    """One step, and all that must hold of any step whatever."""
    was, going = before.state, before.going
    status, frames = before.step(world, command)
    brake, throttle, steering, gear = map(codec.decode, frames)
    state = status.state
    assert brake.enable == throttle.enable == steering.enable == (state in COMMANDING)
    if state is S.ENGAGED and was is not S.ENGAGED:
        assert command is OperatorCommand.ENGAGE
        assert was in (S.DISARMED, S.READY)
        assert (world.said, world.found, world.speed, world.driver) in (
            ("good", (), 0.0, ""), ("good", (), 0.0, "brake")
        )  # fmt: skip
        assert not before.going
    if was is S.ENGAGED and before.going and not going:
        assert command is OperatorCommand.GO
        assert (world.enabled, world.gear, world.driver) == (True, Gear.DRIVE, "")
    if throttle.value > 0.0:
        assert state is S.ENGAGED
        assert before.going
        assert not world.driver
    if was is S.ENGAGED and going and world.driver:
        assert state in (S.STOPPING, S.STOPPED, S.FAULT), "a foot ends the drive"
    if state is S.ENGAGED:
        assert not world.found
        assert world.said != "fault"
    if was in COMMANDING:
        let_go = {S.FAULT} if world.override and world.driver else set()
        if was is S.STOPPED and world.gear is Gear.PARK and not world.speed:
            let_go.add(S.DISARMED)
        assert state in {S.STOPPING, S.STOPPED} | let_go | ({S.ENGAGED} if was is S.ENGAGED else set())
    if state in COMMANDING and not before.going:
        assert brake.value > 0.0 or status.acceleration < 0.0 or world.speed > 0.0
    assert gear.gear is Gear.NONE or world.speed == 0.0
    assert gear.gear is not Gear.PARK or state is S.STOPPED
    assert gear.gear is not Gear.DRIVE or state is S.ENGAGED


def successors(place: Explored, worlds: list[World]) -> Iterator[Explored]:
    """Where one gateway can get: by every command in each of the worlds, and by each that goes on for long."""
    alike = {OperatorCommand.STOP_BY_PAGE, OperatorCommand.END} if worlds is FEW_WORLDS else set()
    for world in worlds:
        for command in (None, *(command for command in OperatorCommand if command not in alike)):
            after = place.copy()
            watched(after, world, command)
            yield after
        # An override that goes on leads to no state of its own: it is left to the run with every world.
        if not (world.driver or (worlds is FEW_WORLDS and world.override)):
            after = place.copy()
            for _ in range(LONG):
                watched(after, world, None)
            yield after


class Reached(NamedTuple):
    """The worlds that a gateway went through, and every state that it came to, each with a gateway in it."""

    worlds: list[World]
    states: dict[tuple[object, ...], Explored]


@pytest.fixture(scope="module", params=with_slow([FEW_WORLDS, EVERY_WORLD], lambda worlds: worlds is FEW_WORLDS))
def reached(request) -> Reached:
    first = Explored(Gateway(FUSION, CALIBRATION, period=PERIOD))
    first.step(World(enabled=False, gear=Gear.PARK))
    found, frontier = {first.key: first}, [first]
    while frontier:
        for after in successors(frontier.pop(), request.param):
            if after.key not in found:
                found[after.key] = after
                frontier.append(after)
    return Reached(request.param, found)


@pytest.mark.thorough
def test_every_state_and_every_stage_of_the_handover_is_reached(reached):
    assert {key[0] for key in reached.states} == set(S)
    stages = {key[1][:3] for key in reached.states if key[0] is S.ENGAGED}
    assert stages == {(False, False, False), (True, False, False), (True, True, False), (True, True, True)}
    assert len(reached.states) > 20


@pytest.mark.thorough
@pytest.mark.parametrize("fault", FAULTS)
def test_from_every_state_every_fault_leads_to_rest(reached, fault):
    for place in reached.states.values():
        after = place.copy()
        commanded = after.state in COMMANDING
        for _ in range(LONG):
            if commanded:
                watched(after, fault, None)
            else:
                after.step(fault)
        assert after.state in ({S.STOPPED} if commanded else {S.DISARMED, S.READY, S.FAULT})
        if commanded:
            for _ in range(LONG):
                watched(after, fault._replace(gear=Gear.PARK), None)
            assert after.state in {S.DISARMED, S.READY}
            assert after.gateway.done


def test_from_every_state_the_driver_gets_the_car(reached):
    for place in reached.states.values():
        after = place.copy()
        commanded = after.state in COMMANDING
        # An override from before the act counts only once it has been seen to be gone.
        after.step(World())
        after.step(World(override=True, driver="brake"))
        if commanded and after.state is not S.DISARMED:
            assert after.state is S.FAULT


def test_from_every_state_an_override_that_nothing_confirms_leads_to_rest(reached):
    for place in reached.states.values():
        after = place.copy()
        commanded = after.state in COMMANDING
        after.step(World())
        for _ in range(LONG):
            after.step(World(override=True))
        if commanded:
            assert after.state is S.STOPPED


@pytest.mark.thorough
def test_no_run_without_the_act_of_engaging_ever_engages(reached):
    """All that is reached from where nothing is commanded, leaving that act out, commands nothing."""
    idle = [place for key, place in reached.states.items() if key[0] not in COMMANDING]
    seen = {place.key for place in idle}
    while idle:
        place = idle.pop()
        for world in reached.worlds:
            for command in (None, OperatorCommand.GO, OperatorCommand.STOP, OperatorCommand.DISARM):
                after = place.copy()
                after.step(world, command)
                assert after.state not in COMMANDING
                if after.key not in seen:
                    seen.add(after.key)
                    idle.append(after)
